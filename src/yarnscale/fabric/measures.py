"""Penetration of neighbouring yarns, and extension of yarns along themselves (LOD03 §4)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from yarnscale.fabric.bspline import GAUSS_POINTS, GAUSS_WEIGHTS, blending
from yarnscale.fabric.spline_knit import SplineFabric

Array = NDArray[np.float64]

_SPACING = 0.1
"""Spacing of the points sampled on a yarn [radii]: a distance of 2 r is found to 0.03 %."""
_TURN = 2.5
"""Distance along a yarn within which it is not its own neighbour [diameters]."""


def penetration(fabric: SplineFabric, control: Array) -> float:
    """Penetration of yarns as a share of their diameter: 1 − distance/diameter, 0 where none touch.

    control: (n, 3) [m].
    """
    along = _lengths(fabric, fabric.control.reshape(-1, 3)).reshape(fabric.yarn_count, -1).sum(axis=1).max()
    per_segment = int(np.ceil(along / fabric.segments_per_yarn / (_SPACING * fabric.radius)))
    lines = fabric.lines(control, per_segment)
    points = lines.reshape(-1, 3)
    near = KDTree(points).query_pairs(2.0 * fabric.radius, output_type="ndarray")
    count = lines.shape[1]
    steps = np.linalg.norm(np.diff(lines, axis=1), axis=2)
    place = np.concatenate([np.zeros((len(lines), 1)), np.cumsum(steps, axis=1)], axis=1).ravel()
    same = near[:, 0] // count == near[:, 1] // count
    apart = np.abs(place[near[:, 0]] - place[near[:, 1]]) > 2.0 * _TURN * fabric.radius
    met = near[~same | apart]
    if not len(met):
        return 0.0
    closest = np.linalg.norm(points[met[:, 0]] - points[met[:, 1]], axis=1).min()
    return float(1.0 - closest / (2.0 * fabric.radius))


def fibre_extension(fabric: SplineFabric, control: Array) -> tuple[float, float]:
    """Largest and mean extension of the yarns' segments, length over rest length − 1; control: (n, 3) [m]."""
    rest = _lengths(fabric, fabric.control.reshape(-1, 3))
    extension = _lengths(fabric, control) / rest - 1.0
    return float(np.abs(extension).max()), float(extension @ rest / rest.sum())


def _lengths(fabric: SplineFabric, control: Array) -> Array:
    """Length of every segment [m]."""
    first = np.einsum("gk,skc->sgc", blending(GAUSS_POINTS, 1), control[fabric.segments])
    return np.linalg.norm(first, axis=2) @ GAUSS_WEIGHTS
