"""Overlap of yarns on a cloth: distances of neighbouring yarns over their diameter."""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from yarnscale.detail.yarns import YarnDetail
from yarnscale.yarn.neighbours import segment_gap

Floats = NDArray[np.float64]

NEIGHBOURS = 3
"""Segments at most so many edges apart along a yarn are no pair, as in the contact of the cell."""
SAME_STITCH = 2.5
"""Segments closer than so many periods in the fabric belong to neighbouring stitches, others to layers of cloth."""


@dataclass(frozen=True, eq=False)
class Overlap:
    """Distance of every yarn segment to the nearest other one, over the diameter; inf beyond one diameter.

    fabric: to yarns of the same stitches, (m,). layers: to yarns of other layers of the cloth or other panels, (m,).
    """

    fabric: Floats
    layers: Floats

    @classmethod
    def of(cls, detail: YarnDetail, curves: Floats) -> Overlap:
        """Of yarns placed at ``curves`` (n, 3) [m] by ``detail.curves``."""
        layout, diameter = detail.layout, 2.0 * detail.radius
        inner = np.ones(layout.vertex_count, bool)
        inner[layout.offsets[1:] - 1] = False
        start = np.flatnonzero(inner)
        middles = 0.5 * (curves[start] + curves[start + 1])
        longest = float(np.linalg.norm(curves[start + 1] - curves[start], axis=1).max())
        pairs = KDTree(middles).query_pairs(diameter + longest, output_type="ndarray")
        curve = layout.curve_of_vertex
        first, second = start[pairs[:, 0]], start[pairs[:, 1]]
        apart = (curve[first] != curve[second]) | (np.abs(first - second) > NEIGHBOURS)
        pairs, first, second = pairs[apart], first[apart], second[apart]
        gaps = _gaps(curves, first, second) / diameter
        spans = np.abs(layout.material[first] - layout.material[second])
        same = (spans < SAME_STITCH * detail.table.pattern.period).all(axis=1)
        same &= layout.panel[first] == layout.panel[second]
        found = np.full((2, len(start)), np.inf)
        for row, which in ((0, same), (1, ~same)):
            for column in range(2):
                np.minimum.at(found[row], pairs[which, column], gaps[which])
        return cls(np.where(found[0] < 1, found[0], np.inf), np.where(found[1] < 1, found[1], np.inf))


@numba.njit(cache=True)
def _gaps(points, first, second):
    gaps = np.empty(len(first))
    for k in range(len(first)):
        a, b, c, d = points[first[k]], points[first[k] + 1], points[second[k]], points[second[k] + 1]
        gaps[k] = np.sqrt(segment_gap(a[0], a[1], a[2], b[0], b[1], b[2], c[0], c[1], c[2], d[0], d[1], d[2]))
    return gaps
