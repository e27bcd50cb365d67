"""Polygons of surface files, cut into triangles without removing corners."""

from __future__ import annotations

import numpy as np

from yarnscale.arrays import Array, Integers
from yarnscale.errors import InputError

FLAT = 1e-9
"""Area of a triangle over the square of its longest edge, below which it has none."""


class PolygonError(InputError):
    """A polygon that cannot be cut into triangles; ``face`` is its number."""

    def __init__(self, face: int, *, expected: str, found: object = None) -> None:
        super().__init__("face", expected=expected, found=found)
        self.face = face


def triangulated(coordinates: Array, starts: Integers) -> tuple[Integers, Integers]:
    """Triangles of polygons in the plane, as numbers of corners (m, 3), and the polygon of each (m,).

    coordinates: of all corners, polygon by polygon, (nc, 2); polygon k owns the corners starts[k] … starts[k + 1] − 1.
    All corners are kept, also those on straight sides, and so is the orientation.
    Raises PolygonError for a polygon that crosses itself or has no area.
    """
    sizes = np.diff(starts)
    parts, faces = [], []
    for size in np.unique(sizes):
        chosen = np.flatnonzero(sizes == size)
        corners = starts[chosen][:, None] + np.arange(size)
        if size == 3:
            flat = np.flatnonzero(flatness(coordinates[corners]) <= FLAT)
            if len(flat):
                raise PolygonError(int(chosen[flat[0]]), expected="a triangle with an area", found="no area")
            local = np.broadcast_to(np.arange(3), (len(chosen), 1, 3))
        elif size == 4:
            local = _quadrilaterals(coordinates[corners], chosen)
        else:
            local = np.stack([_ears(coordinates[row], int(face)) for row, face in zip(corners, chosen, strict=True)])
        parts.append(starts[chosen][:, None, None] + local)
        faces.append(np.repeat(chosen, size - 2))
    order = np.argsort(np.concatenate(faces), kind="stable")
    return np.concatenate([p.reshape(-1, 3) for p in parts])[order], np.concatenate(faces)[order]


def following_corners(starts: Integers) -> Integers:
    """The next corner of the same polygon, (nc,); starts: as in ``triangulated``."""
    following = np.arange(1, starts[-1] + 1)
    following[starts[1:] - 1] = starts[:-1]
    return following


def in_own_plane(positions: Array, starts: Integers) -> Array:
    """Corners of polygons in space (nc, 3), each seen along the polygon's mean normal, (nc, 2)."""
    origin = np.repeat(positions[starts[:-1]], np.diff(starts), axis=0)
    local = positions - origin
    # Newell's normal: the sum of the cross products of neighbouring corners.
    normals = np.add.reduceat(np.cross(local, local[following_corners(starts)]), starts[:-1], axis=0)
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    normals = np.where(lengths > 0, normals / np.where(lengths > 0, lengths, 1.0), [0.0, 0.0, 1.0])
    least = np.eye(3)[np.argmin(np.abs(normals), axis=1)]
    first = np.cross(least, normals)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    axes = np.repeat(np.stack([first, np.cross(normals, first)], axis=1), np.diff(starts), axis=0)
    return np.einsum("nij,nj->ni", axes, local)


def areas_of(triangles: Array) -> Array:
    """Signed areas of triangles (..., 3, 2), positive where they turn counter-clockwise."""
    first, second = triangles[..., 1, :] - triangles[..., 0, :], triangles[..., 2, :] - triangles[..., 0, :]
    return 0.5 * (first[..., 0] * second[..., 1] - first[..., 1] * second[..., 0])


def polygon_areas(coordinates: Array, starts: Integers) -> Array:
    """Signed areas of polygons, (nf,); arguments as in ``triangulated``."""
    local = coordinates - np.repeat(coordinates[starts[:-1]], np.diff(starts), axis=0)
    ahead = local[following_corners(starts)]
    return 0.5 * np.add.reduceat(local[:, 0] * ahead[:, 1] - local[:, 1] * ahead[:, 0], starts[:-1])


def flatness(triangles: Array) -> Array:
    """Area of triangles (..., 3, 2) over the square of their longest edge, without sign."""
    edges = triangles - np.roll(triangles, 1, axis=-2)
    longest = (edges**2).sum(axis=-1).max(axis=-1)
    return np.abs(areas_of(triangles)) / np.where(longest > 0, longest, 1.0)


_WHOLE = "a polygon with an area that does not cross itself"
_DIAGONALS = np.array([[[0, 1, 2], [0, 2, 3]], [[1, 2, 3], [1, 3, 0]]])


def _quadrilaterals(points: Array, faces: Integers) -> Integers:
    """Triangles (k, 2, 3) of quadrilaterals (k, 4, 2), by the first diagonal unless only the other lies inside."""
    both = points[:, _DIAGONALS]
    turning = areas_of(both).sum(axis=2, keepdims=True)
    signed = areas_of(both) * np.sign(turning)
    size = np.ptp(points, axis=1).max(axis=1)
    # Both diagonals of one that crosses itself leave a triangle that turns the other way.
    crosses = signed.min(axis=2).max(axis=1) < -FLAT * size**2
    flat = np.abs(turning[:, 0, 0]) <= FLAT * size**2
    if (flat | crosses).any():
        first = int(np.argmax(flat | crosses))
        raise PolygonError(int(faces[first]), expected=_WHOLE, found="no area" if flat[first] else "4 corners")
    worst = np.where(signed > 0, flatness(both), -1.0).min(axis=2)
    return _DIAGONALS[np.where(worst[:, 0] > FLAT, 0, np.argmax(worst, axis=1))]


def _ears(points: Array, face: int) -> Integers:
    """Triangles (n − 2, 3) of one polygon (n, 2); of all corners to begin with, the one that leaves no sliver."""
    from mapbox_earcut import triangulate_float64

    count = len(points)
    turning = float(polygon_areas(points, np.array([0, count]))[0])
    size = float(np.ptp(points, axis=0).max())
    best, best_worst = None, 0.0
    for first in range(count) if abs(turning) > FLAT * size**2 else ():
        order = np.roll(np.arange(count), -first)
        found = triangulate_float64(points[order] / size, np.array([count], np.uint32)).reshape(-1, 3)
        if len(found) != count - 2:
            continue
        triangles = order[found.astype(np.int64)]
        if turning < 0:
            triangles = triangles[:, ::-1]
        signed = areas_of(points[triangles]) * np.sign(turning)
        if (signed <= 0).any() or abs(signed.sum() - abs(turning)) > 1e-9 * abs(turning):
            continue
        worst = float(flatness(points[triangles]).min())
        if worst > best_worst:
            best, best_worst = triangles, worst
        if best_worst > 1e3 * FLAT:
            break
    if best is None:
        found = "no area" if abs(turning) <= FLAT * size**2 else f"{count} corners"
        raise PolygonError(face, expected=_WHOLE, found=found)
    return best


def extent(points: Array) -> str:
    """Size of points [m] along every axis, as text in centimetres."""
    sizes = 100 * np.ptp(points, axis=0)
    return " × ".join(f"{size:.4g}" if size < 1e4 else f"{size:.0f}" for size in sizes) + " cm"
