"""Frames of a discrete rod at rest: transport, reference twist, material curvature (HYLC20 §5.1)."""

from __future__ import annotations

import numba
import numpy as np


def parallel_transport(vector: np.ndarray, before: np.ndarray, after: np.ndarray) -> np.ndarray:
    """Turn vectors by the smallest rotations that take unit tangents `before` to `after`; shapes (n, 3).

    Undefined if a tangent reverses; callers keep bends below 180°.
    """
    axis = np.cross(before, after)
    cosine = np.einsum("ij,ij->i", before, after)[:, None]
    along = np.einsum("ij,ij->i", axis, vector)[:, None]
    return vector * cosine + np.cross(axis, vector) + axis * along / np.maximum(1.0 + cosine, 1e-12)


@numba.njit(cache=True, error_model="numpy")
def carried_along(director, tangent):
    """A director (3,) of the first edge transported to all edges of a yarn in turn; tangent: (k, 3) -> (k, 3)."""
    out = np.empty_like(tangent)
    out[0] = director
    axis = np.empty(3)
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


def signed_angle(start: np.ndarray, end: np.ndarray, axis: np.ndarray) -> np.ndarray:
    """Angle about unit `axis` that turns `start` into `end`, in (-π, π]; shapes (n, 3) -> (n,) [rad]."""
    sine = np.einsum("ij,ij->i", np.cross(start, end), axis)
    return np.arctan2(sine, np.einsum("ij,ij->i", start, end))


def reference_twist(tangent: np.ndarray, director: np.ndarray, previous: np.ndarray) -> np.ndarray:
    """Twist of the reference frame at each joint, shape (n,) [rad].

    The angle about the outgoing tangent from the transported director of the incoming edge to the director of
    the outgoing edge. `tangent` and `director` are per edge, shape
    (n, 3); `previous` gives the incoming edge of each joint.
    """
    carried = parallel_transport(director[previous], tangent[previous], tangent)
    return signed_angle(carried, director, tangent)


def material_frame(
    tangent: np.ndarray, director: np.ndarray, twist: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Material directors m1, m2: the frame (d1, t × d1) turned by θ about the tangent; (n, 3) each."""
    second = np.cross(tangent, director)
    cosine, sine = np.cos(twist)[:, None], np.sin(twist)[:, None]
    return cosine * director + sine * second, cosine * second - sine * director


def material_curvature(
    tangent: np.ndarray, director: np.ndarray, twist: np.ndarray, previous: np.ndarray
) -> np.ndarray:
    """Integrated curvatures (κ¹, κ²) of each joint in its material frames, shape (n, 2) [-].

    κb = 2 t₋×t / (1 + t₋·t), κ¹ = ½(m2₋ + m2)·κb, κ² = −½(m1₋ + m1)·κb.
    """
    before = tangent[previous]
    cosine = np.einsum("ij,ij->i", before, tangent)[:, None]
    binormal = 2.0 * np.cross(before, tangent) / np.maximum(1.0 + cosine, 1e-12)
    first, second = material_frame(tangent, director, twist)
    return np.stack(
        [
            0.5 * np.einsum("ij,ij->i", second[previous] + second, binormal),
            -0.5 * np.einsum("ij,ij->i", first[previous] + first, binormal),
        ],
        axis=1,
    )
