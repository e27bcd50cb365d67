"""Periods at which a cell has no coarse stress along x and y, as fabric on a table has none."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from yarnscale.arrays import Array
from yarnscale.cell.equilibrium import Equilibrium
from yarnscale.cell.periodic import PeriodicCell
from yarnscale.cell.rest_shape import rebased
from yarnscale.kinematics import ShellStrain

LARGEST_STEP = 0.08
"""Largest change of a period in one step, relative."""
DIFFERENCE = 1e-4
"""Change of a period by which stress is differentiated, relative."""
SOFTEST = 1e-4
"""Smallest stiffness over the largest that a step counts with: softer directions are bounded by its length."""
HALVINGS = 5
"""How often a step that finds no equilibrium is halved."""
RESTING = 1e-4
"""A last step of the periods below this leaves a cell at rest."""


@dataclass(frozen=True, eq=False)
class Release:
    """Outcome of ``released``.

    cell: drawn at the equilibrium, where that is usable. change: of its periods, relative (2,). state: the last usable
    equilibrium, else the first one, its strain counted from the periods before. matrix: of its stress by the change of
    the periods (2, 2) [J/m²], None where it is to be taken anew. solves: equilibria that it took. converged: whether
    the periods are at zero stress.
    """

    cell: PeriodicCell
    change: Array
    state: Equilibrium
    matrix: Array | None
    solves: int
    converged: bool


def released(
    cell: PeriodicCell,
    *,
    start: Equilibrium | None = None,
    matrix: Array | None = None,
    tolerance: float = 1e-7,
    max_steps: int = 25,
    observe: Callable[[Equilibrium], object] | None = None,
) -> Release:
    """Periods at zero stress by Newton's method; its matrix is kept up by Broyden's updates from differences.

    Solves nearby are far cheaper than moduli. Shear stress cannot vanish so: the periods stay orthogonal.

    start: a state near, whose periods are begun with; None: the drawn periods. matrix: that of an almost equal cell.
    tolerance: a step of the periods below this is none. observe: gets every state.
    """
    change = np.zeros(2) if start is None else start.strain.vector[[0, 2]]
    state, solves = cell.relax(flat_strain(change), start=start), 1
    stress, longest, limit, reach = state.stress[[0, 2]], np.inf, LARGEST_STEP, LARGEST_STEP
    for _ in range(max_steps):
        if observe is not None:
            observe(state)
        if not state.usable:
            break
        if matrix is None:
            matrix, solves = _differences(cell, change, state), solves + 2
        if matrix is None:
            longest = np.inf
            break
        step = _downhill(matrix, stress)
        longest = float(np.abs(step).max())
        if longest < tolerance:
            break
        step *= min(1.0, limit / longest)
        longest = min(longest, limit)
        further, step, tries = _further(cell, change, step * min(1.0, reach / longest), state)
        solves += tries
        if further is None:
            longest = np.inf
            break
        # After a failed step, steps are short and double again.
        reach = min(LARGEST_STEP, 2.0 * float(np.abs(step).max())) if tries > 1 else min(LARGEST_STEP, 2.0 * reach)
        there = further.stress[[0, 2]]
        gain = float(np.linalg.norm(there) / np.linalg.norm(stress))
        if gain > 0.8 and there @ step > 0:
            # Beyond the minimum of the energy, and no nearer: back and forth without end but for shorter steps.
            limit = 0.5 * float(np.abs(step).max())
        # Where Newton does not pay, the matrix is taken anew.
        slope = there - stress - matrix @ step
        matrix = matrix + np.outer(slope, step) / (step @ step) if gain < 0.5 else None
        change, state, stress = change + step, further, there
    converged = state.usable and longest < RESTING
    if state.usable:
        cell = replace(cell, pattern=rebased(cell.pattern, state))
    return Release(cell, change, state, matrix, solves, converged)


def _further(
    cell: PeriodicCell, change: Array, step: Array, state: Equilibrium
) -> tuple[Equilibrium | None, Array, int]:
    """A usable equilibrium a step or, where that fails, a part of it away, None where all fail; the step; solves."""
    for tries in range(1, HALVINGS + 2):
        # One solve each: halved steps are the load path.
        further = cell.relax(flat_strain(change + step), start=state, nearby=True)
        if further.usable:
            return further, step, tries
        step = 0.5 * step
    return None, step, tries


def _differences(cell: PeriodicCell, change: Array, state: Equilibrium) -> Array | None:
    """Derivatives of the stress along both periods by them (2, 2), from a state near; None where a side fails."""
    sides = [cell.relax(flat_strain(change + side), start=state) for side in DIFFERENCE * np.eye(2)]
    if not all(side.usable for side in sides):
        return None
    return np.column_stack([(side.stress - state.stress)[[0, 2]] / DIFFERENCE for side in sides])


def _downhill(matrix: Array, stress: Array) -> Array:
    """Newton's step of the periods, downhill along directions of negative stiffness too."""
    sizes, axes = np.linalg.eigh(0.5 * (matrix + matrix.T))
    used = np.maximum(np.abs(sizes), SOFTEST * np.abs(sizes).max())
    return -axes @ ((axes.T @ stress) / used)


def flat_strain(change: Array) -> ShellStrain:
    """The strain of a change of both periods (2,), relative."""
    return ShellStrain(s_x=float(change[0]), s_y=float(change[1]))
