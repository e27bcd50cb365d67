"""Bodies that yarns lie on: a vertex within one yarn radius of the surface is pushed away.

The penalty is cubic in the depth, so that it is twice differentiable; its curvature along the surface is left out, so
that the Hessian is positive semidefinite.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from yarnscale.errors import InputError
from yarnscale.fabric.direct_energy import FabricEnergy

Array = NDArray[np.float64]
Distance = Callable[[Array], tuple[Array, Array]]
"""Signed distance (n,) [m] from a surface, and its outward normal (n, 3), at points (n, 3) [m]."""


def sphere(centre: tuple[float, float, float], radius: float) -> Distance:
    """A ball [m]."""
    if not (math.isfinite(radius) and radius > 0):
        raise InputError("sphere radius", expected="a positive length [m]", found=radius)
    middle = np.array(centre, np.float64)

    def distance(points: Array) -> tuple[Array, Array]:
        away = points - middle
        size = np.linalg.norm(away, axis=1)
        return size - radius, away / np.maximum(size, 1e-12)[:, None]

    return distance


def bar(start: tuple[float, float, float], end: tuple[float, float, float], radius: float) -> Distance:
    """A round bar with round ends [m]."""
    a, b = np.array(start, np.float64), np.array(end, np.float64)
    if not (math.isfinite(radius) and radius > 0 and float(np.linalg.norm(b - a)) > 0):
        raise InputError(
            "bar", expected="two different ends and a positive radius [m]", found=(start, end, radius)
        )

    def distance(points: Array) -> tuple[Array, Array]:
        along = np.clip((points - a) @ (b - a) / float((b - a) @ (b - a)), 0.0, 1.0)
        away = points - (a + along[:, None] * (b - a))
        size = np.linalg.norm(away, axis=1)
        return size - radius, away / np.maximum(size, 1e-12)[:, None]

    return distance


def plane(point: tuple[float, float, float], normal: tuple[float, float, float]) -> Distance:
    """The half-space behind a plane [m]."""
    up = np.array(normal, np.float64)
    if not float(np.linalg.norm(up)) > 0:
        raise InputError("normal of a plane", expected="a direction", found=normal)
    up /= np.linalg.norm(up)

    def distance(points: Array) -> tuple[Array, Array]:
        return (points - np.array(point)) @ up, np.broadcast_to(up, points.shape)

    return distance


def triangles(vertices: Array, corners: NDArray[np.int64], *, reach: float) -> Distance:
    """A closed mesh of outward triangles: vertices (n, 3) [m], corners (m, 3); exact within ``reach`` [m] of it."""
    from scipy.spatial import KDTree

    corner = np.asarray(vertices, np.float64)[np.asarray(corners)]
    if corner.ndim != 3 or corner.shape[1:] != (3, 3) or not np.isfinite(corner).all() or not len(corner):
        raise InputError("mesh of an obstacle", expected="finite triangles", found=corner.shape)
    middle = corner.mean(axis=1)
    size = np.linalg.norm(corner - middle[:, None], axis=2).max(axis=1)
    normal = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    normal /= np.maximum(np.linalg.norm(normal, axis=1), 1e-300)[:, None]
    tree, widest = KDTree(middle), float(size.max())

    def distance(points: Array) -> tuple[Array, Array]:
        signed, direction = np.full(len(points), reach), np.zeros_like(points)
        direction[:, 2] = 1.0
        near = tree.query_ball_point(points, reach + widest)
        counts = np.array([len(found) for found in near])
        if not counts.sum():
            return signed, direction
        which = np.concatenate([np.array(found, np.int64) for found in near if found])
        owner = np.repeat(np.arange(len(points)), counts)
        closest = _closest(points[owner], corner[which])
        away = points[owner] - closest
        gap = np.linalg.norm(away, axis=1)
        first = np.lexsort((gap, owner))
        first = first[np.unique(owner[first], return_index=True)[1]]
        own = owner[first]
        facing = np.einsum("ij,ij->i", away[first], normal[which[first]])
        sign = np.where(facing < 0, -1.0, 1.0)
        signed[own] = sign * gap[first]
        safe = gap[first] > 1e-12
        unit = sign[:, None] * away[first] / np.maximum(gap[first], 1e-12)[:, None]
        direction[own] = np.where(safe[:, None], unit, normal[which[first]])
        return signed, direction

    return distance


def _closest(points: Array, corner: Array) -> Array:
    """Closest points of triangles (m, 3, 3) to points (m, 3)."""
    a, ab, ac = corner[:, 0], corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]
    away = points - a
    uu, vv, uv = (ab * ab).sum(1), (ac * ac).sum(1), (ab * ac).sum(1)
    up, vp = (ab * away).sum(1), (ac * away).sum(1)
    skew = np.maximum(uu * vv - uv * uv, 1e-300)
    s, t = (vv * up - uv * vp) / skew, (uu * vp - uv * up) / skew
    best = a + s[:, None] * ab + t[:, None] * ac
    gap = np.where((s >= 0) & (t >= 0) & (s + t <= 1), 0.0, np.inf)
    for first, second in ((0, 1), (1, 2), (2, 0)):
        start, edge = corner[:, first], corner[:, second] - corner[:, first]
        along = np.clip(((points - start) * edge).sum(1) / np.maximum((edge * edge).sum(1), 1e-300), 0.0, 1.0)
        on = start + along[:, None] * edge
        apart = ((points - on) ** 2).sum(1)
        closer = apart < gap
        best, gap = np.where(closer[:, None], on, best), np.where(closer, apart, gap)
    return best


@dataclass(eq=False)
class Pushes:
    """Contact of every vertex with a body at rest; a ``NodeForce``. stiffness: E''' of the penalty [E π r³ / r³].

    friction: coefficient μ of Coulomb's law, smoothed within a slip of ``slip`` [r] since ``begin``, which also takes
    the pressures: friction lags by a step, as that of yarns on each other. Explicit steps, which are too short for
    such a slip, ask for ``slowed`` instead.
    """

    energy: FabricEnergy
    distance: Distance
    stiffness: float = 1.0
    friction: float = 0.0
    slip: float = 0.02
    _began: Array = field(init=False, repr=False, default_factory=lambda: np.empty((0, 3)))
    _normal: Array = field(init=False, repr=False, default_factory=lambda: np.empty((0, 3)))
    _grip: Array = field(init=False, repr=False, default_factory=lambda: np.empty(0))

    def __post_init__(self) -> None:
        """Check the coefficient."""
        if not (math.isfinite(self.friction) and self.friction >= 0.0):
            raise InputError("friction on an obstacle", expected="a number from 0", found=self.friction)

    def begin(self, positions: Array) -> None:
        """Begin a step at positions (n, 3) [r]: what presses there resists to slip from there on."""
        if self.friction == 0.0:
            return
        gap, normal = self.distance(positions * self.energy.radius)
        depth = np.maximum(1.0 - gap / self.energy.radius, 0.0)
        self._began, self._normal = positions.copy(), np.array(normal)
        self._grip = self.friction * self.stiffness * depth**2

    def at(self, positions: Array) -> tuple[float, Array, Array]:
        """Energy, gradient (n, 3) and Hessian (n, 3, 3) at positions (n, 3) [r]."""
        gap, normal = self.distance(positions * self.energy.radius)
        depth = np.maximum(1.0 - gap / self.energy.radius, 0.0)
        value = float((depth**3).sum()) * self.stiffness / 3.0
        gradient = -self.stiffness * depth[:, None] ** 2 * normal
        hessian = (2.0 * self.stiffness * depth)[:, None, None] * normal[:, :, None] * normal[:, None, :]
        rubbed = np.flatnonzero(self._grip)
        if len(rubbed):
            value += self._rub(positions, rubbed, gradient, hessian)
        return value, gradient, hessian

    def slowed(self, velocity: Array, yielding: Array, duration: float) -> Array:
        """Velocities (n, 3) of vertices whose sliding since ``begin`` is stopped by impulses up to μ N Δt."""
        rubbed = np.flatnonzero(self._grip)
        slower, normal, own = velocity.copy(), self._normal[rubbed], velocity[rubbed]
        along = own - np.einsum("ni,ni->n", own, normal)[:, None] * normal
        size = np.maximum(np.linalg.norm(along, axis=1), 1e-300)
        lost = np.minimum(1.0, duration * self._grip[rubbed] * yielding[rubbed] / size)
        slower[rubbed] -= lost[:, None] * along
        return slower

    def _rub(self, positions: Array, rubbed: NDArray[np.int64], gradient: Array, hessian: Array) -> float:
        """Add μ N (√(|u|² + h²) − h), u the slip along the surface, of vertices ``rubbed``; its value."""
        slip, normal, grip = positions[rubbed] - self._began[rubbed], self._normal[rubbed], self._grip[rubbed]
        slip = slip - np.einsum("ni,ni->n", slip, normal)[:, None] * normal
        size = np.sqrt(np.einsum("ni,ni->n", slip, slip) + self.slip**2)
        gradient[rubbed] += (grip / size)[:, None] * slip
        along = np.eye(3) - normal[:, :, None] * normal[:, None, :]
        unit = slip / size[:, None]
        hessian[rubbed] += (grip / size)[:, None, None] * (along - unit[:, :, None] * unit[:, None, :])
        return float((grip * (size - self.slip)).sum())
