"""Assembled energies, gradients and Hessians against dense finite differences."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from yarnscale.numerics.affine import CopiedNodes
from yarnscale.numerics.assembly import StencilSet
from yarnscale.numerics.block_pattern import BlockPattern
from yarnscale.numerics.energy import Steadied, StencilEnergy
from yarnscale.numerics.factor import SymmetricPattern
from yarnscale.numerics.kernel import BLOCK, run_columns


def _function(v, p):  # type: ignore[no-untyped-def]
    """Not invariant under anything, so that no term is zero by symmetry."""
    a, b, c, t = v["a"], v["b"], v["c"], v["t"]
    stretch = ca.sqrt(0.3 + ca.dot(a - b, a - b))
    volume = ca.dot(a, ca.cross(b, c)) + ca.dot(c, p["pull"])
    return p["k"] * stretch**3 + ca.sin(volume) + ca.dot(b, c) * ca.sin(t) * c[0] + t**4 + t * a[1] ** 2


ENERGY = StencilEnergy("assembled", {"a": 3, "b": 3, "c": 3, "t": 1}, {"k": 1, "pull": 3}, _function)


class Mesh:
    """Random stencils over turned and shifted copies of few free nodes: a stencil often meets a node twice."""

    def __init__(self, seed: int, *, stencils: int, turned: bool) -> None:
        free_nodes, copies = 5, 17
        rng = np.random.default_rng(seed)
        source = np.concatenate([np.arange(free_nodes), rng.integers(0, free_nodes, copies - free_nodes)])
        rotation = Rotation.random(copies, random_state=seed).as_matrix() if turned else np.empty((0, 3, 3))
        self.nodes = CopiedNodes(source, rotation, 0.3 * rng.normal(size=(copies, 3)), free_nodes, 4)
        corners = np.array([rng.permutation(copies)[:3] for _ in range(stencils)], np.int64)
        corners = corners.reshape(stencils, 3)
        if stencils:
            corners[0] = np.flatnonzero(source == source[-1])[[0, -1, 0]]  # a node and its own image
            corners[0, 2] = (corners[0, 1] + 1) % free_nodes
        scalars = 3 * copies + rng.integers(0, 4, (stencils, 1))
        columns = (3 * corners[:, :, None] + np.arange(3)).reshape(stencils, 9)
        self.variables = np.concatenate([columns, scalars], axis=1)
        self.stencils = StencilSet(ENERGY, self.variables, rng.normal(size=(stencils, 4)), 3)
        self.unknowns = self.nodes.unknowns(self.variables)
        self.sizes = np.concatenate([np.full(free_nodes, 3), np.ones(4, np.int64)])
        self.free = 0.5 * rng.normal(size=self.nodes.free_count)

    def value(self, free: np.ndarray) -> float:
        return self.stencils.value(self.nodes.expand(free))

    def gradient(self, free: np.ndarray) -> np.ndarray:
        full = self.nodes.expand(free)
        gradient = np.zeros(len(full))
        self.stencils.gradient(full, gradient)
        return self.nodes.pull_gradient(gradient)

    def hessian(self, free: np.ndarray, unknowns: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
        pattern = BlockPattern.of(self.sizes, [unknowns])
        full = self.nodes.expand(free)
        gradient, values = np.zeros(len(full)), np.zeros(pattern.pattern.entries)
        value = self.stencils.hessian(full, gradient, pattern.slots(unknowns), self.nodes.rotation, values)
        return value, self.nodes.pull_gradient(gradient), dense(pattern.pattern, values)


def dense(pattern: SymmetricPattern, values: np.ndarray) -> np.ndarray:
    columns = np.repeat(np.arange(pattern.size), np.diff(pattern.starts))
    matrix = np.zeros((pattern.size, pattern.size))
    matrix[pattern.rows, columns] = values
    return matrix + np.tril(matrix, -1).T


def central(function, x: np.ndarray, step: float = 1e-5) -> np.ndarray:  # type: ignore[no-untyped-def]
    """Central differences, last axis: component of x."""
    moves = step * np.eye(len(x))
    return np.stack([(np.asarray(function(x + m)) - function(x - m)) / (2 * step) for m in moves], axis=-1)


COUNTS = [1, 5, BLOCK - 1, BLOCK, BLOCK + 3]


@pytest.mark.parametrize("count", COUNTS)
@pytest.mark.parametrize("turned", [False, True], ids=["shifted", "turned"])
def test_gradient_and_hessian_against_differences(count: int, turned: bool) -> None:
    mesh = Mesh(count, stencils=count, turned=turned)
    value, gradient, hessian = mesh.hessian(mesh.free, mesh.unknowns)
    assert value == pytest.approx(mesh.value(mesh.free), rel=1e-13)
    np.testing.assert_allclose(gradient, mesh.gradient(mesh.free), rtol=1e-12, atol=1e-12)
    scale = np.abs(gradient).max()
    assert scale > 0.1
    np.testing.assert_allclose(gradient, central(mesh.value, mesh.free), atol=1e-8 * scale)
    np.testing.assert_allclose(hessian, central(mesh.gradient, mesh.free), atol=1e-8 * np.abs(hessian).max())


@pytest.mark.parametrize("turned", [False, True], ids=["shifted", "turned"])
def test_fixed_unknowns_leave_the_others_alone(turned: bool) -> None:
    mesh = Mesh(3, stencils=40, turned=turned)
    fixed = [0, 1, 2, 7, mesh.nodes.free_count - 1]
    unknowns = np.where(np.isin(mesh.unknowns, fixed), -1, mesh.unknowns)
    _, _, whole = mesh.hessian(mesh.free, mesh.unknowns)
    _, _, found = mesh.hessian(mesh.free, unknowns)
    whole[fixed], whole[:, fixed] = 0.0, 0.0
    np.testing.assert_allclose(found, whole, rtol=1e-12, atol=1e-12)


def test_a_set_without_stencils_is_zero() -> None:
    mesh = Mesh(0, stencils=0, turned=True)
    value, gradient, hessian = mesh.hessian(mesh.free, mesh.unknowns)
    assert value == 0.0 == mesh.value(mesh.free)
    assert not gradient.any() and not hessian.any()


def test_two_sets_add_up_in_one_pattern() -> None:
    first, second = (Mesh(seed, stencils=9, turned=False) for seed in (5, 6))
    pattern = BlockPattern.of(first.sizes, [first.unknowns, second.unknowns])
    values = np.zeros(pattern.pattern.entries)
    expected = 0.0
    for mesh in (first, second):
        full = mesh.nodes.expand(mesh.free)
        slots = pattern.slots(mesh.unknowns)
        mesh.stencils.hessian(full, np.zeros(len(full)), slots, mesh.nodes.rotation, values)
        expected = expected + mesh.hessian(mesh.free, mesh.unknowns)[2]
    np.testing.assert_allclose(dense(pattern.pattern, values), expected, rtol=1e-12, atol=1e-12)


def test_the_pattern_is_exactly_what_meets() -> None:
    sizes = np.array([3, 1, 3, 1])
    pattern = BlockPattern.of(sizes, [np.array([[0, 1, 2, 3]]), np.array([[-1, 4, 7, 7]])])
    filled = dense(pattern.pattern, np.ones(pattern.pattern.entries)) > 0
    expected = np.zeros((8, 8), bool)
    for block in ([0, 1, 2], [3], [4, 5, 6], [7], [0, 1, 2, 3], [4, 5, 6, 7]):
        expected[np.ix_(block, block)] = True
    np.testing.assert_array_equal(filled, expected)
    columns = np.split(pattern.pattern.rows, pattern.pattern.starts[1:-1])
    assert all((np.diff(rows) > 0).all() and rows[0] == j for j, rows in enumerate(columns))


def test_covers_tells_what_the_pattern_holds() -> None:
    pattern = BlockPattern.of(np.array([3, 3, 1]), [np.array([[0, 1, 2, 6]])])
    assert pattern.covers(np.array([[2, 6], [-1, 4], [3, 5]]))
    assert not pattern.covers(np.array([[2, 6], [0, 4]]))


def test_elements_and_parameter_derivatives() -> None:
    mesh = Mesh(8, stencils=BLOCK + 5, turned=True)
    full = mesh.nodes.expand(mesh.free)
    energies, gradients, hessians = mesh.stencils.elements(full)
    assert energies.sum() == pytest.approx(mesh.stencils.value(full), rel=1e-13)
    total = np.zeros(len(full))
    np.add.at(total, mesh.variables, gradients)
    reference = np.zeros(len(full))
    mesh.stencils.gradient(full, reference)
    np.testing.assert_allclose(total, reference, rtol=1e-11, atol=1e-12)
    np.testing.assert_allclose(hessians, hessians.transpose(0, 2, 1))

    by_pull = mesh.stencils.by_parameters(full, ("pull",))
    step, parameters = 1e-6, mesh.stencils.parameters.copy()
    for k in range(3):
        sides = []
        for sign in (1, -1):
            moved = parameters.copy()
            moved[:, 1:4] += sign * step * np.eye(3)[k]
            sides.append(StencilSet(ENERGY, mesh.variables, moved, 3).elements(full)[0])
        np.testing.assert_allclose(by_pull[:, k], (sides[0] - sides[1]) / (2 * step), atol=1e-8)


def test_wrong_columns_are_refused() -> None:
    with pytest.raises(ValueError, match="expected columns"):
        StencilSet(ENERGY, np.zeros((4, 9), np.int64), np.zeros((4, 4)), 3)
    with pytest.raises(KeyError, match="no parameter 'stiffness'"):
        ENERGY.parameter_rows("stiffness")


def test_infinite_elements_make_the_sum_infinite_and_not_nan() -> None:
    energy = StencilEnergy("pole", {"a": 3}, {"k": 1}, lambda v, p: p["k"] / ca.dot(v["a"], v["a"]))
    stencils = StencilSet(energy, np.arange(15).reshape(5, 3), np.ones((5, 1)), 1)
    full = np.ones(15)
    full[6:9] = 0.0
    assert stencils.value(full) == np.inf


def test_a_steadied_hessian_leaves_out_a_share_of_the_softening() -> None:
    def energy(share: float) -> StencilEnergy:
        def function(v, p):
            return Steadied(ca.dot(v["a"], v["a"]), lambda square: ca.sqrt(1.0 + square), share)

        return StencilEnergy(f"steadied_{10 * share:.0f}", {"a": 3}, {}, function)

    a, none = np.array([[0.3, -0.5, 2.0]]), np.empty((1, 0))
    square = float(a[0] @ a[0])
    root = np.sqrt(1.0 + square)
    for share in (0.0, 0.6, 1.0):
        value, gradient, lower = (column.ravel() for column in run_columns(energy(share).hessian, a, none))
        assert value == pytest.approx(root)
        np.testing.assert_allclose(gradient, a[0] / root)
        softening = np.outer(a[0], a[0]) / root**3
        expected = np.eye(3) / root - (1.0 - share) * softening
        np.testing.assert_allclose(lower, expected[np.tril_indices(3)], atol=1e-14)
