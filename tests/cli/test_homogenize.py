"""What ``homogenize`` samples."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from yarnscale.cell import PeriodicCell
from yarnscale.cli import main
from yarnscale.drawing import library
from yarnscale.errors import InputError
from yarnscale.files.patterns import write_pattern
from yarnscale.yarn.material import PRESETS


def test_built_in_patterns_are_settled_first(monkeypatch, tmp_path: Path) -> None:
    """Fabric at rest carries no stress; the drawing of a plain weave does, and resists --as-drawn."""
    cells: list[PeriodicCell] = []

    def stopped(cell: PeriodicCell, *_, **__) -> None:
        cells.append(cell)
        raise InputError("enough")

    monkeypatch.setattr("yarnscale.cli.materials.homogenize_into", stopped)
    for name, options in (("rest", []), ("drawn", ["--as-drawn"])):
        assert main(["homogenize", "plain", "--out", str(tmp_path / name), *options]) == 2
    rest, drawn = (np.abs(cell.relax().stress[:3]).max() for cell in cells)
    assert rest < 0.02 * drawn
    settled, built = cells[0].pattern, library.build("plain")
    assert not np.allclose(settled.period, built.period, rtol=1e-3)
    assert cells[1].pattern.content_hash() == built.content_hash()


@pytest.mark.parametrize(("options", "expected"), [([], 0.25), (["--friction", "0"], 0.0)])
def test_friction_is_that_of_the_yarn_unless_it_is_given(monkeypatch, tmp_path: Path, options, expected) -> None:
    wool, taken = PRESETS["wool"], {}

    def stopped(*_, **settings) -> None:
        taken.update(settings)
        raise InputError("enough")

    monkeypatch.setattr("yarnscale.cli.materials.homogenize_into", stopped)
    yarn = replace(wool, contact=replace(wool.contact, friction=0.25))
    write_pattern(library.build("plain"), tmp_path / "plain.json", yarns=yarn)
    assert main(["homogenize", str(tmp_path / "plain.json"), "--out", str(tmp_path / "m"), *options]) == 2
    assert taken["friction"].coefficient == expected
