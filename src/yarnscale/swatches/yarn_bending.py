"""Bending stiffness of a cell of yarn, as pear loops measure that of a fabric (EST22 §4.3, §5.2)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from yarnscale.arrays import Array
from yarnscale.cell.periodic import PeriodicCell
from yarnscale.swatches.measurements import Direction


def bending_stiffness(cell: PeriodicCell, directions: Sequence[Direction]) -> Array:
    """k of the energy k κ² per area of a cylinder bent along directions, of a flat cell at rest, (n,) [J].

    Half of the second derivative of the energy density, yarns following. Not a number where the cell has no
    equilibrium that moduli could be taken at.
    """
    state = cell.relax()
    if not state.usable:
        return np.full(len(directions), np.nan)
    try:
        moduli = cell.moduli(state)
    except ArithmeticError:
        return np.full(len(directions), np.nan)
    along = np.array([[np.cos(d.angle), np.sin(d.angle)] for d in directions])
    curved = np.zeros((len(directions), 6))
    curved[:, 3:] = np.column_stack([along[:, 0] ** 2, along[:, 0] * along[:, 1], along[:, 1] ** 2])
    return 0.5 * np.einsum("ni,ij,nj->n", curved, moduli, curved)
