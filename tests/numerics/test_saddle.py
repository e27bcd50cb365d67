"""KKT systems factored whole."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.sparse import csr_array

from yarnscale.numerics.factor import SymmetricPattern
from yarnscale.numerics.kkt import LinearConstraints
from yarnscale.numerics.linear_solver import linear_solver
from yarnscale.numerics.newton import minimise
from yarnscale.numerics.saddle import SaddleSolver, SparseConstraints

SIZE, ROWS = 30, 9


class _Quadratic:
    """½ xᵀ A x − b·x with the full pattern."""

    residual_scale = 1.0

    def __init__(self, matrix: np.ndarray, right: np.ndarray) -> None:
        self.matrix, self.right = matrix, right
        column, row = np.triu_indices(SIZE)
        self.pattern = SymmetricPattern.from_keys(SIZE, column * SIZE + row)

    def values(self, shift: float) -> np.ndarray:
        columns = np.repeat(np.arange(SIZE), np.diff(self.pattern.starts))
        return (self.matrix + shift * np.eye(SIZE))[self.pattern.rows, columns]

    def value(self, x: np.ndarray) -> float:
        return float(0.5 * x @ self.matrix @ x - self.right @ x)

    def gradient(self, x: np.ndarray) -> tuple[float, np.ndarray]:
        return self.value(x), self.matrix @ x - self.right

    def quadratic(self, x: np.ndarray) -> tuple[float, np.ndarray, _Quadratic]:
        return *self.gradient(x), self


@pytest.fixture
def rows() -> np.ndarray:
    return np.random.default_rng(1).standard_normal((ROWS, SIZE))


def _matrix(seed: int = 0) -> np.ndarray:
    root = np.random.default_rng(seed).standard_normal((SIZE, SIZE))
    return root @ root.T + np.eye(SIZE)


def test_solves_the_kkt_system(rows: np.ndarray) -> None:
    generator, matrix = np.random.default_rng(2), _matrix()
    right, gap = generator.standard_normal(SIZE), generator.standard_normal(ROWS)
    solver = SaddleSolver(SparseConstraints(csr_array(rows), np.zeros(ROWS)))
    assert solver.factorise(_Quadratic(matrix, right), 0.0)
    system = np.block([[matrix, rows.T], [rows, np.zeros((ROWS, ROWS))]])
    expected = np.linalg.solve(system, np.concatenate([right, gap]))[:SIZE]
    np.testing.assert_allclose(solver.step(right, gap), expected, rtol=1e-9, atol=1e-12)


def test_pivots_tell_definiteness_on_the_constraints(rows: np.ndarray) -> None:
    """A − c·Cᵀ C is indefinite, but positive where C p = 0; a negative direction within C p = 0 is found."""
    matrix = _matrix() - 100.0 * rows.T @ rows
    free = np.linalg.svd(rows)[2][ROWS:]
    solver = SaddleSolver(SparseConstraints(csr_array(rows), np.zeros(ROWS)))
    assert np.linalg.eigvalsh(matrix)[0] < 0
    assert solver.factorise(_Quadratic(matrix, np.zeros(SIZE)), 0.0)
    assert not solver.factorise(_Quadratic(matrix - 1e4 * np.outer(free[0], free[0]), np.zeros(SIZE)), 0.0)


def test_same_minimum_as_eliminated_constraints(rows: np.ndarray) -> None:
    generator = np.random.default_rng(3)
    objective = _Quadratic(_matrix(), generator.standard_normal(SIZE))
    right = generator.standard_normal(ROWS)
    whole = minimise(objective, np.zeros(SIZE), linear=linear_solver(SparseConstraints(csr_array(rows), right)))
    few = minimise(objective, np.zeros(SIZE), linear=linear_solver(LinearConstraints(rows, right)))
    assert whole.converged
    np.testing.assert_allclose(whole.x, few.x, rtol=1e-6, atol=1e-9)


def test_projection_is_along_the_rows(rows: np.ndarray) -> None:
    vector = np.random.default_rng(4).standard_normal(SIZE)
    projected = SparseConstraints(csr_array(rows), np.zeros(ROWS)).project(vector)
    np.testing.assert_allclose(projected, LinearConstraints(rows, np.zeros(ROWS)).project(vector), atol=1e-12)


@pytest.mark.parametrize("fewer", [False, True])
def test_renewed_constraints_project_along_their_own_rows(rows: np.ndarray, fewer: bool) -> None:
    """With the sparsity of the earlier ones, whose analysis they use, or with another."""
    earlier, vector = SparseConstraints(csr_array(rows), np.zeros(ROWS)), np.random.default_rng(4).standard_normal(SIZE)
    before, other = earlier.project(vector), 2.0 + rows**2
    if fewer:
        other[:4, :15] = other[4:, 15:] = 0.0
    projected = earlier.renewed(csr_array(other), np.zeros(ROWS)).project(vector)
    np.testing.assert_allclose(projected, LinearConstraints(other, np.zeros(ROWS)).project(vector), atol=1e-11)
    np.testing.assert_allclose(earlier.project(vector), before, atol=1e-14)
