"""Nested dissection of a graph that lies in space: in which order a sparse Cholesky factorisation has least to fill in.

A straight cut halves the nodes; the fewest nodes that meet every edge across it (König 1931) separate the halves and
are eliminated after them; each half is cut in turn (George 1973). Sheets of yarn are long strips of loops to a general
ordering, which does not see how narrow they can be cut.
"""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import maximum_bipartite_matching

from yarnscale.arrays import Array, Integers

LEAF = 300
"""Nodes that are not cut further: orderings by degree do as well there."""
_LARGE = 4000
"""Nodes from which several cuts are tried."""
_CUTS = tuple(np.linspace(0.42, 0.58, 9))
"""Shares of the nodes on one side of them."""
_BROAD = 0.67
"""Extent along an axis, over the largest, from which cuts across that axis are tried too."""


@dataclass(frozen=True, eq=False)
class Dissection:
    """Stage (n,) at which each node is eliminated, from 0, and the tree of stages.

    parent: (s,) the stage that separates each stage from others, itself at the root.
    """

    stage: Integers
    parent: Integers

    @classmethod
    def of(cls, first: Integers, second: Integers, places: Array, *, leaf: int = LEAF) -> Dissection:
        """Of a graph: halves before what separates them.

        first, second: (m,) nodes that an edge joins, in any order and as often as they like. places: (n, d) of nodes.
        """
        count = len(places)
        ones = np.ones(len(first), np.int8)
        half = csr_array((ones, (first, second)), shape=(count, count))
        graph = csr_array(half + half.T)
        parts = _dissected(graph, places, np.arange(count), leaf)
        stage, parent = np.empty(count, np.int64), np.arange(len(parts))
        roots: list[int] = []  # of the trees that no later stage separates yet
        for number, (part, children) in enumerate(parts):
            stage[part] = number
            for _ in range(children):
                parent[roots.pop()] = number
            roots.append(number)
        return cls(stage, parent)

    def repaired(self, first: Integers, second: Integers) -> tuple[Dissection, int]:
        """The same for a graph with other edges, and how many nodes had to move.

        A node that is newly joined with another branch moves to what separates both.
        """
        stage = self.stage.copy()
        moved = _lift(stage, self.parent, first, second)
        return Dissection(stage, self.parent), int(moved)


def _dissected(graph: csr_array, places: Array, nodes: Integers, leaf: int) -> list[tuple[Integers, int]]:
    """Parts of the nodes, each after those that it separates, and how many trees of parts it separates."""
    if len(nodes) <= leaf:
        return [(nodes, 0)]
    best: tuple[Integers, Integers, Integers] | None = None
    extent = np.ptp(places[nodes], axis=0)
    for axis in np.flatnonzero(extent >= _BROAD * extent.max()):
        along = places[nodes, axis]
        for share in _CUTS if len(nodes) >= _LARGE else (0.5,):
            before = along <= np.quantile(along, share)
            low, high = nodes[before], nodes[~before]
            between = separator(graph, low, high)
            if best is None or len(between) < len(best[0]):
                best = between, low, high
    assert best is not None
    between, low, high = best
    low, high = np.setdiff1d(low, between), np.setdiff1d(high, between)
    if not len(low) or not len(high):  # all in one place, or joined with everything
        return [(nodes, 0)]
    return [*_dissected(graph, places, low, leaf), *_dissected(graph, places, high, leaf), (between, 2)]


@numba.njit(cache=True)
def _lift(stage, parent, first, second):
    """Move nodes up the tree until every edge joins nodes of one branch; how many moves that took."""
    moved = 0
    changed = True
    while changed:
        changed = False
        for k in range(len(first)):
            a, b = first[k], second[k]
            if stage[a] > stage[b]:
                a, b = b, a
            above = stage[a]
            while above < stage[b]:
                above = parent[above]
            if above == stage[b]:
                continue
            # Stages of parents are later than those of their children: the first common one.
            p, q = stage[a], stage[b]
            while p != q:
                if p < q:
                    p = parent[p]
                else:
                    q = parent[q]
            stage[b] = p
            moved += 1
            changed = True
    return moved


def separator(graph: csr_array, low: Integers, high: Integers) -> Integers:
    """The fewest nodes that every edge between two sets of nodes ends at: those of a largest matching (König)."""
    across = csr_array(graph[low][:, high])
    rows = np.flatnonzero(np.diff(across.indptr))
    columns = np.unique(across.indices)
    across = csr_array(across[rows][:, columns])
    partner = maximum_bipartite_matching(across, perm_type="column")  # of each row; −1: none
    matched = np.flatnonzero(partner >= 0)
    row_of = np.full(len(columns), -1)
    row_of[partner[matched]] = matched
    # What alternating ways reach from rows without a partner.
    seen_rows, seen_columns = partner < 0, np.zeros(len(columns), bool)
    front = np.flatnonzero(seen_rows)
    while len(front):
        reached = np.unique(across[front].indices)
        reached = reached[~seen_columns[reached]]
        seen_columns[reached] = True
        front = row_of[reached]
        front = front[(front >= 0) & ~seen_rows[front]]
        seen_rows[front] = True
    return np.concatenate([low[rows[~seen_rows]], high[columns[seen_columns]]])
