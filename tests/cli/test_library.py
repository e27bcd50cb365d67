"""The material library: what the package has is whole, is taken by name, and is made by a command."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from yarnscale.cli import library as command
from yarnscale.cli.arguments import parser
from yarnscale.cli.guide import SAMPLES
from yarnscale.errors import InputError
from yarnscale.files.cell_origin import CellOrigin
from yarnscale.files.material_json import is_material, read_material
from yarnscale.files.material_library import LIBRARY, MATERIAL, TESTS, names
from yarnscale.files.material_library import tests as kept_tests
from yarnscale.files.patterns import is_drawing, read_pattern, read_yarns, structure_of
from yarnscale.files.run_folder import writable_folder
from yarnscale.files.scene_toml import read_scene
from yarnscale.homogeneous.fabrics import fabric_of
from yarnscale.laboratory.homogeneous_tests import tension
from yarnscale.show.canvas import PicturesUnavailable, require_renderer
from yarnscale.show.material_library import COLUMNS, LibraryMaterial
from yarnscale.yarn.material import PRESETS


def test_the_library_has_fabrics_and_is_small() -> None:
    assert len(names()) >= 6 and "stockinette-wool" in names()
    sizes = [path.stat().st_size for path in LIBRARY.rglob("*.json")]
    assert max(sizes) < 100_000 and sum(sizes) < 100_000 * len(names())


@pytest.mark.parametrize("name", names())
def test_a_material_its_fabric_and_its_tests_belong_together(name: str) -> None:
    material, pattern, yarns = read_material(name), read_pattern(name), read_yarns(name)
    assert is_material(name) and not is_drawing(name) and structure_of(name) is None
    origin = CellOrigin.of_material(LIBRARY / name / MATERIAL)
    assert origin is not None and origin.cell_pattern(pattern, name) is pattern
    assert yarns == origin.yarns and yarns in PRESETS.values()
    known = material.provenance
    assert set(known) >= {"unseen", "made", "versions", "seed", "fit"} and known["unseen"]["states"] >= 30
    cell, shell = kept_tests(name)
    assert (cell.kind, shell.kind, cell.subject) == ("cell", "shell", name)
    assert cell.density == pytest.approx(material.density, rel=1e-5)
    assert "/" not in json.loads((LIBRARY / name / TESTS).read_text())["against"]["subject"]


def test_the_tests_of_the_package_are_those_of_its_materials() -> None:
    points = tension(fabric_of(read_material("stockinette-wool")), 0.0, [1.0, 5.0])
    known = {p.load: p for p in kept_tests("stockinette-wool")[1].pulled(0.0)}
    for point in points:
        assert point.stretch == pytest.approx(known[point.load].stretch, rel=1e-3)


def test_names_are_taken_by_commands_and_scenes(run, refused, tmp_path: Path) -> None:
    assert "stockinette-wool" in json.loads(run("patterns", "--json").out)["shells"]
    assert run("evaluate", "stockinette-wool", "--strain", "0.1,0,0,0,0,0", "--json").status == 0
    outcome = run("pattern", "stockinette-wool", "--out", tmp_path / "rest.json", "--json")
    assert outcome.status == 0 and json.loads(outcome.out)["material"] == "wool"
    scene = tmp_path / "my.toml"
    scene.write_text('material = "stockinette-wool"\nscene = "hang"\n')
    assert read_scene(scene).cloth.material.density == read_material("stockinette-wool").density
    line = refused("simulate", "hang", "--shell", "stokinette-wool", "--out", tmp_path / "out")
    assert "unknown shell material" in line and "did you mean stockinette-wool?" in line
    assert "did you mean" in refused("relax", "stockinete-wool")
    line = refused("evaluate", "./stockinette-wool", "--strain", "0.1,0,0,0,0,0")  # a file of the user's, by its path
    assert "stockinette-wool: file does not exist" in line
    with pytest.raises(InputError, match="unknown material"):
        kept_tests("stockinette")


@pytest.fixture
def prepared(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Commands that are run, in place of which the package's materials are copied; seed cannot be homogenized."""
    called = []

    def run(*arguments: str) -> bool:
        options = parser().parse_args(arguments)
        called.append(" ".join(arguments[:2]))
        if options.command == "homogenize":
            if options.pattern == "seed":
                raise InputError("no equilibrium")
            for path in (LIBRARY / "stockinette-wool").glob("*.json"):
                shutil.copy(path, writable_folder(options.out) / path.name)
        else:
            shutil.copytree(LIBRARY / "stockinette-wool" / "tests", options.out)
        return True

    monkeypatch.setattr(command, "_run", run)
    return called


def test_a_library_is_made_resumed_and_replaced(run, refused, prepared: list[str], tmp_path: Path) -> None:
    try:
        require_renderer()
    except PicturesUnavailable as missing:
        pytest.skip(str(missing))
    out = tmp_path / "out"
    outcome = run("library", "stockinette", "seed", "--out", out, "--json")
    assert outcome.status == 1 and "no equilibrium" in outcome.err
    assert json.loads(outcome.out) == {"materials": ["stockinette-wool"], "failed": ["seed-wool"]}
    page = (out / "index.html").read_text(encoding="utf-8")
    assert "unseen states" in page and "Yarn wool: E 1e+07 Pa" in page and "<img" in page
    assert [text.split()[0] for text in prepared] == ["homogenize", "test", "homogenize"]
    prepared.clear()
    assert "output exists" in refused("library", "stockinette", "--out", out)
    assert run("library", "stockinette", "--out", out, "--resume").status == 0
    shutil.copytree(LIBRARY / "links-wool" / "tests", out / "stockinette-wool" / "tests", dirs_exist_ok=True)
    outcome = run("library", "stockinette", "--out", out, "--resume", "--json")  # points of these have no equilibrium
    assert outcome.status == 1 and json.loads(outcome.out)["failed"] == ["stockinette-wool"]
    assert prepared == []
    half = writable_folder(out / "rib-1x1-wool" / "samples") / "begun"  # of a run that was killed
    half.touch()
    outcome = run("library", "plain", "--out", out, "--resume", "--json")
    assert json.loads(outcome.out)["materials"] == ["plain-wool", "stockinette-wool"] and half.exists()
    prepared.clear()
    yarn, again = tmp_path / "own.toml", ("--out", out, "--resume")
    yarn.write_text((SAMPLES / "yarn.toml").read_text().replace("soft wool", "wool").replace("1.0e7", "2e7"))
    assert "cannot resume: another yarn" in refused("library", "stockinette", "--material", yarn, *again)
    shutil.rmtree(out / "stockinette-wool" / "tests")
    assert "cannot resume: another yarn" in refused("library", "stockinette", "--material", yarn, *again)
    assert "two materials are called" in refused("library", "garter", "--material", yarn, "--material", "wool", *again)
    assert "unknown pattern" in refused("library", "lace", "--out", tmp_path / "new")
    assert "unknown material" in refused("library", "plain", "--material", "silk", "--out", tmp_path / "new")
    assert not (tmp_path / "new").exists()


def test_errors_of_a_fit_are_called_poor_where_they_are() -> None:
    entry = LibraryMaterial("stockinette-wool")
    vars(entry)["provenance"] = {**entry.provenance, "unseen": {"states": 40, "median": 0.5, "high": 2.0, "mean": 1.0}}
    assert len(entry.row()) == len(COLUMNS) and "poor fit" in str(entry.row()[0])
    assert entry.poor and "Poor fit: the stress at 40 unseen states is off by 50 %" in entry.remarks()[0]
    assert not np.isnan(entry.bending_error)
