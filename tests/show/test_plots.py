"""Diagrams of fit errors are written whole or not at all."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from matplotlib.image import imread

from yarnscale.errors import InputError
from yarnscale.show.plots import error_histogram, stress_scatter


def test_scatter_and_histogram(tmp_path: Path) -> None:
    generator = np.random.default_rng(1)
    norms = np.geomspace(1e-3, 40, 50)
    groups = {"fitted": (norms, 0.01 * norms), "unseen": (norms, 0.05 * norms)}
    stress_scatter(tmp_path / "stress.png", groups, floor=0.02)
    error_histogram(tmp_path / "errors.png", {"fitted": generator.normal(size=50), "unseen": np.zeros(3)})
    assert imread(tmp_path / "stress.png").std() > 0.05
    assert len(list(tmp_path.iterdir())) == 2


def test_errors_are_one_line(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="at least one finite"):
        error_histogram(tmp_path / "a.png", {"s_x": np.array([np.nan])})
    with pytest.raises(InputError, match="cannot be written"):
        stress_scatter(tmp_path / "no" / "a.png", {"a": (np.ones(2),) * 2}, floor=0.02)
    assert list(tmp_path.iterdir()) == []
