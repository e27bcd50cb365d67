"""The first job as a whole, small: samples, material, pictures and page; killed halfway, resumed, without OpenGL."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from yarnscale.cli import main
from yarnscale.errors import InputError
from yarnscale.files.cloth_frames import FrameFolder
from yarnscale.files.material_json import read_material
from yarnscale.files.visited import visited_strains
from yarnscale.homogenize.compact_fit import CompactOptions
from yarnscale.homogenize.executors import kept_workers
from yarnscale.homogenize.homogenize import errors_at, fit, fit_published
from yarnscale.homogenize.states import FabricStates
from yarnscale.homogenize.store import SampleStore
from yarnscale.shell.mesh import rectangle
from yarnscale.shell.state import ClothState

COMMAND = ["homogenize", "plain", "--solves", "60", "--workers", "2"]
RANGE = ["--form", "hylc2020", "--stretch", "-0.05,0.2", "--shear", "0.15", "--curvature", "0.03"]


@pytest.fixture(scope="module", autouse=True)
def small_fit() -> Iterator[None]:
    """Fits of few numbers and steps."""
    few = partial(CompactOptions, steps=6, springs=16, rounds=10, iterations=40, starts=1)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("yarnscale.homogenize.compact_fit.CompactOptions", few)
        yield


@pytest.fixture(scope="module", autouse=True)
def processes_kept() -> Iterator[None]:
    """The same two processes for all runs."""
    with kept_workers():
        yield


@pytest.fixture(scope="module")
def outcome(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, int]:
    """Folder and exit status of a small run, in which drawing failed at first."""
    folder = tmp_path_factory.mktemp("homogenized") / "out"
    patch = pytest.MonkeyPatch()

    def unavailable(*arguments: object) -> None:
        raise InputError("cannot draw pictures")

    patch.setattr("yarnscale.cli.materials.draw_material", unavailable)
    command = [*COMMAND, "--out", str(folder), "--limit", "5"]
    assert main(command) == 2
    assert SampleStore(folder / "samples").status().any()
    patch.undo()
    return folder, main([*command, "--resume"])


@pytest.mark.slow
def test_the_folder_is_complete(outcome: tuple[Path, int]) -> None:
    folder, status = outcome
    assert status == 0
    found = {path.name for path in folder.iterdir()}
    assert {"samples", "unseen", "material.json", "pattern.json", "pictures", "index.html"} <= found
    assert {"cell.png", "tension.png", "bending.png", "stress.png", "errors.png"} == {
        path.name for path in (folder / "pictures").iterdir()
    }
    assert (folder / "material.json").stat().st_size < 100_000


@pytest.mark.slow
def test_the_page_stands_alone(outcome: tuple[Path, int]) -> None:
    page = (outcome[0] / "index.html").read_text()
    assert re.findall(r"(?:src|href)\s*=\s*[\"']?(?:https?:)?//", page) == []
    assert "http://" not in page.replace("http://www.w3.org", "") and "https://" not in page
    assert "<img" in page
    assert page.count('data-pane="pane-') == 1 and '<div class="stage">\n<img' in page and len(page) < 10_000_000


@pytest.mark.slow
def test_the_material_reads_and_fits_again_alike(outcome: tuple[Path, int]) -> None:
    folder, _ = outcome
    store = SampleStore(folder / "samples")
    material, again = read_material(folder / "material.json"), fit(store)
    states = FabricStates.of(store)
    np.testing.assert_allclose(
        again.energy_density(states.strains), material.energy_density(states.strains), rtol=1e-6, atol=1e-9
    )
    assert errors_at(material, states).median < 0.3
    content = json.loads((folder / "material.json").read_text())
    assert content["provenance"]["pattern"] == "plain"


@pytest.mark.slow
def test_states_that_a_cloth_visited_are_added(outcome: tuple[Path, int], tmp_path: Path) -> None:
    mesh = rectangle(0.1, 0.05, 0.01)
    flat = ClothState.flat(mesh)
    pulled = flat.positions @ np.array([[1.2, 0.3, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    FrameFolder(tmp_path / "run" / "frames", mesh).write(0, ClothState(pulled, 0.0 * pulled))
    command = [*COMMAND, "--out", str(outcome[0]), "--limit", "5", "--visited", str(tmp_path / "run")]
    assert main(command) == 2
    assert main([*command, "--resume"]) == 0
    states = FabricStates.of(SampleStore(outcome[0] / "samples"))
    visited = visited_strains(tmp_path / "run")[0]
    assert states.strains[states.kinds == "visited"][-1] == pytest.approx(visited, abs=1e-6)


@pytest.mark.slow
def test_the_published_form_is_hylc_json(outcome: tuple[Path, int], tmp_path: Path) -> None:
    folder = tmp_path / "out"
    command = [*COMMAND, *RANGE, "--out", str(folder), "--one-dimensional"]
    assert main(command) in (0, 1)
    material = read_material(folder / "material.json")
    assert not material.planes
    with pytest.raises(InputError, match="store of strains"):
        fit_published(SampleStore(outcome[0] / "samples"))


def test_options_of_the_other_form_are_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for more, message in (
        (["--stretch", "-0.1,0.2"], "--stretch; expected --form hylc2020 with it"),
        (["--one-dimensional"], "--one-dimensional; expected --form hylc2020 with it"),
        ([*RANGE, "--limit", "3"], "--limit; expected --form compact with it"),
        (["--visited", "run"], "--visited; expected --resume with it"),
    ):
        assert main([*COMMAND, *more, "--out", str(tmp_path / "out")]) == 2
        assert message in capsys.readouterr().err
