"""Chains of constraints are eliminated as they are by multipliers."""

from __future__ import annotations

import numpy as np
import pytest

from yarnscale.numerics.block_pattern import BlockPattern
from yarnscale.numerics.factor import SymmetricPattern
from yarnscale.numerics.null_space import Chain, ChainConstraints, NullSpaceSolver

SIZES = np.array([3, 3, 3, 3, 3, 3, 1, 1, 1, 1, 3, 2])
"""Two chains of vertices, one of scalars, and groups that no chain binds."""


class _Model:
    """H + shift·1 on a pattern of groups that meet at random."""

    def __init__(self, seed: int = 0) -> None:
        generator = np.random.default_rng(seed)
        ends = np.cumsum(SIZES)
        pairs = [
            np.concatenate([np.arange(ends[g] - SIZES[g], ends[g]) for g in np.unique(generator.integers(0, 12, 3))])
            for _ in range(25)
        ]
        rows = np.full((len(pairs), 9), -1)
        dense = np.zeros((ends[-1], ends[-1]))
        for k, pair in enumerate(pairs):
            rows[k, : len(pair)] = pair
            root = generator.standard_normal((len(pair), len(pair)))
            dense[np.ix_(pair, pair)] += root @ root.T
        self.dense = dense + 0.5 * np.eye(len(dense))
        self.pattern: SymmetricPattern = BlockPattern.of(SIZES, [rows]).pattern

    def values(self, shift: float) -> np.ndarray:
        columns = np.repeat(np.arange(self.pattern.size), np.diff(self.pattern.starts))
        return (self.dense + shift * np.eye(len(self.dense)))[self.pattern.rows, columns]


@pytest.fixture
def constraints() -> ChainConstraints:
    generator = np.random.default_rng(1)
    chains = [
        Chain(np.array([0, 2, 4, 1]), generator.standard_normal((4, 3))),
        Chain(np.array([3, 5]), generator.standard_normal((2, 3))),
        Chain(np.array([6, 8, 7, 9]), generator.uniform(0.5, 2.0, (4, 1))),
    ]
    everywhere = generator.standard_normal((2, int(SIZES.sum())))
    return ChainConstraints(SIZES, chains, everywhere)


def _rows(constraints: ChainConstraints) -> np.ndarray:
    first = np.cumsum(SIZES) - SIZES
    rows = []
    for chain in constraints.chains:
        row = np.zeros(int(SIZES.sum()))
        for group, coefficients in zip(chain.groups, chain.coefficients, strict=True):
            row[first[group] : first[group] + len(coefficients)] = coefficients
        rows.append(row)
    return np.vstack([*rows, constraints.everywhere])


def test_the_basis_spans_what_the_chains_leave(constraints: ChainConstraints) -> None:
    rows, basis = _rows(constraints)[:3], constraints.null.toarray()
    assert basis.shape[1] == SIZES.sum() - 3 == np.linalg.matrix_rank(basis)
    np.testing.assert_allclose(rows @ basis, 0.0, atol=1e-12)


def test_rows_are_orthonormal_and_project_on_what_all_constraints_leave(
    constraints: ChainConstraints,
) -> None:
    matrix = constraints.matrix.toarray()
    np.testing.assert_allclose(matrix @ matrix.T, np.eye(5), atol=1e-12)
    vector = np.random.default_rng(2).standard_normal(int(SIZES.sum()))
    np.testing.assert_allclose(_rows(constraints) @ constraints.project(vector), 0.0, atol=1e-12)


@pytest.mark.parametrize("shift", [0.0, 0.3])
@pytest.mark.parametrize("infeasible", [False, True])
def test_steps_are_those_of_the_whole_system(constraints: ChainConstraints, shift: float, infeasible: bool) -> None:
    model, generator = _Model(), np.random.default_rng(3)
    right = generator.standard_normal(int(SIZES.sum()))
    gap = generator.standard_normal(5) if infeasible else None
    solver = NullSpaceSolver(constraints)
    assert solver.factorise(model, shift)
    rows, n = constraints.matrix.toarray(), len(right)
    system = np.block([[model.dense + shift * np.eye(n), rows.T], [rows, np.zeros((5, 5))]])
    expected = np.linalg.solve(system, np.concatenate([right, np.zeros(5) if gap is None else gap]))[:n]
    for _ in range(2):  # with fresh columns and with kept ones
        np.testing.assert_allclose(solver.step(right, gap), expected, atol=1e-9)
    if gap is None:
        both = solver.step(np.column_stack([right, 2.0 * right]), None)
        np.testing.assert_allclose(both, np.column_stack([expected, 2.0 * expected]), atol=1e-9)


def test_a_matrix_that_is_negative_along_the_constraints_is_refused(constraints: ChainConstraints) -> None:
    model = _Model()
    model.dense -= 200.0 * np.eye(len(model.dense))
    solver = NullSpaceSolver(constraints)
    assert not solver.factorise(model, 0.0)
    assert solver.factorise(model, 201.0)


def test_rows_that_chains_imply_are_left_out() -> None:
    """Everywhere the same as a chain, as where all yarns are straight and parallel."""
    row = np.zeros(int(SIZES.sum()))
    row[:6] = 1.0
    chains = [Chain(np.array([0, 1]), np.ones((2, 3)))]
    constraints = ChainConstraints(SIZES, chains, row[None])
    assert constraints.matrix.shape[0] == 1
    solver = NullSpaceSolver(constraints)
    assert solver.factorise(_Model(), 0.0)
    step = solver.step(np.ones(int(SIZES.sum())), None)
    assert abs(row @ step) < 1e-12
