"""Pairs of yarn segments that are close enough to touch, over explicit periodic images.

A yarn may touch several copies of another, so all copies are enumerated, not only the nearest.
Unlike ``clearance``, which checks a pattern once, this takes any positions of the copies (also in curved cells).
"""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np
from numpy.typing import NDArray

from yarnscale.errors import InputError
from yarnscale.yarn.pattern import YarnPattern

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
LARGEST_IMAGES = 10_000_000
"""Vertices of all copies."""
_JIT = {"cache": True, "error_model": "numpy", "fastmath": {"nsz", "arcp", "contract", "reassoc"}}


@dataclass(frozen=True, eq=False)
class Images:
    """Copies of a pattern's vertices in a box of tiles; node of (tile k, vertex i) is k·n + i, tile 0 is the primary.

    tiles: (T, 2). home: (T_home,) tiles whose segments are complete, their ends lying in the box too.
    segment_end: (T_home · n,) node at the end of segment (tile, i).
    """

    tiles: Indices
    home: int
    segment_end: Indices

    @classmethod
    def of(cls, pattern: YarnPattern, rings: tuple[int, int]) -> Images:
        """Copies in tiles −rings…rings along x and y, and the tiles that their segments reach."""
        reach = np.abs(pattern.edges[:, 2:]).max(axis=0)
        outer = np.array(rings) + reach
        if np.prod(2.0 * outer + 1.0) * len(pattern.edges) > LARGEST_IMAGES:
            raise InputError(
                "copies that yarns may touch are too many", expected="edges, radius and extent of a few periods",
                found=f"a reach of {outer.tolist()} tiles",
            )  # fmt: skip
        tiles = np.stack(np.meshgrid(*(np.arange(-o, o + 1) for o in outer), indexing="ij"), -1).reshape(
            -1, 2
        )
        inside = (np.abs(tiles) <= rings).all(axis=1)
        primary = (tiles == 0).all(axis=1)
        tiles = np.concatenate([tiles[primary], tiles[inside & ~primary], tiles[~inside]])
        home = int(inside.sum())
        ends = tiles[:home, None, :] + pattern.edges[None, :, 2:]
        nodes = _tile_lookup(tiles, ends) * len(pattern.edges) + pattern.edges[None, :, 1]
        return cls(tiles, home, nodes.reshape(-1))

    def node(self, tile: Indices, vertex: Indices, count: int) -> Indices:
        """Node of each (tile, vertex); count: vertices of the pattern."""
        return _tile_lookup(self.tiles, tile) * count + vertex


def _tile_lookup(tiles: Indices, wanted: Indices) -> Indices:
    low = tiles.min(axis=0)
    table = np.full(tiles.max(axis=0) - low + 1, -1, np.int64)
    table[tuple((tiles - low).T)] = np.arange(len(tiles))
    return table[wanted[..., 0] - low[0], wanted[..., 1] - low[1]]


class PairSearch:
    """Finds close pairs (primary segment, copied segment) of one pattern."""

    def __init__(self, pattern: YarnPattern, images: Images, *, neighbours: int, ordered: bool) -> None:
        """neighbours: segments at most so many edges apart along a yarn are no pair. ordered: (i, j) and (j, i)."""
        self.images, self._ordered, self._neighbours = images, ordered, neighbours
        self._yarn = pattern.yarn_of_vertex
        self._place = pattern.position_along_yarn
        self._walked = pattern.tile_along_yarn
        self._lengths = np.array([len(yarn) for yarn in pattern.yarns])
        self._shift = pattern.yarn_shift

    def find(self, nodes: Array, reach: float) -> tuple[Indices, Indices]:
        """Pairs of segments closer than ``reach``: primary segment (m,), copied segment (m,).

        nodes: (T·n, 3) positions of all copies. Copied segment k belongs to tile k // n, vertex k % n.
        """
        capacity = 64 * len(self._yarn)
        while True:
            pairs = np.empty((capacity, 2), np.int64)
            found = _find(
                nodes, self.images.segment_end, self.images.tiles, reach, self._ordered, self._neighbours,
                self._yarn, self._place, self._walked, self._lengths, self._shift, pairs,
            )  # fmt: skip
            if found >= 0:
                return pairs[:found, 0].copy(), pairs[:found, 1].copy()
            capacity *= 4


@numba.njit(**_JIT)
def closest_points(ax, ay, az, bx, by, bz, cx, cy, cz, dx, dy, dz):
    """Places s, t in [0, 1] on the segments a–b and c–d that are closest, and their squared distance."""
    ux, uy, uz = bx - ax, by - ay, bz - az
    vx, vy, vz = dx - cx, dy - cy, dz - cz
    wx, wy, wz = ax - cx, ay - cy, az - cz
    uu, vv, uv = ux * ux + uy * uy + uz * uz, vx * vx + vy * vy + vz * vz, ux * vx + uy * vy + uz * vz
    uw, vw = ux * wx + uy * wy + uz * wz, vx * wx + vy * wy + vz * wz
    skew = uu * vv - uv * uv
    s = min(max((uv * vw - uw * vv) / skew, 0.0), 1.0) if skew > 1e-12 * uu * vv else 0.5
    t = (uv * s + vw) / vv
    if t < 0.0:
        t, s = 0.0, min(max(-uw / uu, 0.0), 1.0)
    elif t > 1.0:
        t, s = 1.0, min(max((uv - uw) / uu, 0.0), 1.0)
    x, y, z = wx + s * ux - t * vx, wy + s * uy - t * vy, wz + s * uz - t * vz
    return s, t, x * x + y * y + z * z


@numba.njit(**_JIT)
def segment_gap(ax, ay, az, bx, by, bz, cx, cy, cz, dx, dy, dz):
    """Squared distance of the segments a–b and c–d."""
    return closest_points(ax, ay, az, bx, by, bz, cx, cy, cz, dx, dy, dz)[2]


@numba.njit(**_JIT)
def _find(
    nodes, ends, tiles, reach, ordered, neighbours, yarn, place, walked, lengths, shift, pairs
):  # fmt: skip
    n = yarn.shape[0]
    segments = ends.shape[0]
    middle, half = np.empty((segments, 3)), np.empty(segments)
    low, high = np.full(3, np.inf), np.full(3, -np.inf)
    longest = 0.0
    for k in range(segments):
        size = 0.0
        for c in range(3):
            middle[k, c] = 0.5 * (nodes[k, c] + nodes[ends[k], c])
            size += (nodes[ends[k], c] - nodes[k, c]) ** 2
        half[k] = 0.5 * np.sqrt(size)
        if k < n:
            longest = max(longest, half[k])
            for c in range(3):
                low[c], high[c] = min(low[c], middle[k, c]), max(high[c], middle[k, c])
    # Copies near the box of the primary segments, sorted along its longest side; of a large sheet strip by strip.
    near = np.empty(segments, np.int64)
    count = 0
    for k in range(segments):
        margin = reach + half[k] + longest
        inside = True
        for c in range(3):
            inside = inside and low[c] - margin < middle[k, c] < high[c] + margin
        if inside:
            near[count] = k
            count += 1
    axis = 0 if high[0] - low[0] > high[1] - low[1] else 1
    widest = reach + 3.0 * longest
    strips = int((high[1 - axis] - low[1 - axis]) / (2.0 * widest))
    if strips < 8:
        strips = 1
    across = (high[1 - axis] - low[1 - axis]) / strips
    span = high[axis] - low[axis] + 8.0 * widest
    keys = np.empty(count)
    for m in range(count):
        place_across = middle[near[m], 1 - axis] - low[1 - axis]
        strip = min(max(int(place_across / across), 0), strips - 1) if strips > 1 else 0
        keys[m] = strip * span + middle[near[m], axis] - low[axis]
    order = np.argsort(keys)
    keys = keys[order]
    found = 0
    for i in range(n):
        window = reach + half[i] + longest * 2.0
        lowest, last = 0, 0
        if strips > 1:
            place_across = middle[i, 1 - axis] - low[1 - axis]
            lowest = min(max(int((place_across - window) / across), 0), strips - 1)
            last = min(max(int((place_across + window) / across), 0), strips - 1)
        for strip in range(lowest, last + 1):
            centre = strip * span + middle[i, axis] - low[axis]
            for m in range(np.searchsorted(keys, centre - window), count):
                if keys[m] > centre + window:
                    break
                g = near[order[m]]
                j, tile = g % n, g // n
                if ordered:
                    if g == i:
                        continue
                elif j < i:
                    continue
                elif j == i:
                    a, b = tiles[tile, 0], tiles[tile, 1]
                    if a < 0 or (a == 0 and b <= 0):
                        continue
                limit = reach + half[i] + half[g]
                x, y, z = (
                    middle[g, 0] - middle[i, 0],
                    middle[g, 1] - middle[i, 1],
                    middle[g, 2] - middle[i, 2],
                )
                if x * x + y * y + z * z >= limit * limit:
                    continue
                if yarn[i] == yarn[j] and _along(
                    i, j, tiles[tile], neighbours, yarn, place, walked, lengths, shift
                ):
                    continue
                e, f = ends[i], ends[g]
                gap = segment_gap(
                    nodes[i, 0], nodes[i, 1], nodes[i, 2], nodes[e, 0], nodes[e, 1], nodes[e, 2],
                    nodes[g, 0], nodes[g, 1], nodes[g, 2], nodes[f, 0], nodes[f, 1], nodes[f, 2],
                )  # fmt: skip
                if gap < reach * reach:
                    if found == pairs.shape[0]:
                        return -1
                    pairs[found, 0], pairs[found, 1] = i, g
                    found += 1
    return found


@numba.njit(**_JIT)
def _along(i, j, tile, neighbours, yarn, place, walked, lengths, shift):
    """Whether segment (tile, j) lies within ``neighbours`` edges of segment i along the same yarn."""
    y = yarn[i]
    turns = neighbours // lengths[y] + 1
    for k in range(-turns, turns + 1):
        apart = place[j] + k * lengths[y] - place[i]
        if -neighbours <= apart <= neighbours:
            a = walked[j, 0] + k * shift[y, 0] - walked[i, 0]
            b = walked[j, 1] + k * shift[y, 1] - walked[i, 1]
            if a == tile[0] and b == tile[1]:
                return True
    return False


@numba.njit(**_JIT)
def pair_gaps(nodes, ends, first, second):
    """Distance of the segments of each pair, (m,)."""
    gaps = np.empty(first.shape[0])
    for m in range(first.shape[0]):
        i, g = first[m], second[m]
        e, f = ends[i], ends[g]
        gaps[m] = np.sqrt(
            segment_gap(
                nodes[i, 0], nodes[i, 1], nodes[i, 2], nodes[e, 0], nodes[e, 1], nodes[e, 2],
                nodes[g, 0], nodes[g, 1], nodes[g, 2], nodes[f, 0], nodes[f, 1], nodes[f, 2],
            )
        )  # fmt: skip
    return gaps


@numba.njit(**_JIT)
def safe_fraction(nodes, moves, ends, first, second, share):
    """Largest fraction of ``moves`` that brings no pair's ends closer than 1 − ``share`` of its distance, at most 1."""
    fraction = 1.0
    for m in range(first.shape[0]):
        i, g = first[m], second[m]
        e, f = ends[i], ends[g]
        largest = 0.0
        for a in (i, e):
            for b in (g, f):
                x, y, z = moves[a, 0] - moves[b, 0], moves[a, 1] - moves[b, 1], moves[a, 2] - moves[b, 2]
                largest = max(largest, x * x + y * y + z * z)
        if largest == 0.0:
            continue
        gap = segment_gap(
            nodes[i, 0], nodes[i, 1], nodes[i, 2], nodes[e, 0], nodes[e, 1], nodes[e, 2],
            nodes[g, 0], nodes[g, 1], nodes[g, 2], nodes[f, 0], nodes[f, 1], nodes[f, 2],
        )  # fmt: skip
        fraction = min(fraction, share * np.sqrt(gap / largest))
    return fraction
