"""Which segments follow each other along yarns, over explicit copies of a period; a finite fabric is its only copy.

A yarn may touch several copies of another, so all copies are enumerated, not only the nearest.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from yarnscale.arrays import Array, Flags, Integers
from yarnscale.errors import InputError
from yarnscale.yarn.pattern import YarnPattern

LARGEST_COPIES = 10_000_000
"""Vertices of all copies."""
ENDLESS = 1 << 40
"""Edges in the period of a yarn that is open: it never repeats."""


@dataclass(frozen=True, eq=False)
class Strands:
    """Segments along yarns: of n vertices, and of their copies in tiles of which the first is the primary one.

    Node of (tile k, vertex i) is k·n + i. tiles: (T, 2). ends: (S,) node at the end of the segment that begins at each
    node, S ≤ T·n; −1 where none does. before: (n,) node at the start of the segment that ends at each vertex, or −1.
    yarn: (n,) of each vertex. place: (n,) edges from the start of its yarn. walked: (n, 2) tiles walked from there.
    lengths: (c,) edges of each yarn's period, ``ENDLESS`` for open yarns. shift: (c, 2) tiles of that period.
    """

    tiles: Integers
    ends: Integers
    before: Integers
    yarn: Integers
    place: Integers
    walked: Integers
    lengths: Integers
    shift: Integers

    @classmethod
    def around(cls, pattern: YarnPattern, reach: float) -> Strands:
        """Copies of a pattern that may touch the primary tile where yarns touch across ``reach`` [m], as drawn."""
        extent = np.ptp(pattern.vertices[:, :2], axis=0)
        with np.errstate(over="ignore"):
            return cls.of(pattern, np.ceil((extent + reach) / pattern.period))

    @classmethod
    def of(cls, pattern: YarnPattern, rings: Array | tuple[int, int]) -> Strands:
        """Copies in tiles −rings…rings along x and y, and the tiles that their segments reach.

        Raises InputError where these are too many.
        """
        n, outer = len(pattern.edges), np.array(rings) + np.abs(pattern.edges[:, 2:]).max(axis=0)
        if np.prod(2.0 * outer + 1.0) * n > LARGEST_COPIES:
            raise InputError(
                "copies that yarns may touch are too many", expected="edges, radius and extent of a few periods",
                found=f"a reach of {outer.tolist()} tiles",
            )  # fmt: skip
        sides = (np.arange(-o, o + 1) for o in outer.astype(np.int64))
        tiles = np.stack(np.meshgrid(*sides, indexing="ij"), -1).reshape(-1, 2)
        inside = (np.abs(tiles) <= rings).all(axis=1)
        primary = (tiles == 0).all(axis=1)
        tiles = np.concatenate([tiles[primary], tiles[inside & ~primary], tiles[~inside]])
        ends = tiles[: int(inside.sum()), None, :] + pattern.edges[None, :, 2:]
        previous = pattern.previous_vertex
        return cls(
            tiles, (_tile_lookup(tiles, ends) * n + pattern.next_vertex).reshape(-1),
            _tile_lookup(tiles, -pattern.edges[previous, 2:]) * n + previous,
            pattern.yarn_of_vertex, pattern.position_along_yarn, pattern.tile_along_yarn,
            np.array([len(chain) for chain in pattern.yarns]), pattern.yarn_shift,
        )  # fmt: skip

    @classmethod
    def finite(cls, offsets: Integers, closed: Flags) -> Strands:
        """Yarns numbered vertex after vertex, yarn i from offsets[i] to offsets[i + 1] − 1, rings where ``closed``."""
        n, yarns = int(offsets[-1]), len(closed)
        last = offsets[1:] - 1
        ends, before = np.arange(1, n + 1), np.arange(-1, n - 1)
        ends[last] = np.where(closed, offsets[:-1], -1)
        before[offsets[:-1]] = np.where(closed, last, -1)
        counts = np.diff(offsets)
        return cls(
            np.zeros((1, 2), np.int64), ends, before, np.repeat(np.arange(yarns), counts),
            np.arange(n) - np.repeat(offsets[:-1], counts), np.zeros((n, 2), np.int64),
            np.where(closed, counts, ENDLESS), np.zeros((yarns, 2), np.int64),
        )  # fmt: skip

    @property
    def count(self) -> int:
        """Vertices n."""
        return len(self.yarn)

    @cached_property
    def edges(self) -> Integers:
        """Vertices at which segments begin (m,)."""
        return np.flatnonzero(self.ends[: self.count] >= 0)

    @cached_property
    def joints(self) -> Integers:
        """Vertices between two segments (j,)."""
        return np.flatnonzero((self.ends[: self.count] >= 0) & (self.before >= 0))

    def copies(self, vertices: Array, period: Array) -> Array:
        """Positions (T·n, 3) of all copies of vertices (n, 3) in the plane, in the units of the period (2,)."""
        nodes = np.tile(vertices, (len(self.tiles), 1))
        nodes[:, :2] += np.repeat(self.tiles, len(vertices), axis=0) * period
        return nodes

    def arc_lengths(self, length: Array) -> tuple[Array, Array]:
        """Arc length from the start of its yarn to each vertex (n,), and of each yarn (c,); length: of edges (n,)."""
        order = np.lexsort((self.place, self.yarn))
        start = np.empty(self.count)
        start[order] = np.cumsum(length[order]) - length[order]
        total = np.bincount(self.yarn, length, len(self.lengths)).astype(np.float64)
        return start - (np.cumsum(total) - total)[self.yarn], total


def _tile_lookup(tiles: Integers, wanted: Integers) -> Integers:
    low = tiles.min(axis=0)
    table = np.full(tiles.max(axis=0) - low + 1, -1, np.int64)
    table[tuple((tiles - low).T)] = np.arange(len(tiles))
    return table[wanted[..., 0] - low[0], wanted[..., 1] - low[1]]
