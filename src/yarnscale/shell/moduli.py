"""Positive 6×6 moduli of shell elements: eigenvalues replaced by their magnitudes.

HYLC20 clamps the eigenvalues of 18×18 element Hessians; the 6×6 moduli in (I, II) are cheaper by far and
Newton converges faster with magnitudes than with clamped values.
"""

from __future__ import annotations

import math

import numba
import numpy as np
from numpy.typing import NDArray

BENDING_SCALE = 100.0
"""Curvatures are divided by 100 /m before eigenvalues are taken, else bending drowns in round-off."""

FAST = {"cache": True, "fastmath": {"nsz", "arcp", "contract", "afn", "reassoc"}, "error_model": "numpy"}
"""Numba options of all loops over elements: no assumption that values are finite."""


@numba.njit(**FAST)
def positive_moduli(moduli: NDArray, out: NDArray) -> int:
    """Symmetric (36, n) with the eigenvalues of each 6×6 replaced by their magnitudes; how many were
    indefinite.

    A Cholesky test keeps the definite ones untouched; only the others go through Jacobi rotations.
    """
    matrix, vectors, lower = np.empty((6, 6)), np.empty((6, 6)), np.empty((6, 6))
    indefinite = 0
    for n in range(moduli.shape[1]):
        k, trace = 0, 0.0
        for i in range(6):
            for j in range(i + 1):
                scale = (BENDING_SCALE if i > 2 else 1.0) * (BENDING_SCALE if j > 2 else 1.0)
                matrix[i, j] = matrix[j, i] = moduli[k, n] * scale
                k += 1
            trace += abs(matrix[i, i])
        if not _is_definite(matrix, 1e-9 * trace, lower):
            indefinite += 1
            _absolute(matrix, vectors, lower, trace)
        for i in range(6):
            for j in range(6):
                scale = (BENDING_SCALE if i > 2 else 1.0) * (BENDING_SCALE if j > 2 else 1.0)
                out[6 * i + j, n] = matrix[i, j] / scale
    return indefinite


@numba.njit(**FAST)
def full_moduli(moduli: NDArray, out: NDArray) -> None:
    """Lower triangles (21, n) to full matrices (36, n), unchanged."""
    k = 0
    for i in range(6):
        for j in range(i + 1):
            for n in range(moduli.shape[1]):
                out[6 * i + j, n] = moduli[k, n]
                out[6 * j + i, n] = moduli[k, n]
            k += 1


@numba.njit(**FAST)
def _is_definite(matrix: NDArray, margin: float, lower: NDArray) -> bool:
    """Whether the Cholesky factorisation of matrix − margin exists."""
    for j in range(6):
        pivot = matrix[j, j] - margin
        for r in range(j):
            pivot -= lower[j, r] * lower[j, r]
        if not pivot > 0.0:
            return False
        lower[j, j] = math.sqrt(pivot)
        for i in range(j + 1, 6):
            entry = matrix[i, j]
            for r in range(j):
                entry -= lower[i, r] * lower[j, r]
            lower[i, j] = entry / lower[j, j]
    return True


@numba.njit(**FAST)
def _absolute(matrix: NDArray, vectors: NDArray, work: NDArray, trace: float) -> None:
    """Replace a symmetric 6×6 matrix by its absolute value, by Jacobi rotations."""
    for i in range(6):
        for j in range(6):
            vectors[i, j] = 1.0 if i == j else 0.0
    for _ in range(12):
        off = 0.0
        for p in range(5):
            for q in range(p + 1, 6):
                off += matrix[p, q] ** 2
        if off <= 1e-24 * trace * trace:
            break
        for p in range(5):
            for q in range(p + 1, 6):
                if abs(matrix[p, q]) > 1e-15 * trace:
                    _rotate(matrix, vectors, p, q)
    for i in range(6):
        for j in range(6):
            total = 0.0
            for r in range(6):
                total += vectors[i, r] * abs(matrix[r, r]) * vectors[j, r]
            work[i, j] = total
    matrix[:] = work


@numba.njit(**FAST)
def _rotate(matrix: NDArray, vectors: NDArray, p: int, q: int) -> None:
    """One Jacobi rotation that zeroes entry (p, q)."""
    ratio = (matrix[q, q] - matrix[p, p]) / (2.0 * matrix[p, q])
    tangent = (1.0 if ratio >= 0.0 else -1.0) / (abs(ratio) + math.sqrt(ratio * ratio + 1.0))
    cosine = 1.0 / math.sqrt(tangent * tangent + 1.0)
    sine = tangent * cosine
    for r in range(6):
        x, y = matrix[r, p], matrix[r, q]
        matrix[r, p], matrix[r, q] = cosine * x - sine * y, sine * x + cosine * y
        x, y = vectors[r, p], vectors[r, q]
        vectors[r, p], vectors[r, q] = cosine * x - sine * y, sine * x + cosine * y
    for r in range(6):
        x, y = matrix[p, r], matrix[q, r]
        matrix[p, r], matrix[q, r] = cosine * x - sine * y, sine * x + cosine * y
