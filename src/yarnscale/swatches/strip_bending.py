"""Bending rigidity from strips whose clamps approach each other: the strip buckles into an arch (an elastica).

A flat strip of length L and width b, clamped at both ends, that becomes shorter between the clamps by δ pushes with

    P = 16 K(m)² B b / L²,    δ/L = 2 − 2 E(m)/K(m),

K and E the complete elliptic integrals: 4π² B b/L² at first, and a quarter more at δ = 0.4 L. By friction, fabric
pushes harder while it is bent than while it is released; the mean of both is elastic. The load cell is set to zero
where the strip is flat, at the beginning of bending and at the end of release.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.special import ellipe, ellipk

from yarnscale.arrays import Array
from yarnscale.errors import InputError

_SHORTENED = (0.1, 0.4)
"""Shares of the length by which a strip is shorter where its push counts; before, it straightens."""
_LEAST = 0.15
"""Shortening that a cycle must reach, as a share of the length."""


def arch_push(shortening: Array) -> Array:
    """P L²/(B b) of a clamped strip shortened by shares δ/L of its length, from 0 to 0.6."""
    modulus = np.linspace(0.0, 0.8, 200)
    whole = ellipk(modulus)
    return np.interp(shortening, 2.0 - 2.0 * ellipe(modulus) / whole, 16.0 * whole**2)


def strip_rigidity(bent: Array, back: Array) -> float:
    """B of one cycle [N m]: distance of the clamps [m] and force over width [N/m], bent and released, (n, 2) each.

    Raises InputError for a cycle that bends too little to determine it.
    """
    length = float(max(bent[:, 0].max(), back[:, 0].max()))
    nearest = max(float(bent[:, 0].min()), float(back[:, 0].min()))
    if nearest > (1.0 - _LEAST) * length:
        expected = f"clamps that approach by {100 * _LEAST:.0f} % of their distance"
        raise InputError("bending", expected=expected, found=f"{length:.4g} to {nearest:.4g} m")
    distance = np.linspace(max(nearest, (1.0 - _SHORTENED[1]) * length), (1.0 - _SHORTENED[0]) * length, 20)
    push = np.zeros(len(distance))
    for branch, flat in ((bent, bent[:2, 1].mean()), (back, back[-1, 1])):
        order = np.argsort(branch[:, 0])
        push += 0.5 * (flat - np.interp(distance, *branch[order].T))
    shape = arch_push(1.0 - distance / length)
    return float(push @ shape / (shape @ shape)) * length**2


def mean_rigidity(cycles: Sequence[tuple[Array, Array]]) -> tuple[float, float]:
    """Mean and standard deviation of ``strip_rigidity`` over cycles that bend far enough [N m]."""
    found, fault = [], InputError("bending", expected="readings of bending and of release", found="none")
    for bent, back in cycles:
        try:
            found.append(strip_rigidity(bent, back))
        except InputError as error:
            fault = error
    if not found:
        raise fault
    return float(np.mean(found)), float(np.std(found, ddof=1)) if len(found) > 1 else 0.0
