"""Derivatives of constrained minima against dense linear algebra and re-solved minima."""

from __future__ import annotations

import numpy as np
import pytest

from yarnscale.numerics.factor import SymmetricPattern
from yarnscale.numerics.implicit import ConstrainedInverse
from yarnscale.numerics.kkt import LinearConstraints
from yarnscale.numerics.linear_solver import linear_solver
from yarnscale.numerics.newton import NewtonOptions, minimise


class Model:
    def __init__(self, matrix: np.ndarray) -> None:
        n = len(matrix)
        self.matrix = matrix
        self.pattern = SymmetricPattern.from_keys(n, np.array([j * n + i for j in range(n) for i in range(j, n)]))

    def values(self, shift: float) -> np.ndarray:
        columns = np.repeat(np.arange(self.pattern.size), np.diff(self.pattern.starts))
        return (self.matrix + shift * np.eye(self.pattern.size))[self.pattern.rows, columns]


def kkt_inverse(matrix: np.ndarray, rows: np.ndarray, right: np.ndarray) -> np.ndarray:
    m, n = rows.shape
    system = np.block([[matrix, rows.T], [rows, np.zeros((m, m))]])
    return np.linalg.solve(system, np.concatenate([right, np.zeros((m, right.shape[1]))]))[:n]


@pytest.mark.parametrize("indefinite", [False, True], ids=["definite", "indefinite across the constraints"])
@pytest.mark.parametrize("shift", [1e-8, 1e-2])
def test_constrained_inverse_against_the_dense_kkt_system(indefinite: bool, shift: float) -> None:
    rng = np.random.default_rng(0)
    rows = rng.normal(size=(3, 14))
    root = rng.normal(size=(14, 14))
    matrix = root @ root.T + 0.5 * np.eye(14)
    if indefinite:
        matrix -= 2.0 * rows.T @ rows
        assert np.linalg.eigvalsh(matrix)[0] < 0
    right = rng.normal(size=(14, 4))
    constraints = LinearConstraints(rows, np.zeros(3))
    inverse = ConstrainedInverse(Model(matrix), constraints, shift=shift)
    found = inverse.apply(right)
    np.testing.assert_allclose(found, kkt_inverse(matrix, rows, right), rtol=1e-7, atol=1e-8)
    np.testing.assert_allclose(rows @ found, 0, atol=1e-9)


def test_without_constraints_it_is_the_inverse() -> None:
    rng = np.random.default_rng(1)
    root = rng.normal(size=(8, 8))
    matrix = root @ root.T + np.eye(8)
    right = rng.normal(size=(8, 3))
    np.testing.assert_allclose(
        ConstrainedInverse(Model(matrix)).apply(right), np.linalg.solve(matrix, right), rtol=1e-8, atol=1e-9
    )


def test_a_zero_right_hand_side_gives_zero() -> None:
    assert not ConstrainedInverse(Model(np.eye(3))).apply(np.zeros((3, 2))).any()


def test_a_saddle_has_no_inverse() -> None:
    with pytest.raises(ArithmeticError, match="no minimum"):
        ConstrainedInverse(Model(np.diag([1.0, -0.5, 2.0]))).apply(np.ones((3, 1)))


def test_a_matrix_of_nan_has_no_inverse() -> None:
    with pytest.raises(ArithmeticError, match="factored"):
        ConstrainedInverse(Model(np.full((3, 3), np.nan)))


def test_the_shift_may_start_at_zero() -> None:
    """An indefinite matrix needs one, and zero times ten is zero."""
    rows = np.array([[0.0, 1.0]])
    inverse = ConstrainedInverse(Model(np.diag([2.0, -1.0])), LinearConstraints(rows, np.zeros(1)), shift=0.0)
    np.testing.assert_allclose(inverse.apply(np.array([[1.0], [1.0]])), [[0.5], [0.0]], atol=1e-9)


class Spring:
    """Σ cosh(x_k − p a_k) + ½ xᵀ A x + p² x₀: nonlinear in x and in the parameter p."""

    residual_scale = 1.0

    def __init__(self, p: float) -> None:
        rng = np.random.default_rng(2)
        root = rng.normal(size=(6, 6))
        self.p, self.a, self.matrix = p, rng.normal(size=6), root @ root.T

    def value(self, x: np.ndarray) -> float:
        tip = float(np.cosh(x - self.p * self.a).sum())
        return tip + float(0.5 * x @ self.matrix @ x + self.p**2 * x[0])

    def gradient(self, x: np.ndarray) -> tuple[float, np.ndarray]:
        g = np.sinh(x - self.p * self.a) + self.matrix @ x
        g[0] += self.p**2
        return self.value(x), g

    def quadratic(self, x: np.ndarray) -> tuple[float, np.ndarray, Model]:
        return *self.gradient(x), Model(self.matrix + np.diag(np.cosh(x - self.p * self.a)))

    def by_parameter(self, x: np.ndarray) -> tuple[float, np.ndarray, float]:
        """E,p  E,xp  E,pp."""
        y = x - self.p * self.a
        mixed = -self.a * np.cosh(y)
        mixed[0] += 2 * self.p
        explicit = float(-self.a @ np.sinh(y) + 2 * self.p * x[0])
        return explicit, mixed, float((self.a**2 * np.cosh(y)).sum() + 2 * x[0])


def test_derivatives_of_a_minimum_against_re_solved_minima() -> None:
    constraints = LinearConstraints(np.ones((1, 6)), np.array([0.4]))

    def solve(p: float):  # type: ignore[no-untyped-def]
        solution = minimise(Spring(p), np.zeros(6), NewtonOptions(tolerance=1e-12), linear=linear_solver(constraints))
        assert solution.converged
        return solution

    p, h = 0.7, 1e-4
    at, ahead, behind = solve(p), solve(p + h), solve(p - h)
    explicit, mixed, second = Spring(p).by_parameter(at.x)
    slope = -ConstrainedInverse(Spring(p).quadratic(at.x)[2], constraints).apply(mixed[:, None])[:, 0]
    np.testing.assert_allclose(slope, (ahead.x - behind.x) / (2 * h), rtol=1e-6, atol=1e-8)
    assert explicit == pytest.approx((ahead.value - behind.value) / (2 * h), rel=1e-7)
    curvature = (Spring(p + h).by_parameter(ahead.x)[0] - Spring(p - h).by_parameter(behind.x)[0]) / (2 * h)
    assert second + mixed @ slope == pytest.approx(curvature, rel=1e-6)
