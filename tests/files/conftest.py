"""A material with every kind of term, for the tests of files."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from yarnscale.shell.materials.compact import CompactMaterial, SpringNetwork, shapes_of
from yarnscale.shell.materials.spline_material import SplineMaterial
from yarnscale.shell.materials.spline_patches import PLANES
from yarnscale.shell.materials.tables import BicubicSpline, CubicSpline

REACH = np.array([0.7, 0.6, 0.5, 90.0, 110.0])


@pytest.fixture
def material() -> SplineMaterial:
    """Axes and nine planes with random nodal data."""
    rng = np.random.default_rng(5)
    axes, planes = [], {}
    for k, reach in enumerate(REACH):
        knots = np.linspace(-1, 1, 7 + k) * reach
        values, slopes = (knots / reach) ** 2, 2 * knots / reach**2
        axes.append(CubicSpline(knots, values + 0.05 * rng.normal(size=len(knots)), slopes))
    for i, j in PLANES:
        u, v = np.linspace(-1, 1, 4 + i) * REACH[i], np.linspace(-1, 1, 3 + j) * REACH[j]
        data = 0.1 * rng.normal(size=(4, len(u), len(v)))
        data[1] /= REACH[i]
        data[2] /= REACH[j]
        data[3] /= REACH[i] * REACH[j]
        planes[i, j] = BicubicSpline(u, v, *data)
    return SplineMaterial(0.2, tuple(axes), planes, density=0.3)


@pytest.fixture
def compact() -> CompactMaterial:
    """A small network with every kind of unit."""
    rng = np.random.default_rng(3)
    arrays = SpringNetwork(*(rng.normal(size=tuple(shape)) for shape in shapes_of(4, 6, 2)))
    positive = {name: np.abs(getattr(arrays, name)) for name in ("stiffnesses", "background", "wall_stiffnesses")}
    scale = np.array([0.5, 0.5, 0.5, 100.0, 100.0, 100.0])
    return CompactMaterial(0.1, scale, arrays._replace(**positive), density=0.3)


@pytest.fixture
def states() -> Callable[..., np.ndarray]:
    """Random strains (count, 6) up to a multiple of the range."""

    def draw(reach: float, count: int = 500) -> np.ndarray:
        strains = np.random.default_rng(6).uniform(-reach, reach, (count, 6))
        strains[:, :3] *= REACH[:3]
        strains[:, 3:] *= 0.5 * REACH[3]
        return strains

    return draw
