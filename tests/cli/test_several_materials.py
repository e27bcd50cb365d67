"""Patterns of several yarn materials on the command line."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path

import numpy as np
import pytest

from yarnscale.cli import main
from yarnscale.homogenize.store import SampleStore
from yarnscale.yarn.material import PRESETS

CHART = """kind = knit
wale_spacing = 10
course_spacing = 6.5
rows:
k : AB
"""


@pytest.fixture
def chart(tmp_path: Path) -> Path:
    path = tmp_path / "plated.chart"
    path.write_text(CHART)
    return path


def _relaxed(capsys: pytest.CaptureFixture[str], chart: Path, *materials: str) -> dict:
    options = [part for name in materials for part in ("--material", name)]
    assert main(["relax", str(chart), "--strain", "0.1,0,0.1,0,0", "--json", *options]) == 0
    return json.loads(capsys.readouterr().out)


def test_relax_takes_a_material_for_each_number(capsys: pytest.CaptureFixture[str], chart: Path) -> None:
    soft, mixed, stiff = (_relaxed(capsys, chart, *m) for m in (["wool"], ["wool", "acrylic"], ["acrylic"]))
    assert mixed["material"] == "wool + acrylic"
    assert soft["energy_density"] < mixed["energy_density"] < stiff["energy_density"]


def test_too_many_materials_are_refused(capsys: pytest.CaptureFixture[str], chart: Path) -> None:
    assert main(["relax", str(chart), *["--material", "wool"] * 3]) == 2
    assert "are of 2 materials; expected one or 2 materials; found 3" in capsys.readouterr().err


def test_a_store_tells_all_materials(tmp_path: Path, chart: Path) -> None:
    grid = tmp_path / "grid.toml"
    grid.write_text("s_x = [0.0]\n")
    options = ["--grid", str(grid), "--out", str(tmp_path / "store"), "--workers", "1"]
    arguments = ["sample", str(chart), "--material", "wool", "--material", "acrylic", *options]
    assert main(arguments) == 0
    provenance = SampleStore(tmp_path / "store").attributes["provenance"]
    expected = [asdict(PRESETS[name]) for name in ("wool", "acrylic")]
    for entry in expected:
        del entry["contact"]["friction"]  # of which samples have none
    assert provenance["material"] == expected
    assert np.isfinite(SampleStore(tmp_path / "store").read(0, "energy_density"))
    assert main([*arguments, "--resume"]) == 0
    swapped = ["sample", str(chart), "--material", "acrylic", "--material", "wool", *options, "--resume"]
    assert main(swapped) == 2
