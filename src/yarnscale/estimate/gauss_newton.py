"""Bounded Gauss–Newton over the whole chain of rest shape and states, and searches that find where to begin.

The rest shape answers to the parameters as strongly as the states do, so sensitivities with the rest shape held point
elsewhere. Columns of the Jacobian are therefore differences over the whole chain, from states next to the converged
ones; they are independent of each other and run side by side.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from yarnscale.estimate.evaluations import Evaluations

Array = NDArray[np.float64]

DIFFERENCE = 1e-3
"""Step of differences, of the unknowns' ranges."""
_SHORTEST = 2e-4
"""A step below this is none."""
_SMALLEST_GAIN = 1e-3
"""Relative decrease of the objective, twice in a row, at which the search ends."""


def jacobian(
    evaluations: Evaluations, unknowns: Array, *, step: float = DIFFERENCE, held: bool = False
) -> Array:
    """d(residuals)/d(unknowns) (m, n), by differences that turn inwards where a bound is near.

    held: columns of the yarn's parameters by exact sensitivities instead, which leave out what the parameters do to the
    rest shape.
    """
    exact = np.empty((0, 0))
    if held:
        exact = evaluations.objective.held_jacobian(evaluations.whole(unknowns))
    axes = np.eye(len(unknowns))[exact.shape[1] :]
    signs = np.where(unknowns + step > 1.0, -1.0, 1.0)[exact.shape[1] :]
    points = [unknowns + sign * step * axis for sign, axis in zip(signs, axes, strict=True)]
    base = evaluations.residuals(unknowns)
    found = evaluations.many(points, near=unknowns)
    columns = [(f.residuals - base) / (s * step) for f, s in zip(found, signs, strict=True)]
    return np.column_stack([*exact.T, *columns])


def gauss_newton(
    evaluations: Evaluations, start: Array, *, iterations: int = 20, held: bool = False
) -> Array:
    """A local minimum of the mean square from a start, unknowns within [0, 1]; ``held`` as for ``jacobian``.

    Levenberg's damping: the step is that of a linear least-squares problem with bounds; several dampings are tried
    side by side, and the best counts.
    """
    from scipy.optimize import lsq_linear

    here = np.clip(np.asarray(start, np.float64), 0.0, 1.0)
    value = evaluations.many([here])[0].objective
    damping, slow = 1e-2, 0
    for _ in range(iterations):
        slopes, residuals = jacobian(evaluations, here, held=held), evaluations.residuals(here)
        scale = max(float(np.linalg.norm(slopes, ord=2)), 1e-12)
        best, moved = value, None
        for _ in range(4):
            tries = []
            for factor in (1.0, 30.0):
                weight = np.sqrt(damping * factor) * scale
                matrix = np.vstack([slopes, weight * np.eye(len(here))])
                target = np.concatenate([-residuals, np.zeros(len(here))])
                step = lsq_linear(matrix, target, bounds=(-here - 1e-12, 1.0 - here + 1e-12)).x
                tries.append((factor, np.clip(here + step, 0.0, 1.0)))
            found = evaluations.many([point for _, point in tries])
            k = int(np.argmin([f.objective for f in found]))
            if found[k].objective < best:
                best, moved = found[k].objective, tries[k][1]
                damping = max(1e-6, damping * (0.2 if tries[k][0] == 1.0 else 6.0))
                break
            damping *= 900.0
            if max(np.abs(point - here).max() for _, point in tries) < _SHORTEST:
                break
        if moved is None:
            break
        gain, length = 1.0 - best / value, np.abs(moved - here).max()
        here, value = moved, best
        slow = slow + 1 if gain < _SMALLEST_GAIN else 0
        if slow == 2 or length < _SHORTEST or value < 1e-14:
            break
        damping = min(damping, 1.0)
    return here


def sobol_starts(evaluations: Evaluations, count: int, keep: int, *, seed: int) -> list[Array]:
    """The best of scattered points, apart from each other, best first."""
    from scipy.stats import qmc

    dimensions = len(evaluations.objective.model.names)
    points = qmc.Sobol(dimensions, rng=seed).random_base2(max(1, int(np.ceil(np.log2(count)))))[:count]
    found = evaluations.many(list(points))
    return _apart([points[k] for k in np.argsort([f.objective for f in found], kind="stable")], keep)


def _apart(points: Sequence[Array], keep: int, distance: float = 0.25) -> list[Array]:
    chosen: list[Array] = []
    for point in points:
        if all(np.linalg.norm(point - other) > distance for other in chosen):
            chosen.append(point)
        if len(chosen) == keep:
            break
    return chosen
