"""A pattern laid over the panels of a cloth: yarns cut at the borders, and the place of each vertex."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numba
import numpy as np

from yarnscale.arrays import Array, Flags, Integers
from yarnscale.errors import InputError
from yarnscale.shell.mesh import TriangleMesh
from yarnscale.yarn.pattern import YarnPattern

SHORTEST = 12.0
"""Pieces of yarn shorter than so many radii, less than a stitch cut off at a free border, are left out."""
LARGEST_TILING = 200_000_000
"""Most copies of vertices in the boxes around the panels."""
_ON_EDGE = -1e-9


@dataclass(frozen=True, eq=False)
class Tilings:
    """Place of the pattern on every panel: reference coordinates ξ = origin + stretch·(place in the pattern).

    origin: (panels, 2) [m]; stretch: (panels, 2) [-], near one.
    """

    origin: Array
    stretch: Array

    @classmethod
    def plain(cls, panels: int) -> Tilings:
        """Tile (0, 0) at the origin of the material coordinates, unstretched."""
        return cls(np.zeros((panels, 2)), np.ones((panels, 2)))


@dataclass(frozen=True, eq=False)
class Bridges:
    """Vertices (m,) on cubic curves from one yarn end to another, tangent to both.

    anchors: (m, 4) the last two vertices of one end and the first two of the other, in the order of the yarn; share:
    (m,) how far along the curve, in (0, 1).
    """

    vertices: Integers
    anchors: Integers
    share: Array

    def place(self, points: Array) -> None:
        """Set the bridges among the points (n, 3) [m] from their anchors."""
        before, start, end, after = (points[self.anchors[:, k]] for k in range(4))
        gap = np.linalg.norm(end - start, axis=1)[:, None]
        first, last = _direction(start - before) * gap, _direction(after - end) * gap
        t = self.share[:, None]
        points[self.vertices] = (
            (1 + 2 * t) * (1 - t) ** 2 * start
            + t * (1 - t) ** 2 * first
            + t * t * (3 - 2 * t) * end
            - t * t * (1 - t) * last
        )

    def among(self, kept: Flags) -> Bridges:
        """The remaining bridges, renumbered, if whole curves of the vertices (n,) are left out."""
        number = np.cumsum(kept) - 1
        own = kept[self.vertices]
        return Bridges(number[self.vertices[own]], number[self.anchors[own]], self.share[own])


NO_BRIDGES = Bridges(np.zeros(0, np.int64), np.zeros((0, 4), np.int64), np.zeros(0))


@dataclass(frozen=True, eq=False)
class YarnLayout:
    """Yarn vertices on a cloth, curve by curve, independent of its deformation.

    vertex: (n,) of the pattern. triangle: (n,) that contains its reference coordinates ξ; place: (n, 3) barycentric
    coordinates there. material: ξ, (n, 2) [m]. panel: (n,). stretch: of the pattern on that panel, (n, 2).
    offsets: (c + 1,) where each curve begins and the last one ends. yarn: (c,) number of each curve's yarn in the
    pattern. closed: (c,) whether the last vertex is joined to the first. bridges: vertices between panels, for which
    the arrays copy their neighbours.
    """

    vertex: Integers
    triangle: Integers
    place: Array
    material: Array
    panel: Integers
    stretch: Array
    offsets: Integers
    yarn: Integers
    closed: Flags
    bridges: Bridges = NO_BRIDGES

    @classmethod
    def of(cls, pattern: YarnPattern, mesh: TriangleMesh) -> YarnLayout:
        """Repeat ``pattern`` over every panel, tile (0, 0) at the origin of its material coordinates.

        A yarn ends at the last vertex whose reference coordinates are in the panel. Raises InputError if no yarn
        fits on any panel, or if the pattern is far too fine for the cloth.
        """
        return cls.pieces(pattern, mesh, Tilings.plain(int(mesh.panel_numbers.max()) + 1)).without_snippets(
            pattern, mesh
        )

    @classmethod
    def pieces(cls, pattern: YarnPattern, mesh: TriangleMesh, tilings: Tilings) -> YarnLayout:
        """All pieces of yarn with a vertex on a panel, however short. Errors as of ``of``."""
        numbers = mesh.panel_numbers[mesh.corners[:, 0]]
        parts = [
            _panel_pieces(
                pattern.vertices[:, :2] * stretch + origin,
                pattern.period * stretch,
                pattern,
                mesh,
                np.flatnonzero(numbers == p),
            )
            for p, (origin, stretch) in enumerate(zip(tilings.origin, tilings.stretch, strict=True))
        ]
        vertex, triangle, place, lengths, closed = (np.concatenate(c) for c in zip(*parts, strict=True))
        offsets = np.concatenate([[0], np.cumsum(lengths)]).astype(np.int64)
        material = np.einsum("nk,nkc->nc", place, mesh.material[mesh.corners[triangle]])
        panel = numbers[triangle]
        yarn = pattern.yarn_of_vertex[vertex[offsets[:-1]]]
        return cls(vertex, triangle, place, material, panel, tilings.stretch[panel], offsets, yarn, closed)

    @property
    def vertex_count(self) -> int:
        """Number of yarn vertices on the cloth."""
        return len(self.vertex)

    def without_snippets(self, pattern: YarnPattern, mesh: TriangleMesh) -> YarnLayout:
        """Without pieces that are too short; at a seam three vertices suffice.

        Raises InputError if nothing is left.
        """
        starts, ends = self.offsets[:-1], self.offsets[1:]
        kept = np.zeros(len(starts), bool)
        if len(starts):
            rest = pattern.rest_length[self.vertex]
            walked = np.concatenate([[0.0], np.cumsum(rest)])
            whole = walked[ends] - walked[starts]
            length = np.where(self.closed, whole, whole - rest[ends - 1])
            sewn = np.logical_or.reduceat(np.asarray(mesh.seams.any(axis=1))[self.triangle], starts)
            kept = ((length >= SHORTEST * pattern.radius) | sewn) & (ends - starts > 2)
        if not kept.any():
            raise InputError("yarns on the cloth", expected="panels larger than the pattern", found="none fits")
        rows = np.repeat(kept, ends - starts)
        return self.among(
            rows,
            offsets=np.concatenate([[0], np.cumsum((ends - starts)[kept])]).astype(np.int64),
            yarn=self.yarn[kept],
            closed=self.closed[kept],
            bridges=self.bridges.among(rows),
        )

    def among(self, rows: Integers | Flags, **changes: Any) -> YarnLayout:
        """The layout of some of its vertices, with other curves."""
        kept = ("vertex", "triangle", "place", "material", "panel", "stretch")
        return replace(self, **{name: getattr(self, name)[rows] for name in kept}, **changes)


def _panel_pieces(
    rest: Array, period: Array, pattern: YarnPattern, mesh: TriangleMesh, own: Integers
) -> tuple[Integers, Integers, Array, Integers, Flags]:
    """Vertex, triangle and place of all yarn vertices on triangles ``own``; length of each curve, whether closed.

    rest: reference coordinates of the vertices of tile (0, 0), (k, 2); period: of the tiles, (2,) [m].
    """
    corners = mesh.material[mesh.corners[own]]
    points = corners.reshape(-1, 2)
    # A margin of the longest step of an edge, so that every neighbour of a vertex inside has a place in the box.
    margin = np.abs(pattern.edges[:, 2:]).max(axis=0)
    low = np.floor((points.min(axis=0) - rest.max(axis=0)) / period).astype(np.int64) - margin
    high = np.ceil((points.max(axis=0) - rest.min(axis=0)) / period).astype(np.int64) + margin
    shape = high - low + 1
    if int(shape[0]) * int(shape[1]) * len(rest) > LARGEST_TILING:
        raise InputError(
            "pattern on the cloth",
            expected=f"at most {LARGEST_TILING} copies of vertices",
            found=f"{shape[0]} × {shape[1]} tiles of {len(rest)}",
        )
    owner, place = _locate(corners, rest, period, low, shape)
    chain, lengths, closed = chains(owner, pattern.next_vertex, pattern.edges[:, 2:].copy(), pattern.previous_vertex)
    return chain % len(rest), own[owner.ravel()[chain]], place.reshape(-1, 3)[chain], lengths, closed


@numba.njit(cache=True, error_model="numpy")
def _locate(corners, rest, period, low, shape):
    """Triangle (−1: none) and barycentric coordinates of every copy (a, b, i) of the pattern's vertices in the box."""
    n = len(rest)
    owner = np.full((shape[0], shape[1], n), -1, np.int64)
    place = np.empty((shape[0], shape[1], n, 3))
    for t in range(len(corners)):
        c = corners[t]
        x0, y0 = c[0, 0], c[0, 1]
        ux, uy, vx, vy = c[1, 0] - x0, c[1, 1] - y0, c[2, 0] - x0, c[2, 1] - y0
        inverse = 1.0 / (ux * vy - uy * vx)
        left, right = min(x0, x0 + ux, x0 + vx), max(x0, x0 + ux, x0 + vx)
        bottom, top = min(y0, y0 + uy, y0 + vy), max(y0, y0 + uy, y0 + vy)
        for i in range(n):
            a_first = int(np.ceil((left - rest[i, 0]) / period[0] - 1e-9)) - low[0]
            a_last = int(np.floor((right - rest[i, 0]) / period[0] + 1e-9)) - low[0]
            b_first = int(np.ceil((bottom - rest[i, 1]) / period[1] - 1e-9)) - low[1]
            b_last = int(np.floor((top - rest[i, 1]) / period[1] + 1e-9)) - low[1]
            for a in range(a_first, a_last + 1):
                for b in range(b_first, b_last + 1):
                    if owner[a, b, i] >= 0:
                        continue
                    x = rest[i, 0] + (a + low[0]) * period[0] - x0
                    y = rest[i, 1] + (b + low[1]) * period[1] - y0
                    second, third = (x * vy - y * vx) * inverse, (ux * y - uy * x) * inverse
                    first = 1.0 - second - third
                    if min(first, second, third) >= _ON_EDGE:
                        owner[a, b, i] = t
                        place[a, b, i, 0], place[a, b, i, 1], place[a, b, i, 2] = first, second, third
    return owner, place


@numba.njit(cache=True)
def chains(owner, following, steps, preceding):
    """Flat indices of copies inside, in order along each yarn; of each piece its number of vertices, whether closed."""
    across, along, n = owner.shape
    used = np.zeros(owner.shape, np.bool_)
    chain = np.empty(owner.size, np.int64)
    lengths, rings = np.empty(owner.size, np.int64), np.empty(owner.size, np.bool_)
    filled, pieces = 0, 0
    for closed in range(2):
        for i0 in range(n):
            for b0 in range(along):
                for a0 in range(across):
                    if owner[a0, b0, i0] < 0 or used[a0, b0, i0]:
                        continue
                    before = preceding[i0]
                    a, b = a0 - steps[before, 0], b0 - steps[before, 1]
                    # In the first round, begin where a yarn comes in from outside; what is left then are rings.
                    if closed == 0 and owner[a, b, before] >= 0:
                        continue
                    begin = filled
                    a, b, i = a0, b0, i0
                    while owner[a, b, i] >= 0 and not used[a, b, i]:
                        used[a, b, i] = True
                        chain[filled] = (a * along + b) * n + i
                        filled += 1
                        a, b, i = a + steps[i, 0], b + steps[i, 1], following[i]
                    lengths[pieces], rings[pieces] = filled - begin, closed == 1
                    pieces += 1
    return chain[:filled], lengths[:pieces], rings[:pieces]


def _direction(vectors: Array) -> Array:
    """Unit vectors; zero for zero vectors."""
    return vectors / np.maximum(np.linalg.norm(vectors, axis=1), 1e-300)[:, None]
