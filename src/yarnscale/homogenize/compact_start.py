"""Where the search for a compact energy starts: springs chosen from many, by their stiffnesses alone.

With directions, bends and thresholds fixed, the energy is linear in the stiffnesses, and they must not be negative:
least squares with that condition finds the best of all, and leaves most springs without stiffness. Those that keep some
stay; others are drawn again, most of them near the ones that stayed, and all compete anew. A round takes some
hundredths of a second, needs no derivative by directions, and does not get stuck where one spring is needed far from
all others.
"""

from __future__ import annotations

import numpy as np

from yarnscale.arrays import Array
from yarnscale.homogenize.compact_problem import FIT_FLOOR, NonNegative, Problem
from yarnscale.homogenize.spring_jacobian import unknowns_of
from yarnscale.shell.materials.compact import SpringNetwork

_FIRST_FLOOR, _LOWERED = 0.3, 0.85
"""Floor of the first round [N/m], and what each round leaves of it."""
_FRESH, _VARIED = 70, 200
"""Springs drawn at random, and near those that stayed, in a round."""
_LEAST_GAIN, _LARGEST_GAIN = 0.5, 15.0
"""Range of |Q|: a spring tightens within a strain of about one over it."""
_LEAST_TOP = 0.0
"""Every spring is at least this tight, u, at some state: the tail of a stiffer one would be a wall close outside."""


def start_of(problem: Problem, rng: np.random.Generator) -> Array:
    """Unknowns of springs that were chosen in rounds; steps are random."""
    options, x = problem.options, problem.data.x
    steps = rng.normal(size=(options.steps, 6))
    steps *= rng.uniform(1.0, 4.0, (options.steps, 1)) / np.linalg.norm(steps, axis=1, keepdims=True)
    thresholds = -np.einsum("ki,ki->k", steps, x[rng.integers(len(x), size=options.steps)])
    none = np.zeros((0, 6)), np.zeros(0)
    springs = SpringNetwork(
        steps,
        thresholds,
        none[0],
        np.zeros((0, options.steps)),
        none[1],
        none[1],
        np.zeros(6),
        *none,
        none[1],
    )
    springs = _joined(springs, _drawn(x, options.steps, _FRESH + _VARIED, rng), x)
    floor, spread, constant = _FIRST_FLOOR, 0.5, 0.0
    for turn in range(options.rounds):
        if turn:
            varied, drawn = _varied(x, springs, spread, rng), _drawn(x, options.steps, _FRESH, rng)
            springs = _joined(springs, np.concatenate([varied, drawn]), x)
            floor, spread = max(FIT_FLOOR, _LOWERED * floor), 0.95 * spread
        springs, constant = _selected(problem, springs, problem.weights(floor))
    return unknowns_of(springs, constant)


def _inputs(springs: SpringNetwork, x: Array) -> Array:
    """What springs read of states, (n, 6 + steps)."""
    bent = x @ springs.steps.T + springs.step_offsets
    return np.column_stack([x, bent / np.sqrt(1.0 + bent * bent)])


def _joined(springs: SpringNetwork, rows: Array, x: Array) -> SpringNetwork:
    """With further springs, rows (Q, W, q)."""
    top = (_inputs(springs, x) @ rows[:, :-1].T + rows[:, -1]).max(axis=0)
    return springs._replace(
        springs=np.concatenate([springs.springs, rows[:, :6]]),
        bends=np.concatenate([springs.bends, rows[:, 6:-1]]),
        spring_offsets=np.append(springs.spring_offsets, rows[:, -1] + np.maximum(0.0, _LEAST_TOP - top)),
        stiffnesses=np.append(springs.stiffnesses, np.ones(len(rows))),
    )


def _drawn(x: Array, steps: int, count: int, rng: np.random.Generator) -> Array:
    """Straight springs with thresholds near states, some of few strains only, (count, 6 + steps + 1)."""
    directions = rng.normal(size=(count, 6))
    directions *= rng.uniform(size=directions.shape) < rng.choice([0.3, 0.5, 1.0], size=(count, 1))
    gains = np.exp(rng.uniform(np.log(_LEAST_GAIN), np.log(_LARGEST_GAIN), (count, 1)))
    directions *= gains / np.linalg.norm(directions + 1e-6, axis=1, keepdims=True)
    states = x[rng.integers(len(x), size=count)]
    offsets = rng.normal(size=count) - np.einsum("ki,ki->k", directions, states)
    return np.column_stack([directions, np.zeros((count, steps)), offsets])


def _varied(x: Array, springs: SpringNetwork, spread: float, rng: np.random.Generator) -> Array:
    """Springs like these: turned about one of the states, bent, stretched and shifted, (count, 6 + steps + 1).

    Without any, new ones at random.
    """
    if not len(springs.springs):
        return _drawn(x, springs.bends.shape[1], _VARIED, rng)
    pick = rng.integers(len(springs.springs), size=_VARIED)
    inputs = _inputs(springs, x[rng.integers(len(x), size=_VARIED)])
    rows = np.column_stack([springs.springs, springs.bends])[pick]
    amount = spread * np.exp(1.2 * rng.normal(size=(_VARIED, 1)))
    there = np.einsum("ki,ki->k", rows, inputs) + springs.spring_offsets[pick]
    turn = rng.normal(size=rows.shape) * (rng.uniform(size=rows.shape) < 0.5)
    turn[:, 6:] *= 0.5 * (rng.uniform(size=(_VARIED, 1)) < 0.7)
    gain = np.exp(np.clip(amount * rng.normal(size=(_VARIED, 1)), -2, 2))
    rows = (rows + amount * np.linalg.norm(rows[:, :6], axis=1, keepdims=True) * turn) * gain
    there = there * gain[:, 0] + 2 * amount[:, 0] * rng.normal(size=_VARIED)
    return np.column_stack([rows, there - np.einsum("ki,ki->k", rows, inputs)])


@np.errstate(over="ignore", invalid="ignore")
def _selected(problem: Problem, springs: SpringNetwork, weights: Array) -> tuple[SpringNetwork, float]:
    """The stiffest springs, at most ``options.springs``, with the best stiffnesses and background; the constant."""
    columns = np.concatenate([problem.coarse.by_stiffness(springs), problem.coarse.by_background()])
    squares, count = NonNegative.of(columns, weights, problem.target), len(springs.springs)
    found = squares.scaled(np.arange(len(columns)))[:count]
    kept = np.argsort(found)[-problem.options.springs :]
    mine = np.concatenate([kept[found[kept] > 0], np.arange(count, len(columns))])
    values = squares.solved(mine)
    stiff = values[:-7] > 0
    kept, stiffnesses, background = mine[:-7][stiff], values[:-7][stiff], np.maximum(values[-7:-1], 1e-6)
    network = springs._replace(
        springs=springs.springs[kept], bends=springs.bends[kept], spring_offsets=springs.spring_offsets[kept],
        stiffnesses=stiffnesses, background=background,
    )  # fmt: skip
    return network, float(values[-1])
