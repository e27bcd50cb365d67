"""Stencils → energy, gradient and sparse Hessian, in compiled loops over blocks of elements.

A set of stencils gathers its variables from a full vector, runs a generated kernel on blocks, and scatters the result:
gradients by index, Hessian entries by slots that are computed once per topology.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numba
import numpy as np
from numpy.typing import NDArray

from yarnscale.numerics.energy import StencilEnergy
from yarnscale.numerics.factor import SymmetricPattern
from yarnscale.numerics.kernel import BLOCK, LANES, call_kernel, run_columns

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

_SKIPPED = -1  # slot of an entry that belongs to a fixed variable
_JIT = {"cache": True, "error_model": "numpy", "fastmath": {"nsz", "arcp", "contract", "reassoc"}}


def _blocked(columns: NDArray) -> NDArray:
    """(k, N) → (blocks, k, BLOCK), the last element repeated so that padded lanes stay harmless."""
    k, count = columns.shape
    blocks = -(-count // BLOCK)
    padded = np.empty((k, blocks * BLOCK), columns.dtype)
    padded[:, :count] = columns
    if count:
        padded[:, count:] = columns[:, -1:]
    return np.ascontiguousarray(padded.reshape(k, blocks, BLOCK).transpose(1, 0, 2))


@dataclass(eq=False)
class StencilSet:
    """Many stencils of one energy.

    variables: (N, n_variables) positions in the full vector. parameters: (N, n_parameters).
    Position variables come first, in threes (``vectors`` of them), then scalars; in the full vector node m of three
    positions begins at 3 m.
    """

    energy: StencilEnergy
    variables: Indices
    parameters: Array
    vectors: int
    count: int = field(init=False)

    def __post_init__(self) -> None:
        self.count = len(self.variables)
        expected = (self.energy.variable_count, self.energy.parameter_count)
        if (self.variables.shape[1], self.parameters.shape[1]) != expected:
            found = (self.variables.shape[1], self.parameters.shape[1])
            raise ValueError(f"stencils of '{self.energy.name}': expected columns {expected}, found {found}")
        self._index = _blocked(np.ascontiguousarray(self.variables.T, np.int64))
        self._parameters = _blocked(np.ascontiguousarray(self.parameters.T, np.float64))

    def value(self, full: Array) -> float:
        """Energy at the full vector."""
        if self.count == 0:
            return 0.0
        return _run_value(self.energy.value.address, full, self._index, self._parameters, self.count)

    def gradient(self, full: Array, gradient: Array) -> float:
        """Energy; adds the gradient to ``gradient``, of the full vector's length."""
        if self.count == 0:
            return 0.0
        address = self.energy.gradient.address
        return _run_gradient(address, full, self._index, self._parameters, self.count, gradient)

    def hessian(
        self, full: Array, gradient: Array, slots: NDArray[np.int32], rotation: Array, values: Array
    ) -> float:
        """Energy; adds gradient and Hessian entries.

        slots: from ``BlockPattern.slots``. rotation: (full nodes, 3, 3) of the copies, or (0, 3, 3) where all are the
        identity; a copy's block is turned back before it is added. values: (entries,) of the pattern.
        """
        if self.count == 0:
            return 0.0
        address, entries = self.energy.hessian.address, self.energy.variable_count
        return _run_hessian(
            address, full, self._index, self._parameters, self.count, gradient,
            slots, entries * (entries + 1) // 2, rotation, self.vectors, values,
        )  # fmt: skip

    def by_parameters(self, full: Array, names: tuple[str, ...]) -> Array:
        """Derivative of every stencil's energy by the named parameters, (N, k)."""
        kernel = self.energy.mixed(names)
        return run_columns(kernel, full[self.variables], self.parameters)[0]

    def elements(self, full: Array) -> tuple[Array, Array, Array]:
        """Energy (N,), gradient (N, n) and Hessian (N, n, n) of every stencil in the full variables."""
        n, padded = self.energy.variable_count, len(self._index) * BLOCK
        lower = np.tril_indices(n)
        energies, gradients, hessians = np.empty(padded), np.empty((padded, n)), np.empty((padded, n, n))
        for block, (index, parameters) in enumerate(zip(self._index, self._parameters, strict=True)):
            outputs = np.empty((1, BLOCK)), np.empty((n, BLOCK)), np.empty((len(lower[0]), BLOCK))
            self.energy.hessian(BLOCK, BLOCK, np.ascontiguousarray(full[index]), parameters, *outputs)
            part = slice(block * BLOCK, (block + 1) * BLOCK)
            energies[part], gradients[part] = outputs[0][0], outputs[1].T
            hessians[part, lower[0], lower[1]] = outputs[2].T
            hessians[part, lower[1], lower[0]] = outputs[2].T
        return energies[: self.count], gradients[: self.count], hessians[: self.count]


@dataclass(frozen=True, eq=False)
class BlockPattern:
    """Pattern of a symmetric matrix whose unknowns come in groups (a vertex of 3, a scalar of 1).

    Which groups meet is kept in a dense table, so it suits up to a few thousand groups.
    """

    pattern: SymmetricPattern
    group: Indices
    first: Indices
    offsets: NDArray[np.int32]

    @classmethod
    def of(cls, group_sizes: Indices, unknowns: list[Indices]) -> BlockPattern:
        """Pattern of stencils: each array (N, k) holds unknowns that meet (−1: fixed)."""
        first = np.zeros(len(group_sizes) + 1, np.int64)
        np.cumsum(group_sizes, out=first[1:])
        group = np.repeat(np.arange(len(group_sizes)), group_sizes)
        table = np.eye(len(group_sizes), dtype=np.uint8)
        for rows in unknowns:
            _mark(table, group, rows)
        size = int(first[-1])
        starts = np.zeros(size + 1, np.int64)
        offsets = np.full(table.shape, -1, np.int32)
        entries = _lay_out(table, first, starts, offsets)
        rows = np.empty(entries, np.int64)
        _fill_rows(offsets, first, starts, rows)
        return cls(SymmetricPattern(size, starts, rows), group, first, offsets)

    def covers(self, unknowns: Indices) -> bool:
        """Whether all pairs of these stencils' unknowns, (N, k), lie in the pattern."""
        return bool(_covered(self.offsets, self.group, unknowns))

    def slots(self, unknowns: Indices) -> NDArray[np.int32]:
        """Where a stencil's Hessian entries go: (blocks, n(n+1)/2, BLOCK).

        −1: skipped. s ≤ −2: entry −s−2 on the diagonal, added twice (two variables of the stencil are one unknown).
        Raises ValueError where two of them do not meet in the pattern.
        """
        count, k = unknowns.shape
        blocks = -(-count // BLOCK)
        slots = np.full((blocks, k * (k + 1) // 2, BLOCK), _SKIPPED, np.int32)
        if not _fill_slots(self.offsets, self.group, self.first, self.pattern.starts, unknowns, slots):
            raise ValueError("the pattern does not cover these stencils")
        return slots


@numba.njit(**_JIT)
def _mark(table, group, rows):
    for e in range(rows.shape[0]):
        for a in range(rows.shape[1]):
            i = rows[e, a]
            if i < 0:
                continue
            for b in range(a + 1):
                j = rows[e, b]
                if j >= 0:
                    table[min(group[i], group[j]), max(group[i], group[j])] = 1


@numba.njit(**_JIT)
def _covered(offsets, group, rows):
    for e in range(rows.shape[0]):
        for a in range(rows.shape[1]):
            i = rows[e, a]
            if i < 0:
                continue
            for b in range(a + 1):
                j = rows[e, b]
                if j >= 0 and offsets[min(group[i], group[j]), max(group[i], group[j])] < 0:
                    return False
    return True


@numba.njit(**_JIT)
def _lay_out(table, first, starts, offsets):
    """Offset of each row group within each column group, and the start of every column."""
    groups = table.shape[0]
    for c in range(groups):
        height = 0
        for r in range(c, groups):
            if table[c, r]:
                offsets[c, r] = height
                height += first[r + 1] - first[r]
        for local in range(first[c + 1] - first[c]):
            j = first[c] + local
            starts[j + 1] = starts[j] + height - local
    return starts[-1]


@numba.njit(**_JIT)
def _fill_rows(offsets, first, starts, rows):
    groups = offsets.shape[0]
    for c in range(groups):
        for r in range(c, groups):
            if offsets[c, r] < 0:
                continue
            for local in range(first[c + 1] - first[c]):
                j = first[c] + local
                for i in range(max(first[r], j), first[r + 1]):
                    rows[starts[j] + offsets[c, r] + (i - first[r]) - local] = i


@numba.njit(**_JIT)
def _fill_slots(offsets, group, first, starts, unknowns, slots):
    for e in range(unknowns.shape[0]):
        block, lane = divmod(e, slots.shape[2])
        k = 0
        for a in range(unknowns.shape[1]):
            for b in range(a + 1):
                i, j = unknowns[e, a], unknowns[e, b]
                if i >= 0 and j >= 0:
                    if i < j:
                        i, j = j, i
                    c, r = group[j], group[i]
                    if offsets[c, r] < 0:
                        return False
                    s = starts[j] + offsets[c, r] + (i - first[r]) - (j - first[c])
                    slots[block, k, lane] = -s - 2 if (a != b and i == j) else s
                k += 1
    return True


@numba.njit(**_JIT)
def _gather(full, index, block, out):
    for k in range(out.shape[0]):
        for e in range(out.shape[1]):
            out[k, e] = full[index[block, k, e]]


@numba.njit(**_JIT)
def _lanes(remaining):
    return min(BLOCK, (remaining + LANES - 1) // LANES * LANES)


@numba.njit(**_JIT)
def _run_value(address, full, index, parameters, count):
    q = np.empty(index.shape[1:])
    energy = np.empty((1, BLOCK))
    pointers = np.zeros(3, np.int64)
    total = 0.0
    for block in range(index.shape[0]):
        remaining = min(count - block * BLOCK, BLOCK)
        _gather(full, index, block, q)
        pointers[0], pointers[1], pointers[2] = (
            q.ctypes.data,
            parameters[block].ctypes.data,
            energy.ctypes.data,
        )
        call_kernel(address, _lanes(remaining), BLOCK, pointers)
        for e in range(remaining):
            total += energy[0, e]
    return total


@numba.njit(**_JIT)
def _run_gradient(address, full, index, parameters, count, gradient):
    n = index.shape[1]
    q, g, energy = np.empty((n, BLOCK)), np.empty((n, BLOCK)), np.empty((1, BLOCK))
    pointers = np.zeros(4, np.int64)
    total = 0.0
    for block in range(index.shape[0]):
        remaining = min(count - block * BLOCK, BLOCK)
        _gather(full, index, block, q)
        pointers[0], pointers[1] = q.ctypes.data, parameters[block].ctypes.data
        pointers[2], pointers[3] = energy.ctypes.data, g.ctypes.data
        call_kernel(address, _lanes(remaining), BLOCK, pointers)
        for e in range(remaining):
            total += energy[0, e]
        for k in range(n):
            for e in range(remaining):
                gradient[index[block, k, e]] += g[k, e]
    return total


@numba.njit(**_JIT)
def _run_hessian(
    address, full, index, parameters, count, gradient, slots, entries, rotation, vectors, values
):  # fmt: skip
    n = index.shape[1]
    q, g, energy, h = (
        np.empty((n, BLOCK)),
        np.empty((n, BLOCK)),
        np.empty((1, BLOCK)),
        np.empty((entries, BLOCK)),
    )
    pointers = np.zeros(5, np.int64)
    total = 0.0
    for block in range(index.shape[0]):
        remaining = min(count - block * BLOCK, BLOCK)
        _gather(full, index, block, q)
        pointers[0], pointers[1] = q.ctypes.data, parameters[block].ctypes.data
        pointers[2], pointers[3], pointers[4] = energy.ctypes.data, g.ctypes.data, h.ctypes.data
        call_kernel(address, _lanes(remaining), BLOCK, pointers)
        for e in range(remaining):
            total += energy[0, e]
        for k in range(n):
            for e in range(remaining):
                gradient[index[block, k, e]] += g[k, e]
        if rotation.shape[0]:
            _turn_back(h, index[block], rotation, vectors, n, remaining)
        for k in range(entries):
            for e in range(remaining):
                s = slots[block, k, e]
                if s >= 0:
                    values[s] += h[k, e]
                elif s < _SKIPPED:
                    values[-s - 2] += 2.0 * h[k, e]
    return total


@numba.njit(**_JIT)
def _turn_back(h, index, rotation, vectors, n, count):
    """Replace each 3×3 block (a, b) of the lower triangles by R_aᵀ H R_b, and rows of scalars by H R_b."""
    half = np.empty((3, 3))
    for e in range(count):
        for b in range(vectors):
            turn_b = rotation[index[3 * b, e] // 3]
            for a in range(b, vectors):
                turn_a = rotation[index[3 * a, e] // 3]
                for i in range(3):
                    for j in range(3):
                        half[i, j] = 0.0
                    for k in range(3):
                        row, column = max(3 * a + i, 3 * b + k), min(3 * a + i, 3 * b + k)
                        entry = h[row * (row + 1) // 2 + column, e]
                        for j in range(3):
                            half[i, j] += entry * turn_b[k, j]
                for i in range(3):
                    row = 3 * a + i
                    for j in range(3):
                        if 3 * b + j <= row:
                            h[row * (row + 1) // 2 + 3 * b + j, e] = (
                                turn_a[0, i] * half[0, j]
                                + turn_a[1, i] * half[1, j]
                                + turn_a[2, i] * half[2, j]
                            )
            for row in range(3 * vectors, n):
                start = row * (row + 1) // 2 + 3 * b
                x, y, z = h[start, e], h[start + 1, e], h[start + 2, e]
                for j in range(3):
                    h[start + j, e] = x * turn_b[0, j] + y * turn_b[1, j] + z * turn_b[2, j]
