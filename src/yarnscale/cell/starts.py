"""Perturbed starts for cells with several buckled equilibria."""

from __future__ import annotations

import numpy as np

from yarnscale.arrays import Array
from yarnscale.cell.energy import CellEnergy
from yarnscale.cell.passages import safe_move

NOISE = 0.1
"""Standard deviation of the noise of every coordinate [r]."""
WAVE = 0.6
"""Largest height of each of the waves across the cell, out of and in the plane [r]."""
_WAVES = ((1, 0), (0, 1), (1, 1), (1, -1))


def perturbed(energy: CellEnergy, x: Array, generator: np.random.Generator) -> Array:
    """A free vector near ``x``: noise on every vertex and waves of the cell's own period, the ones of buckling.

    The perturbation is shortened until no yarn passes another and the energy is finite.
    """
    n, pattern = energy.count, energy.pattern
    moves = NOISE * generator.standard_normal((n, 3))
    place = pattern.vertices[:, :2] / pattern.period
    for wave in _WAVES:
        phase, height = generator.uniform(0.0, 2.0 * np.pi), generator.uniform(-WAVE, WAVE, 3)
        moves += np.cos(2.0 * np.pi * (place @ np.array(wave)) + phase)[:, None] * height * (0.5, 0.5, 1.0)
    step = np.concatenate([moves.ravel(), np.zeros(n)])
    step = energy.constraints.project(step)
    for _ in range(6):
        if safe_move(energy, x, x + step) and np.isfinite(energy.value(x + step)):
            return x + step
        step = 0.5 * step
    return x
