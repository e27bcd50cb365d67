"""Many starts over all of the ranges, of which those that come down fastest are refined to the end."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from yarnscale.arrays import Array
from yarnscale.swatches.evaluations import Evaluations
from yarnscale.swatches.gauss_newton import GaussNewton, advance

STAGES = ((3, 0.5), (4, 0.5), (5, 0.0))
"""Gauss–Newton steps of every remaining start, and the share of starts kept afterwards; the best always is."""
_APART = 0.25
"""Least distance of starts, of the ranges."""


def sobol_starts(evaluations: Evaluations, count: int, keep: int, *, seed: int) -> list[Array]:
    """The best of scattered points, apart from each other, best first."""
    from scipy.stats import qmc

    dimensions = len(evaluations.objective.model.names)
    points = qmc.Sobol(dimensions, rng=seed).random_base2(max(1, int(np.ceil(np.log2(count)))))[:count]
    found = evaluations.many(list(points), keep=True)
    return _apart([points[k] for k in np.argsort([f.objective for f in found], kind="stable")], keep)


def race(evaluations: Evaluations, starts: Sequence[Array], *, iterations: int) -> Array:
    """The lowest point that Gauss–Newton reaches from several starts.

    The objective at a start says little about the minimum it leads to, a few steps say more. So all starts take some,
    the better ones some more, and only the last one runs to its end. iterations: of one start at most.
    """
    descents = [GaussNewton(evaluations, start) for start in starts]
    left = iterations
    for steps, share in STAGES:
        advance(evaluations, descents, min(steps, left))
        left = max(0, left - steps)
        descents.sort(key=lambda descent: descent.value)
        descents = descents[: max(1, int(np.ceil(share * len(descents))))]
    advance(evaluations, descents[:1], left)
    return descents[0].here


def _apart(points: Sequence[Array], keep: int) -> list[Array]:
    chosen: list[Array] = []
    for point in points:
        if all(np.linalg.norm(point - other) > _APART for other in chosen):
            chosen.append(point)
        if len(chosen) == keep:
            break
    return chosen
