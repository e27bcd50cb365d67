"""Pairs of yarn segments that are close enough to touch, found by a grid of cells, and the geometry of a pair."""

from __future__ import annotations

import numba
import numpy as np

from yarnscale.arrays import Array, Integers
from yarnscale.errors import InputError
from yarnscale.yarn.strands import Neighbours, Strands

_JIT = {"cache": True, "error_model": "numpy", "fastmath": {"nsz", "arcp", "contract", "reassoc"}}
LARGEST_PAIRS = 1 << 27
_MOST_CELLS = 1 << 22
_PAIRS_PER_SEGMENT = 24


def close_pairs(
    strands: Strands,
    nodes: Array,
    reach: float,
    *,
    neighbours: Neighbours | int,
    ordered: bool = False,
    moves: Array | None = None,
) -> tuple[Integers, Integers]:
    """Pairs of segments closer than ``reach``: primary segment (m,) and segment of any copy (m,), by their first nodes.

    nodes: (T·n, 3) positions of all copies. neighbours: segments that are no pair, or within how many edges they are.
    ordered: (i, j) and (j, i), otherwise every pair once. moves: (T·n, 3) of the nodes; pairs count as nearer by as
    much as they may move towards each other. Raises InputError where there are too many.
    """
    tight = np.ascontiguousarray
    if isinstance(neighbours, int):
        neighbours = Neighbours.by_edges(strands, neighbours)
    arcs = neighbours.start, neighbours.length, neighbours.period
    going = np.empty((0, 3)) if moves is None else tight(moves)
    capacity = _PAIRS_PER_SEGMENT * strands.count + 64
    while True:
        pairs = np.empty((capacity, 2), np.int64)
        found = _find(
            tight(nodes), going, strands.ends, strands.tiles, reach, ordered, strands.yarn,
            strands.walked, strands.shift, arcs, neighbours.least, pairs,
        )  # fmt: skip
        if found >= 0:
            return pairs[:found, 0].copy(), pairs[:found, 1].copy()
        capacity *= 4
        if capacity > LARGEST_PAIRS:
            raise InputError(
                "too many segments lie on top of each other", expected=f"at most {LARGEST_PAIRS // 4} close pairs",
                found="more",
            )  # fmt: skip


@numba.njit(**_JIT)
def nearest_places(x, a, b, c, d):
    """Places s, t in [0, 1] on the segments x[a]–x[b] and x[c]–x[d] that are closest, and their squared distance."""
    ux, uy, uz = x[b, 0] - x[a, 0], x[b, 1] - x[a, 1], x[b, 2] - x[a, 2]
    vx, vy, vz = x[d, 0] - x[c, 0], x[d, 1] - x[c, 1], x[d, 2] - x[c, 2]
    wx, wy, wz = x[a, 0] - x[c, 0], x[a, 1] - x[c, 1], x[a, 2] - x[c, 2]
    uu, vv, uv = ux * ux + uy * uy + uz * uz, vx * vx + vy * vy + vz * vz, ux * vx + uy * vy + uz * vz
    uw, vw = ux * wx + uy * wy + uz * wz, vx * wx + vy * wy + vz * wz
    skew = uu * vv - uv * uv
    s = min(max((uv * vw - uw * vv) / skew, 0.0), 1.0) if skew > 1e-12 * uu * vv else 0.5
    t = (uv * s + vw) / vv
    if t < 0.0:
        t, s = 0.0, min(max(-uw / uu, 0.0), 1.0)
    elif t > 1.0:
        t, s = 1.0, min(max((uv - uw) / uu, 0.0), 1.0)
    dx, dy, dz = wx + s * ux - t * vx, wy + s * uy - t * vy, wz + s * uz - t * vz
    return s, t, dx * dx + dy * dy + dz * dz


@numba.njit(**_JIT)
def _find(
    nodes, moves, ends, tiles, reach, ordered, yarn, walked, shift, arcs, least, pairs
):  # fmt: skip
    n, segments = yarn.shape[0], ends.shape[0]
    moving = moves.shape[0] > 0
    middle, half = np.zeros((segments, 3)), np.zeros(segments)
    pace, spread = np.zeros((segments if moving else 0, 3)), np.zeros(segments)
    common = np.zeros(3)
    for k in range(segments):
        e = ends[k]
        if e < 0:
            continue
        length = apart = 0.0
        for c in range(3):
            middle[k, c] = 0.5 * (nodes[k, c] + nodes[e, c])
            length += (nodes[e, c] - nodes[k, c]) ** 2
            if moving:
                pace[k, c] = 0.5 * (moves[k, c] + moves[e, c])
                apart += (moves[e, c] - moves[k, c]) ** 2
                common[c] += pace[k, c]
        half[k], spread[k] = 0.5 * np.sqrt(length), 0.5 * np.sqrt(apart)
    # How far from its middle a segment reaches while it moves, but for what all of them do in common.
    size = half + spread
    if moving:
        common /= max((ends >= 0).sum(), 1)
        for k in range(segments):
            own = (pace[k, 0] - common[0]) ** 2 + (pace[k, 1] - common[1]) ** 2 + (pace[k, 2] - common[2]) ** 2
            size[k] += np.sqrt(own)
    low, high, longest = np.full(3, np.inf), np.full(3, -np.inf), 0.0
    for k in range(n):
        if ends[k] >= 0:
            longest = max(longest, size[k])
            for c in range(3):
                low[c], high[c] = min(low[c], middle[k, c]), max(high[c], middle[k, c])
    near, widest = np.empty(segments, np.int64), longest
    count = 0
    for k in range(segments):
        margin = reach + size[k] + longest
        inside = ends[k] >= 0
        for c in range(3):
            inside = inside and low[c] - margin < middle[k, c] < high[c] + margin
        if inside:
            near[count], widest = k, max(widest, size[k])
            count += 1
    near = near[:count]
    shape, cell, starts, order = _grid(middle, near, reach + longest + widest)
    found = 0
    for m in range(count):
        i = near[m]
        if i >= n:
            break
        for a in range(max(cell[m, 0] - 1, 0), min(cell[m, 0] + 2, shape[0])):
            for b in range(max(cell[m, 1] - 1, 0), min(cell[m, 1] + 2, shape[1])):
                first = (a * shape[1] + b) * shape[2]
                # Cells along the last axis follow each other.
                begin = starts[first + max(cell[m, 2] - 1, 0)]
                stop = starts[first + min(cell[m, 2] + 2, shape[2])]
                for entry in range(begin, stop):
                    g = near[order[entry]]
                    x, y, z = (middle[g, 0] - middle[i, 0], middle[g, 1] - middle[i, 1], middle[g, 2] - middle[i, 2])
                    away, limit = x * x + y * y + z * z, reach + size[i] + size[g]
                    if away >= limit * limit:
                        continue
                    limit = reach + spread[i] + spread[g]
                    if moving:
                        x, y, z = pace[g, 0] - pace[i, 0], pace[g, 1] - pace[i, 1], pace[g, 2] - pace[i, 2]
                        limit += np.sqrt(x * x + y * y + z * z)
                    if away >= (limit + half[i] + half[g]) ** 2:
                        continue
                    j, tile = g % n, g // n
                    if ordered:
                        if g == i:
                            continue
                    elif j < i or (j == i and (tiles[tile, 0] < 0 or (tiles[tile, 0] == 0 and tiles[tile, 1] <= 0))):
                        continue
                    if (
                        yarn[i] == yarn[j]
                        and _between(i, j, tiles[tile], yarn[i], walked, shift, arcs) < least[yarn[i]]
                    ):
                        continue
                    gap = nearest_places(nodes, i, ends[i], g, ends[g])[2]
                    if gap < limit * limit:
                        if found == pairs.shape[0]:
                            return -1
                        pairs[found, 0], pairs[found, 1] = i, g
                        found += 1
    return found


@numba.njit(**_JIT)
def _grid(points, chosen, width):
    """Cells of some points, no narrower than ``width``: how many along each axis, and the cell (k, 3) of each point.

    Also where each cell begins in the order of points that is sorted by cells, and that order.
    """
    low, high = np.full(3, np.inf), np.full(3, -np.inf)
    for k in chosen:
        for c in range(3):
            low[c], high[c] = min(low[c], points[k, c]), max(high[c], points[k, c])
    shape, cells = np.ones(3, np.int64), 1.0
    if len(chosen):
        width = max(width, 1e-150)
        while True:
            cells = 1.0
            for c in range(3):
                cells *= np.floor((high[c] - low[c]) / width) + 1.0
            if cells <= _MOST_CELLS:  # a few far points must not fill the memory
                break
            width *= 1.5
        for c in range(3):
            shape[c] = int((high[c] - low[c]) / width) + 1
    cell, number = np.empty((len(chosen), 3), np.int64), np.empty(len(chosen), np.int64)
    starts = np.zeros(int(cells) + 2, np.int64)
    for m in range(len(chosen)):
        for c in range(3):
            cell[m, c] = min(int((points[chosen[m], c] - low[c]) / width), shape[c] - 1)
        number[m] = (cell[m, 0] * shape[1] + cell[m, 1]) * shape[2] + cell[m, 2]
        starts[number[m] + 2] += 1
    starts = np.cumsum(starts)
    order = np.empty(len(chosen), np.int64)
    for m in range(len(chosen)):
        order[starts[number[m] + 1]] = m
        starts[number[m] + 1] += 1
    return shape, cell, starts, order


def yarn_between(strands: Strands, length: Array, first: Integers, second: Integers) -> Array:
    """Length of yarn between the segments of pairs (m,), as ``close_pairs`` gives them; inf on different yarns.

    length: of segments (n,).
    """
    start, period = strands.arc_lengths(length)
    arcs = start, np.ascontiguousarray(length), period
    return _all_between(first, second, strands.tiles, strands.yarn, strands.walked, strands.shift, arcs)


@numba.njit(**_JIT)
def _all_between(first, second, tiles, yarn, walked, shift, arcs):
    found = np.full(first.shape[0], np.inf)
    for m in range(first.shape[0]):
        i, (tile, j) = first[m], divmod(second[m], yarn.shape[0])
        if yarn[i] == yarn[j]:
            found[m] = _between(i, j, tiles[tile], yarn[i], walked, shift, arcs)
    return found


@numba.njit(**_JIT)
def _between(i, j, tile, y, walked, shift, arcs):
    """Length of yarn y between its segments i and (tile, j), negative for a segment and itself; inf on two copies."""
    start, length, period = arcs
    # Tiles from i to j beside those that are walked along the yarn: some of its periods.
    x, z = tile[0] - walked[j, 0] + walked[i, 0], tile[1] - walked[j, 1] + walked[i, 1]
    a, b = shift[y, 0], shift[y, 1]
    ring = a == 0 and b == 0
    turns = 0 if ring else round((x * a + z * b) / (a * a + b * b))
    if x != turns * a or z != turns * b:
        return np.inf
    found = np.inf
    for k in range(-1, 2) if ring else range(turns, turns + 1):
        way = start[j] + k * period[y] - start[i]
        found = min(found, way - length[i] if way > 0.0 else -way - length[j])
    return found


@numba.njit(**_JIT)
def pair_gaps(nodes, ends, first, second):
    """Distance of the segments of each pair, (m,)."""
    gaps = np.empty(first.shape[0])
    for m in range(first.shape[0]):
        i, g = first[m], second[m]
        gaps[m] = np.sqrt(nearest_places(nodes, i, ends[i], g, ends[g])[2])
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
        gap = nearest_places(nodes, i, e, g, f)[2]
        fraction = min(fraction, share * np.sqrt(gap / largest))
    return fraction
