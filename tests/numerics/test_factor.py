"""Factorisation against dense linear algebra."""

from __future__ import annotations

import sys

import numpy as np
import pytest
from scipy.sparse import csc_array
from scipy.sparse.linalg import splu

from yarnscale.numerics import fronts
from yarnscale.numerics.block_pattern import BlockPattern
from yarnscale.numerics.factor import Factorisation, SymmetricPattern
from yarnscale.numerics.fronts import Fronts


def system(n: int, seed: int) -> tuple[np.ndarray, SymmetricPattern, np.ndarray]:
    """A sparse positive definite matrix, its pattern and its lower entries."""
    rng = np.random.default_rng(seed)
    matrix = rng.normal(size=(n, n)) * (rng.random((n, n)) < min(1.0, 4 / n))
    matrix = matrix @ matrix.T + np.eye(n)
    lower = np.array([(i, j) for j in range(n) for i in range(j, n) if i == j or matrix[i, j] != 0])
    pattern = SymmetricPattern.from_keys(n, lower[:, 1] * n + lower[:, 0])
    return matrix, pattern, matrix[lower[:, 0], lower[:, 1]]


@pytest.mark.parametrize("n", [1, 2, 7, 60])
def test_solves(n: int) -> None:
    matrix, pattern, values = system(n, n)
    factor = Factorisation(pattern)
    rng = np.random.default_rng(0)
    for scale in (1.0, 3.0):  # the second time with the same symbolic analysis
        assert factor.factor(scale * values)
        for right in (rng.normal(size=n), rng.normal(size=(n, 1)), rng.normal(size=(n, 4))):
            solution = factor.solve(right)
            assert solution.shape == right.shape
            np.testing.assert_allclose(scale * matrix @ solution, right, atol=1e-10)


def test_right_hand_sides_are_left_alone_in_any_memory_order() -> None:
    matrix, pattern, values = system(9, 2)
    factor = Factorisation(pattern)
    assert factor.factor(values)
    columns = np.random.default_rng(1).normal(size=(3, 9)).T
    kept = columns.copy()
    np.testing.assert_allclose(matrix @ factor.solve(columns), kept, atol=1e-10)
    np.testing.assert_array_equal(columns, kept)


def test_indefinite_singular_and_nan_are_told() -> None:
    matrix, pattern, values = system(20, 3)
    factor = Factorisation(pattern)
    worst = values.copy()
    worst[pattern.diagonal] -= 1.001 * np.linalg.eigvalsh(matrix)[0]
    assert not factor.factor(worst), "one slightly negative eigenvalue"
    assert not factor.factor(-values)
    zero_row = values.copy()
    columns = np.repeat(np.arange(20), np.diff(pattern.starts))
    zero_row[(pattern.rows == 4) | (columns == 4)] = 0.0
    assert not factor.factor(zero_row), "singular"
    for bad in (np.nan, np.inf):
        spoilt = values.copy()
        spoilt[pattern.diagonal[5]] = bad
        assert not factor.factor(spoilt), f"an entry {bad}"
    assert factor.factor(values), "a failure does not spoil what follows"
    right = np.arange(20.0)
    np.testing.assert_allclose(matrix @ factor.solve(right), right, atol=1e-9)


def test_hidden_indefiniteness_is_told() -> None:
    """Positive diagonal, indefinite matrix: pivoting must not hide the sign."""
    pattern = SymmetricPattern(3, np.array([0, 3, 5, 6]), np.array([0, 1, 2, 1, 2, 2]))
    values = np.array([1.0, 2.0, 0.0, 1.0, 2.0, 1.0])
    assert not Factorisation(pattern).factor(values)
    off_diagonal = np.array([0.0, 1.0, 0.0, 0.0, 1.0, 1.0])
    assert not Factorisation(pattern).factor(off_diagonal)


def _grid(width: int) -> tuple[SymmetricPattern, np.ndarray]:
    """Random positive entries of the blocks of threes of a square grid with diagonals: many fronts on many levels."""
    number = np.random.default_rng(3).permutation(width * width).reshape(width, width)
    corners = [number[:-1, :-1], number[1:, :-1], number[:-1, 1:], number[1:, 1:]]
    vertices = np.stack([c.ravel() for c in corners], axis=1)
    unknowns = (3 * vertices[..., None] + np.arange(3)).reshape(-1, 12)
    pattern = BlockPattern.of(np.full(width * width, 3), [unknowns]).pattern
    values = np.random.default_rng(4).normal(size=pattern.entries)
    values[pattern.diagonal] += 20.0
    return pattern, values


@pytest.mark.parametrize("threads", [1, 2, 3])
def test_a_large_matrix_is_solved_alike_by_any_number_of_threads(threads: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(fronts, "_LEAST_WORK", 0.0)
    pattern, values = _grid(24)
    right = np.random.default_rng(0).normal(size=(pattern.size, 3))
    solutions = []
    for factor in (Factorisation(pattern, threads=1), Factorisation(pattern, threads=threads)):
        assert not factor.factor(-values)
        assert factor.factor(values)
        solutions.append(factor.solve(right))
    np.testing.assert_allclose(pattern.multiply(values, solutions[1]), right, atol=1e-11)
    np.testing.assert_allclose(*solutions, rtol=1e-11, atol=1e-14)


@pytest.mark.parametrize("metis", [True, False])
def test_order_and_fronts_fill_hardly_more_than_a_general_library(metis: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """Entries of the factor, zeros of joined columns included, against those of SuperLU's factor."""
    if not metis:
        monkeypatch.setitem(sys.modules, "pymetis", None)
    pattern, values = _grid(24)
    lower = csc_array((values, pattern.rows, pattern.starts), shape=(pattern.size, pattern.size))
    full = csc_array(lower + lower.T)
    lu = splu(full, "MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})
    parts = Fronts.of(pattern.size, pattern.starts, pattern.rows, threads=1)
    width, height = np.diff(parts.first), np.diff(parts.starts)
    assert (width * (width + 1) // 2 + width * height).sum() < 1.2 * lu.L.nnz
    factor, right = Factorisation(pattern), np.ones(pattern.size)
    assert factor.factor(values)
    np.testing.assert_allclose(pattern.multiply(values, factor.solve(right)), right, atol=1e-11)


@pytest.mark.parametrize("metis", [True, False])
@pytest.mark.parametrize("links", [[], [(0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3)], [(0, 1), (1, 2)]])
def test_matrices_without_links_all_linked_and_with_a_last_row_of_its_own_are_solved(
    links: list[tuple[int, int]], metis: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    if not metis:
        monkeypatch.setitem(sys.modules, "pymetis", None)
    columns, rows = np.array([(k, k) for k in range(4)] + links).T
    pattern = SymmetricPattern.from_keys(4, np.sort(4 * columns + rows))
    values = np.where(pattern.columns == pattern.rows, 5.0, 1.0)
    factor, right = Factorisation(pattern), np.arange(1.0, 5.0)
    assert factor.factor(values)
    np.testing.assert_allclose(pattern.multiply(values, factor.solve(right)), right, atol=1e-12)


def test_multiply_is_the_symmetric_product() -> None:
    matrix, pattern, values = system(15, 6)
    rng = np.random.default_rng(0)
    for x in (rng.normal(size=15), rng.normal(size=(15, 4))):
        np.testing.assert_allclose(pattern.multiply(values, x), matrix @ x, rtol=1e-12, atol=1e-12)


def test_nodes_are_unknowns_of_like_neighbours_however_many_there_are() -> None:
    """A row of many entries beside one that lacks a single one; the diagonal is part of the pattern."""
    n = 6000
    dense = [(row, 0) for row in range(n)] + [(row, 1) for row in range(1, n) if row != n - 1]
    lower = np.array(dense + [(row, row) for row in range(2, n)])
    node = fronts._nodes(n, lower[:, 1], lower[:, 0])
    assert node[0] != node[1] and node[-1] == len(np.unique(node)) - 1 == n - 1
    i, j = np.tril_indices(12)
    same = i // 3 - j // 3 <= 1
    assert fronts._nodes(12, j[same], i[same]).tolist() == np.repeat([0, 1, 2, 3], 3).tolist()
