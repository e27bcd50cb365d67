"""What ``homogenize`` samples."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from yarnscale.cli import main
from yarnscale.drawing import library
from yarnscale.errors import InputError
from yarnscale.files.patterns import read_pattern, write_pattern
from yarnscale.homogenize.executors import kept_workers
from yarnscale.yarn.material import PRESETS

SMALL = (
    "--form",
    "hylc2020",
    "--solves",
    12,
    "--workers",
    1,
    "--stretch",
    "-0.05,0.1",
    "--shear",
    0.1,
    "--curvature",
    0.01,
)


def _stress(run, folder: Path) -> np.ndarray:  # type: ignore[no-untyped-def]
    outcome = run("evaluate", folder / "material.json", "--strain", "0,0,0,0,0,0", "--json")
    return np.array(json.loads(outcome.out)["stress"])[:3]


def test_built_in_patterns_are_settled_first(run, tmp_path: Path) -> None:  # type: ignore[no-untyped-def]
    """Fabric at rest carries no stress; the drawing of a plain weave does, and resists --as-drawn."""
    with kept_workers():
        assert run("homogenize", "plain", "--out", tmp_path / "rest", *SMALL).status == 0
        assert run("homogenize", "plain", "--as-drawn", "--out", tmp_path / "drawn", *SMALL).status == 0
    rest, drawn = _stress(run, tmp_path / "rest"), _stress(run, tmp_path / "drawn")
    assert np.abs(rest).max() < 0.02 * np.abs(drawn).max()
    kept = read_pattern(tmp_path / "rest" / "pattern.json")
    assert not np.allclose(kept.period, library.build("plain").period, rtol=1e-3)
    drawn = read_pattern(tmp_path / "drawn" / "pattern.json")
    assert drawn.content_hash() == library.build("plain").content_hash()


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
