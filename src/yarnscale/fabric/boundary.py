"""Glue at the borders of a cut fabric: springs between yarns that touch there (HYLC20 §8.1).

Glue must carry the weight of the outermost yarns, and hardly any tension of the fabric: glue as stiff as yarn makes
a frame around the sheet that carries the tension, prevents narrowing and curling, and supports a drape. The stiffness
that suffices depends on the structure. Yarns looped through each other touch again and again,
stitch after stitch, and stay where one of them ends; glue only fixes their cut ends. Yarns that cross once, as in a
weave, are held by friction alone, and the outermost slide off. ``docs/validation/fabric.md`` has measurements of both.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from yarnscale.arrays import Array, Flags, Integers
from yarnscale.errors import positive
from yarnscale.fabric.sheet import YarnSheet
from yarnscale.yarn.close_pairs import close_pairs
from yarnscale.yarn.material import YarnMaterial
from yarnscale.yarn.stiffness import PatternStiffness

WIDTH = 3.0
"""Width of a glued border [radii]: its outermost yarn and the yarns that it touches."""
LOOPED, CROSSING = 1e-4, 1e-3
"""Stiffness of glue over that of one radius of yarn: of yarns looped through each other, and that cross once."""
SEWN_WIDTH, SEWN = 6.0, 1.0
"""Width [radii] and stiffness of a sewn border."""
_REACH = 2.4
"""Distance of yarns that are glued [radii]."""
_ONE_CROSSING = 25.0
"""Length of yarn along which it touches one that it crosses, at most [radii]: 1–7 in weaves; in knits 90 and more."""


@dataclass(frozen=True, eq=False)
class BorderSprings:
    """Springs between vertices: pairs (k, 2), rest length (k,) [m], stiffness (k,) [N/m]."""

    pairs: Integers
    rest_length: Array
    stiffness: Array

    @classmethod
    def none(cls) -> BorderSprings:
        """No springs."""
        return cls(np.empty((0, 2), np.int64), np.empty(0), np.empty(0))

    def __len__(self) -> int:
        return len(self.pairs)


def border_distance(sheet: YarnSheet) -> Array:
    """How far each vertex of a flat sheet, in its own shape, is from the nearest of its four borders (n,) [m]."""
    place = sheet.vertices[:, :2]
    return np.minimum(place - place.min(axis=0), place.max(axis=0) - place).min(axis=1)


def looped(sheet: YarnSheet, first: Integers, second: Integers) -> Flags:
    """Which touching pairs of segments (m,) belong to yarns looped through each other, or to one yarn (m,).

    first, second: every pair of the sheet (m,), as all contacts of two yarns count. The length is that along the yarn
    with the shorter span, so that a ring that is crossed at its first vertex counts as crossed once.
    """
    yarn, count = sheet.yarn_of_vertex, len(sheet.closed)
    along = sheet.strands.arc_lengths(sheet.rest_length / sheet.radius)[0]
    one, other = yarn[first], yarn[second]
    ordered = one <= other
    _, meeting = np.unique(np.minimum(one, other) * count + np.maximum(one, other), return_inverse=True)
    spans = []
    for near, far in ((first, second), (second, first)):
        places = np.where(ordered, along[near], along[far])
        low, high = np.full(len(places), math.inf), np.full(len(places), -math.inf)
        np.minimum.at(low, meeting, places)
        np.maximum.at(high, meeting, places)
        spans.append(high - low)
    return (one == other) | (np.minimum(*spans)[meeting] > _ONE_CROSSING)


def glue(
    sheet: YarnSheet,
    material: YarnMaterial,
    *,
    width: float | None = None,
    pull: float = 0.9,
    stiffness: float | None = None,
    distance: Array | None = None,
    normals: Array | None = None,
) -> BorderSprings:
    """Springs between the yarns of a border where they touch, shortened through the thickness.

    width: of the border [m], by default ``WIDTH`` radii. pull: rest length
    of a spring over its length through the thickness now. stiffness: of a spring, over that of one radius of yarn, by
    default ``LOOPED`` or ``CROSSING``, whatever its two yarns are. distance: (n,) of vertices from the border [m], by
    default ``border_distance``. normals: (n, 3) of the surface that the sheet lies on, by default along z.
    Raises InputError.
    """
    width = WIDTH * sheet.radius if width is None else width
    for name, value in (("pull", pull), ("stiffness", stiffness), ("width", width)):
        if value is not None:
            positive(f"{name} of glue", value)
    inside = (border_distance(sheet) if distance is None else distance) >= width
    neighbours = PatternStiffness.of(sheet, material).neighbours(sheet.strands)
    first, second = close_pairs(sheet.strands, sheet.vertices / sheet.radius, _REACH, neighbours=neighbours)
    ends = sheet.following
    strengths = np.where(looped(sheet, first, second), LOOPED, CROSSING)
    if stiffness is not None:
        strengths[:] = stiffness
    kept = ~(inside[first] | inside[second])
    first, second, strengths = first[kept], second[kept], strengths[kept]
    # From either end of one segment to the nearest of the other: each pair of vertices once.
    corners = np.stack([np.stack([a, b], 1) for a in (first, ends[first]) for b in (second, ends[second])], axis=1)
    away = sheet.vertices[corners[..., 0]] - sheet.vertices[corners[..., 1]]
    lengths = np.linalg.norm(away, axis=2)
    nearest = np.argmin(lengths, axis=1)
    rows = np.arange(len(first))
    pairs, vector, length = corners[rows, nearest], away[rows, nearest], lengths[rows, nearest]
    _, unique = np.unique(np.sort(pairs, axis=1), axis=0, return_index=True)
    pairs, vector, length, strengths = pairs[unique], vector[unique], length[unique], strengths[unique]
    # Shortened through the thickness only: in the plane the spring has its present length.
    up = np.array([[0.0, 0.0, 1.0]]) if normals is None else normals[pairs].mean(axis=1)
    through = (vector * up).sum(axis=1) / np.maximum(np.linalg.norm(up, axis=1), 1e-12)
    rest = np.sqrt(np.maximum(length**2 - (1.0 - pull**2) * through**2, 0.0))
    of_yarn = material.stretch_stiffness(sheet.radius) / sheet.radius
    return BorderSprings(pairs, np.maximum(rest, 0.1 * length), strengths * of_yarn)
