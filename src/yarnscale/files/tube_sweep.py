"""Tubes around curves as triangles, the same ones in every frame, for formats without curves."""

from __future__ import annotations

from functools import cached_property

import numba
import numpy as np

from yarnscale.arrays import Array, Flags, Integers
from yarnscale.files.curve_frames import CurveSet
from yarnscale.yarn.frames import carried_along


class TubeSweep:
    """Rings of ``sides`` vertices about the points of curves, with flat lids at open ends.

    Seen from all around, a ring is on average as wide as the yarn, however few sides it has: its vertices lie a little
    outside. Rings do not turn about the curve, nor from one frame to the next: each starts from where the last call
    left it, so that a tube may be interpolated between frames.
    """

    def __init__(self, curves: CurveSet, *, sides: int = 8) -> None:
        self.curves, self.sides = curves, sides
        self._starts: Array = np.zeros((len(curves), 3))

    @cached_property
    def triangles(self) -> Integers:
        """Corners (m, 3), facing outwards."""
        return tube_triangles(self.curves, self.sides)

    def surface(self, points: Array, radii: Array) -> tuple[Array, Array]:
        """Vertices [m] and their normals, both (n · sides, 3), of points (n, 3) [m] with radii (n,) [m]."""
        normals, tangents = np.empty_like(points), np.empty_like(points)
        curves = self.curves
        _transport(points, curves.offsets, curves.closed, self._starts, tangents, normals)
        angles = 2 * np.pi * np.arange(self.sides) / self.sides
        vertices, spokes = (np.empty((len(points) * self.sides, 3)) for _ in range(2))
        # The mean width of a convex section is its perimeter over π.
        outer = np.pi / (self.sides * np.sin(np.pi / self.sides))
        _rings(points, outer * radii, tangents, normals, angles, vertices, spokes)
        return vertices, spokes


def tube_triangles(curves: CurveSet, sides: int) -> Integers:
    """Walls and lids of tubes of so many sides, (m, 3), facing outwards."""
    segments = curves.segments()
    here, following = np.arange(sides), (np.arange(sides) + 1) % sides
    first, second = sides * segments[:, :1], sides * segments[:, 1:]
    a, b, c, d = first + here, first + following, second + here, second + following
    walls = np.stack([np.stack([a, b, d], axis=-1), np.stack([a, d, c], axis=-1)], axis=-2).reshape(-1, 3)
    fan = np.stack([np.zeros(sides - 2, int), np.arange(1, sides - 1), np.arange(2, sides)], axis=1)
    begin = sides * curves.offsets[:-1][~curves.closed]
    end = sides * (curves.offsets[1:] - 1)[~curves.closed]
    front = (begin[:, None, None] + fan[:, ::-1]).reshape(-1, 3)
    back = (end[:, None, None] + fan).reshape(-1, 3)
    return np.vstack([walls, front, back]).astype(np.int64)


@numba.njit(cache=True, error_model="numpy")
def _transport(
    points: Array,
    offsets: Integers,
    closed: Flags,
    starts: Array,
    tangents: Array,
    normals: Array,
) -> None:
    """Tangents, and normals carried along each curve without turning; ``starts`` (nc, 3) is read and replaced.

    The mismatch after a loop is spread evenly over it.
    """
    for curve in range(len(closed)):
        low, high, loop = offsets[curve], offsets[curve + 1], closed[curve]
        t = (1.0, 0.0, 0.0)
        for i in range(low, high):
            before = i - 1 if i > low else (high - 1 if loop else i)
            after = i + 1 if i < high - 1 else (low if loop else i)
            x, y, z = (
                points[after, 0] - points[before, 0],
                points[after, 1] - points[before, 1],
                points[after, 2] - points[before, 2],
            )
            length = np.sqrt(x * x + y * y + z * z)
            if length > 0.0:
                t = (x / length, y / length, z / length)
            tangents[i, 0], tangents[i, 1], tangents[i, 2] = t
        first = (tangents[low, 0], tangents[low, 1], tangents[low, 2])
        n = _square((starts[curve, 0], starts[curve, 1], starts[curve, 2]), first)
        starts[curve, 0], starts[curve, 1], starts[curve, 2] = n
        line = np.concatenate((tangents[low:high], tangents[low : low + 1]))
        carried = carried_along(np.array(n), line)
        normals[low:high] = carried[:-1]
        if loop:
            begin, back = carried[0], carried[-1]
            side = _cross(first, begin)
            angle = np.arctan2(_dot(back, side), _dot(back, begin))
            for i in range(low + 1, high):
                turn = -angle * (i - low) / (high - low)
                cosine, sine = np.cos(turn), np.sin(turn)
                n = (normals[i, 0], normals[i, 1], normals[i, 2])
                across = _cross((tangents[i, 0], tangents[i, 1], tangents[i, 2]), n)
                for k in range(3):
                    normals[i, k] = cosine * n[k] + sine * across[k]


@numba.njit(cache=True, error_model="numpy")
def _rings(
    points: Array,
    radii: Array,
    tangents: Array,
    normals: Array,
    angles: Array,
    vertices: Array,
    spokes: Array,
) -> None:
    """Vertices and their normals, both (n · sides, 3), of rings about points."""
    sides = len(angles)
    cosine, sine = np.cos(angles), np.sin(angles)
    for i in range(len(points)):
        n = (normals[i, 0], normals[i, 1], normals[i, 2])
        across = _cross((tangents[i, 0], tangents[i, 1], tangents[i, 2]), n)
        for s in range(sides):
            for k in range(3):
                spoke = cosine[s] * n[k] + sine[s] * across[k]
                spokes[i * sides + s, k] = spoke
                vertices[i * sides + s, k] = points[i, k] + radii[i] * spoke


@numba.njit(cache=True, inline="always")
def _dot(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@numba.njit(cache=True, inline="always")
def _cross(a, b):
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@numba.njit(cache=True, error_model="numpy")
def _square(vector, tangent):
    """The part of a vector across the tangent, as a unit vector; any direction across it where there is none."""
    along = _dot(vector, tangent)
    x, y, z = (vector[0] - along * tangent[0], vector[1] - along * tangent[1], vector[2] - along * tangent[2])
    length = np.sqrt(x * x + y * y + z * z)
    if length < 1e-6:
        a, b, c = abs(tangent[0]), abs(tangent[1]), abs(tangent[2])
        axis = (1.0, 0.0, 0.0) if a <= b and a <= c else (0.0, 1.0, 0.0) if b <= c else (0.0, 0.0, 1.0)
        along = _dot(axis, tangent)
        x, y, z = axis[0] - along * tangent[0], axis[1] - along * tangent[1], axis[2] - along * tangent[2]
        length = np.sqrt(x * x + y * y + z * z)
    return x / length, y / length, z / length
