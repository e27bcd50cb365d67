"""Friction of a shell: springs with sliders in parallel, over the six strains (Jenkins elements; Iwan 1967).

With x the strains over fixed scales, ψ the elastic energy, and the places p_k and limits y_k that a step begins with,

    u_k = a_k·x − p_k,    w = Σ_k c_k ∫₀^{u_k} S(v, y_k) dv

is what a step minimises beside ψ. S is the extension of a spring whose slider moves at the extension y: v up to
(1 − δ) y, then a parabola, y from (1 + δ) y on, so that w has continuous second derivatives. A step ends with

    p_k ← a_k·x − S(u_k, y_k),    y_k ← Σ_j growth_kj |∂ψ/∂x_j|

since yarns press on each other as hard as they are loaded. Without the parabola w is the least, over the slid way q, of
½ c (u − q)² + c y |q| (a variational update, Ortiz and Stainier 1999). Friction takes w(u) − ½ c S(u)² ≥ 0 in a step,
and ½ c e² − w(e) ≥ 0 at its beginning, of a spring of extension e that is now beyond its limit: never less than
nothing, whatever the step. A spring of up to (1 − δ) y keeps its force however many steps go by. Limits are those of
the beginning of a step, as in cells: errors are of first order.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import casadi as ca
import numpy as np

from yarnscale.arrays import Array
from yarnscale.errors import InputError

ROUNDING = 0.02
"""δ: share of its limit within which a slider begins to move."""
LEAST_LIMIT = 1e-9


class Sliders(NamedTuple):
    """Numbers of springs with sliders.

    directions a (K, 6) over scaled strains; stiffnesses c (K,) [J/m²]; growth (K, 6): of the limits with the magnitude
    of each elastic stress over scaled strains [m²/J].
    """

    directions: Array
    stiffnesses: Array
    growth: Array

    @classmethod
    def checked(cls, *arrays: object) -> Sliders:
        """Sliders of arrays that match; InputError."""
        found = cls(*(np.array(array, dtype=np.float64) for array in arrays))
        count = found.stiffnesses.size
        for name, array, shape in zip(cls._fields, found, ((count, 6), (count,), (count, 6)), strict=True):
            if array.shape != shape or count == 0 or not np.isfinite(array).all():
                raise InputError(f"friction {name}", expected=f"finite numbers of shape {shape}", found=array.shape)
            if name != "directions" and (array < 0).any():
                raise InputError(f"friction {name}", expected="no negative number", found=float(array.min()))
        return found

    @property
    def count(self) -> int:
        """Number of sliders."""
        return len(self.stiffnesses)

    @property
    def numbers(self) -> Array:
        """All numbers, as ``sliding`` and ``limits`` read them."""
        return np.concatenate([array.ravel() for array in self])


@dataclass(frozen=True)
class Sliding:
    """Symbols: ``energy`` w of a step, its ``gradient`` (6) and ``hessian`` (6, 6) by x; after the step ``places`` (K)
    and the energy ``stored`` in springs."""

    energy: ca.SX
    gradient: ca.SX
    hessian: ca.SX
    places: ca.SX
    stored: ca.SX


def sliding(x: ca.SX, numbers: ca.SX, memory: ca.SX) -> Sliding:
    """Sliders at scaled strains x (6); numbers: ``Sliders.numbers``; memory (2K): places, then limits."""
    count = memory.numel() // 2
    directions = ca.reshape(numbers[: 6 * count], 6, count).T
    stiffness = numbers[6 * count : 7 * count]
    along = directions @ x
    extension, potential, slope = springs(along - memory[:count], memory[count:])
    pull = stiffness * extension
    stiff = ca.repmat(stiffness * slope, 1, 6) * directions
    energy, stored = ca.dot(stiffness, potential), 0.5 * ca.dot(pull, extension)
    return Sliding(energy, directions.T @ pull, directions.T @ stiff, along - extension, stored)


def limits(stress: ca.SX, numbers: ca.SX) -> ca.SX:
    """Limits (K) after a step that ends with an elastic stress (6) over scaled strains."""
    count = numbers.numel() // 13
    growth = ca.reshape(numbers[7 * count :], 6, count).T
    return growth @ ca.fabs(stress)


def springs(u: ca.SX, limit: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX]:
    """S(u), its integral and its derivative, of each of some springs."""
    y = limit + LEAST_LIMIT
    size = ca.fabs(u)
    width = 2 * ROUNDING * y
    over = size - (1 - ROUNDING) * y
    share = ca.fmin(ca.fmax(over / width, 0), 1)
    beyond = ca.fmax(over - width, 0)
    excess = 0.5 * width * share * share + beyond
    lost = width * width * share * share * share / 6 + beyond * (0.5 * width + 0.5 * beyond)
    return ca.copysign(size - excess, u), 0.5 * u * u - lost, 1 - share
