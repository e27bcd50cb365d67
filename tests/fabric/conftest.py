"""Yarns that tests of finite fabrics share."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from yarnscale.arrays import Array
from yarnscale.fabric.direct_energy import FabricEnergy
from yarnscale.fabric.sheet import YarnSheet
from yarnscale.yarn.material import YarnMaterial


@pytest.fixture
def crossing() -> Callable[[float], FabricEnergy]:
    """A straight yarn of 1 mm radius along x and one along y, a gap of so many radii above it."""

    def made(gap: float) -> FabricEnergy:
        radius, along, zero = 1e-3, np.linspace(-0.01, 0.01, 21), np.zeros(21)
        lines = [np.stack([along, zero, zero], 1), np.stack([zero, along, zero + gap * radius], 1)]
        return FabricEnergy(YarnSheet.from_lines(lines, radius), YarnMaterial(5e5, 2e5, 1.0, 60.0, 120.0))

    return made


@pytest.fixture
def check_derivatives() -> Callable[[Any, Array], None]:
    """Compare gradient and Hessian of an energy at a vector with difference quotients along a random direction."""

    def check(energy: Any, x: Array) -> None:
        direction, step = np.random.default_rng(1).standard_normal(x.size), 1e-8
        value, gradient, model = energy.quadratic(x)
        assert value == pytest.approx(energy.value(x)) and value > 0.0
        ahead, back = x + step * direction, x - step * direction
        assert (energy.value(ahead) - energy.value(back)) / (2 * step) == pytest.approx(gradient @ direction, rel=1e-6)
        slopes = (energy.gradient(ahead)[1] - energy.gradient(back)[1]) / (2 * step)
        product = model.pattern.multiply(model.entries, direction)
        np.testing.assert_allclose(product, slopes, atol=1e-6 * np.abs(slopes).max())

    return check
