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
ENDLESS_LENGTH = 1e30
"""Length of that period."""


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
        n, step = len(pattern.edges), np.abs(pattern.edges[:, 2:]).max(axis=0)
        rings = np.maximum(rings, step)
        outer = rings + step
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

    def edges_between(self, *, smooth: bool) -> tuple[Integers, Array]:
        """Nodes of each edge (m, 4), its ends and those before and after it, and whether it turns there (m, 2).

        At the ends of open yarns, and everywhere unless ``smooth``, it does not, and its own ends stand for the others.
        """
        edges = self.edges
        ends = self.ends[edges]
        beside = np.stack([self.before[edges], self.ends[ends]], 1)
        turns = (beside >= 0) & smooth
        beside = np.where(turns, beside, np.stack([ends, edges], 1))
        return np.column_stack([edges, ends, beside]), turns.astype(np.float64)

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
        start -= (np.cumsum(total) - total)[self.yarn]
        return start, np.where(self.lengths == ENDLESS, ENDLESS_LENGTH, total)


@dataclass(frozen=True, eq=False)
class Neighbours:
    """Which segments of a yarn do not touch each other: those with less than ``least`` of the yarn between them.

    By arc length that is half of the circumference of a circle of the radius of contact. Yarn that is bent no more than
    this circle cannot touch itself before (Schur's theorem), so that contact begins without a jump, however finely the
    yarn is cut. start: length of yarn before each vertex (n,). length: of each segment (n,). period: of each yarn (c,).
    least: for each yarn (c,).
    """

    start: Array
    length: Array
    period: Array
    least: Array

    @classmethod
    def by_length(cls, strands: Strands, length: Array, distance: Array | float) -> Neighbours:
        """By arc length, at rest: length of segments (n,); yarns touch at a distance, of each vertex's yarn (n,)."""
        least = np.zeros(len(strands.lengths))
        least[strands.yarn] = 0.5 * np.pi * distance
        return cls(*cls._arcs(strands, length), least)

    @classmethod
    def by_edges(cls, strands: Strands, count: int) -> Neighbours:
        """The published convention: segments at most ``count`` edges apart, however long these are."""
        return cls(*cls._arcs(strands, np.ones(strands.count)), np.full(len(strands.lengths), float(count)))

    @staticmethod
    def _arcs(strands: Strands, length: Array) -> tuple[Array, Array, Array]:
        start, period = strands.arc_lengths(length)
        return start, np.ascontiguousarray(length, np.float64), period


def _tile_lookup(tiles: Integers, wanted: Integers) -> Integers:
    low = tiles.min(axis=0)
    table = np.full(tiles.max(axis=0) - low + 1, -1, np.int64)
    table[tuple((tiles - low).T)] = np.arange(len(tiles))
    return table[wanted[..., 0] - low[0], wanted[..., 1] - low[1]]
