"""Implicit rules of time integration, each as the velocity and acceleration of the new positions.

Both rules differentiate by a linear formula of the states before: with D x = rate·(x − past(x)),

    v = D x,   a = D v,

so that one step is one minimisation of ½ rate² |x − y|² + …, with y = past(x) + past(v)/rate. Implicit Euler has
rate = 1/Δt and past(x) = x_n. BDF2 fits a parabola through three states, with ω = Δt_n/Δt_{n−1}:

    rate = (1 + 2ω)/((1 + ω) Δt),   past(x) = ((1 + ω)² x_n − ω² x_{n−1}) / (1 + 2ω).

Euler is of first order and damps much; BDF2 is of second order, damps little, and is stable for steps that grow by
less than a factor 1 + √2 (Grigorieff 1983); beyond it, and for the first step, it falls back to Euler.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np

from yarnscale.arrays import Array
from yarnscale.errors import InputError
from yarnscale.kinematics import GRAVITY

Integrator = Literal["euler", "bdf2"]

ENOUGH = 0.003
"""Steps of yarns that are moved end where an iteration gains less than this share of ``fall_energy``."""
LARGEST_GROWTH = 1.0 + math.sqrt(2.0)
"""Ratio of two steps from which BDF2 with variable steps is unstable."""


def checked_integrator(name: str) -> Integrator:
    """The name, if there is such an integrator. Raises InputError."""
    if name not in get_args(Integrator):
        raise InputError("integrator", expected=" or ".join(get_args(Integrator)), found=name)
    return name  # type: ignore[return-value]


def longest_stable_step(times: Callable[[Array], Array], size: int, iterations: int) -> float:
    """Longest stable step of symplectic Euler [s]: 2/ω of the fastest vibration, by power iteration.

    times: product of M⁻¹K with a vector (size,).
    """
    vector, square = np.random.default_rng(0).standard_normal(size), 0.0
    for _ in range(iterations):
        image = times(vector / np.linalg.norm(vector))
        square, vector = float(np.linalg.norm(image)), image
    return 2.0 / math.sqrt(square) if square > 0 else math.inf


def fall_energy(mass: float, duration: float) -> float:
    """Kinetic energy of a mass [kg] after a free fall of so many seconds [J]."""
    return 0.5 * mass * (GRAVITY * duration) ** 2


@dataclass(frozen=True, eq=False)
class Earlier:
    """The state before a state: positions [m], velocities [m/s], of one shape, and the step between them [s].

    Of rods, positions are in radii and with twists [rad].
    """

    positions: Array
    velocities: Array
    duration: float


def remembered(integrator: Integrator, positions: Array, velocities: Array, duration: float) -> Earlier | None:
    """What the step after one of ``duration`` [s] needs of the state at its beginning."""
    return Earlier(positions, velocities, duration) if integrator == "bdf2" else None


@dataclass(frozen=True, eq=False)
class StepRule:
    """A rule on one step: v = rate·(x − positions), a = rate·(v − velocities).

    rate: [1/s], 0 for an equilibrium; positions: past(x) [m], velocities: past(v) [m/s], of one shape.
    """

    rate: float
    positions: Array
    velocities: Array

    def velocity(self, positions: Array) -> Array:
        """Velocities [m/s] that go with new positions."""
        return self.rate * (positions - self.positions)

    def inertia(self, damping: float = 0.0) -> tuple[float, Array]:
        """Weight w [1/s²] and centre of the energy ½ w |x − centre|²_M of a step: inertia, and drag by ``damping``.

        ½ (rate² |x − y|² + damping·rate |x − past|²) is one square about a point between the two.
        """
        total = self.rate + damping
        return self.rate * total, self.positions + self.velocities / total if total else self.positions


def step_rule(
    integrator: Integrator,
    positions: Array,
    velocities: Array,
    before: Earlier | None,
    duration: float,
    *,
    inertia: bool = True,
) -> StepRule:
    """The rule for a step of ``duration`` [s] from a state; without inertia, implicit Euler from rest.

    before: the state before that one, if it is known. duration: inf for an equilibrium.
    """
    if not inertia:
        return StepRule(1.0 / duration, positions, np.zeros_like(velocities))
    if integrator == "euler" or before is None or duration >= LARGEST_GROWTH * before.duration:
        return StepRule(1.0 / duration, positions, velocities)
    growth = duration / before.duration
    near, far = (1.0 + growth) ** 2 / (1.0 + 2.0 * growth), growth**2 / (1.0 + 2.0 * growth)
    return StepRule(
        (1.0 + 2.0 * growth) / ((1.0 + growth) * duration),
        near * positions - far * before.positions,
        near * velocities - far * before.velocities,
    )
