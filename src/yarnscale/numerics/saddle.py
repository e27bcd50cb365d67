"""Many sparse linear constraints: KKT systems factored whole, as L D Lᵀ, instead of eliminating the constraints.

The number of positive pivots tells whether the matrix is positive definite on the constraints: by Sylvester's law it
is the number of unknowns exactly then.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import qdldl
from scipy.sparse import bmat, csc_array, csr_array, diags_array, tril

from yarnscale.arrays import Array, Integers
from yarnscale.numerics.factor import Factorisation, SymmetricPattern
from yarnscale.numerics.kkt import QuadraticModel

_SOFTNESS = 1e-10
"""−softness·I in the corner of the constraints, in units of the matrix: pivots exist, refinement undoes it."""
_REFINEMENTS = 3


@dataclass(eq=False)
class SparseConstraints:
    """``matrix @ x = right`` with many rows, independent of each other: matrix (m, n) sparse, right (m,)."""

    matrix: csr_array
    right: Array
    _normal: _NormalFactor | None = field(init=False, default=None, repr=False)
    _earlier: _NormalFactor | None = field(init=False, default=None, repr=False)

    def __post_init__(self) -> None:
        self.matrix.sort_indices()
        self.transposed = self.matrix.T

    def renewed(self, matrix: csr_array, right: Array) -> SparseConstraints:
        """Constraints of a later step, which reuse the symbolic analysis where their rows have the same sparsity."""
        new = SparseConstraints(matrix, right)
        new._earlier = self._normal or self._earlier
        return new

    def project(self, vector: Array) -> Array:
        if self._normal is None:
            # A Cholesky factor of C Cᵀ; the constraints touch few unknowns each, so that it is sparse too.
            self._normal, self._earlier = _NormalFactor.of(self.matrix, self._earlier), None
        return vector - self.transposed @ self._normal.factor.solve(self.matrix @ vector)


@dataclass(frozen=True, eq=False)
class _NormalFactor:
    """C Cᵀ factored."""

    pattern: SymmetricPattern
    factor: Factorisation

    @classmethod
    def of(cls, matrix: csr_array, earlier: _NormalFactor | None) -> _NormalFactor:
        lower = csc_array(tril(csc_array(matrix @ matrix.T)))  # the diagonal is present
        lower.sort_indices()
        starts, rows = lower.indptr.astype(np.int64), lower.indices.astype(np.int64)
        pattern, entries = SymmetricPattern(len(starts) - 1, starts, rows), np.asarray(lower.data, np.float64)
        alike = earlier is not None and earlier.pattern.alike(pattern)
        factor = earlier.factor.another() if earlier is not None and alike else Factorisation(pattern)
        values = entries.copy()
        while not factor.factor(values):  # dependent rows
            values[pattern.diagonal] += 1e-12 * float(np.abs(entries).max())
            if values[pattern.diagonal].max() > 2.0 * float(np.abs(entries).max()):
                raise ArithmeticError("linearly dependent constraints")
        return cls(pattern, factor)


@dataclass
class SaddleSolver:
    """Factor and solve of K p + Cᵀ λ = b, C p = d; stands beside ``kkt.ConstrainedSolver``.

    ``constraints`` may be exchanged between solves for others whose rows have the same sparsity.
    """

    constraints: SparseConstraints
    factorisations: int = 0
    _pattern: SymmetricPattern | None = None
    _system: csc_array | None = None
    _order: Integers | None = None
    _solver: object | None = None
    _scale: float = 1.0
    _values: Array | None = None

    def factorise(self, model: QuadraticModel, shift: float) -> bool:
        values = model.values(shift)
        if not np.isfinite(values).all():
            return False
        self.factorisations += 1
        fresh = self._solver is None or model.pattern is not self._pattern
        if fresh:
            self._lay_out(model.pattern)
        assert self._system is not None and self._order is not None
        rows = self.constraints.matrix
        # Rows of the constraints at the size of the matrix: pivots of one magnitude.
        self._scale = float(np.abs(values[model.pattern.diagonal]).mean())
        corner = np.full(len(self.constraints.right), -_SOFTNESS)
        entries = np.concatenate([values, self._scale * rows.data, self._scale * corner])[self._order]
        upper = csc_array((entries, self._system.indices, self._system.indptr), shape=self._system.shape)
        self._values = values
        if fresh:
            self._solver = qdldl.Solver(upper, upper=True)
        else:
            self._solver.update(upper, upper=True)  # type: ignore[union-attr]
        pivots = self._solver.factors()[1]  # type: ignore[union-attr]
        return int((pivots > 0).sum()) == model.pattern.size

    def _lay_out(self, pattern: SymmetricPattern) -> None:
        """Upper triangle of [H Cᵀ; C −softness], and in which order the entries of its parts stand in it."""
        self._pattern = pattern
        n, rows = pattern.size, self.constraints.matrix
        m = len(self.constraints.right)
        # Every entry carries its number in (H, C, corner), to be found again; none is zero, so that none is dropped.
        numbers = 1.0 + np.arange(pattern.entries + rows.data.size + m)
        upper, below, corner = np.split(numbers, [pattern.entries, pattern.entries + rows.data.size])
        matrix = csc_array((upper, pattern.rows, pattern.starts), shape=(n, n)).T
        constraints = csr_array((below, rows.indices, rows.indptr), shape=rows.shape).T
        self._system = csc_array(bmat([[matrix, constraints], [None, diags_array(corner)]]))
        self._system.sort_indices()
        self._order = np.rint(self._system.data).astype(np.int64) - 1

    def step(self, right: Array, gap: Array | None) -> Array:
        """Solve K p + Cᵀ λ = right, C p = gap (None: 0) for a vector (n,) or columns (n, k)."""
        if right.ndim == 2:
            return np.column_stack([self.step(column, gap) for column in right.T])
        assert self._solver is not None and self._pattern is not None and self._values is not None
        n, rows, scale = self._pattern.size, self.constraints.matrix, self._scale
        wanted = np.zeros(len(self.constraints.right)) if gap is None else gap
        solution = np.zeros(n + len(wanted))
        for _ in range(_REFINEMENTS):
            p, force = solution[:n], solution[n:]
            free = right - self._pattern.multiply(self._values, p) - scale * (self.constraints.transposed @ force)
            residual = np.concatenate([free, scale * (wanted - rows @ p)])
            solution = solution + self._solver.solve(residual)  # type: ignore[attr-defined]
        return solution[:n]
