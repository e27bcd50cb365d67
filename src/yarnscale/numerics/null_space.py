"""Many linear constraints, each on a closed chain of unknowns of its own, eliminated by a basis of their null space.

A constraint Σ cᵢ·xᵢ = 0 along a chain of groups holds exactly where the components along cᵢ are differences around
the chain, cᵢ·xᵢ = sᵢ − sᵢ₋₁ with one s kept at zero: a basis Z in which every vector touches two neighbours. The
matrix ZᵀKZ is nearly as sparse as K, so that many constraints cost no more than one. The few constraints on all
unknowns are left to a Schur complement, as in ``kkt``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numba
import numpy as np
from scipy.sparse import csr_array, vstack

from yarnscale.arrays import Array, Integers
from yarnscale.numerics.block_pattern import BlockPattern, find_block
from yarnscale.numerics.factor import SymmetricPattern
from yarnscale.numerics.kkt import ConstrainedSolver, LinearConstraints, QuadraticModel
from yarnscale.numerics.regularisation import ShiftedHessian

WIDTH = 4
"""Most reduced unknowns behind one group: two of the chain and two across it."""
_JIT = {"cache": True, "error_model": "numpy"}


@dataclass(frozen=True, eq=False)
class Chain:
    """A constraint Σ cᵢ·xᵢ = 0 on groups in their order around a closed chain.

    groups: (L,). coefficients: cᵢ (L, k), k the size of these groups.
    """

    groups: Integers
    coefficients: Array


@dataclass(frozen=True, eq=False)
class GroupBasis:
    """Groups x_g = weight[g] @ y[index[g]] of reduced unknowns y.

    index: (g, WIDTH), −1: none. weight: (g, 3, WIDTH). sizes: of the reduced groups.
    """

    index: Integers
    weight: Array
    sizes: Integers

    @classmethod
    def of(cls, group_sizes: Integers, chains: Sequence[Chain]) -> GroupBasis:
        """Basis of the null space of chains that share no group; groups in no chain stay as they are."""
        count = len(group_sizes)
        along, before = np.zeros(count, bool), np.full(count, -1)
        dropped = np.zeros(count, bool)
        weight = np.zeros((count, 3, WIDTH))
        weight[:, range(3), range(3)] = 1.0
        for chain in chains:
            size = np.linalg.norm(chain.coefficients, axis=1)
            k = chain.coefficients.shape[1]
            part = np.zeros((len(size), 3, WIDTH))
            part[:, :k, 0] = chain.coefficients / size[:, None] ** 2 * size.mean()
            part[:, :k, 1] = -part[:, :k, 0]
            if k == 3:
                part[:, :, 2], part[:, :, 3] = _across(chain.coefficients / size[:, None])
            weight[chain.groups], along[chain.groups] = part, True
            before[chain.groups] = np.roll(chain.groups, 1)
            dropped[chain.groups[-1]] = True
        # Reduced groups in the order of their owners: the difference along the chain, then what is across it.
        own = np.column_stack([along & ~dropped, np.where(along, group_sizes - 1, group_sizes)])
        first = np.concatenate([[0], np.cumsum(own.ravel())])[:-1].reshape(-1, 2)
        index = np.full((count, WIDTH), -1)
        kept = along & ~dropped
        index[kept, 0] = first[kept, 0]
        index[along, 1] = index[before[along], 0]
        for column, place in ((2, 0), (3, 1)):
            there = along & (group_sizes > column - 1)
            index[there, column] = first[there, 1] + place
        for column in range(3):
            there = ~along & (group_sizes > column)
            index[there, column] = first[there, 1] + column
        return cls(index, weight, own[own > 0].astype(np.int64))

    def matrix(self, group_sizes: Integers) -> csr_array:
        """Z as a sparse matrix (n, r)."""
        there = np.arange(3)[None, :] < group_sizes[:, None]
        rows = np.cumsum(there.ravel()).reshape(there.shape) - 1
        g, a, b = np.nonzero(there[:, :, None] & (self.index >= 0)[:, None, :] & (self.weight != 0.0))
        shape = (int(group_sizes.sum()), int(self.sizes.sum()))
        return csr_array((self.weight[g, a, b], (rows[g, a], self.index[g, b])), shape=shape)


def _across(unit: Array) -> tuple[Array, Array]:
    """Two unit vectors at right angles to each of the unit vectors (L, 3) and to each other."""
    least = np.eye(3)[np.abs(unit).argmin(axis=1)]
    first = np.cross(unit, least)
    first /= np.linalg.norm(first, axis=1)[:, None]
    return first, np.asarray(np.cross(unit, first), np.float64)


@dataclass(eq=False)
class ChainConstraints:
    """Homogeneous constraints: chains that share no group, and a few rows on all unknowns.

    group_sizes: (g,). everywhere: (d, n) rows, made independent. ``matrix`` has orthonormal rows.
    """

    group_sizes: Integers
    chains: Sequence[Chain]
    everywhere: Array
    matrix: csr_array = field(init=False, repr=False)
    right: Array = field(init=False, repr=False)

    def __post_init__(self) -> None:
        first = np.concatenate([[0], np.cumsum(self.group_sizes)])
        size = int(first[-1])
        rows, columns, entries = [], [], []
        for number, chain in enumerate(self.chains):
            k = chain.coefficients.shape[1]
            columns.append((first[chain.groups][:, None] + np.arange(k)).ravel())
            entries.append((chain.coefficients / np.linalg.norm(chain.coefficients)).ravel())
            rows.append(np.full(len(columns[-1]), number))
        parts = np.concatenate(entries), (np.concatenate(rows), np.concatenate(columns))
        local = csr_array(parts, shape=(len(self.chains), size))
        rest = self.everywhere / np.linalg.norm(self.everywhere, axis=1)[:, None]
        rest = rest - (local.T @ (local @ rest.T)).T
        sizes, vectors = np.linalg.eigh(rest @ rest.T)
        kept = sizes > 1e-14
        self.few = (vectors[:, kept] / np.sqrt(sizes[kept])).T @ rest
        self.matrix = csr_array(vstack([local, csr_array(self.few)]))
        self.right = np.zeros(len(self.chains) + len(self.few))
        self.basis = GroupBasis.of(self.group_sizes, self.chains)
        self.null = self.basis.matrix(self.group_sizes)
        self.few_reduced = np.ascontiguousarray((self.null.T @ self.few.T).T)

    def project(self, vector: Array) -> Array:
        return vector - self.matrix.T @ (self.matrix @ vector)


@dataclass
class NullSpaceSolver:
    """Factor and solve of K p + Cᵀ λ = b, C p = d by p = Z y + …; stands beside ``kkt.ConstrainedSolver``."""

    constraints: ChainConstraints
    _pattern: SymmetricPattern | None = None
    _values: Array | None = None

    def __post_init__(self) -> None:
        few = self.constraints.few_reduced
        rows = LinearConstraints(few, np.zeros(len(few))) if len(few) else None
        self._reduced = ConstrainedSolver(rows)

    @property
    def factorisations(self) -> int:
        """Number of factorisations so far."""
        return self._reduced.factorisations

    def factorise(self, model: QuadraticModel, shift: float) -> bool:
        """Factor the model's matrix with this shift; False where it is not positive definite on the null space."""
        if model.pattern is not self._pattern:
            self._lay_out(model.pattern)
        self._values = values = model.values(shift)
        reduced = np.zeros(self._inner.entries)
        basis = self.constraints.basis
        _reduce(*self._blocks, self._starts, self._first, basis.weight, self._slots, values, reduced)
        return self._reduced.factorise(ShiftedHessian(self._inner, reduced), 0.0)

    def _lay_out(self, pattern: SymmetricPattern) -> None:
        """Pattern of the reduced matrix, and where each block of the full one goes in it."""
        constraints, basis = self.constraints, self.constraints.basis
        first = np.concatenate([[0], np.cumsum(constraints.group_sizes)])
        group = np.repeat(np.arange(len(constraints.group_sizes)), constraints.group_sizes)
        self._pattern, self._starts, self._first = pattern, pattern.starts, first
        self._blocks = column, row, _ = _blocks(pattern.starts, pattern.rows, group, first)
        reduced = BlockPattern.of(basis.sizes, [np.hstack([basis.index[row], basis.index[column]])])
        self._slots = _slots(
            reduced.starts, reduced.rows, reduced.offsets, reduced.group, reduced.first, reduced.pattern.starts,
            row, column, basis.index,
        )  # fmt: skip
        self._inner = reduced.pattern

    def step(self, right: Array, gap: Array | None) -> Array:
        """Solve K p + Cᵀ λ = right, C p = gap (None: 0) for columns (n, k) or a vector (n,)."""
        assert self._pattern is not None and self._values is not None
        constraints = self.constraints
        columns = right.reshape(len(right), -1)
        fixed = np.zeros((len(right), 1))
        if gap is not None and gap.any():
            fixed[:, 0] = constraints.matrix.T @ gap
            columns = columns - self._pattern.multiply(self._values, fixed)
        step = constraints.null @ self._reduced.step(constraints.null.T @ columns, None) + fixed
        return step if right.ndim == 2 else step[:, 0]


@numba.njit(**_JIT)
def _blocks(starts, rows, group, first):
    """Column group, row group and offset below the column's first entry of every block of a pattern."""
    groups = len(first) - 1
    capacity = 0
    for c in range(groups):
        capacity += starts[first[c] + 1] - starts[first[c]]
    column, row = np.empty(capacity, np.int64), np.empty(capacity, np.int64)
    offset = np.empty(capacity, np.int64)
    found = 0
    for c in range(groups):
        begin, last = starts[first[c]], -1
        for k in range(begin, starts[first[c] + 1]):
            g = group[rows[k]]
            if g != last:
                column[found], row[found], offset[found] = c, g, k - begin
                found += 1
                last = g
    return column[:found].copy(), row[:found].copy(), offset[:found].copy()


@numba.njit(**_JIT)
def _slots(starts, rows, offsets, group, first, column_starts, row, column, index):
    """Where the entries of each block's WIDTH × WIDTH contribution go; −1: nowhere, s ≤ −2: twice to −s−2."""
    slots = np.full((len(row), WIDTH * WIDTH), -1, np.int32)
    for k in range(len(row)):
        for p in range(WIDTH):
            for q in range(WIDTH):
                i, j = index[row[k], p], index[column[k], q]
                if i < 0 or j < 0 or (row[k] == column[k] and i < j):
                    continue
                twice = i == j and row[k] != column[k]
                if i < j:
                    i, j = j, i
                block = find_block(starts, rows, group[j], group[i])
                s = column_starts[j] + offsets[block] + (i - first[group[i]]) - (j - first[group[j]])
                slots[k, WIDTH * p + q] = -s - 2 if twice else s
    return slots


@numba.njit(**_JIT)
def _reduce(column, row, offset, starts, first, weight, slots, values, reduced):
    """Add Zᵀ K Z, block by block."""
    block, half = np.empty((3, 3)), np.empty((3, WIDTH))
    for k in range(len(column)):
        c, r = column[k], row[k]
        height, width = first[r + 1] - first[r], first[c + 1] - first[c]
        for b in range(width):
            begin = starts[first[c] + b] + offset[k] - b
            for a in range(b if r == c else 0, height):
                block[a, b] = values[begin + a]
                if r == c:
                    block[b, a] = block[a, b]
        for a in range(height):
            for q in range(WIDTH):
                total = 0.0
                for b in range(width):
                    total += block[a, b] * weight[c, b, q]
                half[a, q] = total
        for p in range(WIDTH):
            for q in range(WIDTH):
                s = slots[k, WIDTH * p + q]
                if s == -1:
                    continue
                total = 0.0
                for a in range(height):
                    total += weight[r, a, p] * half[a, q]
                if s >= 0:
                    reduced[s] += total
                else:
                    reduced[-s - 2] += 2.0 * total
