"""Penetration of neighbouring yarns, and extension of yarns along themselves (LOD03 §4)."""

from __future__ import annotations

import numpy as np

from yarnscale.arrays import Array
from yarnscale.fabric.bspline import GAUSS_POINTS, GAUSS_WEIGHTS, blending
from yarnscale.fabric.spline_knit import SplineFabric
from yarnscale.yarn.close_pairs import close_pairs, pair_gaps
from yarnscale.yarn.strands import Neighbours, Strands

_SPACING = 0.2
"""Length of the segments sampled on a yarn [radii]: a distance of 2 r is found to 0.1 %."""


def penetration(fabric: SplineFabric, control: Array) -> float:
    """Penetration of yarns as a share of their diameter: 1 − distance/diameter, 0 where none touch.

    control: (n, 3) [m].
    """
    along = _lengths(fabric, fabric.control.reshape(-1, 3)).reshape(fabric.yarn_count, -1).sum(axis=1).max()
    per_segment = int(np.ceil(along / fabric.segments_per_yarn / (_SPACING * fabric.radius)))
    lines = fabric.lines(control, per_segment)
    points, reach = lines.reshape(-1, 3), 2.0 * fabric.radius
    strands = Strands.finite(lines.shape[1] * np.arange(len(lines) + 1), np.zeros(len(lines), bool))
    lengths = np.linalg.norm(points[strands.ends] - points, axis=1)
    neighbours = Neighbours.by_length(strands, lengths, reach)
    first, second = close_pairs(strands, points, reach, neighbours=neighbours)
    gaps = pair_gaps(points, strands.ends, first, second)
    return 1.0 - float(gaps.min(initial=reach)) / reach


def fibre_extension(fabric: SplineFabric, control: Array) -> tuple[float, float]:
    """Largest and mean extension of the yarns' segments, length over rest length − 1; control: (n, 3) [m]."""
    rest = _lengths(fabric, fabric.control.reshape(-1, 3))
    extension = _lengths(fabric, control) / rest - 1.0
    return float(np.abs(extension).max()), float(extension @ rest / rest.sum())


def _lengths(fabric: SplineFabric, control: Array) -> Array:
    """Length of every segment [m]."""
    first = np.einsum("gk,skc->sgc", blending(GAUSS_POINTS, 1), control[fabric.segments])
    return np.linalg.norm(first, axis=2) @ GAUSS_WEIGHTS
