"""Affine parametrisation q = B y + d of full degrees of freedom by free ones (theory §7).

``AffineMap`` has any sparse B: pinned vertices, a bounding volume. ``CopiedNodes`` is the case where every full node is
a turned and shifted copy of one free node, as periodic images are; its pull-back happens stencil by stencil
(``assembly``).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import cast

import numba
import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csc_array, csr_array

from yarnscale.numerics.factor import SymmetricPattern
from yarnscale.numerics.kkt import QuadraticModel
from yarnscale.numerics.newton import Objective

Array = NDArray[np.float64]
_JIT = {"cache": True, "error_model": "numpy", "fastmath": {"nsz", "arcp", "contract", "reassoc"}}


@dataclass(frozen=True, eq=False)
class AffineMap:
    """q = matrix @ y + offset: matrix (n_full, n_free) sparse, offset (n_full,)."""

    matrix: csr_array
    offset: Array

    @classmethod
    def pinning(cls, values: Array, pinned: NDArray[np.bool_]) -> AffineMap:
        """Map whose pinned entries keep ``values`` (n,) and whose free entries are y."""
        free = np.flatnonzero(~pinned)
        matrix = csr_array((np.ones(len(free)), (free, np.arange(len(free)))), shape=(len(values), len(free)))
        return cls(matrix, np.where(pinned, values, 0.0))

    def expand(self, free: Array) -> Array:
        """Full degrees of freedom, (n_full,)."""
        return self.matrix @ free + self.offset

    def pull_gradient(self, gradient: Array) -> Array:
        """Gradient by the free degrees of freedom, Bᵀ g."""
        return self.matrix.T @ gradient


class _PulledModel:
    def __init__(self, model: QuadraticModel, matrix: csr_array, pattern: SymmetricPattern | None) -> None:
        self._model, self._matrix = model, matrix
        self.pattern = pattern if pattern is not None else self._pattern()

    def _product(self, values: Array) -> csc_array:
        inner = self._model.pattern
        lower = csc_array((values, inner.rows, inner.starts), shape=(inner.size, inner.size))
        diagonal = csc_array((values[inner.diagonal], (np.arange(inner.size),) * 2), shape=lower.shape)
        return csc_array(self._matrix.T @ (lower + lower.T - diagonal) @ self._matrix)

    def _pattern(self) -> SymmetricPattern:
        _, size = cast("tuple[int, int]", self._matrix.shape)
        ones = abs(self._matrix)
        inner = self._model.pattern
        lower = csc_array((np.ones(inner.entries), inner.rows, inner.starts), shape=(inner.size, inner.size))
        product = (ones.T @ (lower + lower.T) @ ones).tocoo()
        below = product.row >= product.col
        keys = product.col[below].astype(np.int64) * size + product.row[below]
        diagonal = np.arange(size) * (size + 1)
        return SymmetricPattern.from_keys(size, np.unique(np.concatenate([keys, diagonal])))

    def values(self, shift: float) -> Array:
        """Entries of Bᵀ (H + shift·M) B."""
        product = self._product(self._model.values(shift)).tocoo()
        below = product.row >= product.col
        size = self.pattern.size
        columns = np.repeat(np.arange(size), np.diff(self.pattern.starts))
        keys = columns * size + self.pattern.rows
        entries = np.zeros(self.pattern.entries)
        at = np.searchsorted(keys, product.col[below].astype(np.int64) * size + product.row[below])
        np.add.at(entries, at, product.data[below])
        return entries


class MappedObjective:
    """An objective of the full degrees of freedom, as an objective of the free ones."""

    def __init__(self, objective: Objective, affine: AffineMap) -> None:
        self._objective, self._affine = objective, affine
        self._inner: SymmetricPattern | None = None
        self._pattern: SymmetricPattern | None = None

    @property
    def residual_scale(self) -> float:
        """Gradient norm that counts as 1."""
        return self._objective.residual_scale

    def value(self, x: Array) -> float:
        """Energy at the free degrees of freedom."""
        return self._objective.value(self._affine.expand(x))

    def gradient(self, x: Array) -> tuple[float, Array]:
        """Energy and Bᵀ g."""
        value, gradient = self._objective.gradient(self._affine.expand(x))
        return value, self._affine.pull_gradient(gradient)

    def quadratic(self, x: Array) -> tuple[float, Array, QuadraticModel]:
        """Energy, Bᵀ g and the model Bᵀ H B."""
        value, gradient, model = self._objective.quadratic(self._affine.expand(x))
        kept = self._pattern if model.pattern is self._inner else None
        pulled = _PulledModel(model, self._affine.matrix, kept)
        self._inner, self._pattern = model.pattern, pulled.pattern
        return value, self._affine.pull_gradient(gradient), pulled


@dataclass(frozen=True, eq=False)
class CopiedNodes:
    """Full nodes that copy free ones: x_m = R_m y_source(m) + d_m, followed by scalars that are free themselves.

    source: (m,) free node of each full node. rotation: (m, 3, 3), or (0, 3, 3) where all are the identity.
    offset: (m, 3). free_nodes, scalars: sizes of the free vector [3·free_nodes, scalars].
    """

    source: NDArray[np.int64]
    rotation: Array
    offset: Array
    free_nodes: int
    scalars: int

    @property
    def free_count(self) -> int:
        """Length of the free vector."""
        return 3 * self.free_nodes + self.scalars

    def expand(self, free: Array) -> Array:
        """Full vector [3·m positions, scalars]."""
        full = np.empty(3 * len(self.source) + self.scalars)
        _expand(free, self.source, self.rotation, self.offset, full)
        full[3 * len(self.source) :] = free[3 * self.free_nodes :]
        return full

    def pull_gradient(self, gradient: Array) -> Array:
        """Gradient by the free vector."""
        free = np.zeros(self.free_count)
        _pull(gradient, self.source, self.rotation, free)
        free[3 * self.free_nodes :] = gradient[3 * len(self.source) :]
        return free

    def unknowns(self, variables: NDArray[np.int64]) -> NDArray[np.int64]:
        """Free unknown that stands behind each full variable, same shape."""
        positions = 3 * len(self.source)
        node, component = np.divmod(np.minimum(variables, positions - 1), 3)
        scalar = variables - positions + 3 * self.free_nodes
        return np.where(variables < positions, 3 * self.source[node] + component, scalar)


@numba.njit(**_JIT)
def _expand(free, source, rotation, offset, full):
    turned = rotation.shape[0] > 0
    for m in range(source.shape[0]):
        s = 3 * source[m]
        for i in range(3):
            if turned:
                moved = (
                    rotation[m, i, 0] * free[s]
                    + rotation[m, i, 1] * free[s + 1]
                    + rotation[m, i, 2] * free[s + 2]
                )
            else:
                moved = free[s + i]
            full[3 * m + i] = moved + offset[m, i]


@numba.njit(**_JIT)
def _pull(gradient, source, rotation, free):
    turned = rotation.shape[0] > 0
    for m in range(source.shape[0]):
        s, g = 3 * source[m], 3 * m
        for i in range(3):
            if turned:
                free[s + i] += (
                    rotation[m, 0, i] * gradient[g]
                    + rotation[m, 1, i] * gradient[g + 1]
                    + rotation[m, 2, i] * gradient[g + 2]
                )
            else:
                free[s + i] += gradient[g + i]
