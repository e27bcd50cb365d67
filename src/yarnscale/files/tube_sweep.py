"""Tubes around curves as triangles, the same ones in every frame, for formats that know no curves."""

from __future__ import annotations

import numba
import numpy as np
from numpy.typing import NDArray

from yarnscale.files.curve_frames import CurveSet

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]


class TubeSweep:
    """Rings of ``sides`` vertices about the points of curves, with flat lids at open ends.

    triangles: (m, 3), facing outwards. Rings do not turn about the curve, nor from one frame to the next: each starts
    from where the last call left it, so that a tube may be interpolated between frames.
    """

    def __init__(self, curves: CurveSet, *, sides: int = 8) -> None:
        self.curves, self.sides = curves, sides
        self.triangles = _walls(curves, sides)
        self._starts: Floats = np.zeros((len(curves), 3))

    def surface(self, points: Floats, radii: Floats) -> tuple[Floats, Floats]:
        """Vertices [m] and their normals, both (n · sides, 3), of points (n, 3) [m] with radii (n,) [m]."""
        normals = np.empty_like(points)
        tangents = np.empty_like(points)
        _transport(points, self.curves.offsets, self.curves.closed, self._starts, tangents, normals)
        across = np.cross(tangents, normals)
        angles = 2 * np.pi * np.arange(self.sides) / self.sides
        spokes = (
            np.cos(angles)[None, :, None] * normals[:, None, :]
            + np.sin(angles)[None, :, None] * across[:, None, :]
        )
        rings = points[:, None, :] + radii[:, None, None] * spokes
        return rings.reshape(-1, 3), spokes.reshape(-1, 3)


def _walls(curves: CurveSet, sides: int) -> Integers:
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


@numba.njit(cache=True)
def _transport(
    points: Floats,
    offsets: Integers,
    closed: NDArray[np.bool_],
    starts: Floats,
    tangents: Floats,
    normals: Floats,
) -> None:
    """Tangents, and normals carried along each curve without turning; ``starts`` (nc, 3) is read and replaced.

    The mismatch after a loop is spread evenly over it.
    """
    for curve in range(len(closed)):
        low, high = offsets[curve], offsets[curve + 1]
        for i in range(low, high):
            before = i - 1 if i > low else (high - 1 if closed[curve] else i)
            after = i + 1 if i < high - 1 else (low if closed[curve] else i)
            tangent = points[after] - points[before]
            length = np.sqrt(np.sum(tangent * tangent))
            if length > 0.0:
                tangents[i] = tangent / length
            elif i > low:
                tangents[i] = tangents[i - 1]
            else:
                tangents[i] = np.array([1.0, 0.0, 0.0])
        normal = _square(starts[curve], tangents[low])
        starts[curve] = normal
        normals[low] = normal
        for i in range(low + 1, high):
            normal = _carried(normal, tangents[i - 1], tangents[i])
            normals[i] = normal
        if closed[curve]:
            back = _carried(normal, tangents[high - 1], tangents[low])
            side = np.cross(tangents[low], normals[low])
            angle = np.arctan2(np.sum(back * side), np.sum(back * normals[low]))
            for i in range(low + 1, high):
                turn = -angle * (i - low) / (high - low)
                normals[i] = np.cos(turn) * normals[i] + np.sin(turn) * np.cross(tangents[i], normals[i])


@numba.njit(cache=True)
def _square(vector: Floats, tangent: Floats) -> Floats:
    """The part of a vector across the tangent, as a unit vector; any direction across it where there is none."""
    across = vector - np.sum(vector * tangent) * tangent
    length = np.sqrt(np.sum(across * across))
    if length < 1e-6:
        axis = np.zeros(3)
        axis[np.argmin(np.abs(tangent))] = 1.0
        across = axis - np.sum(axis * tangent) * tangent
        length = np.sqrt(np.sum(across * across))
    return across / length


@numba.njit(cache=True)
def _carried(normal: Floats, tangent: Floats, following: Floats) -> Floats:
    """The normal turned by the smallest rotation that takes a tangent to the following one."""
    axis, cosine = np.cross(tangent, following), np.sum(tangent * following)
    if cosine < -0.999999:
        return _square(normal, following)
    turned = cosine * normal + np.cross(axis, normal) + axis * (np.sum(axis * normal) / (1.0 + cosine))
    return _square(turned, following)
