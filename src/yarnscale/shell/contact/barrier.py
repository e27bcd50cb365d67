"""Contact settings, the barrier energy of a distance, and the smoothed length of a slip."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from yarnscale.arrays import Array
from yarnscale.errors import InputError, not_negative, positive

# −db/dd at d = t/2 in units of t³.
_HALF_WAY_SLOPE = 4.5 * 0.5 + 3.0 * math.log(2.0)


@dataclass(frozen=True)
class ContactSettings:
    """Contact settings of a cloth.

    thickness: distance [m] at which repulsion begins; pressure: [Pa] at half the thickness; self_contact: whether the
    cloth is in contact with itself; friction: Coulomb coefficient; slip: speed of slip [m/s] from which friction has
    its full value; holding_force: largest force [N] that drives each point of a moving obstacle (the centre of a ball,
    a vertex of a mesh) to its prescribed place. Raises InputError.
    """

    thickness: float = 1e-3
    pressure: float = 100.0
    self_contact: bool = True
    friction: float = 0.0
    slip: float = 1e-3
    holding_force: float = 100.0

    def __post_init__(self) -> None:
        for name in ("thickness", "pressure", "slip"):
            positive(f"contact {name}", getattr(self, name))
        if not self.holding_force > 0:
            raise InputError("holding force", expected="a positive number, or inf", found=self.holding_force)
        not_negative("contact friction", self.friction)

    @property
    def stiffness(self) -> float:
        """Factor of the barrier per area [Pa/m³]."""
        return self.pressure / (_HALF_WAY_SLOPE * self.thickness**3)


def barrier(distance: Array, thickness: float) -> tuple[Array, Array, Array]:
    """b(d) = −(d² − t²)² ln(d²/t²) of distances in (0, t) and its first and second derivative (Li et al. 2020)."""
    x, t2 = distance * distance, thickness * thickness
    gap, log = x - t2, np.log(x / t2)
    first = -2.0 * gap * log - gap * gap / x  # by x = d²
    second = -2.0 * log - 4.0 * gap / x + (gap / x) ** 2
    return -gap * gap * log, 2.0 * distance * first, 2.0 * first + 4.0 * x * second


def reach_aside(thickness: float) -> tuple[float, float]:
    """Lateral range of the repulsion at a distance of half a thickness: ∫ g dr and (2 ∫ r g dr)^½ [m].

    g: normal force at an offset r along the surfaces, over that without offset.
    """
    count, height = 400, 0.5
    offset = (np.arange(count) + 0.5) / count * math.sqrt(1.0 - height**2)
    distance = np.hypot(height, offset)
    force = barrier(distance, 1.0)[1] * height / distance / barrier(np.array([height]), 1.0)[1]
    width = offset[1] - offset[0]
    return thickness * float(force.sum() * width), thickness * math.sqrt(2.0 * float(offset @ force) * width)


def smooth_length(length: Array, reach: float) -> tuple[Array, Array, Array]:
    """A length made smooth below ``reach``, f(l), with f'(l)/l and f''(l) (Li et al. 2020, section 5.4)."""
    sticks = length < reach
    potential = np.where(sticks, length**2 / reach - length**3 / (3.0 * reach * reach) + reach / 3.0, length)
    rate = np.where(sticks, 2.0 / reach - length / (reach * reach), 1.0 / np.maximum(length, reach))
    return potential, rate, np.where(sticks, 2.0 / reach - 2.0 * length / (reach * reach), 0.0)
