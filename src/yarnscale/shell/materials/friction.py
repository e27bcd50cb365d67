"""Friction of a shell: springs with sliders in parallel, over the six strains (Jenkins elements; Iwan 1967).

With x the strains over fixed scales, ψ the elastic energy and σ_j(x) its steps (``shell.materials.compact``), every
slider has a coordinate, and with the places p_k and limits y_k⁺, y_k⁻ that a step begins with,

    g_k = a_k·x + Σ_j b_kj σ_j(x),    u_k = g_k − p_k,    w = Σ_k c_k ∫₀^{u_k} S(v) dv

is what a step minimises beside ψ. The direction of a slider, ∂g/∂x, follows the strain: yarns of stretched fabric slide
along other strains than those of fabric at rest. S is the extension of a spring whose slider moves at the extension y,
y⁺ where it is pulled and y⁻ where it is pushed: v up to (1 − δ) y, then a parabola, y from (1 + δ) y on, so that w has
continuous second derivatives. A step ends with

    p_k ← g_k − S(u_k),    y_k± ← rest_k + Σ_j [same_kj max(0, ±∂ψ/∂x_j) + other_kj max(0, ∓∂ψ/∂x_j)]

since yarns press on each other in fabric at rest, and the harder the more it is loaded. ``same_sign`` counts for
stresses of the sign of the spring's extension, ``other_sign`` for the others: friction that adds to a load and friction
that takes from it differ, as the tension of a yarn around another grows and falls by a factor. Without the parabola w
is the least, over the slip q, of ½ c (u − q)² + c y± |q| (a variational update, Ortiz and Stainier 1999). Friction
takes w(u) − ½ c S(u)² ≥ 0 in a step, and ½ c e² − w(e) ≥ 0 at its beginning, of a spring of extension e that is now
beyond its limit: never less than nothing, whatever the step. A spring of up to (1 − δ) y keeps its force however many
steps go by. Limits are those of the beginning of a step, as in cells: errors are of first order.

Where the fabric is its own mirror image, w is the mean over both images of x, each with its own places.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from yarnscale.arrays import Array
from yarnscale.errors import InputError

ROUNDING = 0.02
"""δ: share of its limit within which a slider begins to move."""
LEAST_LIMIT = 1e-9


class Sliders(NamedTuple):
    """Numbers of springs with sliders.

    directions a (K, 6) over scaled strains; bends b (K, R) by the steps of the energy; stiffnesses c (K,) [J/m²];
    rest (K,): limits without load; same_sign, other_sign (K, 6): growth of the limits with each elastic stress over
    scaled strains [m²/J] that has the sign of the spring's extension, and with one that has the other.
    """

    directions: Array
    bends: Array
    stiffnesses: Array
    rest: Array
    same_sign: Array
    other_sign: Array

    @classmethod
    def checked(cls, *arrays: object) -> Sliders:
        """Sliders of arrays that match; InputError."""
        found = cls(*(np.array(array, dtype=np.float64) for array in arrays))
        count, steps = found.stiffnesses.size, found.bends.shape[-1] if found.bends.ndim else 0
        shapes = ((count, 6), (count, steps), (count,), (count,), (count, 6), (count, 6))
        for name, array, shape in zip(cls._fields, found, shapes, strict=True):
            if array.shape != shape or count == 0 or not np.isfinite(array).all():
                raise InputError(f"friction {name}", expected=f"finite numbers of shape {shape}", found=array.shape)
            if name not in ("directions", "bends") and (array < 0).any():
                raise InputError(f"friction {name}", expected="no negative number", found=float(array.min()))
        return found

    @property
    def count(self) -> int:
        """Number of sliders."""
        return len(self.stiffnesses)

    @property
    def numbers(self) -> Array:
        """All numbers, as ``unpacked`` reads them."""
        return np.concatenate([array.ravel() for array in self])


def unpacked(numbers: ca.SX, count: int, steps: int) -> Any:
    """Sliders of symbols: so many of them, over so many steps of the energy."""
    widths = (6, steps, 1, 1, 6, 6)
    parts = ca.vertsplit(numbers, np.cumsum([0, *(width * count for width in widths)]).tolist())
    # Rows of our arrays lie one behind the other, CasADi's columns do.
    return Sliders(*(ca.reshape(part, width, count).T for part, width in zip(parts, widths, strict=True)))  # type: ignore[arg-type]


@dataclass(frozen=True)
class Sliding:
    """Symbols: ``energy`` w of a step, its ``gradient`` (6) and ``hessian`` (6, 6) by x; after the step ``places`` (K)
    and the energy ``stored`` in springs."""

    energy: ca.SX
    gradient: ca.SX
    hessian: ca.SX
    places: ca.SX
    stored: ca.SX


def sliding(x: ca.SX, bent: tuple[ca.SX, ca.SX, ca.SX], steps: ca.SX, sliders: Any, memory: ca.SX) -> Sliding:
    """Sliders (of symbols) at scaled strains x (6).

    bent: σ (R) at x and its first two derivatives by its argument, whose gradients are ``steps`` (R, 6). memory (3K):
    places, then limits of pulled springs, then of pushed ones.
    """
    count = memory.numel() // 3
    value, first, second = bent
    along = sliders.directions @ x + sliders.bends @ value
    slope = sliders.directions + (sliders.bends * ca.repmat(first.T, count, 1)) @ steps
    extension, potential, share = springs(along - memory[:count], memory[count : 2 * count], memory[2 * count :])
    pull = sliders.stiffnesses * extension
    curved = (sliders.bends.T @ pull) * second
    hessian = slope.T @ (ca.repmat(sliders.stiffnesses * share, 1, 6) * slope)
    hessian += steps.T @ (ca.repmat(curved, 1, 6) * steps)
    energy, stored = ca.dot(sliders.stiffnesses, potential), 0.5 * ca.dot(pull, extension)
    return Sliding(energy, slope.T @ pull, hessian, along - extension, stored)


def limits(stress: ca.SX, sliders: Any) -> ca.SX:
    """Limits (2K) of pulled and of pushed springs after a step that ends with an elastic stress (6)."""
    up, down = ca.fmax(stress, 0), ca.fmax(-stress, 0)
    same, other = sliders.same_sign, sliders.other_sign
    pulled, pushed = same @ up + other @ down, same @ down + other @ up
    return ca.vertcat(sliders.rest + pulled, sliders.rest + pushed)


def springs(u: ca.SX, pulled: ca.SX, pushed: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX]:
    """S(u), its integral and its derivative, of each of some springs with limits on either side."""
    y = 0.5 * (pulled + pushed) + ca.copysign(0.5, u) * (pulled - pushed) + LEAST_LIMIT
    size = ca.fabs(u)
    width = 2 * ROUNDING * y
    over = size - (1 - ROUNDING) * y
    share = ca.fmin(ca.fmax(over / width, 0), 1)
    beyond = ca.fmax(over - width, 0)
    excess = 0.5 * width * share * share + beyond
    lost = width * width * share * share * share / 6 + beyond * (0.5 * width + 0.5 * beyond)
    return ca.copysign(size - excess, u), 0.5 * u * u - lost, 1 - share
