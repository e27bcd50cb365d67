"""Whether yarns passed through each other between two shapes.

Both shapes are joined by straight motions of all vertices. Two segments pass through each other where the volume of the
tetrahedron of their four ends, a cubic in time, changes its sign while the segments meet; the sign of the change tells
from which side. A straight motion is no record of what happened. Where it has no passage, or only passages that are
taken back near the same place of the same two yarns, both shapes are the same fabric. Where it has others, they may be:
a loop that swings around another is passed twice on the straight path and not at all on its own. But the passages of
two different yarns, or of two copies of one, add up to the change of their linking number, which no motion without a
passage changes.
"""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import dataclass, field, replace

import numba
import numpy as np

from yarnscale.arrays import Array, Integers
from yarnscale.yarn.close_pairs import close_pairs
from yarnscale.yarn.stiffness import PatternStiffness
from yarnscale.yarn.strands import Strands

UNDO_WITHIN = 4.0
"""Two opposite passages undo each other when they lie so near along both yarns [r]."""
_ROUNDING = 1e-6
"""Distance at which yarns count as touching [r]."""
_JIT = {"cache": True, "error_model": "numpy"}
_MEETING = 1e-8
"""Squared distance, over squared lengths of the segments, below which coplanar segments meet."""


@dataclass(frozen=True, eq=False)
class Passages:
    """Passages of yarns through each other, none to begin with.

    rows: (k, 6), a passage each: primary segment, segment of a copy (its node), time, places on both segments in
    [0, 1), and sign of the change of the volume.
    """

    strands: Strands
    stiffness: PatternStiffness
    rows: Array = field(default_factory=lambda: np.empty((0, 6)))

    def along(self, before: Array, after: Array) -> Passages:
        """These, and those on straight paths between two positions (T·n, 3) [r] of all copies."""
        before, after = np.ascontiguousarray(before), np.ascontiguousarray(after)
        neighbours = self.stiffness.neighbours(self.strands)
        pairs = close_pairs(self.strands, before, _ROUNDING, neighbours=neighbours, moves=after - before)
        found = pair_passages(before, after, self.strands.ends, *pairs)
        return replace(self, rows=np.concatenate([self.rows, found]))

    def lasting(self) -> Passages:
        """Those that no opposite one near them undoes, matched nearest first."""
        ends, sign = _Ends.of(self), self.rows[:, 5]
        opposite = np.argwhere(np.triu(sign[:, None] * sign < 0))
        near = sorted((ends.apart(int(a), int(b)), int(a), int(b)) for a, b in opposite)
        left = np.ones(len(sign), bool)
        for apart, a, b in near:
            if apart < UNDO_WITHIN and left[a] and left[b]:
                left[a] = left[b] = False
        return replace(self, rows=self.rows[left])

    def changes_links(self) -> bool:
        """Whether linking numbers of yarns, or of copies of one yarn, change."""
        found = self.lasting()
        sums: Counter[tuple[int, ...]] = Counter()
        for pair, sign in zip(_Ends.of(found).pairs(), found.rows[:, 5], strict=True):
            if pair is not None:
                sums[pair] += int(sign)
        return any(sums.values())


@dataclass(frozen=True, eq=False)
class _Ends:
    """Which copies of which yarns each passage joins, and where along them.

    yarn, place [r]: (k, 2). tile: (k, 2, 2), of the copy of the yarn. period [r], shift: of every yarn.
    """

    yarn: Integers
    place: Array
    tile: Integers
    period: Array
    shift: Integers

    @classmethod
    def of(cls, found: Passages) -> _Ends:
        strands = found.strands
        length = found.stiffness.pattern.rest_length / found.stiffness.pattern.radius
        start, period = strands.arc_lengths(length)
        nodes = found.rows[:, :2].astype(np.int64)
        vertex, tile = nodes % strands.count, strands.tiles[nodes // strands.count]
        place = start[vertex] + found.rows[:, 3:5] * length[vertex]
        return cls(strands.yarn[vertex], place, tile - strands.walked[vertex], period, strands.shift)

    def pairs(self) -> list[tuple[int, ...] | None]:
        """Which two yarns each passage joins and how many tiles apart, the same for all copies; None: itself."""
        names: list[tuple[int, ...] | None] = []
        for yarn, tile in zip(self.yarn, self.tile, strict=True):
            (one, two), apart = sorted(yarn), tile[1] - tile[0]
            turns = [apart] if yarn[0] < yarn[1] else [-apart] if yarn[0] > yarn[1] else [apart, -apart]
            reduced = min(_remainder(turn, self.shift[one], self.shift[two]) for turn in turns)
            names.append(None if one == two and reduced == (0, 0) else (int(one), int(two), *reduced))
        return names

    def apart(self, a: int, b: int) -> float:
        """How far two passages lie apart along their yarns [r]; inf where they are passages of other yarns.

        A passage of two yarns is one of all their copies: that of b is moved by tiles until its first yarn is a's,
        as drawn or a period earlier or later; then the second ones must agree, whatever period.
        """
        best = math.inf
        for p, q in ((0, 1), (1, 0)):  # either yarn of b may be the first one of a
            one, two = self.yarn[a]
            if self.yarn[b, p] != one or self.yarn[b, q] != two:
                continue
            for turn in (-1, 0, 1):
                move = self.tile[a, 0] - self.tile[b, p] - turn * self.shift[one]
                gap = self.tile[b, q] + move - self.tile[a, 1]
                size = int(self.shift[two] @ self.shift[two])
                along_one = self.place[b, p] - turn * self.period[one] - self.place[a, 0]
                along_two = self.place[b, q] - self.place[a, 1]
                # A ring comes back to where it began, another yarn to another tile.
                turns = round(float(gap @ self.shift[two]) / size if size else -along_two / self.period[two])
                if not np.array_equal(turns * self.shift[two], gap):
                    continue
                along_two += turns * self.period[two]
                best = min(best, max(abs(along_one), abs(along_two)))
        return best


def _remainder(tile: Integers, first: Integers, second: Integers) -> tuple[int, int]:
    """The same member of tile + Z first + Z second for every tile of this set."""
    (a, b), (c, d) = (map(int, shift) for shift in (first, second))
    while c:  # Euclid: the second shift ends along y
        a, b, c, d = c, d, a - a // c * c, b - a // c * d
    x, y = map(int, tile)
    if a:
        x, y = x - x // a * a, y - x // a * b
    else:
        d = math.gcd(b, d)
    return x, y % abs(d) if d else y


@numba.njit(**_JIT)
def _triple(u, v, w):
    return u[0] * (v[1] * w[2] - v[2] * w[1]) + u[1] * (v[2] * w[0] - v[0] * w[2]) + u[2] * (v[0] * w[1] - v[1] * w[0])


@numba.njit(**_JIT)
def _cubic(k, t):
    return ((k[3] * t + k[2]) * t + k[1]) * t + k[0]


@numba.njit(**_JIT)
def pair_passages(before, after, ends, first, second):
    """Passages of pairs of segments (k → ends[k]) through each other between two sets of nodes (n, 3), (m, 6).

    Columns: segments of the pair, time, places on both segments in [0, 1), sign of the change of the volume.
    """
    out = np.empty((64, 6))
    found = 0
    k, split = np.empty(4), np.empty(4)
    for m in range(first.shape[0]):
        i, g = first[m], second[m]
        e, f = ends[i], ends[g]
        if i == g or e == g or f == i:
            continue
        # Volume u·(v × w) of the edges u, w and the vector v between them, each linear in time.
        u0, w0, v0 = before[e] - before[i], before[f] - before[g], before[g] - before[i]
        u1, w1, v1 = after[e] - after[i] - u0, after[f] - after[g] - w0, after[g] - after[i] - v0
        k[0] = _triple(u0, v0, w0)
        k[1] = _triple(u1, v0, w0) + _triple(u0, v1, w0) + _triple(u0, v0, w1)
        k[2] = _triple(u1, v1, w0) + _triple(u1, v0, w1) + _triple(u0, v1, w1)
        k[3] = _triple(u1, v1, w1)
        b1, b2, b3 = k[0] + k[1] / 3, k[0] + (2 * k[1] + k[2]) / 3, k[0] + k[1] + k[2] + k[3]
        if min(k[0], b1, b2, b3) > 0.0 or max(k[0], b1, b2, b3) < 0.0:
            continue  # Bernstein coefficients of one sign: no root
        parts = _monotone_parts(k, split)
        for part in range(parts):
            left, right = split[part], split[part + 1]
            start, stop = _cubic(k, left), _cubic(k, right)
            if (start > 0.0) == (stop > 0.0):
                continue
            sign = 1.0 if stop > 0.0 else -1.0
            for _ in range(52):
                middle = 0.5 * (left + right)
                if (_cubic(k, middle) > 0.0) == (start > 0.0):
                    left = middle
                else:
                    right = middle
            t = 0.5 * (left + right)
            u, v, w = u0 + t * u1, v0 + t * v1, w0 + t * w1
            uu, uw, ww = np.sum(u * u), np.sum(u * w), np.sum(w * w)
            uv, vw = np.sum(u * v), np.sum(v * w)
            skew = uu * ww - uw * uw
            if skew <= 1e-24 * uu * ww:
                continue
            s, r = (uv * ww - uw * vw) / skew, (uw * uv - uu * vw) / skew
            if 0.0 <= s < 1.0 and 0.0 <= r < 1.0:
                gap = s * u - v - r * w
                if np.sum(gap * gap) > _MEETING * (uu + ww):  # side by side: coplanar all the time, but for round-off
                    continue
                if found == out.shape[0]:
                    out = np.concatenate((out, np.empty((found, 6))))
                row = out[found]
                row[0], row[1], row[2], row[3], row[4], row[5] = i, g, t, s, r, sign
                found += 1
    return out[:found]


@numba.njit(**_JIT)
def _monotone_parts(k, split):
    """Ends of the intervals of [0, 1] in which the cubic is monotone; their number."""
    split[0] = 0.0
    count = 1
    a, b, c = 3 * k[3], 2 * k[2], k[1]
    root = b * b - 4 * a * c
    if root > 0.0:
        q = -0.5 * (b + (np.sqrt(root) if b >= 0 else -np.sqrt(root)))
        first = q / a if a != 0.0 else -1.0
        second = c / q if q != 0.0 else -1.0
        for value in (min(first, second), max(first, second)):
            if 0.0 < value < 1.0:
                split[count] = value
                count += 1
    split[count] = 1.0
    return count
