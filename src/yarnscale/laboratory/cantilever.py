"""Bending length of a strip that hangs over an edge by its weight (ASTM D1388, the 41.5° test).

The strip is an inextensible elastica with the moment M(κ) [N] per width that was measured. With s from the tip, θ the
slope below the horizontal and w the weight per area [N/m²],

    M'(s) = w s cos θ,   θ'(s) = −κ(M),   M(0) = 0,   θ(L) = 0 at the edge.                                    (D1)

The overhang L is the one at which the line from the edge to the tip falls by 41.5°; the bending length is L/2, which
for M = B κ is (B/w)^(1/3) to 1 %.
"""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import root_scalar

from yarnscale.arrays import Array
from yarnscale.kinematics import GRAVITY

FALL = math.radians(41.5)
_TRIES = 40


def bending_length(curvatures: Array, moments: Array, density: float) -> float | None:
    """Bending length [m] of a strip that hangs towards positive curvature.

    curvatures [1/m], moments [N] (n,): points of M(κ), κ of both signs; outside them M is continued linearly.
    density: [kg/m²]. None where the strip has no such shape: a moment that does not rise with curvature (the fabric
    rolls up by itself), or a strip that is curled by more than its weight.
    """
    order = np.argsort(curvatures)
    kappa, moment = np.asarray(curvatures, float)[order], np.asarray(moments, float)[order]
    good = np.isfinite(moment)
    kappa, moment = kappa[good], moment[good]
    if len(kappa) < 3 or density <= 0 or not (np.diff(moment) > 0).all():
        return None
    weight = density * GRAVITY
    stiffness = (moment[-1] - moment[0]) / (kappa[-1] - kappa[0])
    scale = (stiffness / weight) ** (1 / 3)

    def curvature(value: float) -> float:
        if value > moment[-1]:
            return kappa[-1] + (value - moment[-1]) * (kappa[-1] - kappa[-2]) / (moment[-1] - moment[-2])
        if value < moment[0]:
            return kappa[0] + (value - moment[0]) * (kappa[1] - kappa[0]) / (moment[1] - moment[0])
        return float(np.interp(value, moment, kappa))

    def miss(tip_slope: float) -> tuple[float, float]:
        """Overhang at which a strip with this slope at its tip is level, and by how much its chord misses 41.5°."""

        def along(_: float, y: Array) -> list[float]:
            theta, torque, _x, _z, s = y
            return [-curvature(torque), weight * s * math.cos(theta), math.cos(theta), math.sin(theta), 1.0]

        def level(_: float, y: Array) -> float:
            return y[0]

        level.terminal, level.direction = True, -1  # type: ignore[attr-defined]
        run = solve_ivp(along, (0, 20 * scale), [tip_slope, 0.0, 0.0, 0.0, 0.0], events=level, rtol=1e-7)
        if not len(run.t_events[0]):
            return math.nan, math.nan
        _, _, x, z, length = run.y_events[0][0]
        return length, math.atan2(z, x) - FALL

    slopes = np.linspace(0.02, 0.5 * math.pi - 1e-3, _TRIES)
    misses = [miss(slope)[1] for slope in slopes]
    for (a, low), (b, high) in pairwise(zip(slopes, misses, strict=True)):
        if low <= 0 < high:  # false of NaN too
            slope = root_scalar(lambda value: miss(value)[1], bracket=(a, b), xtol=1e-6).root
            return 0.5 * miss(float(slope))[0]
    return None
