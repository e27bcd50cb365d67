"""Coincident borders of cloth: found, counted, and sewn together.

Files of garments hold vertices that are split for every face or panel, and long edges that meet two short ones (a
vertex "hangs" within the long edge). Such cloth would fall apart along these borders. Before polygons are cut into
triangles, split vertices become one, and a hanging vertex becomes a corner of the other polygon.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial import KDTree

from yarnscale.arrays import Array, Integers
from yarnscale.shell.garments.polygons import following_corners, polygon_areas
from yarnscale.shell.mesh_arrays import joined

NEAR = 0.05
"""Distance of borders over the length of their edges, below which they count as one line."""
_LARGEST_SHARE = 0.45
"""Of the edges at a vertex: largest distance, so that no edge shrinks to a point."""


@dataclass(frozen=True, eq=False)
class Polygons:
    """Cloth as polygons, in space and in the fabric.

    positions: (nv, 3) [m]; material: (nm, 2) [m]. Polygon i has the corners starts[i] … starts[i + 1] − 1, with
    vertices (nc,) among the positions and points (nc,) among the material ones. names: number in the file of every
    vertex (nv,), counted from 1.
    """

    positions: Array
    material: Array
    starts: Integers
    vertices: Integers
    points: Integers
    names: Integers

    @property
    def following(self) -> Integers:
        """The next corner of the same polygon, (nc,)."""
        return following_corners(self.starts)

    @property
    def faces(self) -> Integers:
        """The polygon of every corner, (nc,)."""
        return np.repeat(np.arange(len(self.starts) - 1), np.diff(self.starts))

    def border(self) -> Integers:
        """Corners whose edge to the next corner belongs to no other polygon, (nb,)."""
        ends = np.sort(np.stack([self.vertices, self.vertices[self.following]]), axis=0)
        _, which, count = np.unique(ends[0] * len(self.positions) + ends[1], return_inverse=True, return_counts=True)
        return np.flatnonzero(count[which] == 1)

    def pieces(self) -> Integers:
        """Number of the piece that every vertex belongs to, (nv,): what edges in space join."""
        return joined(np.stack([self.vertices, self.vertices[self.following]], axis=1), len(self.positions))


@dataclass(frozen=True, eq=False)
class Weld:
    """Polygons with borders sewn: how many vertices were split, how many hung within an edge, and how many border
    edges were closed; place: corner of the unsewn polygons where the first of these begins."""

    cloth: Polygons
    split: int = 0
    hanging: int = 0
    closed: int = 0
    place: int = 0


def weld(cloth: Polygons, distance: float | None = None) -> Weld:
    """Sew borders within ``distance`` [m] of each other, by default within ``NEAR`` of their edges' length."""
    border = cloth.border()
    if not len(border):
        return Weld(cloth)
    tails, heads = cloth.vertices[border], cloth.vertices[cloth.following[border]]
    lengths = np.linalg.norm(cloth.positions[heads] - cloth.positions[tails], axis=1)
    shortest = np.full(len(cloth.positions), np.inf)
    np.minimum.at(shortest, tails, lengths)
    np.minimum.at(shortest, heads, lengths)
    share = NEAR if distance is None else _LARGEST_SHARE
    reach = np.where(np.isfinite(shortest), share * shortest, 0.0)
    if distance is not None:
        reach = np.minimum(reach, distance)
    merged = _merged(cloth, np.unique(np.concatenate([tails, heads])), reach)
    group = merged.vertices
    reach = np.full(len(merged.positions), np.inf)
    limits = (share * lengths) if distance is None else np.minimum(share * lengths, distance)
    for ends in (border, cloth.following[border]):
        np.minimum.at(reach, group[ends], limits)
    hanging = _hanging(merged, reach)
    sewn = _with_hanging(merged, hanging)
    before = np.zeros(len(cloth.vertices), bool)
    before[border] = True
    corner = np.cumsum(np.bincount(hanging.corners, minlength=len(cloth.vertices)) + 1)
    pieces = np.repeat(before, np.diff(corner, prepend=0))
    pieces[sewn.border()] = False
    closed = np.flatnonzero(pieces)
    place = int(np.searchsorted(corner, closed[0], side="right")) if len(closed) else 0
    split = len(cloth.positions) - len(merged.positions)
    return Weld(sewn, split, len(np.unique(hanging.vertices)), len(closed), place)


def continuous(cloth: Polygons) -> Polygons:
    """Material points that are one point of the fabric but numbered for every face become one.

    The fabric is continuous across an edge whose ends coincide in both polygons, if these have the same orientation.
    """
    following, count = cloth.following, len(cloth.positions)
    tails, heads = cloth.vertices, cloth.vertices[following]
    order = np.argsort(tails * count + heads, kind="stable")
    keys = (tails * count + heads)[order]
    place = np.minimum(np.searchsorted(keys, heads * count + tails), len(keys) - 1)
    twin = np.where(keys[place] == heads * count + tails, order[place], -1)
    one = np.flatnonzero(twin >= 0)
    two = twin[one]
    turns = np.sign(polygon_areas(cloth.material[cloth.points], cloth.starts))[cloth.faces]
    first = np.stack([cloth.points[one], cloth.points[following[two]]], axis=1)
    second = np.stack([cloth.points[following[one]], cloth.points[two]], axis=1)
    length = np.linalg.norm(cloth.material[first[:, 0]] - cloth.material[second[:, 0]], axis=1)
    gaps = [np.linalg.norm(np.diff(cloth.material[ends], axis=1)[:, 0], axis=1) for ends in (first, second)]
    whole = (np.maximum(*gaps) <= NEAR * length) & (turns[one] == turns[two])
    group = joined(np.concatenate([first[whole], second[whole]]), len(cloth.material))
    return replace(cloth, material=_means(cloth.material, group), points=group[cloth.points])


def _means(values: Array, group: Integers) -> Array:
    """Mean of the rows of every group."""
    count = np.bincount(group)
    return np.column_stack([np.bincount(group, column) / count for column in values.T])


def _merged(cloth: Polygons, vertices: Integers, reach: Array) -> Polygons:
    """Border vertices within reach of each other become one, unless an edge joins them."""
    tree = KDTree(cloth.positions[vertices])
    pairs = vertices[tree.query_pairs(float(reach.max()), output_type="ndarray").reshape(-1, 2)]
    apart = np.linalg.norm(cloth.positions[pairs[:, 0]] - cloth.positions[pairs[:, 1]], axis=1)
    pairs = pairs[apart <= reach[pairs].min(axis=1)]
    group = joined(pairs, len(cloth.positions))
    names = np.full(int(group.max()) + 1, np.iinfo(np.int64).max)
    np.minimum.at(names, group, cloth.names)
    return replace(cloth, positions=_means(cloth.positions, group), vertices=group[cloth.vertices], names=names)


@dataclass(frozen=True, eq=False)
class _Hanging:
    """Vertices (n,) that hang within the edges that begin at corners (n,), at a share of its length (n,), in order."""

    corners: Integers
    vertices: Integers
    shares: Array


def _hanging(cloth: Polygons, reach: Array) -> _Hanging:
    border = cloth.border()
    starts = cloth.positions[cloth.vertices[border]]
    spans = cloth.positions[cloth.vertices[cloth.following[border]]] - starts
    lengths = np.linalg.norm(spans, axis=1)
    ends = np.unique(cloth.vertices[np.concatenate([border, cloth.following[border]])])
    near = KDTree(cloth.positions[ends]).query_ball_point(starts + 0.5 * spans, 0.5 * lengths)
    rows = np.repeat(np.arange(len(border)), [len(found) for found in near])
    vertices = ends[np.concatenate([np.zeros(0, np.int64), *map(np.asarray, near)]).astype(np.int64)]
    offset = cloth.positions[vertices] - starts[rows]
    along = np.einsum("ij,ij->i", offset, spans[rows]) / lengths[rows] ** 2
    away = np.linalg.norm(offset - along[:, None] * spans[rows], axis=1)
    limit = np.minimum(reach[vertices], reach[cloth.vertices[border]][rows])
    inside = (along * lengths[rows] > limit) & ((1 - along) * lengths[rows] > limit)
    faces = cloth.faces
    own = np.unique(faces * len(cloth.positions) + cloth.vertices)
    foreign = ~np.isin(faces[border[rows]] * len(cloth.positions) + vertices, own)
    found = np.flatnonzero((away <= limit) & inside & foreign)
    found = found[np.lexsort([along[found], border[rows[found]]])]
    return _Hanging(border[rows[found]], vertices[found], along[found])


def _with_hanging(cloth: Polygons, hanging: _Hanging) -> Polygons:
    """Hanging vertices become corners of the polygons that they hang on."""
    if not len(hanging.corners):
        return cloth
    nearby: dict[int, list[int]] = {int(vertex): [] for vertex in hanging.vertices}
    for vertex, point in set(zip(cloth.vertices.tolist(), cloth.points.tolist(), strict=True)):
        if vertex in nearby:
            nearby[vertex].append(point)
    material, points = [*cloth.material], []
    for corner, vertex, share in zip(hanging.corners, hanging.vertices, hanging.shares, strict=True):
        a, b = (cloth.material[cloth.points[k]] for k in (corner, cloth.following[corner]))
        place = a + share * (b - a)
        limit = NEAR * min(share, 1 - share) * np.linalg.norm(b - a)
        # Where the fabric goes on, its own point; across a seam, a new one.
        own = [point for point in nearby[int(vertex)] if np.linalg.norm(cloth.material[point] - place) <= limit]
        points.append(own[0] if own else len(material))
        if not own:
            material.append(place)
    added = np.bincount(cloth.faces[hanging.corners], minlength=len(cloth.starts) - 1)
    return replace(
        cloth,
        material=np.array(material),
        starts=cloth.starts + np.concatenate([[0], np.cumsum(added)]),
        vertices=np.insert(cloth.vertices, hanging.corners + 1, hanging.vertices),
        points=np.insert(cloth.points, hanging.corners + 1, points),
    )
