"""What ``homogenize`` samples."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from yarnscale.drawing import library
from yarnscale.files.patterns import read_pattern

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
    assert run("homogenize", "plain", "--out", tmp_path / "rest", *SMALL).status == 0
    assert run("homogenize", "plain", "--as-drawn", "--out", tmp_path / "drawn", *SMALL).status == 0
    rest, drawn = _stress(run, tmp_path / "rest"), _stress(run, tmp_path / "drawn")
    assert np.abs(rest).max() < 0.02 * np.abs(drawn).max()
    kept = read_pattern(tmp_path / "rest" / "pattern.json")
    assert not np.allclose(kept.period, library.build("plain").period, rtol=1e-3)
    drawn = read_pattern(tmp_path / "drawn" / "pattern.json")
    assert drawn.content_hash() == library.build("plain").content_hash()
