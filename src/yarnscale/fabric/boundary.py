"""What keeps the borders of a cut fabric together: springs between yarns that touch there (HYLC20 §8.1)."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from yarnscale.errors import InputError
from yarnscale.fabric.direct_neighbours import close_pairs
from yarnscale.fabric.sheet import YarnSheet
from yarnscale.yarn.material import YarnMaterial

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

BORDER_WIDTH = 6.0
"""Width of a glued border [radii]."""


@dataclass(frozen=True, eq=False)
class Springs:
    """Springs between vertices: pairs (k, 2), rest length (k,) [m], stiffness (k,) [N/m]."""

    pairs: Indices
    rest_length: Array
    stiffness: Array

    @classmethod
    def none(cls) -> Springs:
        """No springs."""
        return cls(np.empty((0, 2), np.int64), np.empty(0), np.empty(0))

    def __len__(self) -> int:
        return len(self.pairs)


def border_vertices(sheet: YarnSheet, width: float) -> NDArray[np.bool_]:
    """Vertices of a flat sheet's own shape that lie within ``width`` [m] of its four borders (n,)."""
    low, high = sheet.vertices[:, :2].min(axis=0) + width, sheet.vertices[:, :2].max(axis=0) - width
    return ((sheet.vertices[:, :2] < low) | (sheet.vertices[:, :2] > high)).any(axis=1)


def glue(
    sheet: YarnSheet,
    material: YarnMaterial,
    *,
    width: float | None = None,
    reach: float = 2.4,
    pull: float = 0.9,
    stiffness: float = 1.0,
    borders: NDArray[np.bool_] | None = None,
    normals: Array | None = None,
) -> Springs:
    """Springs that hold the yarns of a border together where they cross, drawn tight through the thickness.

    width: of the border [m], by default ``BORDER_WIDTH`` radii. reach: distance of yarns that are glued [r]. pull: rest
    length of a spring over its length through the thickness now. stiffness: of a spring, over that of one radius of
    yarn. borders: (n,) vertices to glue instead. normals: (n, 3) of the surface that the sheet lies on, by default
    along z. Raises InputError.
    """
    for name, value, least in (("reach", reach, 0.0), ("pull", pull, 0.0), ("stiffness", stiffness, 0.0)):
        if not (math.isfinite(value) and value > least):
            raise InputError(f"{name} of glue", expected="a positive number", found=value)
    if borders is None:
        borders = border_vertices(sheet, BORDER_WIDTH * sheet.radius if width is None else width)
    neighbours = material.contact.neighbours
    first, second = close_pairs(
        sheet.vertices / sheet.radius, sheet.following, sheet.offsets, sheet.closed, reach, neighbours
    )
    ends = sheet.following
    kept = borders[first] & borders[second]
    first, second = first[kept], second[kept]
    # From either end of one segment to the nearest of the other: each pair of vertices once.
    corners = np.stack(
        [np.stack([a, b], 1) for a in (first, ends[first]) for b in (second, ends[second])], axis=1
    )
    away = sheet.vertices[corners[..., 0]] - sheet.vertices[corners[..., 1]]
    distance = np.linalg.norm(away, axis=2)
    nearest = np.argmin(distance, axis=1)
    rows = np.arange(len(first))
    pairs, vector, length = corners[rows, nearest], away[rows, nearest], distance[rows, nearest]
    _, unique = np.unique(np.sort(pairs, axis=1), axis=0, return_index=True)
    pairs, vector, length = pairs[unique], vector[unique], length[unique]
    # Drawn together through the thickness only: in the plane the spring is as long as it lies.
    up = np.array([[0.0, 0.0, 1.0]]) if normals is None else normals[pairs].mean(axis=1)
    through = (vector * up).sum(axis=1) / np.maximum(np.linalg.norm(up, axis=1), 1e-12)
    rest = np.sqrt(np.maximum(length**2 - (1.0 - pull**2) * through**2, 0.0))
    spring = stiffness * material.stretch_stiffness(sheet.radius) / sheet.radius
    return Springs(pairs, np.maximum(rest, 0.1 * length), np.full(len(pairs), spring))
