"""Searches over all of the ranges: scattered starts, of which those that come down fastest are refined to the end; and,
as published, a particle swarm with decaying inertia, then COBYLA (EST22 §7.3.3)."""

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
PARTICLES, STEPS = 64, 10
INERTIA = 0.9, 0.1
"""At the first and at the last step."""
_PULL = 1.5
"""Largest share of the way to its own best and to the best of all that a particle is drawn in a step."""
_NEAR = 0.02
"""Particles closer than this to the best of all are driven off, so that they go on searching."""


def sobol_starts(evaluations: Evaluations, count: int, keep: int, *, seed: int) -> list[Array]:
    """The best of scattered points, apart from each other, best first."""
    from scipy.stats import qmc

    dimensions = len(evaluations.objective.model.names)
    points = qmc.Sobol(dimensions, rng=seed).random_base2(max(1, int(np.ceil(np.log2(count)))))[:count]
    found = evaluations.many(list(points), keep=True)
    return _apart([points[k] for k in np.argsort([f.objective for f in found], kind="stable")], keep)


def race(evaluations: Evaluations, starts: Sequence[Array], *, iterations: int) -> Array:
    """The lowest point that Gauss–Newton reaches from several starts.

    The objective at a start is a poor measure of the minimum reached from it, that after a few steps a better one. So
    all starts take some steps, the better ones some more, and the best one all. iterations: of one start at most.
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


def swarm(evaluations: Evaluations, *, seed: int, particles: int = PARTICLES, steps: int = STEPS) -> Array:
    """The best point that a swarm in [0, 1]ⁿ comes by."""
    generator = np.random.default_rng(seed)
    n = len(evaluations.objective.model.names)
    place = generator.random((particles, n))
    speed = 0.25 * (generator.random((particles, n)) - 0.5)
    own, own_value = place.copy(), np.full(particles, np.inf)
    for step in range(steps):
        value = np.array([found.objective for found in evaluations.many(list(place))])
        better = value < own_value
        own[better], own_value[better] = place[better], value[better]
        leader = own[np.argmin(own_value)]
        inertia = INERTIA[0] + (INERTIA[1] - INERTIA[0]) * step / max(steps - 1, 1)
        to_own, to_leader = _PULL * generator.random((2, particles, n))
        speed = inertia * speed + to_own * (own - place) + to_leader * (leader - place)
        crowd = np.linalg.norm(place - leader, axis=1) < _NEAR
        speed[crowd] += 0.2 * (generator.random((int(crowd.sum()), n)) - 0.5)
        moved = place + speed
        # Particles bounce off the ends of the ranges.
        speed = np.where((moved < 0.0) | (moved > 1.0), -0.5 * speed, speed)
        place = np.clip(moved, 0.0, 1.0)
    return own[np.argmin(own_value)].copy()


def cobyla(evaluations: Evaluations, start: Array, *, largest: int = 200, reach: float = 0.05) -> Array:
    """A local minimum without derivatives from a start, within [0, 1]ⁿ."""
    from scipy.optimize import minimize

    best = [np.inf, start]

    def value(unknowns: Array) -> float:
        inside = np.clip(unknowns, 0.0, 1.0)
        found = evaluations.many([inside])[0].objective
        if found < best[0]:
            best[:] = [found, inside]
        # Outside, the value at the bound and the way to it.
        return found + float(np.abs(unknowns - inside).sum())

    minimize(value, start, method="COBYLA", options={"rhobeg": reach, "maxiter": largest, "tol": 1e-3})
    return np.asarray(best[1], np.float64)
