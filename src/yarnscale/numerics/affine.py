"""Affine parametrisation q = B y + d of full degrees of freedom by free ones (theory §7).

``NodeMap`` has nodes that are weighted sums of others, as in a bounding volume. ``FreeUnknowns`` are some of the full
degrees of freedom. ``CopiedNodes`` is the case where every full node is a turned and shifted copy of one free node, as
periodic images are; its pull-back happens stencil by stencil (``assembly``).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Protocol, cast

import numba
import numpy as np
from scipy.sparse import csr_array

from yarnscale.arrays import Array, Integers
from yarnscale.numerics.factor import SymmetricPattern, by_rows
from yarnscale.numerics.kkt import QuadraticModel
from yarnscale.numerics.newton import Objective

_JIT = {"cache": True, "error_model": "numpy", "fastmath": {"nsz", "arcp", "contract", "reassoc"}}


@dataclass(frozen=True, eq=False)
class NodeMap:
    """Nodes as weighted sums of other nodes, the same for x, y and z: q = (weights ⊗ 1₃) y + offset.

    weights: (m, n) dense or sparse; offset: (3m,). A bounding volume maps so (LOD03 §3): the blocks of a Hessian are
    pulled back by ``weights`` alone.
    """

    weights: Array | csr_array
    offset: Array

    def expand(self, free: Array) -> Array:
        return (self.weights @ free.reshape(-1, 3)).ravel() + self.offset

    def pull_gradient(self, gradient: Array) -> Array:
        return (self.weights.T @ gradient.reshape(-1, 3)).ravel()

    def pulled(self, inner: SymmetricPattern) -> _NodePull:
        return _NodePull(self.weights, inner)


@lru_cache(maxsize=4)
def _full_pattern(size: int) -> SymmetricPattern:
    """Every entry of a matrix; one object for one size, so that it is analysed once."""
    column, row = np.triu_indices(size)
    return SymmetricPattern.from_keys(size, column * size + row)


class _NodePull:
    """(W ⊗ 1₃)ᵀ H (W ⊗ 1₃) by its six different blocks Wᵀ H_kl W; every pair of nodes is taken to meet."""

    def __init__(self, weights: Array | csr_array, inner: SymmetricPattern) -> None:
        self._weights = weights
        _, count = cast("tuple[int, int]", weights.shape)
        self._count, size, nodes = count, 3 * count, inner.size // 3
        self._column, self._row = np.triu_indices(size)
        self.pattern = _full_pattern(size)
        columns = inner.columns
        self._blocks = []
        for k in range(3):
            for other in range(k + 1):
                # Lower entries of either order of the components make up the block (k, other).
                own = np.flatnonzero((inner.rows % 3 == k) & (columns % 3 == other))
                turned = np.flatnonzero((inner.rows % 3 == other) & (columns % 3 == k))
                turned = turned[inner.rows[turned] // 3 != columns[turned] // 3] if k == other else turned
                source = np.concatenate([own, turned])
                r = np.concatenate([inner.rows[own], columns[turned]]) // 3
                c = np.concatenate([columns[own], inner.rows[turned]]) // 3
                order, indices, begins = by_rows(r, c, nodes)
                self._blocks.append((k, other, source[order], indices, begins))

    def entries(self, values: Array) -> Array:
        nodes, whole = len(self._blocks[0][4]) - 1, np.empty((self._count, 3, self._count, 3))
        for k, other, order, indices, indptr in self._blocks:
            block = csr_array((values[order], indices, indptr), shape=(nodes, nodes))
            pulled = self._weights.T @ (block @ self._weights)
            pulled = pulled if isinstance(pulled, np.ndarray) else pulled.toarray()
            whole[:, k, :, other], whole[:, other, :, k] = pulled, pulled.T
        return whole.reshape(3 * self._count, -1)[self._row, self._column]


@dataclass(frozen=True, eq=False)
class FreeUnknowns:
    """Some of the degrees of freedom, ``places`` (k,) increasing; the others stay as in ``state`` (n,)."""

    places: Integers
    state: Array

    def expand(self, free: Array) -> Array:
        full = self.state.copy()
        full[self.places] = free
        return full

    def pull_gradient(self, gradient: Array) -> Array:
        return gradient[self.places]

    def pulled(self, inner: SymmetricPattern) -> _PartPull:
        return _PartPull(self.places, inner)


class _PartPull:
    def __init__(self, places: Integers, inner: SymmetricPattern) -> None:
        self.pattern, self._chosen = inner.part(places)

    def entries(self, values: Array) -> Array:
        return values[self._chosen]


class MatrixPull(Protocol):
    """How the entries of matrices H of one pattern become those of Bᵀ H B."""

    pattern: SymmetricPattern

    def entries(self, values: Array) -> Array: ...


class AffineParameters(Protocol):
    """A parametrisation q = B y + d: q, Bᵀ g, and how matrices of a pattern are pulled back."""

    def expand(self, free: Array) -> Array: ...
    def pull_gradient(self, gradient: Array) -> Array: ...
    def pulled(self, inner: SymmetricPattern) -> MatrixPull: ...


class KeptPull:
    """How matrices are pulled back by a parametrisation, kept until a matrix has another pattern."""

    def __init__(self, affine: AffineParameters) -> None:
        self._affine = affine
        self._inner: SymmetricPattern | None = None
        self._pull: MatrixPull | None = None

    def of(self, inner: SymmetricPattern) -> MatrixPull:
        """That of matrices of this pattern."""
        if self._pull is None or inner is not self._inner:
            self._inner, self._pull = inner, self._affine.pulled(inner)
        return self._pull


class _PulledModel:
    def __init__(self, model: QuadraticModel, pull: MatrixPull) -> None:
        self._model, self._pull = model, pull
        self.pattern = pull.pattern

    def values(self, shift: float) -> Array:
        """Entries of Bᵀ (H + shift·M) B."""
        return self._pull.entries(self._model.values(shift))


class MappedObjective:
    """An objective of the full degrees of freedom, as an objective of the free ones.

    pull: that of an objective with the same parameters before this one, whose matrices had the same pattern.
    """

    def __init__(self, objective: Objective, affine: AffineParameters, *, pull: KeptPull | None = None) -> None:
        self._objective, self._affine = objective, affine
        self._pull = pull or KeptPull(affine)

    @property
    def residual_scale(self) -> float:
        return self._objective.residual_scale

    def value(self, x: Array) -> float:
        return self._objective.value(self._affine.expand(x))

    def gradient(self, x: Array) -> tuple[float, Array]:
        value, gradient = self._objective.gradient(self._affine.expand(x))
        return value, self._pulled(gradient)

    def quadratic(self, x: Array) -> tuple[float, Array, QuadraticModel]:
        value, gradient, model = self._objective.quadratic(self._affine.expand(x))
        return value, self._pulled(gradient), _PulledModel(model, self._pull.of(model.pattern))

    def _pulled(self, gradient: Array) -> Array:
        return self._affine.pull_gradient(gradient)


@dataclass(frozen=True, eq=False)
class CopiedNodes:
    """Full nodes that copy free ones: x_m = R_m y_source(m) + d_m, followed by scalars that are free themselves.

    source: (m,) free node of each full node. rotation: (m, 3, 3), or (0, 3, 3) where all are the identity.
    offset: (m, 3). free_nodes, scalars: sizes of the free vector [3·free_nodes, scalars].
    """

    source: Integers
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

    def unknowns(self, variables: Integers) -> Integers:
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
                moved = rotation[m, i, 0] * free[s] + rotation[m, i, 1] * free[s + 1] + rotation[m, i, 2] * free[s + 2]
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
