"""Compiled loops of a sparse Cholesky factorisation over ``fronts``, with the BLAS that SciPy has.

Each front adds up its part of the matrix and the updates of its children, factors its columns and leaves an update for
its parent, in an order that does not depend on the number of threads.
"""

from __future__ import annotations

from typing import NamedTuple

import numba
import numpy as np
from numba.extending import get_cython_function_address
from numpy.typing import NDArray

from yarnscale.arrays import Array
from yarnscale.numerics.address_call import call_address

_JIT = {"cache": True, "error_model": "numpy", "nogil": True, "fastmath": {"nsz", "contract", "reassoc"}}


class Blas(NamedTuple):
    """Routines by their addresses, and arguments for them: the letters L, N, R, T and the numbers 1, −1, 0.

    The arrays are not made inside compiled functions, which free an array after its last use by name.
    """

    letters: NDArray[np.uint8]
    numbers: Array
    dpotrf: int
    dtrsm: int
    dsyrk: int
    dgemm: int
    dtrsv: int
    dgemv: int


BLAS = Blas(
    np.frombuffer(b"LNRT", np.uint8),
    np.array([1.0, -1.0, 0.0]),
    get_cython_function_address("scipy.linalg.cython_lapack", "dpotrf"),
    *(get_cython_function_address("scipy.linalg.cython_blas", name) for name in Blas._fields[3:]),
)


@numba.njit(**_JIT)
def scatter(values, places, factor):
    """Entries at their places in a factor, zero elsewhere."""
    factor[:] = 0.0
    for k in range(len(values)):
        factor[places[k]] = values[k]


@numba.njit(**_JIT)
def factor_fronts(share, first, starts, places, begin, by_parent, children, raised, lowered, updates, factor, blas):
    """Factor fronts in their order; False as soon as a pivot is not positive."""
    lower, none, right, transposed = [blas.letters.ctypes.data + k for k in range(4)]
    size = np.zeros(4, np.int32)  # width, rows below, rows, outcome
    for s in share:
        width, below = first[s + 1] - first[s], starts[s + 1] - starts[s]
        rows = width + below
        size[0], size[1], size[2] = width, below, rows
        columns = factor[begin[s] : begin[s + 1]]
        update = updates[raised[s] : raised[s] + below * below]
        many = children[s + 1] > children[s]
        if many:
            update[:] = 0.0
        for c in by_parent[children[s] : children[s + 1]]:
            _add_update(updates[lowered[c] :], places[starts[c] : starts[c + 1]], width, below, columns, update)
        data = columns.ctypes.data
        width_at, below_at, rows_at = size.ctypes.data, size.ctypes.data + 4, size.ctypes.data + 8
        call_address(blas.dpotrf, (lower, width_at, data, rows_at, size.ctypes.data + 12))
        if size[3] != 0:
            return False
        if below == 0:
            continue
        plus = blas.numbers.ctypes.data
        minus, beta = plus + 8, plus + (0 if many else 16)
        under = data + 8 * width
        call_address(
            blas.dtrsm, (right, lower, transposed, none, below_at, width_at, plus, data, rows_at, under, rows_at)
        )
        call_address(
            blas.dsyrk, (lower, none, below_at, width_at, minus, under, rows_at, beta, update.ctypes.data, below_at)
        )
        if lowered[s] < raised[s]:
            for k in range(below * below):
                updates[lowered[s] + k] = update[k]
    return True


@numba.njit(**_JIT)
def _add_update(child, places, width, below, columns, update):
    """Add the update of a child, a lower triangle, to the columns and to the update of its parent."""
    count, rows = len(places), width + below
    for j in range(count):
        column, place = child[j * count : (j + 1) * count], places[j]
        at = np.int64(place)
        if at < width:
            into = columns[at * rows + at : (at + 1) * rows]
        else:
            into = update[(at - width) * (below + 1) : (at - width + 1) * below]
        for i in range(j, count):
            into[places[i] - place] += column[i]


@numba.njit(**_JIT)
def solve_fronts(first, starts, rows, begin, factor, x, blas):
    """Replace columns x in the order of elimination by the solution of L Lᵀ x = right."""
    lower, none, _, transposed = [blas.letters.ctypes.data + k for k in range(4)]
    plus = blas.numbers.ctypes.data
    minus, zero = plus + 8, plus + 16
    size = np.zeros(6, np.int32)  # width, rows below, rows, of x: rows, columns; one
    width_at, below_at, rows_at, length_at, count_at = [size.ctypes.data + 4 * k for k in range(5)]
    count, step_at = x.shape[1], size.ctypes.data + 20
    size[3], size[4], size[5] = len(x), count, 1
    most = 0  # rows below a front; np.diff would take seconds to compile
    for s in range(len(starts) - 1):
        most = max(most, starts[s + 1] - starts[s])
    others = np.zeros(count * most)
    for k in range(2 * (len(first) - 1)):
        forward = k < len(first) - 1
        s = k if forward else 2 * (len(first) - 1) - 1 - k
        width, below = first[s + 1] - first[s], starts[s + 1] - starts[s]
        size[0], size[1], size[2] = width, below, width + below
        data, mine = factor[begin[s] :].ctypes.data, x.ctypes.data + 8 * first[s]
        met, under, apart = rows[starts[s] : starts[s + 1]], data + 8 * width, others.ctypes.data
        if not forward and below:
            for c in range(count):
                for i in range(below):
                    others[c * below + i] = x[met[i], c]
            if count == 1:
                call_address(blas.dgemv, (
                    transposed, below_at, width_at, minus, under, rows_at, apart, step_at, plus, mine, step_at
                ))  # fmt: skip
            else:
                call_address(blas.dgemm, (
                    transposed, none, width_at, count_at, below_at, minus, under, rows_at, apart, below_at, plus,
                    mine, length_at,
                ))  # fmt: skip
        turned = none if forward else transposed
        if count == 1:
            call_address(blas.dtrsv, (lower, turned, none, width_at, data, rows_at, mine, step_at))
        else:
            call_address(
                blas.dtrsm, (lower, lower, turned, none, width_at, count_at, plus, data, rows_at, mine, length_at)
            )
        if forward and below:
            if count == 1:
                call_address(
                    blas.dgemv, (none, below_at, width_at, plus, under, rows_at, mine, step_at, zero, apart, step_at)
                )
            else:
                call_address(blas.dgemm, (
                    none, none, below_at, count_at, width_at, plus, under, rows_at, mine, length_at, zero,
                    apart, below_at,
                ))  # fmt: skip
            for c in range(count):
                for i in range(below):
                    x[met[i], c] -= others[c * below + i]
