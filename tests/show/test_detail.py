"""Pictures of yarns on cloth, whole and near."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from matplotlib.image import imread

from yarnscale.errors import InputError
from yarnscale.files.curve_frames import CurveSet
from yarnscale.show.detail import yarn_cloth_picture


@pytest.fixture
def rows() -> tuple[CurveSet, np.ndarray]:
    """Ten straight yarns along x, 1 cm apart."""
    x = np.linspace(-0.05, 0.05, 21)
    points = np.concatenate([np.column_stack([x, np.full(21, 0.01 * k - 0.045), 0 * x]) for k in range(10)])
    return CurveSet(np.arange(0, 211, 21), 1e-3, yarn=np.zeros(10, int)), points


def covered(path: Path) -> float:
    return float((imread(path)[..., :3].min(axis=2) < 0.9).mean())


def test_near_views_show_a_part(rows: tuple[CurveSet, np.ndarray], tmp_path: Path) -> None:
    curves, points = rows
    yarn_cloth_picture(tmp_path / "far.png", curves, points, camera="top", size=(300, 300))
    yarn_cloth_picture(
        tmp_path / "near.png", curves, points, camera="top", size=(300, 300), about=(0, 0.005, 0), width=0.018
    )
    # Yarns 2 mm wide every centimetre cover a fifth; of a view with a single one, they cover less than half.
    assert covered(tmp_path / "far.png") == pytest.approx(0.2, abs=0.06)
    assert 0.08 < covered(tmp_path / "near.png") < 0.5


def test_views_without_yarns_and_broken_points_are_refused(rows: tuple[CurveSet, np.ndarray], tmp_path: Path) -> None:
    curves, points = rows
    with pytest.raises(InputError, match="near view"):
        yarn_cloth_picture(tmp_path / "no.png", curves, points, about=(1, 1, 1), width=0.01)
    points[3] = np.nan
    with pytest.raises(InputError, match="points of the yarns"):
        yarn_cloth_picture(tmp_path / "no.png", curves, points)
