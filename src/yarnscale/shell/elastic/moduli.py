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
"""Curvatures are divided by 100 /m before eigenvalues are computed, so that bending is not lost to round-off."""

FAST = {"cache": True, "fastmath": {"nsz", "arcp", "contract", "afn", "reassoc"}, "error_model": "numpy", "nogil": True}
"""Numba options of all loops over elements: values need not be finite; loops release the interpreter's lock."""


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
def positive_moduli(moduli: NDArray, out: NDArray) -> int:
    """Symmetric (36, n) from lower triangles (21, n), eigenvalues replaced by magnitudes; how many were indefinite.

    Definite ones (by a Cholesky test) stay as they are; the others are packed for Jacobi rotations.
    """
    count = moduli.shape[1]
    matrix, lower = np.empty((6, 6)), np.empty((6, 6))
    packed, places = np.empty((6, 6, count)), np.empty(count, np.int64)
    full_moduli(moduli, out)
    indefinite = 0
    for n in range(count):
        trace = 0.0
        for i in range(6):
            for j in range(6):
                matrix[i, j] = out[6 * i + j, n] * _scale(i) * _scale(j)
            trace += abs(matrix[i, i])
        if not _is_definite(matrix, 1e-9 * trace, lower):
            packed[:, :, indefinite] = matrix
            places[indefinite] = n
            indefinite += 1
    if indefinite:
        _absolute(packed, indefinite)
        for i in range(6):
            for j in range(6):
                unscale = 1.0 / (_scale(i) * _scale(j))
                for k in range(indefinite):
                    out[6 * i + j, places[k]] = packed[i, j, k] * unscale
    return indefinite


@numba.njit(**FAST)
def _scale(component: int) -> float:
    return BENDING_SCALE if component > 2 else 1.0


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
def _absolute(matrices: NDArray, count: int) -> None:
    """Replace symmetric matrices (6, 6, count) by their absolute values, by cyclic Jacobi rotations side by side."""
    vectors = np.zeros((6, 6, count))
    cosines, sines = np.empty(count), np.empty(count)
    for i in range(6):
        vectors[i, i, :] = 1.0
    for _ in range(12):
        for p in range(5):
            for q in range(p + 1, 6):
                _rotate(matrices, vectors, p, q, cosines, sines, count)
        if _largest_coupling(matrices, count) <= 1e-10:
            break
    values = np.empty((6, count))
    for r in range(6):
        for n in range(count):
            values[r, n] = abs(matrices[r, r, n])
    for i in range(6):
        for j in range(i + 1):
            for n in range(count):
                total = 0.0
                for r in range(6):
                    total += vectors[i, r, n] * values[r, n] * vectors[j, r, n]
                matrices[i, j, n] = total
                matrices[j, i, n] = total


@numba.njit(**FAST)
def _largest_coupling(matrices: NDArray, count: int) -> float:
    """Largest off-diagonal norm over the trace norm of any matrix."""
    largest = 0.0
    for n in range(count):
        off, trace = 0.0, 1e-300
        for p in range(6):
            trace += abs(matrices[p, p, n])
            for q in range(p):
                off += matrices[p, q, n] ** 2
        largest = max(largest, off / (trace * trace))
    return math.sqrt(largest)


@numba.njit(**FAST)
def _rotate(matrices: NDArray, vectors: NDArray, p: int, q: int, cosines: NDArray, sines: NDArray, count: int) -> None:
    """One Jacobi rotation that zeroes entry (p, q) of every matrix."""
    for n in range(count):
        coupling, gap = matrices[p, q, n], matrices[q, q, n] - matrices[p, p, n]
        size = abs(gap) + math.sqrt(gap * gap + 4.0 * coupling * coupling) + 1e-300
        tangent = math.copysign(2.0, gap) * coupling / size
        cosines[n] = 1.0 / math.sqrt(tangent * tangent + 1.0)
        sines[n] = tangent * cosines[n]
    for r in range(6):
        _mix(matrices[r, p], matrices[r, q], cosines, sines, count)
        _mix(vectors[r, p], vectors[r, q], cosines, sines, count)
    for r in range(6):
        _mix(matrices[p, r], matrices[q, r], cosines, sines, count)


@numba.njit(**FAST)
def _mix(first: NDArray, second: NDArray, cosines: NDArray, sines: NDArray, count: int) -> None:
    for n in range(count):
        x, y = first[n], second[n]
        first[n] = cosines[n] * x - sines[n] * y
        second[n] = sines[n] * x + cosines[n] * y
