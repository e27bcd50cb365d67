"""The command ``detail``: curves for every frame, taken up again, and refusals."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from yarnscale.cell import PeriodicCell
from yarnscale.cli.detail import curve_set
from yarnscale.detail.fluctuations import FluctuationTable, fluctuation
from yarnscale.detail.yarns import YarnDetail
from yarnscale.drawing import library
from yarnscale.files.animation import read_animation
from yarnscale.files.cloth_frames import FrameFolder
from yarnscale.files.patterns import write_pattern
from yarnscale.homogenize.plan import StrainGrid, scattered_axes
from yarnscale.homogenize.sample import create_store
from yarnscale.homogenize.store import SampleStore
from yarnscale.homogenize.worker import CODE_OF, solve
from yarnscale.shell.mesh import rectangle
from yarnscale.shell.state import ClothState
from yarnscale.yarn.material import PRESETS

RECORD = dict.fromkeys(("energy_density", "iterations", "seconds", "residual", "min_distance_over_diameter"), 0.0) | {
    "stress": np.zeros(6),
    "status": CODE_OF["converged"],
}
"""What a store holds of a state beside the place of its yarns."""
MESH = rectangle(0.04, 0.03, 0.008)


@pytest.fixture(scope="module")
def inputs(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """A pattern file, and samples of it at two stretches."""
    folder = tmp_path_factory.mktemp("inputs")
    cell = PeriodicCell(library.build("plain"), PRESETS["hylc2020-stockinette"])
    write_pattern(cell.pattern, folder / "plain.json")
    store = create_store(folder / "samples", cell, StrainGrid(s_x=(0.0, 0.1)).axes, scattered=False)
    for number, state in enumerate(store.states):
        store.write(number, solve(cell, state, None)[0])
    return folder / "plain.json", folder / "samples"


def simulated(folder: Path, count: int = 3) -> Path:
    """A run of a sheet that is stretched and lifted."""
    frames = FrameFolder(folder / "frames", MESH)
    for number in range(count):
        positions = np.column_stack(
            [MESH.material * [1 + 0.05 * number, 1.0], np.full(MESH.vertex_count, 0.1 * number)]
        )
        frames.write(number, ClothState(positions, np.zeros_like(positions), 0.1 * number))
    return folder


def test_every_frame_gets_yarns_that_go_with_the_cloth(
    run: Callable, inputs: tuple[Path, Path], tmp_path: Path
) -> None:
    folder = simulated(tmp_path)
    outcome = run("detail", folder, "--pattern", inputs[0], "--samples", inputs[1], "--json")
    assert outcome.status == 0
    summary = json.loads(outcome.out)
    animation = read_animation(folder)
    assert len(animation) == 3 and animation.yarns is not None
    assert summary["material"] == "hylc2020-stockinette" and summary["material_from"] == "of the samples"
    assert summary["frames_written"] == 3 and summary["yarn_vertices"] == animation.yarns.point_count
    for number, moment in enumerate(animation):
        assert moment.yarns is not None
        assert moment.yarns[:, 2].mean() == pytest.approx(0.1 * number, abs=1e-4)
        assert np.ptp(moment.yarns[:, 0]) == pytest.approx(0.04 * (1 + 0.05 * number), rel=0.05)


def test_resume_writes_what_is_missing_or_old_only(run: Callable, inputs: tuple[Path, Path], tmp_path: Path) -> None:
    folder = simulated(tmp_path)
    call = ("detail", folder, "--pattern", inputs[0], "--samples", inputs[1], "--json")
    run(*call)
    written = {path.name: path.read_bytes() for path in (folder / "yarns").glob("frame_*.npz")}
    (folder / "yarns" / "frame_0001.npz").unlink()
    again = json.loads(run(*call, "--resume").out)
    assert again["frames_written"] == 1
    assert {p.name: p.read_bytes() for p in (folder / "yarns").glob("frame_*.npz")} == written
    assert json.loads(run(*call, "--resume").out)["frames_written"] == 0


def test_other_patterns_and_folders_are_refused(
    refused: Callable[..., str], inputs: tuple[Path, Path], tmp_path: Path
) -> None:
    folder = simulated(tmp_path, 1)
    other = refused("detail", folder, "--pattern", "twill-2x2", "--samples", inputs[1])
    assert "is not the one behind" in other
    assert "folder does not exist" in refused("detail", tmp_path / "none", "--pattern", inputs[0])
    assert "no sample store" in refused("detail", folder, "--pattern", inputs[0], "--samples", tmp_path / "no")


def test_resume_refuses_frames_made_from_other_samples(
    run: Callable, refused: Callable[..., str], inputs: tuple[Path, Path], tmp_path: Path
) -> None:
    folder = simulated(tmp_path, 1)
    run("detail", folder, "--pattern", inputs[0], "--samples", inputs[1])
    cell = PeriodicCell(library.build("plain"), PRESETS["hylc2020-stockinette"])
    other = create_store(tmp_path / "other", cell, StrainGrid().axes, scattered=False)
    other.write(0, solve(cell, other.states[0], None)[0])
    said = refused("detail", folder, "--pattern", inputs[0], "--samples", other.path, "--resume")
    assert "frames of other yarns" in said


def test_samples_beside_the_pattern_are_used_without_a_solve(
    run: Callable, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What 'homogenize' leaves: scattered states; û is linear in them here, and the yarns follow it exactly."""
    pattern = library.build("plain")
    cell, count = PeriodicCell(pattern, PRESETS["wool"]), len(pattern.edges)
    write_pattern(pattern, tmp_path / "pattern.json", yarns=PRESETS["wool"])
    rng = np.random.default_rng(3)
    slope = rng.normal(size=(count, 3, 5)) * pattern.radius * [1, 1, 1, pattern.radius, pattern.radius]
    for name, states in (("samples", 30), ("unseen", 6)):
        strains = rng.uniform(-0.1, 0.3, (states, 5)) * [1, 1, 1, 300, 300]
        strains[np.arange(states), 3 + np.arange(states) % 2] = 0.0
        store = create_store(tmp_path / name, cell, scattered_axes(strains), scattered=True)
        for number, strain in enumerate(strains):
            store.write(number, RECORD | {"fluctuation": slope @ strain, "twist": np.zeros(count)})
    folder = simulated(tmp_path / "run")
    monkeypatch.setattr("yarnscale.cli.detail.run_sample", None)  # no solve may be asked for
    out = run("detail", folder, "--pattern", tmp_path / "pattern.json", "--frames", "1:2", "--json")
    summary = json.loads(out.out)
    assert (summary["material"], summary["frames_written"]) == ("wool", 2)
    assert max(summary["error_in_radii"]) < 1e-6
    table = FluctuationTable.from_store(SampleStore(tmp_path / "samples"), pattern)
    inside, found = np.array([0.05, 0.1, 0.2, 0.0, 0.0]), np.empty((count, 3))
    for vertex, moved in enumerate(found):
        fluctuation(table.values, table.axes, inside, vertex, moved)
    np.testing.assert_allclose(found, slope @ inside, atol=1e-5 * pattern.radius)
    assert sorted(path.name for path in (folder / "yarns").glob("frame_*")) == [
        "frame_0001.npz", "frame_0002.npz",
    ]  # fmt: skip


def test_thick_and_thin_yarns_keep_their_size_and_colour() -> None:
    """Warp of one kind, weft of another that is half as thick."""
    plain = library.build("plain")
    warp = np.array([plain.edges[chain, 3].sum() != 0 for chain in plain.yarns])
    pattern = replace(plain, yarn_material=(~warp).astype(int), yarn_radius=plain.radius * np.where(warp, 1.0, 0.5))
    zero = np.zeros(1)
    table = FluctuationTable(pattern, (zero, zero, zero, zero, zero), np.zeros((1, 1, 1, 3, len(pattern.edges), 3)))
    curves = curve_set(YarnDetail.of(table, MESH))
    assert set(curves.yarn.tolist()) == {0, 1}
    for kind, radius, yarn in zip(curves.yarn, curves.radii[curves.offsets[:-1]], range(len(curves)), strict=True):
        own = slice(curves.offsets[yarn], curves.offsets[yarn + 1])
        assert radius == pattern.radius * (0.5 if kind else 1.0) and (curves.radii[own] == radius).all()
