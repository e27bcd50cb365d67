"""Pattern of a sparse symmetric matrix made by stencils whose unknowns come in groups (a vertex of 3, a scalar of 1).

Which groups meet is kept by columns, so that a cell of a hundred vertices and a fabric of a hundred thousand are the
same thing; entries are found by group, not one by one.
"""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np
from numpy.typing import NDArray

from yarnscale.arrays import Array, Flags, Integers
from yarnscale.numerics.factor import SymmetricPattern
from yarnscale.numerics.kernel import BLOCK

SKIPPED = -1
"""Slot of an entry that belongs to a fixed variable."""
_JIT = {"cache": True, "error_model": "numpy", "fastmath": {"nsz", "arcp", "contract", "reassoc"}}


@dataclass(frozen=True, eq=False)
class BlockPattern:
    """Pattern of a symmetric matrix and where the blocks of its groups lie in it.

    group: (n,) group of each unknown; first: (g + 1,) first unknown of each group. Block k of column group c, with
    starts[c] ≤ k < starts[c + 1], meets row group rows[k] ≥ c (sorted) and begins offsets[k] rows below the column's
    first.
    """

    pattern: SymmetricPattern
    group: Integers
    first: Integers
    starts: Integers
    rows: NDArray[np.int32]
    offsets: NDArray[np.int32]

    @classmethod
    def of(cls, group_sizes: Integers, unknowns: list[Integers]) -> BlockPattern:
        """Pattern of stencils: each array (N, k) holds unknowns that meet (−1: fixed)."""
        groups = len(group_sizes)
        group = np.repeat(np.arange(groups), group_sizes)
        return cls.from_keys(group_sizes, np.concatenate([_met(group, rows, groups) for rows in unknowns]))

    @classmethod
    def from_keys(cls, group_sizes: Integers, keys: Integers) -> BlockPattern:
        """Pattern of blocks ``column·g + row`` ≥ the diagonal, in any order and as often as they like."""
        groups = len(group_sizes)
        first = np.zeros(groups + 1, np.int64)
        np.cumsum(group_sizes, out=first[1:])
        group = np.repeat(np.arange(groups), group_sizes)
        starts, rows = _columns(keys, groups)
        offsets = np.empty(len(rows), np.int32)
        size = int(first[-1])
        column_starts = np.zeros(size + 1, np.int64)
        entries = _lay_out(starts, rows, first, offsets, column_starts)
        entry_rows = np.empty(entries, np.int64)
        _fill_rows(starts, rows, offsets, first, column_starts, entry_rows)
        pattern = SymmetricPattern(size, column_starts, entry_rows)
        return cls(pattern, group, first, starts, rows.astype(np.int32), offsets)

    @property
    def keys(self) -> Integers:
        """Keys ``column·g + row`` of all blocks, increasing."""
        groups = len(self.starts) - 1
        return np.repeat(groups * np.arange(groups), np.diff(self.starts)) + self.rows

    def add_blocks(self, places: Integers, blocks: Array, entries: Array) -> None:
        """Add 3×3 blocks (m, 9), row by row, to the entries of a matrix whose groups are threes.

        places: (m,) where the blocks are among ``keys``.
        """
        columns = np.searchsorted(self.starts, places, side="right") - 1
        _add_blocks(columns, self.rows[places], self.offsets[places], self.pattern.starts, blocks, entries)

    def covers(self, unknowns: Integers) -> bool:
        """Whether all pairs of these stencils' unknowns, (N, k), lie in the pattern."""
        return bool(self.covered(unknowns).all())

    def covered(self, unknowns: Integers) -> Flags:
        """Of which stencils, (N, k), all pairs of unknowns lie in the pattern."""
        return _covered_each(self.starts, self.rows, self.group, unknowns)

    def slots(self, unknowns: Integers) -> NDArray[np.int32]:
        """Where a stencil's Hessian entries go: (blocks, n(n+1)/2, BLOCK).

        −1: skipped. s ≤ −2: entry −s−2 on the diagonal, added twice (two variables of the stencil are one unknown).
        Raises ValueError where two of them do not meet in the pattern.
        """
        count, k = unknowns.shape
        blocks = -(-count // BLOCK)
        slots = np.full((blocks, k * (k + 1) // 2, BLOCK), SKIPPED, np.int32)
        found = _fill_slots(
            self.starts, self.rows, self.offsets, self.group, self.first, self.pattern.starts, unknowns, slots
        )
        if not found:
            raise ValueError("the pattern does not cover these stencils")
        return slots


@numba.njit(**_JIT)
def _add_blocks(columns, rows, offsets, column_starts, blocks, entries):
    for k in range(len(columns)):
        for a in range(3):
            begin = column_starts[3 * columns[k] + a] + offsets[k] - a
            for b in range(a if rows[k] == columns[k] else 0, 3):
                entries[begin + b] += blocks[k, 3 * b + a]


@numba.njit(**_JIT)
def _met(group, unknowns, groups):
    """Keys ``column·groups + row`` of the pairs of groups that stencils (N, k) bring together, with repeats."""
    count, k = unknowns.shape
    keys = np.empty(count * (k * (k + 1) // 2), np.int64)
    own = np.empty(k, np.int64)
    found = 0
    for e in range(count):
        distinct = _distinct(group, unknowns[e], own)
        for a in range(distinct):
            for b in range(a + 1):
                keys[found] = min(own[a], own[b]) * groups + max(own[a], own[b])
                found += 1
    return keys[:found]


@numba.njit(**_JIT)
def _columns(keys, groups):
    """Starts (g + 1,) and sorted rows of the columns of keys, each once, the diagonal with them."""
    first = np.zeros(groups + 1, np.int64)
    for key in keys:
        first[key // groups + 1] += 1
    first = np.cumsum(first)
    bucket, filled = np.empty(len(keys), np.int64), first.copy()
    for key in keys:
        column = key // groups
        bucket[filled[column]] = key - column * groups
        filled[column] += 1
    starts, rows, seen = (np.zeros(groups + 1, np.int64), np.empty(len(keys) + groups, np.int64), np.full(groups, -1))
    found = 0
    for column in range(groups):
        rows[found], seen[column] = column, column
        found += 1
        for row in bucket[first[column] : first[column + 1]]:
            if seen[row] != column:
                rows[found], seen[row] = row, column
                found += 1
        rows[starts[column] : found].sort()
        starts[column + 1] = found
    return starts, rows[:found].copy()


@numba.njit(**_JIT)
def _distinct(group, unknowns, own):
    """Write the different groups of a stencil's unknowns into ``own``; how many there are."""
    found = 0
    for unknown in unknowns:
        if unknown < 0:
            continue
        g, known = group[unknown], False
        for i in range(found):
            known |= own[i] == g
        if not known:
            own[found] = g
            found += 1
    return found


@numba.njit(**_JIT)
def find_block(starts, rows, column, row):
    """Which block of a column group is the given row group; −1: none."""
    low, high = starts[column], starts[column + 1]
    while low < high:
        middle = (low + high) // 2
        if rows[middle] < row:
            low = middle + 1
        else:
            high = middle
    return low if low < starts[column + 1] and rows[low] == row else -1


@numba.njit(**_JIT)
def _covered_each(starts, rows, group, unknowns):
    own = np.empty(unknowns.shape[1], np.int64)
    covered = np.ones(unknowns.shape[0], np.bool_)
    for e in range(unknowns.shape[0]):
        distinct = _distinct(group, unknowns[e], own)
        for a in range(distinct):
            for b in range(a):
                if find_block(starts, rows, min(own[a], own[b]), max(own[a], own[b])) < 0:
                    covered[e] = False
    return covered


@numba.njit(**_JIT)
def _lay_out(starts, rows, first, offsets, column_starts):
    """Offset of each block in its column group, and the start of every column; the number of entries."""
    for c in range(len(starts) - 1):
        height = 0
        for k in range(starts[c], starts[c + 1]):
            offsets[k] = height
            height += first[rows[k] + 1] - first[rows[k]]
        for local in range(first[c + 1] - first[c]):
            j = first[c] + local
            column_starts[j + 1] = column_starts[j] + height - local
    return column_starts[-1]


@numba.njit(**_JIT)
def _fill_rows(starts, rows, offsets, first, column_starts, entry_rows):
    for c in range(len(starts) - 1):
        for k in range(starts[c], starts[c + 1]):
            r = rows[k]
            for local in range(first[c + 1] - first[c]):
                j = first[c] + local
                for i in range(max(first[r], j), first[r + 1]):
                    entry_rows[column_starts[j] + offsets[k] + (i - first[r]) - local] = i


@numba.njit(**_JIT)
def _fill_slots(starts, rows, offsets, group, first, column_starts, unknowns, slots):
    count, width = unknowns.shape
    own = np.empty(width, np.int64)
    place = np.empty(width, np.int64)
    offset = np.empty((width, width), np.int64)
    for e in range(count):
        distinct = _distinct(group, unknowns[e], own)
        for a in range(distinct):
            for b in range(a + 1):
                block = find_block(starts, rows, min(own[a], own[b]), max(own[a], own[b]))
                if block < 0:
                    return False
                offset[a, b] = offset[b, a] = offsets[block]
        for a in range(width):
            for i in range(distinct):
                if unknowns[e, a] >= 0 and own[i] == group[unknowns[e, a]]:
                    place[a] = i
        block, lane = divmod(e, slots.shape[2])
        k = 0
        for a in range(width):
            for b in range(a + 1):
                i, j = unknowns[e, a], unknowns[e, b]
                if i >= 0 and j >= 0:
                    if i < j:
                        i, j = j, i
                    below = (i - first[group[i]]) - (j - first[group[j]])
                    s = column_starts[j] + offset[place[a], place[b]] + below
                    slots[block, k, lane] = -s - 2 if (a != b and i == j) else s
                k += 1
    return True
