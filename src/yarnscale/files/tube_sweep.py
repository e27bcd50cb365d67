"""Tubes around curves as triangles, the same ones in every frame, for formats without curves."""

from __future__ import annotations

from functools import cached_property

import numba
import numpy as np

from yarnscale.arrays import Array, Integers
from yarnscale.files.curve_frames import CurveSet
from yarnscale.yarn.frames import carried_along, material_frame, signed_angle, upright


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
        offsets, closed = self.curves.offsets, self.curves.closed
        lengths, first = np.diff(offsets), offsets[:-1]
        tangents = _tangents(points, self._neighbours, np.repeat(first, lengths))
        along = tangents[first]
        # Round-off is left of a normal that the curve now runs along.
        lost = np.linalg.norm(np.cross(self._starts, along), axis=1) < 1e-6
        starts = upright(np.where(lost[:, None], np.eye(3)[np.abs(along).argmin(axis=1)], self._starts), along)
        normals, back = _carried(tangents, offsets, starts)
        # The mismatch after a loop is spread evenly over it.
        mismatch = np.where(closed, signed_angle(starts, back, along), 0.0)
        share = (np.arange(len(points)) - np.repeat(first, lengths)) / np.repeat(lengths, lengths)
        frame = np.stack(material_frame(tangents, normals, -share * np.repeat(mismatch, lengths)), axis=1)
        self._starts = starts
        angles = 2 * np.pi * np.arange(self.sides) / self.sides
        spokes = np.column_stack([np.cos(angles), np.sin(angles)]) @ frame
        # The mean width of a convex section is its perimeter over π.
        outer = np.pi / (self.sides * np.sin(np.pi / self.sides)) * radii
        return (points[:, None] + outer[:, None, None] * spokes).reshape(-1, 3), spokes.reshape(-1, 3)

    @cached_property
    def _neighbours(self) -> tuple[Integers, Integers]:
        """The points before and after each, (n,) both; the point itself at an open end."""
        first, last, loop = self.curves.offsets[:-1], self.curves.offsets[1:] - 1, self.curves.closed
        before, after = np.arange(self.curves.point_count) - 1, np.arange(self.curves.point_count) + 1
        before[first], after[last] = np.where(loop, last, first), np.where(loop, first, last)
        return before, after


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


def _tangents(points: Array, neighbours: tuple[Integers, Integers], first: Integers) -> Array:
    """Unit tangents (n, 3); where points coincide that of the point before; first: of each point's curve (n,)."""
    before, after = neighbours
    tangents = points[after] - points[before]
    length = np.linalg.norm(tangents, axis=1)
    if (none := length == 0.0).any():
        known = np.maximum.accumulate(np.where(none, first, np.arange(len(points))))
        tangents, length = tangents[known], length[known]
        tangents[length == 0.0], length[length == 0.0] = (1.0, 0.0, 0.0), 1.0
    return tangents / length[:, None]


@numba.njit(cache=True, error_model="numpy")
def _carried(tangents: Array, offsets: Integers, starts: Array) -> tuple[Array, Array]:
    """Normals (n, 3) carried along each curve from its start (nc, 3), and what they are back at the start (nc, 3)."""
    normals, back = np.empty_like(tangents), np.empty_like(starts)
    for curve in range(len(starts)):
        low, high = offsets[curve], offsets[curve + 1]
        line = carried_along(starts[curve], np.concatenate((tangents[low:high], tangents[low : low + 1])))
        for axis in range(3):
            back[curve, axis] = line[-1, axis]
            for k in range(low, high):
                normals[k, axis] = line[k - low, axis]
    return normals, back
