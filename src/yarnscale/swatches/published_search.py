"""Particle swarm with decaying inertia, then COBYLA: the published way to the parameters (EST22 §7.3.3)."""

from __future__ import annotations

import numpy as np

from yarnscale.arrays import Array
from yarnscale.swatches.evaluations import Evaluations

PARTICLES, STEPS = 64, 10
INERTIA = 0.9, 0.1
"""At the first and at the last step."""
_PULL = 1.5
"""Largest share of the way to its own best and to the best of all that a particle is drawn in a step."""
_NEAR = 0.02
"""Particles closer than this to the best of all are driven off, so that they go on searching."""


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
