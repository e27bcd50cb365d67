"""Contact of yarns with obstacles: a vertex within one yarn radius of the surface is pushed away.

The penalty is cubic in the depth, so that it is twice differentiable; its curvature along the surface is left out, so
that the Hessian is positive semidefinite.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from yarnscale.arrays import Array, Integers
from yarnscale.errors import not_negative
from yarnscale.fabric.holds import YarnPoints
from yarnscale.motion.obstacles import Obstacle
from yarnscale.motion.surfaces import surface_of

_REACH = 20.0
"""Depth in a mesh, or distance from it, up to which contact is computed [r]."""


@dataclass(eq=False)
class Pushes:
    """Contact of every vertex with an obstacle; a ``NodeForce``. stiffness: E''' of the penalty [E π r³ / r³].

    friction: coefficient μ of Coulomb's law, smoothed within a slip of ``slip`` [r] on the surface since ``begin``,
    which also takes the pressures: friction lags by a step, as that of yarns on each other. Explicit steps, which are
    too short for such a slip, use ``slowed`` instead.
    """

    energy: YarnPoints
    obstacle: Obstacle
    stiffness: float = 1.0
    friction: float = 0.0
    slip: float = 0.02
    _time: float = field(init=False, repr=False, default=0.0)
    _stuck: Array = field(init=False, repr=False, default_factory=lambda: np.empty((0, 3)))
    _normal: Array = field(init=False, repr=False, default_factory=lambda: np.empty((0, 3)))
    _grip: Array = field(init=False, repr=False, default_factory=lambda: np.empty(0))

    def __post_init__(self) -> None:
        """Check the coefficient."""
        not_negative("friction on an obstacle", self.friction, "a number from 0")
        self._surface = surface_of(self.obstacle, reach=_REACH * self.energy.radius)

    def begin(self, positions: Array, start: float, end: float) -> None:
        """Begin a step [s] at positions (n, 3) [r]: vertices in contact resist slip on the surface from here on."""
        self._time = start
        if self.friction:
            depth, normal = self._depth(positions)
            self._stuck, self._normal = self._carried(positions, start, end), np.array(normal)
            self._grip = self.friction * self.stiffness * depth**2
        self._time = end

    def _carried(self, positions: Array, start: float, end: float) -> Array:
        radius = self.energy.radius
        return self._surface.carried(positions * radius, start, end) / radius

    def _depth(self, positions: Array) -> tuple[Array, Array]:
        """Depth of vertices in the obstacle (n,) [r], and its normals (n, 3)."""
        gap, normal = self._surface.at(positions * self.energy.radius, self._time)
        return np.maximum(1.0 - gap / self.energy.radius, 0.0), normal

    def at(self, positions: Array) -> tuple[float, Array, Array]:
        depth, normal = self._depth(positions)
        value = float((depth**3).sum()) * self.stiffness / 3.0
        gradient = -self.stiffness * depth[:, None] ** 2 * normal
        hessian = (2.0 * self.stiffness * depth)[:, None, None] * normal[:, :, None] * normal[:, None, :]
        rubbed = np.flatnonzero(self._grip)
        if len(rubbed):
            value += self._rub(positions, rubbed, gradient, hessian)
        return value, gradient, hessian

    def slowed(self, velocity: Array, yielding: Array, duration: float) -> Array:
        """Velocities (n, 3) of vertices whose sliding is stopped by impulses up to μ N Δt, N as ``begin`` found it."""
        rubbed = np.flatnonzero(self._grip)
        slower, normal, here = velocity.copy(), self._normal[rubbed], self._stuck[rubbed]
        own = velocity[rubbed] - (self._carried(here, self._time, self._time + duration) - here) / duration
        along = own - np.einsum("ni,ni->n", own, normal)[:, None] * normal
        size = np.maximum(np.linalg.norm(along, axis=1), 1e-300)
        lost = np.minimum(1.0, duration * self._grip[rubbed] * yielding[rubbed] / size)
        slower[rubbed] -= lost[:, None] * along
        return slower

    def _rub(self, positions: Array, rubbed: Integers, gradient: Array, hessian: Array) -> float:
        """Add μ N (√(|u|² + h²) − h), u the slip along the surface, of vertices ``rubbed``; its value."""
        slip, normal, grip = positions[rubbed] - self._stuck[rubbed], self._normal[rubbed], self._grip[rubbed]
        slip = slip - np.einsum("ni,ni->n", slip, normal)[:, None] * normal
        size = np.sqrt(np.einsum("ni,ni->n", slip, slip) + self.slip**2)
        gradient[rubbed] += (grip / size)[:, None] * slip
        along = np.eye(3) - normal[:, :, None] * normal[:, None, :]
        unit = slip / size[:, None]
        hessian[rubbed] += (grip / size)[:, None, None] * (along - unit[:, :, None] * unit[:, None, :])
        return float((grip * (size - self.slip)).sum())
