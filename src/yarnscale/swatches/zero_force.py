"""Lengths and widths at zero force, which no clamp can be set to: extrapolated from the first readings (EST22 §4)."""

from __future__ import annotations

import numpy as np

from yarnscale.arrays import Array

_STEP, _FIRST_STEPS = 0.01, 5
"""Steps of force that the extrapolation to zero force uses: size as a share of the largest force, and number."""


def at_zero_force(force: Array, value: Array) -> float:
    """Value at zero force of readings whose force does not fall, (n,) both.

    The last reading at zero force is taken as it is: those before are slack. Without one, readings are averaged in
    steps of a hundredth of the largest force, and a parabola through the first five steps is extrapolated; a line where
    the parabola bends the wrong way, since fabric stiffens and a length grows less and less with force.
    """
    if (at_rest := np.flatnonzero(force == 0)).size:
        return float(value[at_rest[-1]])
    step = ((force - force[0]) / (_STEP * force[-1])).astype(int)
    _, place, counts = np.unique(step, return_inverse=True, return_counts=True)
    force = (np.bincount(place, force) / counts)[:_FIRST_STEPS]
    value = (np.bincount(place, value) / counts)[:_FIRST_STEPS]
    scaled = force / force[-1]
    if len(force) > 3:
        bend, slope, start = np.polyfit(scaled, value, 2)
        # The slope must keep its sign from zero force to the last of these steps while it shrinks.
        if bend * slope < 0 and abs(slope) >= 2 * abs(bend):
            return float(start)
    return float(np.polyfit(scaled, value, 1)[-1])
