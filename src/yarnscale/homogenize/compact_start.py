"""Where the search for a compact energy starts: springs chosen from many, by their stiffnesses alone.

With directions and thresholds fixed, the energy is linear in the stiffnesses, and they must not be negative: least
squares with that condition finds the best of all, and leaves most springs without stiffness. Those that keep some stay;
others are drawn again, half of them near the ones that stayed, and all compete anew. A round takes a tenth of a second,
needs no derivative by directions, and does not get stuck where one spring is needed far from all others.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import nnls

from yarnscale.homogenize.compact_problem import STRESS_FLOOR, Problem
from yarnscale.homogenize.spring_jacobian import unknowns_of
from yarnscale.shell.materials.compact import Springs

Array = NDArray[np.float64]

_FIRST_FLOOR, _LOWERED = 0.3, 0.85
"""Floor of the first round [N/m], and what each round leaves of it."""
_FRESH, _VARIED = 70, 200
"""Springs drawn at random, and near those that stayed, in a round."""
_LEAST_GAIN, _LARGEST_GAIN = 0.5, 15.0
"""Range of |Q|: a spring tightens within a strain of about one over it."""


def start_of(problem: Problem, rng: np.random.Generator) -> Array:
    """Unknowns of springs that were chosen in rounds; ramps stand at random and bend little."""
    options, x = problem.options, problem.data.x
    directions, offsets = _drawn(x, _FRESH + _VARIED, rng)
    floor, spread = _FIRST_FLOOR, 0.5
    stiffnesses, tail = np.zeros(0), np.zeros(7)
    for _ in range(options.rounds):
        kept, stiffnesses, tail = _chosen(problem, directions, offsets, floor)
        directions, offsets = directions[kept], offsets[kept]
        best = directions, offsets
        others = [_varied(x, *best, spread, rng), _drawn(x, _FRESH, rng)]
        directions = np.concatenate([directions, *(one[0] for one in others)])
        offsets = np.concatenate([offsets, *(one[1] for one in others)])
        floor, spread = max(STRESS_FLOOR, _LOWERED * floor), 0.95 * spread
    stiff = stiffnesses > 0
    directions, offsets, stiffnesses = best[0][stiff], best[1][stiff], stiffnesses[stiff]
    ramps = rng.normal(size=(options.ramps, 6))
    ramps *= rng.uniform(1.0, 4.0, (options.ramps, 1)) / np.linalg.norm(ramps, axis=1, keepdims=True)
    thresholds = -np.einsum("ki,ki->k", ramps, x[rng.integers(len(x), size=options.ramps)])
    network = Springs(
        ramps, thresholds, directions, np.zeros((len(offsets), options.ramps)), offsets,
        stiffnesses, np.maximum(tail[:6], 1e-6), np.zeros((0, 6)), np.zeros(0), np.zeros(0),
    )  # fmt: skip
    return unknowns_of(network, float(problem.energies.min()) + tail[6])


def _drawn(x: Array, count: int, rng: np.random.Generator) -> tuple[Array, Array]:
    """Directions (count, 6), some of few strains only, and offsets with thresholds near states."""
    directions = rng.normal(size=(count, 6))
    directions *= rng.uniform(size=directions.shape) < rng.choice([0.3, 0.5, 1.0], size=(count, 1))
    gains = np.exp(rng.uniform(np.log(_LEAST_GAIN), np.log(_LARGEST_GAIN), (count, 1)))
    directions *= gains / np.linalg.norm(directions + 1e-6, axis=1, keepdims=True)
    states = x[rng.integers(len(x), size=count)]
    return directions, rng.normal(size=count) - np.einsum("ki,ki->k", directions, states)


def _varied(
    x: Array, directions: Array, offsets: Array, spread: float, rng: np.random.Generator
) -> tuple[Array, Array]:
    """Springs like these: turned about one of the states, stretched and shifted."""
    pick, states = rng.integers(len(offsets), size=_VARIED), x[rng.integers(len(x), size=_VARIED)]
    directions, offsets = directions[pick], offsets[pick]
    amount = spread * np.exp(1.2 * rng.normal(size=(_VARIED, 1)))
    there = np.einsum("ki,ki->k", directions, states) + offsets
    turn = rng.normal(size=directions.shape) * (rng.uniform(size=directions.shape) < 0.5)
    gain = np.exp(np.clip(amount * rng.normal(size=(_VARIED, 1)), -2, 2))
    directions = (directions + amount * np.linalg.norm(directions, axis=1, keepdims=True) * turn) * gain
    there = there * gain[:, 0] + 2 * amount[:, 0] * rng.normal(size=_VARIED)
    return directions, there - np.einsum("ki,ki->k", directions, states)


def _chosen(
    problem: Problem, directions: Array, offsets: Array, floor: float
) -> tuple[NDArray[np.int64], Array, Array]:
    """Springs that stay stiff, at most as many as asked; their stiffnesses; those of the background, and c."""
    weights = problem.weights(floor)
    columns = np.concatenate(
        [problem.states.by_stiffness(directions, offsets), problem.states.by_background()]
    )
    target = problem.target.copy()
    target[0] -= problem.energies.min()
    rows = (columns * weights).reshape(len(columns), -1)
    matrix, right = rows @ rows.T, rows @ (weights * target).ravel()
    size = np.sqrt(np.diag(matrix)) + 1e-300
    matrix, right = matrix / size / size[:, None], right / size
    matrix[np.diag_indices(len(matrix))] += 1e-9
    count = len(offsets)

    def stiffest(chosen: NDArray[np.int64]) -> Array:
        lower = np.linalg.cholesky(matrix[np.ix_(chosen, chosen)])
        return nnls(lower.T, np.linalg.solve(lower, right[chosen]), maxiter=30 * len(chosen))[0]

    found = stiffest(np.arange(len(matrix)))[:count]
    kept = np.flatnonzero(found > 0)
    kept = kept[np.argsort(found[kept])[-problem.options.springs :]]
    chosen = np.concatenate([kept, np.arange(count, len(matrix))])
    values = stiffest(chosen) / size[chosen]
    return kept, values[: len(kept)], values[len(kept) :]
