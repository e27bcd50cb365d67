"""Shells whose clamped edges are held."""

from __future__ import annotations

import numpy as np
import pytest

from yarnscale.arrays import Array
from yarnscale.numerics.affine import FreeUnknowns, KeptPull
from yarnscale.swatches.held_shell import _HeldObjective


class Pulled:
    """A force on each of three coordinates."""

    residual_scale = 1.0

    def gradient(self, x: Array) -> tuple[float, Array]:
        return 0.0, np.array([3.0, 4.0, 1.0])


def test_residuals_are_relative_to_the_forces_that_hold_the_other_coordinates() -> None:
    free = FreeUnknowns(np.array([0, 2]), np.zeros(3))
    held = _HeldObjective(Pulled(), free, KeptPull(free))  # type: ignore[arg-type]
    held.gradient(np.zeros(2))
    assert held.residual_scale == pytest.approx(4.0)
