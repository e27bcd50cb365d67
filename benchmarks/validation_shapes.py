"""Shapes of one sheet by two simulations, compared where they are the same piece of fabric.

Yarns and triangles have no vertices in common. Both are smoothed to a middle surface at the same points of the flat
sheet: there the stretch in the middle, the width, the height of the curl, outlines and distances are read in one way.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_closing, binary_erosion, distance_transform_edt, zoom
from scipy.sparse import csr_array
from scipy.spatial import KDTree

Array = NDArray[np.float64]
View = Literal["top", "side"]

POINTS = 41
"""Of the middle surface along either edge of the sheet."""
SPREAD = 0.0035
"""Standard deviation of the weights of vertices around a point [m]: most of a stitch's own relief is smoothed away."""
INSIDE = 0.94
"""Share of the sheet's edge that the points span: what hangs loose at the very border is left out."""
PIXEL = 0.0005
"""Of silhouettes [m]."""
FINER = 16
"""Points of the surface that fill them, over those it has along an edge."""


@dataclass(frozen=True, eq=False)
class MiddleSurface:
    """From vertices (n, 3) to points of the middle surface (POINTS, POINTS, 3), along x and y of the flat sheet."""

    weights: csr_array

    @classmethod
    def of(cls, flat: Array, size: float) -> MiddleSurface:
        """Moving least squares of the planes through vertices at (n, 2) [m] of a flat sheet about 0."""
        line = np.linspace(-0.5, 0.5, POINTS) * INSIDE * size
        points = np.stack(np.meshgrid(line, line, indexing="ij"), axis=-1).reshape(-1, 2)
        rows, columns, entries = [], [], []
        for row, near in enumerate(KDTree(flat).query_ball_point(points, 3.0 * SPREAD)):
            away = (flat[near] - points[row]) / SPREAD
            weight = np.exp(-0.5 * (away * away).sum(axis=1))
            plane = np.column_stack([np.ones(len(away)), away])
            moment = plane.T @ (weight[:, None] * plane)
            rows.append(np.full(len(near), row))
            columns.append(np.array(near))
            entries.append(np.linalg.solve(moment, plane.T * weight)[0])
        index = (np.concatenate(rows), np.concatenate(columns))
        return cls(csr_array((np.concatenate(entries), index), shape=(len(points), len(flat))))

    def at(self, places: Array) -> Array:
        """The surface of vertices at places (n, 3) [m]."""
        return (self.weights @ places).reshape(POINTS, POINTS, 3)


@dataclass(frozen=True)
class Shape:
    """Of a middle surface: stretch in its middle along and across the pull; lengths [m].

    width: half way between the bars, across the pull. rise: from the lowest to the highest point half way, negative
    where the highest is nearer to the middle: edges that hang. lowest: of everything, over the middle.
    """

    along: float
    across: float
    width: float
    rise: float
    lowest: float


def shape_of(surface: Array, size: float, axis: int) -> Shape:
    """Measures of a surface; axis: of the pull."""
    line = np.linspace(-0.5, 0.5, POINTS) * INSIDE * size
    inner = np.flatnonzero(np.abs(line) < 0.1 * size)
    x, y = np.meshgrid(line[inner], line[inner], indexing="ij")
    design = np.column_stack([x.ravel(), y.ravel(), np.ones(x.size)])
    middle = surface[np.ix_(inner, inner)].reshape(-1, 3)
    slopes = np.linalg.norm(np.linalg.lstsq(design, middle, rcond=None)[0][:2], axis=1)
    half_way = np.take(surface, POINTS // 2, axis=axis)
    height = half_way[:, 2]
    highest, lowest = (abs(int(k) - POINTS // 2) for k in (height.argmax(), height.argmin()))
    rise = math.copysign(float(np.ptp(height)), highest - lowest)
    return Shape(
        float(slopes[axis]), float(slopes[1 - axis]), float(np.ptp(half_way[:, 1 - axis])),
        rise, float((surface[..., 2] - middle[:, 2].mean()).min()),
    )  # fmt: skip


@dataclass(frozen=True)
class Difference:
    """Of two surfaces: shared over united silhouette; mean distance of outlines, and of the same points [m]."""

    overlap: float
    outline: float
    apart: float


def difference(one: Array, other: Array, view: View) -> Difference:
    """Of two surfaces, their silhouettes seen from above or from the side (along y)."""
    pixels = silhouettes(one, other, view)
    shared, united = np.logical_and(*pixels).sum(), np.logical_or(*pixels).sum()
    rims = [shape & np.logical_not(binary_erosion(shape)) for shape in pixels]
    gaps = [np.asarray(distance_transform_edt(np.logical_not(rims[1 - k])))[rims[k]].mean() for k in range(2)]
    apart = np.sqrt(((one - other) ** 2).sum(axis=-1).mean())
    return Difference(float(shared / united), float(np.mean(gaps)) * PIXEL, float(apart))


def silhouettes(one: Array, other: Array, view: View) -> list[NDArray[np.bool_]]:
    """Which pixels two surfaces cover, on one grid."""
    seen = [surface[..., [0, 1 if view == "top" else 2]] for surface in (one, other)]
    low = np.min([s.min(axis=(0, 1)) for s in seen], axis=0) - 4 * PIXEL
    high = np.max([s.max(axis=(0, 1)) for s in seen], axis=0) + 4 * PIXEL
    found = []
    for surface in seen:
        pixels = np.zeros(np.ceil((high - low) / PIXEL).astype(int), bool)
        fine = np.asarray(zoom((surface - low) / PIXEL, (FINER, FINER, 1), order=1))
        pixels[tuple(fine.reshape(-1, 2).astype(int).T)] = True
        found.append(binary_closing(pixels))
    return found
