"""Vertices near triangles, and edges near edges: a tree of boxes over triangles.

Triangles overlap in pairs; every vertex and edge belongs to one of its triangles, so each pair of a vertex and a
triangle, and each pair of edges, is found once (representative triangles: Curtis, Tamstorf and Manocha 2008). The
tree is balanced, over triangles sorted along a space-filling curve.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeVar

import numba
import numpy as np

from yarnscale.arrays import Array, Flags, Integers
from yarnscale.numerics.threads import equal_ranges, run_parts

Found = TypeVar("Found")


@dataclass(frozen=True, eq=False)
class Surfaces:
    """Triangles (m, 3), those of the cloth first, with the vertices and edges that each represents.

    edges: vertices of each edge (k, 2); sides: the edge from corner i to i + 1 of each triangle (m, 3); own_corners,
    own_sides: which of these the triangle represents (m, 3).
    """

    triangles: Integers
    cloth: int
    edges: Integers
    sides: Integers
    own_corners: Flags
    own_sides: Flags

    @classmethod
    def of(cls, triangles: Integers, cloth: int) -> Surfaces:
        """Surfaces of triangles (m, 3), of which the first ``cloth`` are the cloth's and the rest obstacles'."""
        ends = np.sort(np.stack([triangles, np.roll(triangles, -1, axis=1)], axis=2), axis=2).reshape(-1, 2)
        edges, first, sides = np.unique(ends, axis=0, return_index=True, return_inverse=True)
        own_sides, own_corners = np.zeros(len(ends), bool), np.zeros(triangles.size, bool)
        own_sides[first] = True
        own_corners[np.unique(triangles, return_index=True)[1]] = True
        shape = triangles.shape
        return cls(
            triangles,
            cloth,
            edges,
            sides.reshape(shape).astype(np.int64),
            own_corners.reshape(shape),
            own_sides.reshape(shape),
        )


def near_pairs(surfaces: Surfaces, lowest: Array, highest: Array, *, within_cloth: bool) -> tuple[Integers, Integers]:
    """Pairs whose boxes overlap, in a fixed order, without those that share a vertex or belong to obstacles only.

    lowest, highest: corners of the boxes of the vertices, (nv, 3) [m]. Returns vertices and triangles (n, 2), and edges
    and edges (m, 2).
    """
    s, boxes = surfaces, np.column_stack([lowest, -highest])
    edges, triangles = boxes[s.edges].min(axis=1), boxes[s.triangles].min(axis=1)

    def pairs_of(near: Integers) -> tuple[Integers, Integers]:
        return _pairs_of(near, s.triangles, s.edges, s.sides, s.own_corners, s.own_sides, boxes, edges, triangles)

    found = on_overlaps(triangles, s.cloth, pairs_of, within_cloth=within_cloth)
    nothing = [np.zeros((0, 2), np.int64)]
    return np.concatenate(nothing + [a for a, _ in found]), np.concatenate(nothing + [b for _, b in found])


def on_overlaps(boxes: Array, cloth: int, act: Callable[[Integers], Found], *, within_cloth: bool) -> list[Found]:
    """What ``act`` makes of pairs of triangles (n, 2) whose boxes overlap, the cloth's first, part by part on threads.

    boxes: lowest and then negated highest corners (m, 6), of which the first ``cloth`` are the cloth's.
    """
    asking, jobs = _Tree.of(boxes, 0, cloth), []
    if within_cloth:
        jobs += [(asking, True, *bounds) for bounds in equal_ranges(cloth)]
    if len(boxes) > cloth:
        obstacles = _Tree.of(boxes, cloth, len(boxes))
        jobs += [(obstacles, False, *bounds) for bounds in equal_ranges(cloth)]

    def run(job: tuple[_Tree, bool, int, int]) -> Found:
        asked, same, begin, end = job
        return act(_overlapping(boxes, asking.order, asked.order, asked.boxes, asked.leaves, same, begin, end))

    return run_parts(run, jobs)


@dataclass(frozen=True, eq=False)
class _Tree:
    """A complete binary tree of boxes: children of node i are 2i and 2i + 1, the root is 1.

    order: triangle of each leaf; boxes: (nodes, 6), lowest and then negated highest corners.
    """

    order: Integers
    boxes: Array
    leaves: int

    @classmethod
    def of(cls, triangles: Array, begin: int, end: int) -> _Tree:
        """Tree of some of the boxes of triangles (m, 6)."""
        own = triangles[begin:end]
        order = np.argsort(_curve(own[:, :3] - own[:, 3:]), kind="stable")
        leaves = 1 << max(0, int(np.ceil(np.log2(max(1, len(order))))))
        boxes = np.full((2 * leaves, 6), np.inf)
        boxes[leaves : leaves + len(order)] = own[order]
        level = leaves
        while level > 1:
            pairs = boxes[level : 2 * level].reshape(-1, 2, 6)
            np.minimum(pairs[:, 0], pairs[:, 1], out=boxes[level // 2 : level])
            level //= 2
        return cls(order + begin, boxes, leaves)


def _curve(points: Array) -> Integers:
    """Place of points (n, 3) along a space-filling curve (Morton), 15 bits an axis."""
    extent = np.ptp(points, axis=0).max() if len(points) else 0.0
    scaled = (points - points.min(axis=0, initial=np.inf)) * (32767.0 / extent if extent > 0 else 0.0)
    cells, place = scaled.astype(np.int64), np.zeros(len(points), np.int64)
    for bit in range(15):
        for axis in range(3):
            place |= ((cells[:, axis] >> bit) & 1) << (3 * bit + axis)
    return place


@numba.njit(cache=True, error_model="numpy", nogil=True)
def _overlapping(boxes, order, other_order, other_boxes, other_leaves, same, begin, end):
    """Triangles at places begin … end − 1 of one tree with those of another, or later ones of the same, (n, 2)."""
    found, count = np.empty((1024, 2), np.int64), 0
    stack = np.empty(256, np.int64)
    last = np.empty(2 * other_leaves, np.int64)
    for node in range(2 * other_leaves - 1, 0, -1):
        last[node] = node - other_leaves if node >= other_leaves else last[2 * node + 1]
    for place in range(begin, end):
        a = order[place]
        after = place if same else -1
        stack[0] = 1
        height = 1
        while height:
            height -= 1
            node = stack[height]
            if last[node] <= after or not _overlap(boxes, a, other_boxes, node):
                continue
            if node < other_leaves:
                stack[height] = 2 * node + 1
                stack[height + 1] = 2 * node
                height += 2
                continue
            if count == len(found):
                found = np.concatenate((found, np.empty_like(found)))
            found[count, 0], found[count, 1] = a, other_order[node - other_leaves]
            count += 1
    return found[:count]


@numba.njit(cache=True, error_model="numpy", nogil=True)
def _pairs_of(near, triangles, edges, sides, own_corners, own_sides, vertex_boxes, edge_boxes, triangle_boxes):
    """Overlapping vertices and triangles, and edges and edges, that pairs of triangles (n, 2) represent."""
    corners, met = np.empty((1024, 2), np.int64), np.empty((1024, 2), np.int64)
    corner_count = met_count = 0
    for n in range(len(near)):
        a, b = near[n]
        if corner_count + 6 > len(corners):
            corners = np.concatenate((corners, np.empty_like(corners)))
        if met_count + 9 > len(met):
            met = np.concatenate((met, np.empty_like(met)))
        for p, q in ((a, b), (b, a)):
            corner_count = _add_corners(
                triangles, own_corners, vertex_boxes, triangle_boxes, p, q, corners, corner_count
            )
        met_count = _add_sides(edges, sides, own_sides, edge_boxes, triangle_boxes, a, b, met, met_count)
    return corners[:corner_count], met[:met_count]


@numba.njit(cache=True, error_model="numpy", nogil=True, inline="always")
def _overlap(boxes, i, others, j):
    """Whether boxes overlap, given as lowest and negated highest corners."""
    return (
        boxes[i, 0] <= -others[j, 3]
        and boxes[i, 1] <= -others[j, 4]
        and boxes[i, 2] <= -others[j, 5]
        and others[j, 0] <= -boxes[i, 3]
        and others[j, 1] <= -boxes[i, 4]
        and others[j, 2] <= -boxes[i, 5]
    )


@numba.njit(cache=True, error_model="numpy", nogil=True)
def _add_corners(triangles, own_corners, vertex_boxes, triangle_boxes, a, b, found, count):
    """Vertices that triangle a represents with triangle b."""
    p, q, r = triangles[b, 0], triangles[b, 1], triangles[b, 2]
    for i in range(3):
        v = triangles[a, i]
        if own_corners[a, i] and _overlap(vertex_boxes, v, triangle_boxes, b) and v not in (p, q, r):
            found[count, 0], found[count, 1] = v, b
            count += 1
    return count


@numba.njit(cache=True, error_model="numpy", nogil=True)
def _add_sides(edges, sides, own_sides, edge_boxes, triangle_boxes, a, b, found, count):
    """Edges that triangle a represents with those that triangle b represents."""
    for i in range(3):
        e = sides[a, i]
        if not (own_sides[a, i] and _overlap(edge_boxes, e, triangle_boxes, b)):
            continue
        p, q = edges[e, 0], edges[e, 1]
        for j in range(3):
            f = sides[b, j]
            if not (own_sides[b, j] and _overlap(edge_boxes, e, edge_boxes, f)):
                continue
            r, s = edges[f, 0], edges[f, 1]
            if p not in (r, s) and q not in (r, s):
                found[count, 0], found[count, 1] = e, f
                count += 1
    return count
