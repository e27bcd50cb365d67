"""Panels as cut from fabric: an outline of named edges, filled with nearly equilateral triangles.

Edges are divided evenly, so that edges of equal division can be sewn point to point. The interior is a lattice of
equilateral triangles, connected with the edges by Delaunay triangulation.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from yarnscale.arrays import Array, Flags, Integers
from yarnscale.errors import InputError
from yarnscale.shell.garments.polygons import areas_of, flatness, polygon_areas
from yarnscale.shell.mesh import TriangleMesh

_CLEARANCE = 0.65
"""Distance of inner points from the outline, in units of the spacing."""
_SMOOTHING = 8
MOST_DIVISIONS = 2000
"""Of one edge of a panel."""


@dataclass(frozen=True, eq=False)
class Panel:
    """One piece of fabric.

    points: as cut [m], (n, 2); triangles: counter-clockwise seen from the right side, (m, 3); edges: points along
    every named edge of the outline, in the counter-clockwise order of the outline, ends included; grain: angle [rad]
    from x to the fabric's course direction.
    """

    name: str
    points: Array
    triangles: Integers
    edges: Mapping[str, Integers]
    grain: float = 0.0

    def edge(self, name: str) -> Integers:
        """Points along an edge; InputError for an unknown name."""
        if name not in self.edges:
            raise InputError(
                f"edge '{name}' of panel '{self.name}'",
                expected=" or ".join(self.edges),
                found="no such edge",
            )
        return self.edges[name]

    def mesh(self) -> TriangleMesh:
        """The panel alone, flat."""
        flat = TriangleMesh(self.points, self.triangles)
        return flat.with_grain(self.grain) if self.grain else flat


def check_spacing(name: str, spacing: float, extent: float) -> None:
    """InputError for a spacing that is not positive or divides an extent [m] into too many parts."""
    if not (math.isfinite(spacing) and spacing > 0 and extent <= MOST_DIVISIONS * spacing):
        least = f"at least {extent / MOST_DIVISIONS:g} m" if extent else "a positive length [m]"
        raise InputError(f"spacing of panel '{name}'", expected=least, found=spacing)


def cut_panel(
    name: str,
    outline: Mapping[str, ArrayLike],
    spacing: float,
    *,
    segments: Mapping[str, int] | None = None,
    grain: float = 0.0,
) -> Panel:
    """Fill an outline with triangles.

    outline: named edges in counter-clockwise order, each a polyline (k, 2) [m] from the end of the one before;
    spacing: desired edge length [m]; segments: number of divisions of an edge to match another (default:
    length over spacing); grain: angle of the fabric's course direction [rad].

    Raises InputError for outlines that are open, clockwise or too narrow for the spacing.
    """
    check_spacing(name, spacing, 0.0)
    boundary, chains = _divided(name, outline, spacing, segments or {})
    if polygon_areas(boundary, np.array([0, len(boundary)]))[0] <= 0:
        raise InputError(f"outline of panel '{name}'", expected="counter-clockwise edges", found="clockwise")
    inner = _lattice(boundary, spacing)
    points, triangles = _triangulated(name, boundary, inner)
    for _ in range(_SMOOTHING):
        points = smoothed(points, triangles, len(boundary))
        points, triangles = _triangulated(name, boundary, points[len(boundary) :])
    triangles = _without_ears(points, triangles, len(boundary))
    return Panel(name, points, triangles, chains, grain)


def _divided(
    name: str, outline: Mapping[str, ArrayLike], spacing: float, segments: Mapping[str, int]
) -> tuple[Array, dict[str, Integers]]:
    """Points of the outline (n, 2) and, for every edge, their numbers."""
    curves = {edge: np.asarray(curve, dtype=np.float64) for edge, curve in outline.items()}
    for edge, curve in curves.items():
        if curve.ndim != 2 or curve.shape[1] != 2 or len(curve) < 2 or not np.isfinite(curve).all():
            raise InputError(
                f"edge '{edge}' of panel '{name}'", expected="finite points, shape (k, 2)", found=curve.shape
            )
    names = list(curves)
    for edge, following in zip(names, names[1:] + names[:1], strict=True):
        gap = float(np.linalg.norm(curves[edge][-1] - curves[following][0]))
        if gap > 1e-6 * spacing:
            raise InputError(
                f"edge '{following}' of panel '{name}'",
                expected=f"to begin where '{edge}' ends",
                found=f"a gap of {gap:g} m",
            )
    points, chains, first = [], {}, 0
    for edge, curve in curves.items():
        places = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(curve, axis=0), axis=1))])
        check_spacing(name, spacing, places[-1])
        count = segments.get(edge, max(1, round(places[-1] / spacing)))
        if count < 1 or places[-1] == 0:
            raise InputError(f"edge '{edge}' of panel '{name}'", expected="a length", found=places[-1])
        wanted = np.linspace(0.0, places[-1], count + 1)[:-1]
        points.append(np.column_stack([np.interp(wanted, places, curve[:, k]) for k in (0, 1)]))
        chains[edge] = np.arange(first, first + count + 1)
        first += count
    chains = {edge: chain % first for edge, chain in chains.items()}
    return np.concatenate(points), chains


def _lattice(boundary: Array, spacing: float) -> Array:
    """Points of a lattice of equilateral triangles inside the outline, not too near to it."""
    from scipy.spatial import KDTree

    low, high = boundary.min(axis=0), boundary.max(axis=0)
    columns, rows = np.maximum(1, np.round((high - low) / spacing / [1.0, math.sqrt(3) / 2])).astype(int)
    step = (high - low) / [columns, rows]
    i, j = np.meshgrid(np.arange(columns + 1), np.arange(rows + 1))
    points = np.column_stack([low[0] + (i.ravel() + 0.5 * (j.ravel() % 2)) * step[0], low[1] + j.ravel() * step[1]])
    following = np.roll(boundary, -1, axis=0)
    fine = np.concatenate([boundary + s * (following - boundary) for s in np.arange(8) / 8])
    away = KDTree(fine).query(points)[0]
    return points[inside(points, boundary) & (away > _CLEARANCE * spacing)]


def inside(points: Array, polygon: Array) -> Flags:
    """Whether points (n, 2) lie inside a closed polygon (k, 2)."""
    result = np.zeros(len(points), bool)
    for a, b in zip(polygon, np.roll(polygon, -1, axis=0), strict=True):
        crosses = (a[1] > points[:, 1]) != (b[1] > points[:, 1])
        rise = b[1] - a[1] if b[1] != a[1] else 1.0
        result ^= crosses & (points[:, 0] < a[0] + (points[:, 1] - a[1]) / rise * (b[0] - a[0]))
    return result


def _triangulated(name: str, boundary: Array, inner: Array) -> tuple[Array, Integers]:
    from scipy.spatial import Delaunay

    points = np.concatenate([boundary, inner])
    triangles = Delaunay(points).simplices.astype(np.int64)
    corners = points[triangles]
    clockwise = areas_of(corners) < 0
    triangles[clockwise] = triangles[clockwise][:, [0, 2, 1]]
    # Slivers between points of a straight edge are no part of the panel.
    kept = inside(corners.mean(axis=1), boundary) & (flatness(corners) > 1e-3)
    triangles = triangles[kept]
    count = len(boundary)
    sides = {(int(t[k]), int(t[(k + 1) % 3])) for t in triangles for k in range(3)}
    missing = [k for k in range(count) if (k, (k + 1) % count) not in sides]
    unused = np.setdiff1d(np.arange(len(points)), triangles)
    if missing or len(unused):
        x, y = boundary[missing[0]] if missing else points[unused[0]]
        raise InputError(
            f"outline of panel '{name}'",
            expected="wider than two spacings everywhere and no sharp corners",
            found=f"no room for triangles near ({x:.4g}, {y:.4g}) m",
        )
    return points, triangles


def smoothed(points: Array, triangles: Integers, fixed: int = 0) -> Array:
    """Every point (n, d) but the first ``fixed`` half way to the mean of its neighbours in triangles (m, 3)."""
    pairs = np.unique(np.sort(triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1), axis=0)
    one, two = np.concatenate([pairs, pairs[:, ::-1]]).T
    sums = np.column_stack([np.bincount(one, column[two], len(points)) for column in points.T])
    result = 0.5 * points + 0.5 * sums / np.bincount(one, minlength=len(points))[:, None]
    result[:fixed] = points[:fixed]
    return result


def _without_ears(points: Array, triangles: Integers, fixed: int) -> Integers:
    """Flip the inner edge of triangles with two edges on the outline: sewn, their corner would have too few."""
    triangles = triangles.copy()
    for row, corners in enumerate(triangles):
        sides = [(int(corners[k]), int(corners[(k + 1) % 3])) for k in range(3)]
        free = [b == (a + 1) % fixed and a < fixed for a, b in sides]
        if sum(free) != 2:
            continue
        k = free.index(False)
        c, a = sides[k]
        b = int(corners[(k + 2) % 3])
        other = np.flatnonzero((triangles == a).any(axis=1) & (triangles == c).any(axis=1))
        other = other[other != row]
        if len(other) != 1:
            continue
        d = int(triangles[other[0]].sum() - a - c)
        flipped = np.array([[a, b, d], [b, c, d]])
        if (areas_of(points[flipped]) > 0).all():
            triangles[row], triangles[other[0]] = flipped
    return triangles
