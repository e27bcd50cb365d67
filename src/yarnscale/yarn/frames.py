"""Frames of discrete rods: transport, reference twist, material curvature (HYLC20 §5.1).

An edge's director is transported along the shortest rotation to the edge's new direction. The twist between the frames
of two edges then changes by an angle below half a turn, which is added up: frames may turn any number of times.
"""

from __future__ import annotations

import math
from typing import Any

import numba
import numpy as np

from yarnscale.arrays import Array, Integers

NO_EDGE = np.array([1.0, 0.0, 0.0])
"""Direction at the end of an open yarn, where no edge starts."""

GAUSS_POINTS = (0.5 - 0.5 / math.sqrt(3.0), 0.5 + 0.5 / math.sqrt(3.0))
"""Places on an edge, from 0 to 1, at which edges and curve of a smooth yarn coincide (theory §1)."""


def unit(vectors: Array) -> Array:
    """Vectors (n, 3) of length 1 along these."""
    return vectors / np.linalg.norm(vectors, axis=1)[:, None]


def upright(director: Array, tangent: Array) -> Array:
    """Unit vectors (n, 3) nearest to directors at right angles to unit tangents; 0 where a director is."""
    moved = director - np.einsum("ij,ij->i", director, tangent)[:, None] * tangent
    size = np.linalg.norm(moved, axis=1)[:, None]
    return np.divide(moved, size, out=np.zeros_like(moved), where=size > 0)


def unit_edges(positions: Array, ends: Integers) -> Array:
    """Direction of the edge that starts at each vertex (n, 3); ends: its other end (n,), −1 where none starts."""
    edge = positions[ends] - positions
    edge[ends < 0] = NO_EDGE
    return unit(edge)


def curve_share(turned: Any) -> Any:
    """Length of the smooth curve over that of its edges where these turn: that of the circle through the two Gauss
    points of every edge, θ √(1 + tan²(θ/2)/3)/(2 tan(θ/2)) of a polygon with joints turned by θ.

    turned: squared difference of the unit tangents at a joint, 4 sin²(θ/2).
    """
    return 1.0 - turned / 24.0 - (13.0 / 5760.0) * turned * turned


def curve_length(edge: Array, before: Integers, ends: Integers) -> Array:
    """Length of the smooth curve along each edge (n, 3), as ``STRETCH`` counts it, (n,).

    before: the edge that ends where one begins, ends: the one that begins where it ends, both (n,); −1: none.
    """
    length = np.linalg.norm(edge, axis=1)
    tangent = edge / length[:, None]
    turned = ((tangent - tangent[before]) ** 2).sum(axis=1)
    turned[(before < 0) | (ends < 0)] = 0.0
    return 0.5 * length * (curve_share(turned) + curve_share(turned[ends]))


def parallel_transport(vector: Array, before: Array, after: Array) -> Array:
    """Turn vectors by the smallest rotations that take unit tangents `before` to `after`; shapes (n, 3).

    Undefined if a tangent reverses; callers keep bends below 180°.
    """
    axis = np.cross(before, after)
    cosine = np.einsum("ij,ij->i", before, after)[:, None]
    along = np.einsum("ij,ij->i", axis, vector)[:, None]
    return vector * cosine + np.cross(axis, vector) + axis * along / np.maximum(1.0 + cosine, 1e-12)


def carried(start: Array, end: Array, director: Array) -> Array:
    """Directors (n, 3) transported from unit tangents ``start`` to ``end``, exactly perpendicular to them."""
    return upright(parallel_transport(director, start, end), end)


@numba.njit(cache=True, error_model="numpy")
def carried_along(director, tangent):
    """A director (3,) of the first edge transported to all edges of a yarn in turn; tangent: (k, 3) -> (k, 3)."""
    out, axis = np.empty_like(tangent), np.empty(3)
    for a in range(3):  # as a slice it would take seconds to compile
        out[0, a] = director[a]
    for i in range(1, len(tangent)):
        s, t, d = tangent[i - 1], tangent[i], out[i - 1]
        cosine = s[0] * t[0] + s[1] * t[1] + s[2] * t[2]
        for a in range(3):
            b, c = (a + 1) % 3, (a + 2) % 3
            axis[a] = s[b] * t[c] - s[c] * t[b]
        along = (axis[0] * d[0] + axis[1] * d[1] + axis[2] * d[2]) / max(1.0 + cosine, 1e-12)
        for a in range(3):
            b, c = (a + 1) % 3, (a + 2) % 3
            out[i, a] = d[a] * cosine + axis[b] * d[c] - axis[c] * d[b] + axis[a] * along
        # Rounding would add up over a long yarn.
        tilt = out[i, 0] * t[0] + out[i, 1] * t[1] + out[i, 2] * t[2]
        for a in range(3):
            out[i, a] -= tilt * t[a]
        size = np.sqrt(out[i, 0] ** 2 + out[i, 1] ** 2 + out[i, 2] ** 2)
        for a in range(3):
            out[i, a] /= size
    return out


def signed_angle(start: Array, end: Array, axis: Array) -> Array:
    """Angle about unit `axis` that turns `start` into `end`, in (-π, π]; shapes (n, 3) -> (n,) [rad]."""
    sine = np.einsum("ij,ij->i", np.cross(start, end), axis)
    return np.arctan2(sine, np.einsum("ij,ij->i", start, end))


def reference_twist(tangent: Array, director: Array, previous: Integers, near: Array | float = 0.0) -> Array:
    """Twist of the reference frame at each joint (n,) [rad], on the branch nearest to ``near`` (n,).

    The angle about the outgoing tangent from the transported director of the incoming edge to the director of the
    outgoing edge. tangent, director: per edge (n, 3). previous: the incoming edge of each joint; where it is −1, there
    is no joint, and the twist is ``near``.
    """
    carried = parallel_transport(director[previous], tangent[previous], tangent)
    angle = signed_angle(carried, director, tangent)
    return np.where(previous < 0, near, angle + 2.0 * np.pi * np.round((near - angle) / (2.0 * np.pi)))


def material_frame(tangent: Array, director: Array, twist: Array) -> tuple[Array, Array]:
    """Material directors m1, m2: the frame (d1, t × d1) turned by θ about the tangent; (n, 3) each."""
    second = np.cross(tangent, director)
    cosine, sine = np.cos(twist)[:, None], np.sin(twist)[:, None]
    return cosine * director + sine * second, cosine * second - sine * director


def material_curvature(tangent: Array, director: Array, twist: Array, previous: Integers) -> Array:
    """Integrated curvatures (κ¹, κ²) of each joint in its material frames, shape (n, 2) [-].

    κb = 2 t₋×t / (1 + t₋·t), κ¹ = ½(m2₋ + m2)·κb, κ² = −½(m1₋ + m1)·κb.
    """
    before = tangent[previous]
    cosine = np.einsum("ij,ij->i", before, tangent)[:, None]
    binormal = 2.0 * np.cross(before, tangent) / np.maximum(1.0 + cosine, 1e-12)
    first, second = material_frame(tangent, director, twist)
    means = 0.5 * (second[previous] + second), -0.5 * (first[previous] + first)
    return np.stack([np.einsum("ij,ij->i", mean, binormal) for mean in means], axis=1)


def untwisted_frames(
    positions: Array, ends: Integers, before: Integers, first: Integers
) -> tuple[Array, Array, Array, Array]:
    """Directors without twist along yarns, the twist left where a yarn closes, curvatures and lengths of edges.

    positions: (n, 3) of vertices that are numbered along the yarns. ends, before: (n,) as those of ``Strands``. first:
    vertices at which yarns begin.
    """
    tangent = unit_edges(positions, ends)
    lean = np.eye(3)[np.argmin(np.abs(tangent[first]), axis=1)]
    starts = upright(lean, tangent[first])
    lines = zip(starts, np.split(tangent, first[1:]), strict=True)
    director = np.concatenate([carried_along(start, line) for start, line in lines])
    twist = reference_twist(tangent, director, before)
    curvature = material_curvature(tangent, director, np.zeros(len(tangent)), before)
    curvature[(before < 0) | (ends < 0)] = 0.0
    edge = positions[ends] - positions
    edge[ends < 0] = NO_EDGE
    length = curve_length(edge, before, ends)
    # No edge starts at the end of a yarn; the length before it keeps means what they are.
    length[ends < 0] = length[before[ends < 0]]
    return director, twist, curvature, length
