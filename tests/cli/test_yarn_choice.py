"""Which yarn commands take: what comes with a pattern or a run, never what a name suggests."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from yarnscale.cell import PeriodicCell
from yarnscale.cli.cloth import MATERIAL
from yarnscale.cli.yarn_choice import YarnChoice, same_yarns, yarn_for
from yarnscale.drawing import library
from yarnscale.errors import InputError
from yarnscale.files.cloth_frames import FrameFolder
from yarnscale.files.material_json import write_material
from yarnscale.files.material_toml import write_yarn_material as write_yarn
from yarnscale.files.patterns import read_pattern, read_yarns, write_pattern
from yarnscale.homogenize.plan import StrainGrid
from yarnscale.homogenize.sample import create_store, provenance
from yarnscale.homogenize.store import SampleStore
from yarnscale.homogenize.worker import CODE_OF
from yarnscale.shell.materials.orthotropic import OrthotropicMaterial
from yarnscale.shell.mesh import rectangle
from yarnscale.shell.state import ClothState
from yarnscale.yarn.material import PRESETS

KNIT, WEAVE = "kind = knit\nrows:\nkp\npk\n", "kind = weave\nrows:\nx.\n.x\n"
WOOL = PRESETS["wool"]
FLAT = ("--strain", "0,0,0,0,0")


@pytest.fixture(scope="module")
def fabric(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A weave in a file that says that it is of wool; its name is that of a knit."""
    path = tmp_path_factory.mktemp("fabric") / "garter.json"
    write_pattern(replace(library.build("plain"), name="stockinette"), path, yarns=WOOL)
    return path


@pytest.mark.parametrize("name", ["basket", "satin", "stockinette", "plain", "rib"])
def test_names_decide_nothing(tmp_path: Path, name: str) -> None:
    for text, preset in ((KNIT, "hylc2020-stockinette"), (WEAVE, "hylc2020-basket")):
        for source in (tmp_path / f"{name}.chart", tmp_path / f"{name}.json", tmp_path / f"{name}.pyp"):
            if source.suffix == ".chart":
                source.write_text(text)
            else:
                write_pattern(read_pattern(tmp_path / f"{name}.chart"), source)
            yarn = yarn_for(source, read_pattern(source), None)
            assert (yarn.materials, yarn.is_default) == (PRESETS[preset], True)


@pytest.mark.parametrize("name", library.names())
def test_built_in_patterns_have_a_yarn_that_suits_them(name: str) -> None:
    pattern = library.build(name)
    assert pattern.woven == (library.structure(name).draft is not None)
    assert yarn_for(name, pattern, None).materials == PRESETS[library.structure(name).material]


def test_the_yarn_of_a_file_is_used_by_every_command(
    run: Callable, fabric: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    grid = tmp_path / "grid.toml"
    grid.write_text("s_x = [0.0]\n")
    commands = {
        "relax": ("relax", fabric, *FLAT, "--json"),
        "study": ("study", fabric, *FLAT, "--sizes", "1x1", "--starts", 1, "--json"),
        "sample": ("sample", fabric, "--grid", grid, "--out", tmp_path / "store", "--workers", 1, "--json"),
    }
    for name, command in commands.items():
        outcome = run(*command)
        assert json.loads(outcome.out)["material"] == "wool", name
        assert "wool (of the file)" in outcome.err
    material = SampleStore(tmp_path / "store").attributes["provenance"]["material"]
    assert material["young_modulus"] == WOOL.young_modulus
    counted = run("fabric", fabric, "--rows", 3, "--columns", 3, "--method", "direct", "--count")
    assert "wool (of the file)" in counted.err
    sampled, out = [], tmp_path / "out"

    def sample_nothing(cell: PeriodicCell, *_: object, **__: object) -> tuple[SimpleNamespace, None]:
        sampled.append(cell)
        summary = SimpleNamespace(states=1, converged=1, pending=0, ended=0, seconds=0.1)
        errors = SimpleNamespace(states=1, median=0.01, high=0.1)
        material = SimpleNamespace(density=0.1, remembers=False)
        return SimpleNamespace(summary=summary, errors=errors, material=material), None

    monkeypatch.setattr("yarnscale.cli.materials.homogenize_into", sample_nothing)
    done = run("homogenize", fabric, "--out", out)
    assert done.status == 0 and "wool (of the file)" in done.err and sampled[0].material == WOOL
    assert read_yarns(out / "pattern.json") == WOOL
    assert read_pattern(out / "pattern.json").content_hash() == read_pattern(fabric).content_hash()


def test_another_yarn_is_taken_with_a_notice(run: Callable, fabric: Path, tmp_path: Path) -> None:
    outcome = run("relax", fabric, *FLAT, "--material", "cotton", "--json")
    assert json.loads(outcome.out)["material"] == "cotton"
    assert "cotton (--material), instead of wool that came with it" in outcome.err
    write_yarn(replace(WOOL, name="mine"), tmp_path / "mine.toml")
    assert "instead" not in run("relax", fabric, *FLAT, "--material", tmp_path / "mine.toml").err


def test_pattern_writes_the_yarn_that_it_used(run: Callable, tmp_path: Path) -> None:
    assert run("pattern", "plain", "--material", "wool", "--out", tmp_path / "p.json").status == 0
    assert read_yarns(tmp_path / "p.json") == WOOL
    said = run("pattern", "plain", "--as-drawn", "--out", tmp_path / "p.pyp").err
    assert "hylc2020-basket" in said and ".pyp files hold no yarn material" in said
    assert read_yarns(tmp_path / "p.pyp") is None


def _run(folder: Path, cell: PeriodicCell) -> Path:
    """Frames of a cloth of a cell."""
    mesh = rectangle(0.03, 0.03, 0.01)
    flat = np.column_stack([mesh.material, np.zeros(mesh.vertex_count)])
    FrameFolder(folder / "frames", mesh).write(0, ClothState(flat, np.zeros_like(flat), 0.0))
    shell = OrthotropicMaterial(10.0, 1.0, 10.0, 2.0)
    write_material(folder / MATERIAL, replace(shell, provenance=provenance(cell)))
    return folder


def _store(path: Path, cell: PeriodicCell) -> Path:
    """One state, as drawn; what yarns of it look like is not the question here."""
    store, count = create_store(path, cell, StrainGrid().axes, scattered=False), len(cell.pattern.edges)
    names = ("energy_density", "iterations", "seconds", "residual", "min_distance_over_diameter")
    arrays = {"stress": np.zeros(6), "fluctuation": np.zeros((count, 3)), "twist": np.zeros(count)}
    store.write(0, dict.fromkeys(names, 0.0) | arrays | {"status": CODE_OF["converged"]})
    return path


def test_a_run_knows_its_pattern_and_yarn(
    run: Callable, refused: Callable[..., str], fabric: Path, tmp_path: Path
) -> None:
    pattern = read_pattern(fabric)
    cell = PeriodicCell(pattern, PRESETS["cotton"])
    folder = _run(tmp_path / "run", cell)
    other = refused("detail", folder, "--pattern", "twill-2x2", "--samples", tmp_path)
    assert "is not the one behind" in other and "pattern.json" in other
    own, wool = _store(tmp_path / "own", cell), _store(tmp_path / "wool", PeriodicCell(pattern, WOOL))
    said = refused("detail", folder, "--pattern", fabric, "--samples", wool)
    assert "expected cotton (of the run)" in said and "found wool" in said
    for place in (folder, folder / "frames"):
        outcome = run("detail", place, "--pattern", fabric, "--samples", own, "--json", "--overwrite")
        assert outcome.status == 0
        assert json.loads(outcome.out)["material"] == "cotton"
    taken = run("detail", folder, "--pattern", fabric, "--samples", wool, "--material", "wool", "--overwrite")
    assert taken.status == 0 and "wool (--material), instead of cotton that came with it" in taken.err


def test_equal_yarns_may_have_other_names() -> None:
    assert same_yarns(WOOL, (replace(WOOL, name="mine"),))
    assert not same_yarns(WOOL, replace(WOOL, density=1.0))
    # Samples of a yarn with friction are those of the yarn without.
    assert same_yarns(WOOL, replace(WOOL, contact=replace(WOOL.contact, friction=0.2)))
    assert not same_yarns(WOOL, (WOOL, WOOL))


def test_yarns_of_different_friction_stand_in_one_fabric_but_have_none_in_common() -> None:
    rubbing = replace(WOOL, contact=replace(WOOL.contact, friction=0.2))
    assert YarnChoice("plain", rubbing, "").friction == YarnChoice("plain", (rubbing, rubbing), "").friction == 0.2
    mixed = YarnChoice("plain", (rubbing, WOOL), "")
    assert mixed.rubs and not YarnChoice("plain", WOOL, "").rubs
    with pytest.raises(InputError, match="--friction, one for all"):
        _ = mixed.friction
