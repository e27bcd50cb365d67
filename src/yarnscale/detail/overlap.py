"""Overlap of yarns on a cloth: distances of neighbouring yarns over their diameter."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from yarnscale.arrays import Array
from yarnscale.detail.yarns import YarnDetail
from yarnscale.yarn.close_pairs import close_pairs, pair_gaps
from yarnscale.yarn.strands import Neighbours, Strands

SAME_STITCH = 2.5
"""Segments closer than so many periods in the fabric belong to neighbouring stitches, others to layers of cloth."""


@dataclass(frozen=True, eq=False)
class Overlap:
    """Distance of every yarn segment to the nearest other one, over the diameter; inf beyond one diameter.

    fabric: to yarns of the same stitches, (m,). layers: to yarns of other layers of the cloth or other panels, (m,).
    """

    fabric: Array
    layers: Array

    @classmethod
    def of(cls, detail: YarnDetail, curves: Array) -> Overlap:
        """Of yarns placed at ``curves`` (n, 3) [m] by ``detail.curves``."""
        layout, diameter = detail.layout, 2.0 * detail.radius
        # Where a yarn closes, its ends are no neighbours.
        strands = Strands.finite(layout.offsets, np.zeros(len(layout.yarn), bool))
        neighbours = Neighbours.by_length(strands, detail.table.pattern.rest_length[layout.vertex], diameter)
        first, second = close_pairs(strands, curves, diameter, neighbours=neighbours)
        gaps = pair_gaps(curves, strands.ends, first, second) / diameter
        spans = np.abs(layout.material[first] - layout.material[second])
        same = (spans < SAME_STITCH * detail.table.pattern.period).all(axis=1)
        same &= layout.panel[first] == layout.panel[second]
        found = np.full((2, layout.vertex_count), np.inf)
        for row, which in ((0, same), (1, ~same)):
            for side in (first, second):
                np.minimum.at(found[row], side[which], gaps[which])
        return cls(*found[:, strands.edges])
