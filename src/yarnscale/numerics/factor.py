"""Sparse Cholesky factorisation behind one small interface: CHOLMOD (extra ``fast``) or SuperLU (always there)."""

from __future__ import annotations

from dataclasses import dataclass
from importlib import import_module
from importlib.util import find_spec
from typing import Protocol

import numba
import numpy as np

from yarnscale.arrays import Array, Integers
from yarnscale.errors import InputError


@dataclass(frozen=True, eq=False)
class SymmetricPattern:
    """Where a symmetric matrix may be nonzero: its lower triangle by columns, rows sorted, diagonal present.

    size: number of rows n; starts: (n + 1,) int64, first entry of each column; rows: (nnz,) int64. stages: (n,) at
    which rows are best eliminated (``dissection``), None: the factorisation finds an order by itself.
    """

    size: int
    starts: Integers
    rows: Integers
    stages: Integers | None = None

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
        columns = number[np.repeat(np.arange(self.size), np.diff(self.starts))]
        rows = number[self.rows]
        chosen = np.flatnonzero((columns >= 0) & (rows >= 0))
        return SymmetricPattern.from_keys(len(kept), columns[chosen] * len(kept) + rows[chosen]), chosen

    @property
    def entries(self) -> int:
        """Number of stored entries."""
        return len(self.rows)

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


@numba.njit(cache=True, error_model="numpy")
def _multiply(starts, rows, values, x, product):
    for j in range(len(starts) - 1):
        total = values[starts[j]] * x[j]
        for k in range(starts[j] + 1, starts[j + 1]):
            product[rows[k]] += values[k] * x[j]
            total += values[k] * x[rows[k]]
        product[j] += total


class Factorisation(Protocol):
    """Cholesky factor of matrices that share one pattern."""

    def factor(self, values: Array) -> bool:
        """Factor the matrix with these entries; False where it is not positive definite."""
        ...

    def solve(self, right: Array) -> Array:
        """Solve for (n,) or (n, k); only after ``factor`` returned True."""
        ...


class CholmodFactorisation:
    """Supernodal CHOLMOD through cvxopt; symbolic analysis once per pattern."""

    def __init__(self, pattern: SymmetricPattern) -> None:
        import cvxopt

        cholmod = import_module("cvxopt.cholmod")  # compiled, without types
        # Chosen by itself, CHOLMOD takes its simplicial method on these matrices, five times slower.
        cholmod.options["supernodal"] = 2
        self._matrix, self._cholmod = cvxopt.matrix, cholmod
        columns = np.repeat(np.arange(pattern.size), np.diff(pattern.starts))
        size = (pattern.size, pattern.size)
        self._values = cvxopt.spmatrix(1.0, cvxopt.matrix(pattern.rows), cvxopt.matrix(columns), size)
        if pattern.stages is None:
            self._factor = cholmod.symbolic(self._values)
            return
        by_degree = np.array(import_module("cvxopt.amd").order(self._values)).ravel()
        order = by_degree[np.argsort(pattern.stages[by_degree], kind="stable")]
        self._factor = cholmod.symbolic(self._values, p=cvxopt.matrix(order))

    def factor(self, values: Array) -> bool:
        if not np.isfinite(values).all():  # CHOLMOD factors NaN without complaint
            return False
        self._values.V = self._matrix(values)
        try:
            self._cholmod.numeric(self._values, self._factor)
        except ArithmeticError:
            return False
        return True

    def solve(self, right: Array) -> Array:
        solution = self._matrix(np.asfortranarray(right, dtype=np.float64))
        self._cholmod.solve(self._factor, solution)
        return np.array(solution).reshape(right.shape)


class SuperLUFactorisation:
    """SuperLU without pivoting; the signs of the pivots tell definiteness."""

    def __init__(self, pattern: SymmetricPattern) -> None:
        from scipy.sparse import csc_array
        from scipy.sparse.linalg import splu

        self._splu, self._csc = splu, csc_array
        self._pattern = pattern
        self._lu = None

    def factor(self, values: Array) -> bool:
        pattern = self._pattern
        if not np.isfinite(values).all():
            return False
        lower = self._csc((values, pattern.rows, pattern.starts), shape=(pattern.size, pattern.size))
        diagonal = self._csc((values[pattern.diagonal], (np.arange(pattern.size),) * 2), shape=lower.shape)
        full = (lower + lower.T - diagonal).tocsc()
        options = {"SymmetricMode": True}
        try:
            lu = self._splu(full, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options=options)
        except RuntimeError:  # exactly singular
            return False
        if not (lu.U.diagonal() > 0).all() or not (lu.perm_r == lu.perm_c).all():
            return False
        self._lu = lu
        return True

    def solve(self, right: Array) -> Array:
        if self._lu is None:
            raise RuntimeError("solve before a factorisation succeeded")
        return self._lu.solve(np.asarray(right, dtype=np.float64))


BACKENDS = {"cholmod": CholmodFactorisation, "superlu": SuperLUFactorisation}


def default_backend() -> str:
    """``cholmod`` where cvxopt is installed, else ``superlu``."""
    return "cholmod" if find_spec("cvxopt") is not None else "superlu"


def factorisation(pattern: SymmetricPattern, backend: str | None = None) -> Factorisation:
    """A factorisation for matrices of this pattern by the named back end (None: the fastest installed)."""
    name = backend or default_backend()
    if name not in BACKENDS:
        raise InputError("factorisation back end", expected=" or ".join(BACKENDS), found=name)
    if name == "cholmod" and find_spec("cvxopt") is None:
        raise InputError(
            "factorisation back end cholmod", expected="the extra 'fast' (cvxopt) installed", found="none"
        )
    # After a large block was freed, glibc takes the arrays of later factorisations from the heap, without page faults.
    np.empty(4_000_000)
    return BACKENDS[name](pattern)
