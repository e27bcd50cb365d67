"""Reference frames of yarns of finite length, and how they are carried from one shape to the next.

An edge's director is transported along the shortest rotation to the edge's new direction. The twist between the frames
of two edges then changes by an angle below half a turn, which is added up: frames may turn any number of times
(HYLC20 §5.1).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from yarnscale.yarn.rest_frames import material_curvature, parallel_transport, reference_twist

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

NO_EDGE = np.array([1.0, 0.0, 0.0])
"""Direction at the end of an open yarn, where no edge starts."""


def unit_edges(positions: Array, following: Indices) -> Array:
    """Direction of the edge that starts at each vertex (n, 3)."""
    edge = positions[following] - positions
    edge[following < 0] = NO_EDGE
    return edge / np.linalg.norm(edge, axis=1)[:, None]


def carried(start: Array, end: Array, director: Array) -> Array:
    """Directors (n, 3) transported from unit tangents ``start`` to ``end``, exactly perpendicular to them."""
    moved = parallel_transport(director, start, end)
    moved -= np.einsum("ij,ij->i", moved, end)[:, None] * end
    size = np.linalg.norm(moved, axis=1)[:, None]
    return np.divide(moved, size, out=np.zeros_like(moved), where=size > 0)


def joint_twists(tangent: Array, director: Array, preceding: Indices, before: Array) -> Array:
    """Reference twist of every joint (n,) [rad], on the branch nearest to its value ``before``."""
    joint = np.flatnonzero(preceding >= 0)
    angle = reference_twist(tangent, director, np.maximum(preceding, 0))[joint]
    twist = before.copy()
    turns = np.round((before[joint] - angle) / (2.0 * np.pi))
    twist[joint] = angle + 2.0 * np.pi * turns
    return twist


def rest_frames(
    positions: Array, following: Indices, preceding: Indices
) -> tuple[Array, Array, Array, Array]:
    """Directors without twist along lines, the twist left where a line closes, curvatures and lengths of edges."""
    tangent = unit_edges(positions, following)
    director = np.zeros_like(tangent)
    for k in range(len(tangent)):
        if preceding[k] != k - 1 or k == 0:
            lean = np.eye(3)[np.argmin(np.abs(tangent[k]))]
            lean = lean - (lean @ tangent[k]) * tangent[k]
            director[k] = lean / np.linalg.norm(lean)
        else:
            director[k] = carried(tangent[k - 1 : k], tangent[k : k + 1], director[k - 1 : k])[0]
    n = len(tangent)
    twist = joint_twists(tangent, director, preceding, np.zeros(n))
    curvature = material_curvature(tangent, director, np.zeros(n), np.maximum(preceding, 0))
    curvature[(preceding < 0) | (following < 0)] = 0.0
    length = np.linalg.norm(positions[following] - positions, axis=1)
    # No edge starts at the end of a yarn; the length before it keeps means what they are.
    last = np.flatnonzero(following < 0)
    length[last] = length[preceding[last]]
    return director, twist, curvature, length
