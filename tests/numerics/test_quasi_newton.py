"""Kept factors: the minimum is found with few of them, failures are told, the energy never rises."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest

from yarnscale.numerics.factor import SymmetricPattern
from yarnscale.numerics.kkt import ConstrainedSolver
from yarnscale.numerics.newton import NewtonOptions, Status
from yarnscale.numerics.quasi_newton import KeepRule, minimise_keeping_factors

SIZE = 40


class Chain:
    """Σ cosh-like springs between neighbours and to the ground, convex; the model is stiffer than the truth."""

    residual_scale = 1.0

    def __init__(self, *, wall: float = math.inf) -> None:
        self.wall, self.models = wall, 0
        rows = [j * SIZE + i for j in range(SIZE) for i in (j, j + 1) if i < SIZE]
        self.pattern = SymmetricPattern.from_keys(SIZE, np.array(rows))

    def value(self, x: np.ndarray) -> float:
        return self.gradient(x)[0]

    def gradient(self, x: np.ndarray) -> tuple[float, np.ndarray]:
        if np.abs(x).max() > self.wall:
            return math.inf, np.full(SIZE, np.nan)
        gaps = np.diff(x, prepend=0.0) - 0.3
        value = float(np.sum(np.sqrt(1 + 25 * gaps**2)) + 0.01 * x @ x)
        slope = 25 * gaps / np.sqrt(1 + 25 * gaps**2)
        return value, slope - np.append(slope[1:], 0.0) + 0.02 * x

    def quadratic(self, x: np.ndarray) -> tuple[float, np.ndarray, Chain]:
        self.models += 1
        return *self.gradient(x), self

    def values(self, shift: float) -> np.ndarray:
        columns = np.repeat(np.arange(SIZE), np.diff(self.pattern.starts))
        return np.where(self.pattern.rows == columns, 50.02, -25.0) * 1.0 + 0.0 * shift


def test_the_minimum_is_found_with_few_factors() -> None:
    chain, solver = Chain(), ConstrainedSolver()
    solution = minimise_keeping_factors(chain, np.zeros(SIZE), NewtonOptions(1e-8), linear=solver)
    assert solution.converged and solution.iterations > 10
    assert np.linalg.norm(chain.gradient(solution.x)[1]) <= 1e-8
    assert solution.factorisations <= 2 + solution.iterations / 25
    assert solver.analyses == 1
    assert all(b[0] <= a[0] + 1e-12 for a, b in itertools.pairwise(solution.history))


def test_memory_saves_iterations() -> None:
    counts = [
        minimise_keeping_factors(
            Chain(), np.zeros(SIZE), NewtonOptions(1e-6, max_iterations=3000), KeepRule(memory=memory)
        ).iterations
        for memory in (0, 12)
    ]
    assert counts[1] < 0.6 * counts[0]


def test_large_forces_renew_the_factor_every_time() -> None:
    chain = Chain()
    keep = KeepRule(while_below=1e-6)
    solution = minimise_keeping_factors(chain, np.zeros(SIZE), NewtonOptions(1e-6, max_iterations=40), keep)
    assert solution.iterations == 40 and chain.models == solution.factorisations == 40


def test_a_bound_is_kept_and_limits_every_step() -> None:
    farthest: list[float] = []
    solution = minimise_keeping_factors(
        Chain(),
        np.zeros(SIZE),
        NewtonOptions(1e-6, max_iterations=3000),
        bound=lambda x, step: min(1.0, 0.05 / np.abs(step).max()),
        after_step=lambda x: farthest.append(float(x.max())),
    )
    assert solution.converged
    assert max(b - a for a, b in itertools.pairwise([0.0, *farthest])) <= 0.05 + 1e-12


def test_endings_are_told() -> None:
    few = minimise_keeping_factors(Chain(), np.zeros(SIZE), NewtonOptions(1e-12, max_iterations=3))
    assert few.status is Status.ITERATION_LIMIT and few.iterations == 3
    outside = minimise_keeping_factors(Chain(wall=0.5), np.full(SIZE, 1.0), NewtonOptions())
    assert outside.status is Status.INVALID and not math.isfinite(outside.residual)
    walled = minimise_keeping_factors(Chain(wall=0.5), np.zeros(SIZE), NewtonOptions(1e-8))
    assert walled.status in (Status.STALLED, Status.ITERATION_LIMIT) and np.abs(walled.x).max() <= 0.5
    assert walled.value == pytest.approx(Chain().value(walled.x))


class Valley:
    """Chained curved valleys (Rosenbrock) with the model of Gauss and Newton."""

    residual_scale, size, stiff = 1.0, 40, 30.0

    def __init__(self) -> None:
        rows = [j * self.size + i for j in range(self.size) for i in (j, j + 1) if i < self.size]
        self.pattern = SymmetricPattern.from_keys(self.size, np.array(rows))

    def value(self, x: np.ndarray) -> float:
        return self.gradient(x)[0]

    def gradient(self, x: np.ndarray) -> tuple[float, np.ndarray]:
        off, slope = self.stiff * (x[1:] - x[:-1] ** 2), x - 1.0
        slope[1:] += self.stiff * off
        slope[:-1] -= 2.0 * self.stiff * x[:-1] * off
        return 0.5 * float(off @ off + (x - 1.0) @ (x - 1.0)), slope

    def quadratic(self, x: np.ndarray) -> tuple[float, np.ndarray, Valley]:
        self.at = x.copy()
        return *self.gradient(x), self

    def values(self, shift: float) -> np.ndarray:
        entries, diagonal = np.zeros(self.pattern.entries), np.ones(self.size)
        diagonal[1:] += self.stiff**2
        diagonal[:-1] += (2.0 * self.stiff * self.at[:-1]) ** 2
        entries[self.pattern.diagonal] = diagonal
        entries[self.pattern.diagonal[:-1] + 1] = -2.0 * self.stiff**2 * self.at[:-1]
        return entries


def test_factors_renewed_after_short_steps_save_iterations_in_curved_valleys() -> None:
    counts = []
    for shortest in (0.05, KeepRule().shortest):
        keep = KeepRule(shortest=shortest, while_below=math.inf)
        solution = minimise_keeping_factors(
            Valley(), np.full(Valley.size, -1.2), NewtonOptions(1e-6, max_iterations=1000), keep
        )
        assert solution.converged
        np.testing.assert_allclose(solution.x, 1.0, atol=1e-4)
        counts.append(solution.iterations)
    assert counts[1] < 0.7 * counts[0]
