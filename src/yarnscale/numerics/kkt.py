"""Solve K p + Cᵀ λ = b, C p = d for a sparse positive definite K and few constraint rows C."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from yarnscale.arrays import Array
from yarnscale.numerics.factor import Factorisation, SymmetricPattern


class QuadraticModel(Protocol):
    """Second-order model of an objective at a point, H + shift·M with M positive: a diagonal, or a positive model − H.

    pattern: of the Hessian; the same object as long as it did not change. values: entries at a shift.
    """

    @property
    def pattern(self) -> SymmetricPattern: ...
    def values(self, shift: float) -> Array: ...


@dataclass(frozen=True, eq=False)
class LinearConstraints:
    """``matrix @ x = right`` with few rows: matrix (m, n), right (m,)."""

    matrix: Array
    right: Array
    _basis: Array = field(init=False, repr=False)

    def __post_init__(self) -> None:
        orthonormal = np.allclose(self.matrix @ self.matrix.T, np.eye(len(self.matrix)), rtol=0.0, atol=1e-12)
        object.__setattr__(self, "_basis", self.matrix.T if orthonormal else np.linalg.qr(self.matrix.T)[0])

    def project(self, vector: Array) -> Array:
        """Part of a gradient that the constraints leave free, (n,)."""
        return vector - self._basis @ (self._basis.T @ vector)


@dataclass
class ConstrainedSolver:
    """Factor and constraint elimination; the symbolic analysis lives as long as the pattern.

    The constraints are eliminated by a Schur complement on the factor, with one extra column each.
    """

    constraints: LinearConstraints | None = None
    factorisations: int = 0
    analyses: int = 0
    _pattern: SymmetricPattern | None = None
    _factor: Factorisation | None = None
    _columns: Array | None = None  # K⁻¹ Cᵀ of the present factor
    _schur: Array | None = None

    def factorise(self, model: QuadraticModel, shift: float) -> bool:
        """Factor the model's matrix with this shift; False where it is not positive definite."""
        if self._factor is None or model.pattern is not self._pattern:
            self._pattern = model.pattern
            self._factor = Factorisation(model.pattern)
            self.analyses += 1
        self.factorisations += 1
        self._columns = None
        return self._factor.factor(model.values(shift))

    def step(self, right: Array, gap: Array | None) -> Array:
        """Solve K p + Cᵀ λ = right, C p = gap (None: 0) for columns (n, k) or a vector (n,)."""
        assert self._factor is not None
        if self.constraints is None:
            return self._factor.solve(right)
        matrix = self.constraints.matrix
        if self._columns is None or self._schur is None:
            solved = self._factor.solve(np.column_stack([right, matrix.T]))
            free, self._columns = solved[:, : -len(matrix)], solved[:, -len(matrix) :]
            self._schur = matrix @ self._columns
        else:
            free = self._factor.solve(right).reshape(len(right), -1)
        step, wanted = free, 0.0 if gap is None else gap[:, None]
        for _ in range(2):  # the second time takes away what round-off of a soft K left, so that none adds up
            step = step - self._columns @ np.linalg.solve(self._schur, matrix @ step - wanted)
        return step if right.ndim == 2 else step[:, 0]
