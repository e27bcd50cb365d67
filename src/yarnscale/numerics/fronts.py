"""Symbolic part of a sparse Cholesky factorisation: order of elimination, fronts, and who works on them.

Unknowns that meet the same others (the coordinates of a vertex) are one node. Nodes are ordered by METIS (Karypis and
Kumar 1998). Columns of like structure are joined to supernodes, with few zeros more (Ashcraft and Grimes 1989); each is
a dense front that passes what is left of its other rows to its parent (Duff and Reid 1983).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csc_array, diags_array
from scipy.sparse.linalg import splu

from yarnscale.arrays import Integers

_JIT = {"cache": True, "error_model": "numpy", "nogil": True}
_LEAST_WORK = 1e8
"""Multiplications below which a factorisation is not shared by threads."""
_EVEN = 1.15
"""Work of the busiest thread over the mean with which a division of work is good enough."""
_MORE_ZEROS = ((4, 1.0), (16, 0.8), (48, 0.1), (1 << 60, 0.05))
"""Up to how many columns a supernode may have which share of zeros (the rule of CHOLMOD)."""


@dataclass(frozen=True, eq=False)
class Fronts:
    """Fronts in the order of elimination: dense matrices whose rows are their columns and, below, others.

    order: (n,) unknowns as they are eliminated. first: (f + 1,) first column of each front. starts: (f + 1,) where its
    other rows are in ``rows``, which are eliminated later, and in ``places``, their places in the front of the parent.
    parent: (f,), −1 at roots. factor: (f + 1,) where the columns of each are in the factor; entries: where those of
    the pattern are. shares: fronts of each thread and, last, those of one thread after them. updates: (f,) where what a
    front leaves for its parent is kept, once it went down from ``raised``; room: of all of them.
    """

    order: Integers
    first: Integers
    starts: Integers
    rows: Integers
    places: NDArray[np.uint32]
    parent: Integers
    factor: Integers
    entries: Integers
    shares: list[Integers]
    raised: Integers
    updates: Integers
    room: int

    @classmethod
    def of(cls, size: int, starts: Integers, rows: Integers, *, threads: int) -> Fronts:
        """Of the lower triangle of a symmetric pattern by columns."""
        columns = np.repeat(np.arange(size), np.diff(starts))
        node = _nodes(size, columns, rows)
        sizes = np.bincount(node)
        links, count = _links(node, columns, rows), len(sizes)
        order = _elimination_order(*_by_columns(links, count))
        order = order[_postorder(_tree(*_by_columns(_inverse(order)[links], count)))]
        graph = _by_columns(_inverse(order)[links], count)
        sizes = sizes[order]
        above = _tree(*graph)
        heights = _heights(*graph, above, sizes)
        ends = np.cumsum(sizes)
        heads = _heads(above, sizes, heights)
        first = np.concatenate([[0], ends])[heads]
        height = heights[heads[1:] - 1]
        row_starts = np.concatenate([[0], np.cumsum(height)])
        found, parent = _rows(*graph, heads, ends - sizes, sizes, row_starts)
        unknowns = np.argsort(_inverse(order)[node], kind="stable")
        factor = np.concatenate([[0], np.cumsum(np.diff(first) * (np.diff(first) + height))])
        i, j = _inverse(unknowns)[np.stack([rows, columns])]
        shares = _shares(parent, np.diff(first) * (np.diff(first) + height) ** 2, threads)
        return cls(
            unknowns, first, row_starts, found, _places(first, row_starts, found, parent), parent, factor,
            _entries(np.maximum(i, j), np.minimum(i, j), first, row_starts, found, factor),
            shares, *_stack(parent, height, shares),
        )  # fmt: skip


def _inverse(order: Integers) -> Integers:
    number = np.empty(len(order), np.int64)
    number[order] = np.arange(len(order))
    return number


def _nodes(size: int, columns: Integers, rows: Integers) -> Integers:
    """Node of each unknown: those in succession that meet the same unknowns are one."""
    # Sums of whole numbers are the same in any order, also where they wrap around.
    weight = np.random.default_rng(0).integers(1 << 64, size=size, dtype=np.uint64)
    met = -weight
    np.add.at(met, columns, weight[rows])
    np.add.at(met, rows, weight[columns])
    return np.cumsum(np.diff(met, prepend=met[:1]) != 0, dtype=np.int64)


def _links(node: Integers, columns: Integers, rows: Integers) -> Integers:
    """Pairs (2, m) of different nodes that meet, each in both orders."""
    leads = np.diff(node, prepend=-1) > 0
    met = leads[columns] & leads[rows] & (columns != rows)
    pairs = node[np.stack([columns[met], rows[met]])]
    return np.concatenate([pairs, pairs[::-1]], axis=1)


def _by_columns(links: Integers, count: int) -> tuple[Integers, Integers]:
    """Starts and rows of the columns of a graph of so many nodes."""
    keys = np.sort(links[0] * count + links[1])
    return np.searchsorted(keys, count * np.arange(count + 1)), keys % count


def _elimination_order(starts: Integers, rows: Integers) -> Integers:
    """Nodes in an order that leaves little to fill in: nested dissection; without METIS multiple minimum degree."""
    try:
        from pymetis import CSRAdjacency, nested_dissection
    except ImportError:
        count = len(starts) - 1
        graph = csc_array((np.full(len(rows), -1.0), rows, starts), shape=(count, count))
        dominant = csc_array(graph + diags_array(np.diff(starts) + 2.0))
        options = {"SymmetricMode": True}
        return np.argsort(splu(dominant, "MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options=options).perm_c)
    links: Any = CSRAdjacency(starts.astype(np.int32), rows.astype(np.int32))
    return np.array(nested_dissection(links)[0], np.int64)


@numba.njit(**_JIT)
def _tree(starts, rows):
    """Elimination tree of a graph (Liu 1986): parent of every node, −1 at roots."""
    count = len(starts) - 1
    above, reached = np.full(count, -1), np.full(count, -1)
    for j in range(count):
        for k in range(starts[j], starts[j + 1]):
            i = rows[k]
            while i != -1 and i < j:
                following = reached[i]
                reached[i] = j
                if following == -1:
                    above[i] = j
                i = following
    return above


@numba.njit(**_JIT)
def _postorder(above):
    """Nodes of a tree such that each comes right after its descendants."""
    count = len(above)
    head, following = np.full(count, -1), np.full(count, -1)
    for j in range(count - 1, -1, -1):
        if above[j] >= 0:
            following[j], head[above[j]] = head[above[j]], j
    order, stack, done = np.empty(count, np.int64), np.empty(count, np.int64), 0
    for root in range(count):
        if above[root] >= 0:
            continue
        stack[0], top = root, 1
        while top > 0:
            j = stack[top - 1]
            child = head[j]
            if child >= 0:
                head[j] = following[child]
                stack[top] = child
                top += 1
            else:
                order[done] = j
                done, top = done + 1, top - 1
    return order


@numba.njit(**_JIT)
def _heights(starts, rows, above, sizes):
    """Unknowns below each node in its column of the factor, those of the node itself not counted."""
    count = len(sizes)
    heights, seen = np.zeros(count, np.int64), np.full(count, -1)
    for i in range(count):
        seen[i] = i
        for k in range(starts[i], starts[i + 1]):
            j = rows[k]
            while j < i and seen[j] != i:
                seen[j] = i
                heights[j] += sizes[i]
                j = above[j]
    return heights


def _heads(above: Integers, sizes: Integers, heights: Integers) -> Integers:
    """First node of each supernode, and the number of nodes."""
    count = len(above)
    same = (above[:-1] == np.arange(1, count)) & (heights[:-1] == heights[1:] + sizes[1:])
    heads = np.flatnonzero(np.concatenate([[True], ~same]))
    limits, zeros = np.array([n for n, _ in _MORE_ZEROS]), np.array([share for _, share in _MORE_ZEROS])
    return np.concatenate([heads[_joined(heads, above, sizes, heights, limits, zeros)], [count]])


@numba.njit(**_JIT)
def _joined(heads, above, sizes, heights, limits, shares):
    """Which supernodes begin one after each was joined with its parent where that adds few zeros."""
    fronts, count = len(heads), len(above)
    last = np.empty(fronts, np.int64)
    front = np.empty(count, np.int64)
    width, kept, into = np.empty(fronts), np.ones(fronts, np.bool_), np.arange(fronts)
    for s in range(fronts):
        end = heads[s + 1] if s + 1 < fronts else count
        last[s], front[heads[s] : end], width[s] = end - 1, s, sizes[heads[s] : end].sum()
    begin, zeros = np.arange(fronts), np.zeros(fronts)
    for s in range(fronts - 2, -1, -1):
        if above[last[s]] < 0:
            continue
        p = front[above[last[s]]]
        while into[p] != p:
            p = into[p]
        if begin[p] != s + 1:
            continue
        others = heights[last[p]]
        wide = width[s] + width[p]
        more = zeros[s] + zeros[p] + width[s] * (width[p] + others - heights[last[s]])
        share = more / (0.5 * wide * (wide + 1.0) + wide * others)
        rule = 0
        while wide > limits[rule]:
            rule += 1
        if share <= shares[rule]:
            into[s], kept[s + 1], begin[p] = p, False, s
            width[p], zeros[p] = wide, more
    return kept


@numba.njit(**_JIT)
def _rows(starts, rows, heads, begins, sizes, row_starts):
    """Rows of all fronts below their columns, as unknowns in the order of elimination, and the parents."""
    fronts, count = len(heads) - 1, len(sizes)
    found = np.empty(row_starts[-1], np.int64)
    nodes, node_starts = np.empty(row_starts[-1], np.int64), np.zeros(fronts + 1, np.int64)
    parent, front = np.full(fronts, -1), np.empty(count, np.int64)
    head, following = np.full(fronts, -1), np.full(fronts, -1)
    seen = np.full(count, -1)
    for s in range(fronts):
        front[heads[s] : heads[s + 1]] = s
    for s in range(fronts):
        end, filled = heads[s + 1], node_starts[s]
        for j in range(heads[s], end):
            for k in range(starts[j], starts[j + 1]):
                if rows[k] >= end and seen[rows[k]] != s:
                    seen[rows[k]] = s
                    nodes[filled] = rows[k]
                    filled += 1
        child = head[s]
        while child >= 0:
            for k in range(node_starts[child], node_starts[child + 1]):
                if nodes[k] >= end and seen[nodes[k]] != s:
                    seen[nodes[k]] = s
                    nodes[filled] = nodes[k]
                    filled += 1
            child = following[child]
        node_starts[s + 1] = filled
        nodes[node_starts[s] : filled].sort()
        if filled > node_starts[s]:
            parent[s] = front[nodes[node_starts[s]]]
            following[s], head[parent[s]] = head[parent[s]], s
        at = row_starts[s]
        for k in range(node_starts[s], filled):
            for c in range(sizes[nodes[k]]):
                found[at] = begins[nodes[k]] + c
                at += 1
    return found, parent


@numba.njit(**_JIT)
def _places(first, starts, rows, parent):
    """Place of every row of a front in the front of its parent; without sign, loops over them are faster."""
    places = np.empty(len(rows), np.uint32)
    for s in range(len(parent)):
        p = parent[s]
        at = 0
        for k in range(starts[s], starts[s + 1]):
            if rows[k] < first[p + 1]:
                places[k] = rows[k] - first[p]
                continue
            while rows[starts[p] + at] < rows[k]:
                at += 1
            places[k] = first[p + 1] - first[p] + at
    return places


@numba.njit(**_JIT)
def _entries(row, column, first, starts, rows, factor):
    """Places in the factor of entries of the matrix."""
    places, front = np.empty(len(row), np.int64), np.empty(first[-1], np.int64)
    for s in range(len(first) - 1):
        front[first[s] : first[s + 1]] = s
    for k in range(len(row)):
        s = front[column[k]]
        width, place = first[s + 1] - first[s], row[k] - first[s]
        if place >= width:
            place = width + np.searchsorted(rows[starts[s] : starts[s + 1]], row[k])
        height = width + starts[s + 1] - starts[s]
        places[k] = factor[s] + (column[k] - first[s]) * height + place
    return places


def _shares(parent: Integers, work: Integers, threads: int) -> list[Integers]:
    """Fronts of each thread, whole trees below some front, and those left to one thread after them."""
    count, all_work = len(parent), work.astype(float)
    begin = np.arange(count)
    for s, p in enumerate(parent.tolist()):
        if p >= 0:
            all_work[p] += all_work[s]
            begin[p] = min(begin[p], begin[s])
    if threads < 2 or work.sum() < _LEAST_WORK:
        return [np.arange(count)]
    trees = np.flatnonzero(parent < 0).tolist()
    while True:
        loads, parts = np.zeros(threads), [[] for _ in range(threads)]
        for tree in sorted(trees, key=lambda s: -all_work[s]):
            least = int(loads.argmin())
            loads[least] += all_work[tree]
            parts[least].append(np.arange(begin[tree], tree + 1))
        heaviest = max(trees, key=lambda s: all_work[s])
        children = np.flatnonzero(parent == heaviest).tolist()
        if loads.max() <= _EVEN * loads.mean() or not children:
            break
        trees.remove(heaviest)
        trees.extend(children)
    shares = [np.sort(np.concatenate([np.zeros(0, np.int64), *part])) for part in parts]
    return [*shares, np.setdiff1d(np.arange(count), np.concatenate(shares))]


def _stack(parent: Integers, height: Integers, shares: list[Integers]) -> tuple[Integers, Integers, int]:
    """Where updates are made and kept: each share stacks its own, and lowers each over those of its children."""
    raised, updates = np.zeros(len(parent), np.int64), np.zeros(len(parent), np.int64)
    sizes, bottom = (height**2).tolist(), 0
    for share in shares:
        mine = np.zeros(len(parent), bool)
        mine[share] = True
        lowest = np.full(len(parent), -1)
        top = highest = bottom
        for s in share.tolist():
            raised[s] = top
            updates[s] = top if lowest[s] < 0 else lowest[s]
            highest = max(highest, top + sizes[s])
            top = int(updates[s]) + sizes[s]
            if parent[s] >= 0 and mine[parent[s]] and lowest[parent[s]] < 0:
                lowest[parent[s]] = updates[s]
        bottom = highest
    return raised, updates, bottom
