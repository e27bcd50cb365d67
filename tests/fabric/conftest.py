"""Yarns that tests of finite fabrics share."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

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
