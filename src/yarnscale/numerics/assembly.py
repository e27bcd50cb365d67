"""Stencils → energy, gradient and sparse Hessian, in compiled loops over blocks of elements.

A set of stencils gathers its variables from a full vector, runs a generated kernel on blocks, and scatters the result:
gradients by index, Hessian entries by slots that are computed once per topology.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numba
import numpy as np
from numpy.typing import NDArray

from yarnscale.arrays import Array, Integers
from yarnscale.numerics.address_call import call_address
from yarnscale.numerics.block_pattern import SKIPPED
from yarnscale.numerics.energy import StencilEnergy
from yarnscale.numerics.kernel import BLOCK, Kernel, run_columns
from yarnscale.numerics.vector_ir import LANES

_NOTHING = np.empty(0)
_NO_SLOTS = np.empty((0, 0, BLOCK), np.int32)
_NOT_TURNED = np.empty((0, 3, 3))
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
    variables: Integers
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
        return self._run(self.energy.value, full, _NOTHING, _NO_SLOTS, _NOT_TURNED, _NOTHING)

    def gradient(self, full: Array, gradient: Array) -> float:
        """Energy; adds the gradient to ``gradient``, of the full vector's length."""
        return self._run(self.energy.gradient, full, gradient, _NO_SLOTS, _NOT_TURNED, _NOTHING)

    def hessian(self, full: Array, gradient: Array, slots: NDArray[np.int32], rotation: Array, values: Array) -> float:
        """Energy; adds gradient and Hessian entries.

        slots: from ``BlockPattern.slots``. rotation: (full nodes, 3, 3) of the copies, or (0, 3, 3) where all are the
        identity; a copy's block is turned back before it is added. values: (entries,) of the pattern.
        """
        return self._run(self.energy.hessian, full, gradient, slots, rotation, values)

    def _run(self, kernel: Kernel, full: Array, gradient: Array, slots: NDArray[np.int32], *matrix: Array) -> float:
        if self.count == 0:
            return 0.0
        parts = self._index, self._parameters, self.count, self.vectors
        return _run(kernel.address, full, *parts, gradient, slots, *matrix)

    def by_parameters(self, full: Array, names: tuple[str, ...]) -> Array:
        """Derivative of every stencil's energy by the named parameters, (N, k)."""
        kernel = self.energy.mixed(names)
        return run_columns(kernel, full[self.variables], self.parameters)[0]

    def elements(self, full: Array) -> tuple[Array, Array, Array]:
        """Energy (N,), gradient (N, n) and Hessian (N, n, n) of every stencil in the full variables."""
        if self.count == 0:
            n = self.energy.variable_count
            return np.empty(0), np.empty((0, n)), np.empty((0, n, n))
        energies, gradients, lower = run_columns(self.energy.hessian, full[self.variables], self.parameters)
        return energies[:, 0], gradients, symmetric(lower, self.energy.variable_count)


def symmetric(lower: Array, size: int) -> Array:
    """Symmetric matrices (N, size, size) of their lower triangles, row by row."""
    rows, columns = np.tril_indices(size)
    whole = np.empty((len(lower), size, size))
    whole[:, rows, columns] = whole[:, columns, rows] = lower
    return whole


def position_variables(nodes: Integers) -> Integers:
    """Full variables of nodes (N, k) → (N, 3k)."""
    return (3 * nodes[:, :, None] + np.arange(3)).reshape(len(nodes), 3 * nodes.shape[1])


@numba.njit(**_JIT)
def _gather(full, index, block, out):
    for k in range(out.shape[0]):
        for e in range(out.shape[1]):
            out[k, e] = full[index[block, k, e]]


@numba.njit(**_JIT)
def _lanes(remaining):
    return min(BLOCK, (remaining + LANES - 1) // LANES * LANES)


@numba.njit(**_JIT)
def _run(address, full, index, parameters, count, vectors, gradient, slots, rotation, values):
    """Sum of the energies; adds gradients and Hessians where there are arrays for them."""
    n, entries = index.shape[1], slots.shape[1]
    q, g, energy, h = (np.empty((n, BLOCK)), np.empty((n, BLOCK)), np.empty((1, BLOCK)), np.empty((entries, BLOCK)))
    pointers = np.zeros(5, np.int64)  # a kernel takes those of its outputs
    total = 0.0
    for block in range(index.shape[0]):
        remaining = min(count - block * BLOCK, BLOCK)
        _gather(full, index, block, q)
        pointers[0], pointers[1] = q.ctypes.data, parameters[block].ctypes.data
        pointers[2], pointers[3], pointers[4] = energy.ctypes.data, g.ctypes.data, h.ctypes.data
        call_address(address, (_lanes(remaining), BLOCK, pointers))
        for e in range(remaining):
            total += energy[0, e]
        if gradient.shape[0]:
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
                elif s < SKIPPED:
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
                                turn_a[0, i] * half[0, j] + turn_a[1, i] * half[1, j] + turn_a[2, i] * half[2, j]
                            )
            for row in range(3 * vectors, n):
                start = row * (row + 1) // 2 + 3 * b
                x, y, z = h[start, e], h[start + 1, e], h[start + 2, e]
                for j in range(3):
                    h[start + j, e] = x * turn_b[0, j] + y * turn_b[1, j] + z * turn_b[2, j]
