"""Bending length of a strip that hangs over an edge by its weight (ASTM D1388, the 41.5° test).

The strip is an inextensible elastica with the moment M(κ) [N] per width that was measured. With s from the tip, θ the
slope below the horizontal and w the weight per area [N/m²],

    M'(s) = w s cos θ,   θ'(s) = −κ(M),   M(0) = 0,   θ(L) = 0 at the edge.                                    (D1)

The overhang L is the one at which the line from the edge to the tip falls by 41.5°; the bending length is L/2, which
for M = B κ is (B/w)^(1/3) to 1 %.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from yarnscale.arrays import Array
from yarnscale.kinematics import GRAVITY

FALL = math.radians(41.5)
_TRIES, _ROUNDS = 40, (5, 1, 1)
"""Slopes of the tip that are tried at once; how many steps are one, when slopes about the best pair are tried again."""
_STEP, _LONGEST = 0.01, 20.0
"""Step and longest overhang, over (B/w)^(1/3)."""


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
    ends = [(moment[1] - moment[0]) / (kappa[1] - kappa[0]), (moment[-1] - moment[-2]) / (kappa[-1] - kappa[-2])]

    def curvature(torque: Array) -> Array:
        beyond = np.minimum(torque - moment[0], 0.0) / ends[0] + np.maximum(torque - moment[-1], 0.0) / ends[1]
        return np.interp(torque, moment, kappa) + beyond

    step = _STEP * (stiffness / weight) ** (1 / 3)
    slopes = np.linspace(0.02, 0.5 * math.pi - 1e-3, _TRIES)
    for longer in _ROUNDS:
        length, fall = _level(slopes, curvature, weight, longer * step, round(_LONGEST / _STEP / longer))
        found = np.flatnonzero((fall[:-1] <= FALL) & (fall[1:] > FALL))  # false of NaN too
        if not len(found):
            return None
        lengths, falls = length[found[0] :][:2], fall[found[0] :][:2]
        slopes = np.linspace(slopes[max(found[0] - 1, 0)], slopes[min(found[0] + 2, _TRIES - 1)], _TRIES)
    return float(0.5 * np.interp(FALL, falls, lengths))


def _level(
    slopes: Array, curvature: Callable[[Array], Array], weight: float, step: float, count: int
) -> tuple[Array, Array]:
    """Overhangs [m] at which strips with these slopes at their tips (n,) are level, and the fall of their chords [rad].

    Integrated from the tip with at most ``count`` steps [m] of the classical Runge-Kutta method; NaN where a strip is
    nowhere level.
    """

    def along(state: Array) -> Array:
        theta, torque, _x, _z, s = state
        level = np.cos(theta)
        return np.stack([-curvature(torque), weight * s * level, level, np.sin(theta), np.ones_like(s)])

    def after(state: Array, h: Array) -> Array:
        a = along(state)
        b = along(state + 0.5 * h * a)
        c = along(state + 0.5 * h * b)
        return state + h / 6.0 * (a + 2.0 * (b + c) + along(state + h * c))

    state = np.vstack([slopes, np.zeros((4, len(slopes)))])
    ended = np.full((5, len(slopes)), np.nan)
    for _ in range(count):
        new = after(state, np.full(len(slopes), step))
        crossed = (state[0] > 0.0) & (new[0] <= 0.0) & np.isnan(ended[0])
        if crossed.any():
            # Newton's method for the part of the step after which the strip is level.
            old = state[:, crossed]
            part = step * old[0] / (old[0] - new[0, crossed])
            for _ in range(3):
                end = after(old, part)
                part = part + end[0] / curvature(end[1])
            ended[:, crossed] = after(old, part)
        if not np.isnan(ended[0]).any():
            break
        state = new
    _, _, x, z, length = ended
    return length, np.arctan2(z, x)
