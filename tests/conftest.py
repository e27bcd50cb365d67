"""Fixtures that every test may use."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

REPOSITORY = Path(__file__).resolve().parents[1]


@pytest.fixture(scope="session")
def shared() -> Path:
    """The reference data folder; tests that need it are skipped where it is missing."""
    folder = Path(os.environ.get("YARNSCALE_SHARED") or REPOSITORY.parent / "shared")
    if not (folder / "reference").is_dir():
        pytest.skip(f"reference data folder not found: {folder} (set YARNSCALE_SHARED to its path)")
    return folder


@pytest.fixture(scope="session")
def lit_picture() -> Callable[..., np.ndarray]:
    """Draws yarns (lengths in radii) as a photograph has them: lit, uneven, noisy, six pixels for a radius."""
    from scipy import ndimage

    from yarnscale.swatches.registration.curves import YarnCurves
    from yarnscale.swatches.registration.registration import SIDES
    from yarnscale.swatches.registration.relief import Relief

    def picture(curves: YarnCurves, side: str, size: tuple[int, int] = (260, 280)) -> np.ndarray:
        """Brightness (rows, columns) around 100, rows downwards."""
        shape = (int(12.0 * curves.period[1]), int(12.0 * curves.period[0]))
        pixel = (float(curves.period[1]) / shape[0], float(curves.period[0]) / shape[1])
        relief = Relief.of(curves.samples, curves.following, curves.sample_radii, curves.period, shape, SIDES[side])
        cell = relief.lit(np.array([-0.3, 0.5, 1.0, 0.3, 0.2, 0.0, 0.1]), 1.0, pixel, 0.1)
        rows, columns = np.meshgrid(np.arange(size[0]), np.arange(size[1]), indexing="ij")
        across = columns / 6.0 * (1.0 if side == "front" else -1.0)
        at = [(-rows / 6.0 / curves.period[1] % 1.0) * shape[0], (across / curves.period[0] % 1.0) * shape[1]]
        seen = ndimage.map_coordinates(np.pad(cell, ((0, 1), (0, 1)), mode="wrap"), at, order=1)
        noise = np.random.default_rng(3).normal(0.0, 0.08, size)
        return 60.0 * (seen * (1.0 + 0.2 * columns / size[1]) + noise + 1.0)

    return picture
