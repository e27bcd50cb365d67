"""Bending length of a strip that hangs over an edge by its weight (ASTM D1388, the 41.5° test).

The strip is an inextensible elastica with the moment M(κ) [N] per width that was measured. With s from the tip, θ the
slope below the horizontal and w the weight per area [N/m²],

    M'(s) = w s cos θ,   θ'(s) = −κ(M),   M(0) = 0,   θ(L) = 0 at the edge.                                    (D1)

The overhang L is the one at which the line from the edge to the tip falls by 41.5°; the bending length is L/2, which
for M = B κ is (B/w)^(1/3) to 1 %.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from yarnscale.arrays import Array
from yarnscale.kinematics import GRAVITY

FALL = math.radians(41.5)
_TRIES = 40
"""Slopes of the tip that are tried until a strip falls by more than this."""
_LONGEST = 20.0
"""Longest overhang, over (B/w)^(1/3)."""


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
    stiffness = (moment[-1] - moment[0]) / (kappa[-1] - kappa[0])
    unit = (stiffness / (density * GRAVITY)) ** (1 / 3)
    # Lengths in units of (B/w)^(1/3), moments accordingly.
    kappa, moment = kappa * unit, moment * unit / stiffness
    ends = [(moment[1] - moment[0]) / (kappa[1] - kappa[0]), (moment[-1] - moment[-2]) / (kappa[-1] - kappa[-2])]

    def along(s: float, state: Array) -> list[float]:
        theta, torque, _, _ = state.tolist()
        beyond = min(torque - moment[0], 0.0) / ends[0] + max(torque - moment[-1], 0.0) / ends[1]
        level = math.cos(theta)
        return [-float(np.interp(torque, moment, kappa)) - beyond, s * level, level, math.sin(theta)]

    def hung(slope: float) -> tuple[float, float]:
        """Overhang at which a strip with this slope at its tip is level, and the fall of its chord [rad]; or NaN."""
        found = solve_ivp(along, (0.0, _LONGEST), [slope, 0.0, 0.0, 0.0], events=_ended, rtol=1e-8, atol=1e-10)
        theta, _, x, z = found.y[:, -1]
        return (found.t[-1], math.atan2(z, x)) if abs(theta) < 1e-6 else (math.nan, math.nan)

    low, before = 0.0, math.nan
    for slope in np.linspace(0.02, 0.5 * math.pi - 1e-3, _TRIES).tolist():
        fall = hung(slope)[1]
        if before <= FALL < fall:  # false of NaN too
            tip: Any = brentq(lambda tip: hung(tip)[1] - FALL, low, slope, xtol=1e-10)
            return 0.5 * unit * hung(tip)[0]
        low, before = slope, fall
    return None


def _ended(_s: float, state: Array) -> float:
    """Zero where a strip is level, or turned over."""
    return state[0] * (math.pi - state[0])


_ended.terminal = True  # type: ignore[attr-defined]
