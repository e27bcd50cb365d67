"""Sparse symmetric positive definite matrices of one pattern: product, and multifrontal Cholesky factorisation."""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass

import numba
import numpy as np

from yarnscale.arrays import Array, Integers
from yarnscale.numerics.fronts import Fronts
from yarnscale.numerics.multifrontal import BLAS, factor_fronts, scatter, solve_fronts
from yarnscale.numerics.threads import available_threads, one_thread, run_parts


@dataclass(frozen=True, eq=False)
class SymmetricPattern:
    """Where a symmetric matrix may be nonzero: its lower triangle by columns, rows sorted, diagonal present.

    size: number of rows n; starts: (n + 1,) int64, first entry of each column; rows: (nnz,) int64.
    """

    size: int
    starts: Integers
    rows: Integers

    @classmethod
    def from_keys(cls, size: int, keys: Integers) -> SymmetricPattern:
        """Pattern from sorted unique keys ``column·size + row`` of the lower triangle."""
        columns, rows = np.divmod(keys, size)
        starts = np.zeros(size + 1, np.int64)
        np.cumsum(np.bincount(columns, minlength=size), out=starts[1:])
        return cls(size, starts, rows)

    def widened(self, count: int) -> SymmetricPattern:
        """The pattern with ``count`` more unknowns at the end, which have nothing but their diagonal."""
        starts = np.concatenate([self.starts, self.starts[-1] + np.arange(1, count + 1)])
        rows = np.concatenate([self.rows, self.size + np.arange(count)])
        return SymmetricPattern(self.size + count, starts, rows)

    def part(self, kept: Integers) -> tuple[SymmetricPattern, Integers]:
        """Pattern of the rows and columns ``kept`` (increasing), and which entries of the whole it has."""
        number = np.full(self.size, -1)
        number[kept] = np.arange(len(kept))
        columns, rows = number[self.columns], number[self.rows]
        chosen = np.flatnonzero((columns >= 0) & (rows >= 0))
        return SymmetricPattern.from_keys(len(kept), columns[chosen] * len(kept) + rows[chosen]), chosen

    def alike(self, other: SymmetricPattern) -> bool:
        """Whether both have the same places."""
        return np.array_equal(self.starts, other.starts) and np.array_equal(self.rows, other.rows)

    @property
    def entries(self) -> int:
        """Number of stored entries."""
        return len(self.rows)

    @property
    def columns(self) -> Integers:
        """Column of every entry, (nnz,)."""
        return np.repeat(np.arange(self.size), np.diff(self.starts))

    @property
    def keys(self) -> Integers:
        """Keys ``column·size + row`` of all entries, increasing."""
        return self.columns * self.size + self.rows

    @property
    def diagonal(self) -> Integers:
        """Position of every diagonal entry, (n,): first of its column, since rows are sorted."""
        return self.starts[:-1]

    def multiply(self, values: Array, x: Array) -> Array:
        """Product of the symmetric matrix with a vector (n,) or columns (n, k)."""
        if x.ndim == 2:
            return np.column_stack([self.multiply(values, column) for column in x.T])
        product = np.zeros(self.size)
        _multiply(self.starts, self.rows, values, np.ascontiguousarray(x), product)
        return product


def places_among(keys: Integers, wanted: Integers) -> Integers | None:
    """Where some keys stand among increasing ones; None where one of them is not there."""
    places = np.minimum(np.searchsorted(keys, wanted), len(keys) - 1)
    return places if np.array_equal(keys[places], wanted) else None


def by_rows(rows: Integers, columns: Integers, size: int) -> tuple[Integers, Integers, Integers]:
    """Entries of a square matrix, row after row: their numbers among those given, columns, where each row begins."""
    order = np.argsort(rows * size + columns)
    return order, columns[order], np.searchsorted(rows[order], np.arange(size + 1))


@numba.njit(cache=True, error_model="numpy")
def _multiply(starts, rows, values, x, product):
    for j in range(len(starts) - 1):
        total = values[starts[j]] * x[j]
        for k in range(starts[j] + 1, starts[j + 1]):
            product[rows[k]] += values[k] * x[j]
            total += values[k] * x[rows[k]]
        product[j] += total


class Factorisation:
    """Cholesky factor of matrices that share one pattern; made with its symbolic analysis.

    Large ones are shared by threads. Results do not depend on their number, but for round-off of BLAS on several.
    """

    def __init__(self, pattern: SymmetricPattern, *, threads: int | None = None) -> None:
        threads = available_threads() if threads is None else threads
        fronts = Fronts.of(pattern.size, pattern.starts, pattern.rows, threads=threads)
        self._fronts = fronts
        self._factor, self._updates = np.empty(fronts.factor[-1]), np.empty(fronts.room)
        by_parent = np.argsort(fronts.parent, kind="stable")
        children = np.searchsorted(fronts.parent[by_parent], np.arange(len(fronts.parent) + 1))
        self._tree = fronts.first, fronts.starts, fronts.places, fronts.factor, by_parent, children

    def another(self) -> Factorisation:
        """Of other matrices of the pattern, by the same symbolic analysis."""
        new = copy(self)
        new._factor, new._updates = np.empty_like(self._factor), np.empty_like(self._updates)
        return new

    def factor(self, values: Array) -> bool:
        """Factor the matrix with these entries; False where it is not positive definite."""
        if not np.isfinite(values).all():
            return False
        fronts, data = self._fronts, (self._updates, self._factor)
        scatter(values, fronts.entries, self._factor)

        def work(share: Integers) -> bool:
            places = fronts.raised, fronts.updates
            return factor_fronts(share, *self._tree, *places, *data, BLAS)

        *side_by_side, last = fronts.shares
        if side_by_side:
            with one_thread():
                if not all(run_parts(work, side_by_side)):
                    return False
        return work(last)

    def solve(self, right: Array) -> Array:
        """Solve for (n,) or (n, k); only after ``factor`` returned True."""
        order = self._fronts.order
        columns = np.asfortranarray(right.reshape(len(right), -1)[order], dtype=np.float64)
        fronts = self._fronts
        solve_fronts(fronts.first, fronts.starts, fronts.rows, fronts.factor, self._factor, columns, BLAS)
        solution = np.empty_like(columns)
        solution[order] = columns
        return solution.reshape(right.shape)
