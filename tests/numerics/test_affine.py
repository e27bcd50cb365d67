"""Affine parametrisations against dense linear algebra."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.sparse import csr_array
from scipy.spatial.transform import Rotation

from yarnscale.numerics.affine import CopiedNodes, KeptPull, MappedObjective, NodeMap
from yarnscale.numerics.factor import SymmetricPattern
from yarnscale.numerics.newton import NewtonOptions, minimise


def lower_pattern(matrix: np.ndarray) -> SymmetricPattern:
    n = len(matrix)
    keys = [j * n + i for j in range(n) for i in range(j, n) if i == j or matrix[i, j] != 0]
    return SymmetricPattern.from_keys(n, np.array(keys, np.int64))


class Model:
    def __init__(self, matrix: np.ndarray, pattern: SymmetricPattern) -> None:
        self.matrix, self.pattern = matrix, pattern

    def values(self, shift: float) -> np.ndarray:
        columns = np.repeat(np.arange(self.pattern.size), np.diff(self.pattern.starts))
        return (self.matrix + shift * np.diag(np.arange(1.0, len(self.matrix) + 1)))[self.pattern.rows, columns]


class Quartic:
    """½ xᵀ A x − bᵀ x + ¼ Σ x⁴ with a sparse A."""

    residual_scale = 2.0

    def __init__(self, n: int, seed: int) -> None:
        rng = np.random.default_rng(seed)
        matrix = rng.normal(size=(n, n)) * (rng.random((n, n)) < 0.3)
        self.matrix = matrix + matrix.T + 6 * np.eye(n)
        self.right = rng.normal(size=n)
        self.pattern = lower_pattern(self.matrix)

    def value(self, x: np.ndarray) -> float:
        return float(0.5 * x @ self.matrix @ x - self.right @ x + 0.25 * (x**4).sum())

    def gradient(self, x: np.ndarray) -> tuple[float, np.ndarray]:
        return self.value(x), self.matrix @ x - self.right + x**3

    def hessian(self, x: np.ndarray) -> np.ndarray:
        return self.matrix + np.diag(3 * x**2)

    def quadratic(self, x: np.ndarray) -> tuple[float, np.ndarray, Model]:
        return *self.gradient(x), Model(self.hessian(x), self.pattern)


def dense(model) -> np.ndarray:  # type: ignore[no-untyped-def]
    def of(values: np.ndarray) -> np.ndarray:
        pattern = model.pattern
        columns = np.repeat(np.arange(pattern.size), np.diff(pattern.starts))
        matrix = np.zeros((pattern.size, pattern.size))
        matrix[pattern.rows, columns] = values
        return matrix + np.tril(matrix, -1).T

    return of  # type: ignore[return-value]


@pytest.mark.parametrize("sparse", [False, True])
@pytest.mark.parametrize("seed", [0, 1, 2])
def test_an_objective_of_mapped_nodes_is_the_congruence(seed: int, sparse: bool) -> None:
    rng = np.random.default_rng(seed)
    objective = Quartic(12, seed)
    weights = rng.normal(size=(4, 3)) * (rng.random((4, 3)) < 0.7)
    matrix, offset = np.kron(weights, np.eye(3)), rng.normal(size=12)
    mapped = MappedObjective(objective, NodeMap(csr_array(weights) if sparse else weights, offset))
    for _ in range(2):  # the second time the pattern is kept
        y = rng.normal(size=9)
        x = matrix @ y + offset
        value, gradient, model = mapped.quadratic(y)
        assert value == pytest.approx(objective.value(x), rel=1e-13)
        assert mapped.value(y) == value
        np.testing.assert_allclose(gradient, matrix.T @ objective.gradient(x)[1], rtol=1e-11, atol=1e-11)
        np.testing.assert_allclose(mapped.gradient(y)[1], gradient)
        for shift in (0.0, 0.7):
            inner = objective.hessian(x) + shift * np.diag(np.arange(1.0, 13))
            np.testing.assert_allclose(
                dense(model)(model.values(shift)), matrix.T @ inner @ matrix, rtol=1e-10, atol=1e-11
            )
    assert mapped.residual_scale == 2.0


def test_the_pattern_of_a_mapped_objective_is_one_object() -> None:
    """Newton keeps its symbolic analysis as long as the pattern is the same object."""
    mapped = MappedObjective(Quartic(6, 0), NodeMap(np.ones((2, 1)), np.zeros(6)))
    assert mapped.quadratic(np.zeros(3))[2].pattern is mapped.quadratic(np.ones(3))[2].pattern


def test_a_pull_that_is_kept_serves_matrices_of_its_pattern_alone() -> None:
    nodes = NodeMap(np.random.default_rng(3).normal(size=(2, 2)), np.zeros(6))
    matrix, kept = np.kron(nodes.weights, np.eye(3)), KeptPull(nodes)
    first, second = Quartic(6, 0), Quartic(6, 5)
    assert len(first.pattern.rows) != len(second.pattern.rows)
    assert kept.of(first.pattern) is kept.of(first.pattern)
    for objective in (first, second, first):
        _, _, model = MappedObjective(objective, nodes, pull=kept).quadratic(np.zeros(6))
        np.testing.assert_allclose(
            dense(model)(model.values(0.0)), matrix.T @ objective.hessian(np.zeros(6)) @ matrix, atol=1e-12
        )


def test_minimises_over_the_nodes_that_are_free() -> None:
    """At the minimum no force is left that the free nodes could follow."""
    objective, weights = Quartic(12, 4), np.array([[1.0, 0.0], [0.5, 0.5], [0.0, 1.0], [0.0, 0.0]])
    mapped = MappedObjective(objective, NodeMap(weights, np.linspace(-1, 1, 12)))
    solution = minimise(mapped, np.zeros(6), NewtonOptions(tolerance=1e-10))
    assert solution.converged
    x = np.kron(weights, np.eye(3)) @ solution.x + np.linspace(-1, 1, 12)
    np.testing.assert_allclose(np.kron(weights, np.eye(3)).T @ objective.gradient(x)[1], 0.0, atol=1e-8)


@pytest.mark.parametrize("turned", [False, True])
def test_copied_nodes_are_an_affine_map(turned: bool) -> None:
    rng = np.random.default_rng(1)
    source = np.array([0, 1, 2, 0, 0, 2])
    rotation = Rotation.random(6, random_state=1).as_matrix() if turned else np.empty((0, 3, 3))
    nodes = CopiedNodes(source, rotation, rng.normal(size=(6, 3)), 3, 2)
    free = rng.normal(size=nodes.free_count)
    turn = rotation if turned else np.tile(np.eye(3), (6, 1, 1))
    matrix = np.zeros((20, 11))
    for m, s in enumerate(source):
        matrix[3 * m : 3 * m + 3, 3 * s : 3 * s + 3] = turn[m]
    matrix[18:, 9:] = np.eye(2)
    offset = np.concatenate([nodes.offset.ravel(), np.zeros(2)])
    np.testing.assert_allclose(nodes.expand(free), matrix @ free + offset, rtol=1e-13, atol=1e-14)
    force = rng.normal(size=20)
    np.testing.assert_allclose(nodes.pull_gradient(force), matrix.T @ force, rtol=1e-13, atol=1e-14)
    unknowns = nodes.unknowns(np.arange(20))
    expected = [3 * s + i for s in source for i in range(3)] + [9, 10]
    np.testing.assert_array_equal(unknowns, expected)
