"""Moduli of a cell: the derivative of the stress by the macroscopic strain along equilibria (theory §2)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from yarnscale.cell.energy import CellEnergy
from yarnscale.cell.equilibrium import Equilibrium
from yarnscale.kinematics import ShellStrain
from yarnscale.numerics.implicit import ConstrainedInverse

Array = NDArray[np.float64]

_STEP = 2e-8
"""Of one-sided differences, times 1/r for curvature: contacts that begin within a longer step spoil it."""


def moduli(energy: CellEnergy, state: Equilibrium, backend: str | None = None) -> Array:
    """∂²Ψ/∂z² (6, 6), z = (s_x, s_a, s_y, II11, II12, II22), at an equilibrium of an energy, also a curved one.

    One linear solve per component with one factorisation; backend: of it (``numerics.factor``). W,zz and W,xz at fixed
    x are one-sided differences of exact gradients.
    """
    x = energy.start(state.fluctuation / energy.pattern.radius, state.twist)
    _, gradient, model = energy.quadratic(x)
    stress = energy.stress(x)
    mixed, explicit = np.empty((len(x), 6)), np.empty((6, 6))
    for k, step in enumerate(_STEP * np.array([1.0] * 3 + [1.0 / energy.pattern.radius] * 3)):
        vector = energy.strain.vector.copy()
        vector[k] += step
        # A step from a flat state may bend it both ways.
        moved = CellEnergy(
            energy.pattern, energy.material, ShellStrain.from_vector(vector), energy.sliding, True
        )
        mixed[:, k] = (moved.gradient(x)[1] - gradient) / step
        explicit[k] = (moved.stress(x) - stress) / step
    by_state = -ConstrainedInverse(model, energy.constraints, backend=backend).apply(mixed)
    found = explicit + energy.unit / energy.pattern.area * mixed.T @ by_state
    return 0.5 * (found + found.T)
