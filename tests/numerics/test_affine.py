"""Affine parametrisations against dense linear algebra."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.sparse import csr_array
from scipy.spatial.transform import Rotation

from yarnscale.numerics.affine import AffineMap, CopiedNodes, MappedObjective, NodeMap
from yarnscale.numerics.factor import SymmetricPattern
from yarnscale.numerics.newton import minimise


def lower_pattern(matrix: np.ndarray) -> SymmetricPattern:
    n = len(matrix)
    keys = [j * n + i for j in range(n) for i in range(j, n) if i == j or matrix[i, j] != 0]
    return SymmetricPattern.from_keys(n, np.array(keys, np.int64))


class Model:
    def __init__(self, matrix: np.ndarray, pattern: SymmetricPattern) -> None:
        self.matrix, self.pattern = matrix, pattern

    def values(self, shift: float) -> np.ndarray:
        columns = np.repeat(np.arange(self.pattern.size), np.diff(self.pattern.starts))
        return (self.matrix + shift * np.diag(np.arange(1.0, len(self.matrix) + 1)))[
            self.pattern.rows, columns
        ]


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


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_a_mapped_objective_is_the_congruence(seed: int) -> None:
    rng = np.random.default_rng(seed)
    objective = Quartic(12, seed)
    matrix = rng.normal(size=(12, 7)) * (rng.random((12, 7)) < 0.4)
    mapped = MappedObjective(objective, AffineMap(csr_array(matrix), rng.normal(size=12)))
    for _ in range(2):  # the second time the pattern is kept
        y = rng.normal(size=7)
        x = mapped._affine.expand(y)
        value, gradient, model = mapped.quadratic(y)
        assert value == objective.value(x) == mapped.value(y)
        np.testing.assert_allclose(gradient, matrix.T @ objective.gradient(x)[1], rtol=1e-12, atol=1e-12)
        np.testing.assert_allclose(mapped.gradient(y)[1], gradient)
        for shift in (0.0, 0.7):
            inner = objective.hessian(x) + shift * np.diag(np.arange(1.0, 13))
            np.testing.assert_allclose(
                dense(model)(model.values(shift)), matrix.T @ inner @ matrix, rtol=1e-11, atol=1e-12
            )
    assert mapped.residual_scale == 2.0


def test_the_pattern_of_a_mapped_objective_is_one_object() -> None:
    """Newton keeps its symbolic analysis as long as the pattern is the same object."""
    objective = Quartic(6, 0)
    mapped = MappedObjective(objective, AffineMap(csr_array(np.eye(6)[:, :4]), np.zeros(6)))
    assert mapped.quadratic(np.zeros(4))[2].pattern is mapped.quadratic(np.ones(4))[2].pattern


def test_the_pattern_does_not_depend_on_cancellation() -> None:
    """B = (1, 1) with H = (1, −1 …) cancels at one point only; the entry must exist all the same."""
    objective = Quartic(4, 0)
    matrix = np.array([[1.0, 1.0], [1.0, -1.0], [0.0, 1.0], [1.0, 0.0]])
    mapped = MappedObjective(objective, AffineMap(csr_array(matrix), np.zeros(4)))
    assert mapped.quadratic(np.zeros(2))[2].pattern.entries == 3


def test_pinned_values_stay_and_the_rest_is_minimised() -> None:
    objective = Quartic(10, 4)
    values, pinned = np.linspace(-1, 1, 10), np.zeros(10, bool)
    pinned[[0, 3, 9]] = True
    affine = AffineMap.pinning(values, pinned)
    solution = minimise(MappedObjective(objective, affine), np.zeros(7), tolerance=1e-10)
    x = affine.expand(solution.x)
    np.testing.assert_array_equal(x[pinned], values[pinned])
    assert solution.converged
    np.testing.assert_allclose(objective.gradient(x)[1][~pinned], 0.0, atol=1e-9)


def test_everything_pinned_or_nothing_pinned() -> None:
    values = np.arange(3.0)
    np.testing.assert_array_equal(AffineMap.pinning(values, np.ones(3, bool)).expand(np.empty(0)), values)
    np.testing.assert_array_equal(AffineMap.pinning(values, np.zeros(3, bool)).expand(values + 1), values + 1)


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


@pytest.mark.parametrize("sparse", [False, True])
def test_node_map_is_its_kronecker_product(sparse: bool) -> None:
    objective, rng = Quartic(12, 5), np.random.default_rng(6)
    weights, offset = rng.normal(size=(4, 2)), rng.normal(size=12)
    nodes = NodeMap(csr_array(weights) if sparse else weights, offset)
    matrix = AffineMap(csr_array(np.kron(weights, np.eye(3))), offset)
    x = rng.normal(size=6)
    found, expected = (MappedObjective(objective, m).quadratic(x) for m in (nodes, matrix))
    assert found[0] == pytest.approx(expected[0], rel=1e-13)
    np.testing.assert_allclose(found[1], expected[1], rtol=1e-12)
    np.testing.assert_allclose(
        dense(found[2])(found[2].values(0.3)), dense(expected[2])(expected[2].values(0.3))
    )
