"""Factorisation back ends against dense linear algebra."""

from __future__ import annotations

from importlib.util import find_spec

import numpy as np
import pytest

from yarnscale.errors import InputError
from yarnscale.numerics.factor import BACKENDS, SymmetricPattern, default_backend, factorisation

INSTALLED = [name for name in BACKENDS if name != "cholmod" or find_spec("cvxopt") is not None]


def system(n: int, seed: int) -> tuple[np.ndarray, SymmetricPattern, np.ndarray]:
    """A sparse positive definite matrix, its pattern and its lower entries."""
    rng = np.random.default_rng(seed)
    matrix = rng.normal(size=(n, n)) * (rng.random((n, n)) < min(1.0, 4 / n))
    matrix = matrix @ matrix.T + np.eye(n)
    lower = np.array([(i, j) for j in range(n) for i in range(j, n) if i == j or matrix[i, j] != 0])
    pattern = SymmetricPattern.from_keys(n, lower[:, 1] * n + lower[:, 0])
    return matrix, pattern, matrix[lower[:, 0], lower[:, 1]]


@pytest.mark.parametrize("backend", INSTALLED)
@pytest.mark.parametrize("n", [1, 2, 7, 60])
def test_solves(backend: str, n: int) -> None:
    matrix, pattern, values = system(n, n)
    factor = factorisation(pattern, backend)
    rng = np.random.default_rng(0)
    for scale in (1.0, 3.0):  # the second time with the same symbolic analysis
        assert factor.factor(scale * values)
        for right in (rng.normal(size=n), rng.normal(size=(n, 1)), rng.normal(size=(n, 4))):
            solution = factor.solve(right)
            assert solution.shape == right.shape
            np.testing.assert_allclose(scale * matrix @ solution, right, atol=1e-10)


@pytest.mark.parametrize("backend", INSTALLED)
def test_right_hand_sides_are_left_alone_in_any_memory_order(backend: str) -> None:
    matrix, pattern, values = system(9, 2)
    factor = factorisation(pattern, backend)
    assert factor.factor(values)
    columns = np.random.default_rng(1).normal(size=(3, 9)).T
    kept = columns.copy()
    np.testing.assert_allclose(matrix @ factor.solve(columns), kept, atol=1e-10)
    np.testing.assert_array_equal(columns, kept)


@pytest.mark.parametrize("backend", INSTALLED)
def test_indefinite_singular_and_nan_are_told(backend: str) -> None:
    matrix, pattern, values = system(20, 3)
    factor = factorisation(pattern, backend)
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


@pytest.mark.parametrize("backend", INSTALLED)
def test_hidden_indefiniteness_is_told(backend: str) -> None:
    """Positive diagonal, indefinite matrix: pivoting must not hide the sign."""
    pattern = SymmetricPattern(3, np.array([0, 3, 5, 6]), np.array([0, 1, 2, 1, 2, 2]))
    values = np.array([1.0, 2.0, 0.0, 1.0, 2.0, 1.0])
    assert not factorisation(pattern, backend).factor(values)
    off_diagonal = np.array([0.0, 1.0, 0.0, 0.0, 1.0, 1.0])
    assert not factorisation(pattern, backend).factor(off_diagonal)


@pytest.mark.skipif(len(INSTALLED) < 2, reason="one back end installed")
def test_back_ends_agree() -> None:
    _, pattern, values = system(50, 5)
    right = np.random.default_rng(0).normal(size=(50, 3))
    answers = []
    for backend in INSTALLED:
        factor = factorisation(pattern, backend)
        assert factor.factor(values)
        answers.append(factor.solve(right))
    np.testing.assert_allclose(answers[0], answers[1], rtol=1e-9, atol=1e-11)


def test_multiply_is_the_symmetric_product() -> None:
    matrix, pattern, values = system(15, 6)
    rng = np.random.default_rng(0)
    for x in (rng.normal(size=15), rng.normal(size=(15, 4))):
        np.testing.assert_allclose(pattern.multiply(values, x), matrix @ x, rtol=1e-12, atol=1e-12)


def test_an_unknown_back_end_is_an_input_error() -> None:
    _, pattern, _ = system(2, 0)
    with pytest.raises(InputError, match="superlu"):
        factorisation(pattern, "umfpack")


def test_the_default_is_installed() -> None:
    assert default_backend() in INSTALLED
