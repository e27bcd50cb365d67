"""Tubes of yarns as fine as a picture shows them, and no finer."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from yarnscale.files.curve_frames import CurveSet
from yarnscale.files.curve_thinning import thinned
from yarnscale.files.tube_sweep import TubeSweep
from yarnscale.show import theme

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

_SIDES = ((0.7, 3), (1.6, 4), (3.0, 6), (6.0, 8), (16.0, 12), (np.inf, 20))
"""Up to a radius [pixels], corners of a tube's section."""
_SMALLEST = 0.25
"""What does not show [pixels]."""


def seen_tubes(curves: CurveSet, points: Floats, scale: float) -> tuple[TubeSweep, Integers]:
    """Tubes about curves, and the points (m,) that they need of all, in a picture of a scale [pixels/m].

    points: positions (n, 3) [m] in one frame. Points are left out where nobody sees it, sections have fewer sides.
    """
    radius = scale * float(curves.radii.max())
    sides = next(count for limit, count in _SIDES if radius <= limit)
    few, chosen = thinned(curves, points, _SMALLEST / scale)
    return TubeSweep(few, sides=sides), chosen


def tube_colours(sweep: TubeSweep) -> NDArray[np.uint8]:
    """Colour of every vertex of tubes by its yarn, (n · sides, 3)."""
    curves = sweep.curves
    palette = np.rint(255 * np.array([theme.yarn_colour(k) for k in range(len(theme.YARNS))]))
    per_curve = palette.astype(np.uint8)[curves.yarn % len(palette)]
    return np.repeat(per_curve, np.diff(curves.offsets) * sweep.sides, axis=0)
