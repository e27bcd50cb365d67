"""Contact of cloth with itself and with obstacles, as a barrier that is infinite where surfaces meet.

The barrier of Li et al. 2020 (incremental potential contact), b(d) = −(d² − t²)² ln(d²/t²) for distances d
below the
thickness t: layers come to lie somewhere between 0 and t. It is weighted with area and scaled so that
surfaces t/2 apart press with a given pressure. Surfaces (cloth, mesh obstacles) go through ``ipctk``; spheres
and half-spaces are met by the vertices of the cloth. Steps are cut short before anything touches, so nothing
ever passes through.
Friction is lagged: normal forces of the start of a step resist tangential motion during it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import ipctk
import numpy as np
from numpy.typing import NDArray

from yarnscale.errors import InputError
from yarnscale.shell.mesh import TriangleMesh
from yarnscale.shell.obstacles import MeshObstacle, Obstacle, Shape

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

# −db/dd at d = t/2 in units of t³.
_HALF_WAY_SLOPE = 4.5 * 0.5 + 3.0 * math.log(2.0)
_SAFE = 0.9


@dataclass(frozen=True)
class ContactSettings:
    """How surfaces repel.

    thickness: distance [m] at which repulsion begins; pressure: [Pa] at half the thickness; self_contact:
    whether the cloth meets itself; friction: Coulomb coefficient; slip: speed [m/s] below which friction
    sticks. Raises InputError.
    """

    thickness: float = 1e-3
    pressure: float = 100.0
    self_contact: bool = True
    friction: float = 0.0
    slip: float = 1e-3

    def __post_init__(self) -> None:
        for name in ("thickness", "pressure", "slip"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0):
                raise InputError(f"contact {name}", expected="a positive number", found=value)
        if not (math.isfinite(self.friction) and self.friction >= 0):
            raise InputError("contact friction", expected="zero or a positive number", found=self.friction)

    @property
    def stiffness(self) -> float:
        """Factor of the barrier per area [Pa/m³]."""
        return self.pressure / (_HALF_WAY_SLOPE * self.thickness**3)


class ClothContact:
    """All contact of one mesh with itself and with obstacles; see ``step.ContactEnergy`` for the methods' contract."""

    def __init__(
        self, mesh: TriangleMesh, settings: ContactSettings, obstacles: Sequence[Obstacle] = ()
    ) -> None:
        shapes = [o for o in obstacles if not isinstance(o, MeshObstacle)]
        bodies = [o for o in obstacles if isinstance(o, MeshObstacle)]
        self.parts: list[_ShapeContact | _SurfaceContact] = [
            _ShapeContact(shape, mesh.vertex_areas, settings) for shape in shapes
        ]
        if settings.self_contact or bodies:
            self.parts.append(_SurfaceContact(mesh, bodies, settings))

    def start_step(self, positions: Floats, duration: float) -> None:
        """Take normal forces and the origin of slip for friction from the start of a step of ``duration`` [s]."""
        for part in self.parts:
            part.start_step(positions, duration)

    def value(self, positions: Floats) -> float:
        """Energy [J], inf where surfaces meet."""
        return sum(part.value(positions) for part in self.parts)

    def gradient(self, positions: Floats) -> tuple[float, Floats]:
        """Energy [J] and gradient (nv, 3) [N]."""
        total, gradient = 0.0, np.zeros_like(positions)
        for part in self.parts:
            value, push = part.gradient(positions)
            total += value
            gradient += push
        return total, gradient

    def hessian(self, positions: Floats) -> tuple[Integers, Floats]:
        """Positive semi-definite Hessian: sorted keys ``column·3nv + row`` (lower triangle) and entries [N/m]."""
        found = [part.hessian(positions) for part in self.parts]
        if not found:
            return np.zeros(0, np.int64), np.zeros(0)
        keys, place = np.unique(np.concatenate([k for k, _ in found]), return_inverse=True)
        entries = np.zeros(len(keys))
        np.add.at(entries, place, np.concatenate([e for _, e in found]))
        return keys, entries

    def bound(self, positions: Floats, step: Floats) -> float:
        """Fraction of a step (nv, 3) after which nothing touches, in (0, 1]."""
        return min([1.0, *(part.bound(positions, step) for part in self.parts)])

    def closest(self, positions: Floats) -> float:
        """Smallest distance [m] between surfaces that may meet; inf beyond the thickness, negative inside a body."""
        return min([math.inf, *(part.closest(positions) for part in self.parts)])

    def intersects(self, positions: Floats) -> bool:
        """Whether any surfaces cross."""
        return any(part.intersects(positions) for part in self.parts)


def _barrier(distance: Floats, thickness: float) -> tuple[Floats, Floats, Floats]:
    """Barrier of distances in (0, thickness) and its first and second derivative."""
    x, t2 = distance * distance, thickness * thickness
    gap, log = x - t2, np.log(x / t2)
    first = -2.0 * gap * log - gap * gap / x  # by x = d²
    second = -2.0 * log - 4.0 * gap / x + (gap / x) ** 2
    return -gap * gap * log, 2.0 * distance * first, 2.0 * first + 4.0 * x * second


class _ShapeContact:
    """Vertices against a sphere or a half-space."""

    def __init__(self, shape: Shape, areas: Floats, settings: ContactSettings) -> None:
        self.shape, self.settings = shape, settings
        self.weights = areas * settings.stiffness
        self.size = 3 * len(areas)
        self.origin: Floats | None = None
        self.grip, self.normals, self.reach = np.zeros(0), np.zeros((0, 3)), 1.0
        self.held = np.zeros(0, np.int64)

    def start_step(self, positions: Floats, duration: float) -> None:
        if self.settings.friction == 0.0:
            return
        distance, normals = self.shape.distances(positions)
        self.held = np.flatnonzero((distance < self.settings.thickness) & (distance > 0))
        slope = _barrier(distance[self.held], self.settings.thickness)[1]
        self.grip = -slope * self.weights[self.held] * self.settings.friction
        self.normals, self.origin = normals[self.held], positions[self.held].copy()
        self.reach = self.settings.slip * duration

    def value(self, positions: Floats) -> float:
        distance, _ = self.shape.distances(positions)
        near = distance < self.settings.thickness
        if (distance[near] <= 0).any():
            return math.inf
        normal = float(_barrier(distance[near], self.settings.thickness)[0] @ self.weights[near])
        return normal + float(self.grip @ self._slip(positions)[1])

    def gradient(self, positions: Floats) -> tuple[float, Floats]:
        distance, normals = self.shape.distances(positions)
        near = np.flatnonzero(distance < self.settings.thickness)
        gradient = np.zeros_like(positions)
        if (distance[near] <= 0).any():
            return math.inf, gradient
        energy, slope, _ = _barrier(distance[near], self.settings.thickness)
        gradient[near] = (slope * self.weights[near])[:, None] * normals[near]
        sliding, potential, rate, _ = self._slip(positions)
        gradient[self.held] += (self.grip * rate)[:, None] * sliding
        return float(energy @ self.weights[near]) + float(self.grip @ potential), gradient

    def hessian(self, positions: Floats) -> tuple[Integers, Floats]:
        distance, normals = self.shape.distances(positions)
        near = np.flatnonzero((distance < self.settings.thickness) & (distance > 0))
        bend = _barrier(distance[near], self.settings.thickness)[2] * self.weights[near]
        # The curvature of the sphere contributes a negative term, left out.
        blocks = np.maximum(bend, 0.0)[:, None, None] * _outer(normals[near])
        blocks = np.concatenate([blocks, self._friction_blocks(positions)])
        vertices = np.concatenate([near, self.held])
        row, column = np.tril_indices(3)
        keys = (3 * vertices[:, None] + column) * self.size + 3 * vertices[:, None] + row
        return keys.ravel(), blocks[:, row, column].ravel()

    def _friction_blocks(self, positions: Floats) -> Floats:
        """Second derivative of the friction potential of the held vertices, (n, 3, 3)."""
        sliding, _, rate, change = self._slip(positions)
        if self.origin is None:
            return np.zeros((0, 3, 3))
        length = np.linalg.norm(sliding, axis=1)
        along = _outer(sliding / np.maximum(length, 1e-300)[:, None])
        across = np.eye(3) - _outer(self.normals) - along
        return self.grip[:, None, None] * (rate[:, None, None] * across + change[:, None, None] * along)

    def _slip(self, positions: Floats) -> tuple[Floats, Floats, Floats, Floats]:
        """Tangential motion s of the held vertices, (n, 3), and of the smoothed length f(|s|): f, f'/|s| and f''."""
        if self.origin is None:
            return np.zeros((0, 3)), np.zeros(0), np.zeros(0), np.zeros(0)
        moved = positions[self.held] - self.origin
        sliding = moved - np.einsum("ni,ni->n", moved, self.normals)[:, None] * self.normals
        length = np.linalg.norm(sliding, axis=1)
        e = self.reach
        sticks = length < e
        smooth = np.where(sticks, length**2 / e - length**3 / (3 * e * e) + e / 3, length)
        rate = np.where(sticks, 2.0 / e - length / (e * e), 1.0 / np.maximum(length, e))
        return sliding, smooth, rate, np.where(sticks, 2.0 / e - 2.0 * length / (e * e), 0.0)

    def bound(self, positions: Floats, step: Floats) -> float:
        fraction = self.shape.clear_fraction(positions, step)
        return 1.0 if fraction >= 1.0 else _SAFE * fraction

    def closest(self, positions: Floats) -> float:
        return float(self.shape.distances(positions)[0].min())

    def intersects(self, positions: Floats) -> bool:
        return self.closest(positions) <= 0


class _SurfaceContact:
    """Cloth against itself and against mesh obstacles, whose vertices follow those of the cloth in ``ipctk``."""

    def __init__(self, mesh: TriangleMesh, bodies: Sequence[MeshObstacle], settings: ContactSettings) -> None:
        self.settings, self.count = settings, mesh.vertex_count
        rest = np.column_stack([mesh.panel, np.zeros(self.count)])
        self.fixed = np.concatenate([np.zeros((0, 3)), *(b.vertices for b in bodies)])
        offsets = self.count + np.cumsum([0, *(len(b.vertices) for b in bodies)])
        faces = [mesh.triangles, *(b.triangles + o for b, o in zip(bodies, offsets, strict=False))]
        triangles = np.concatenate(faces).astype(np.int32)
        edges = ipctk.edges(np.asfortranarray(triangles))
        self.mesh = ipctk.CollisionMesh(
            np.asfortranarray(np.concatenate([rest, self.fixed])), edges, np.asfortranarray(triangles)
        )
        if not settings.self_contact:
            patches = np.concatenate([np.zeros(self.count, np.int32), np.ones(len(self.fixed), np.int32)])
            self.mesh.can_collide = ipctk.make_vertex_patches_filter(patches)
        elif bodies:
            self.mesh.can_collide = ipctk.make_static_obstacle_filter(self.count)
        self.barrier = ipctk.BarrierPotential(settings.thickness, settings.stiffness)
        self.narrow = ipctk.AdditiveCCD()
        self.candidates = ipctk.Candidates()
        self.path: tuple[Floats, Floats] | None = None
        self.slack = settings.thickness
        self.tangential, self.friction, self.origin = ipctk.TangentialCollisions(), None, np.zeros((0, 3))

    def start_step(self, positions: Floats, duration: float) -> None:
        if self.settings.friction == 0.0:
            return
        everything = self._all(positions)
        self.origin = everything
        self.tangential = ipctk.TangentialCollisions()
        self.tangential.build(
            self.mesh, everything, self._collisions(positions), self.barrier, self.settings.friction
        )
        self.friction = ipctk.FrictionPotential(self.settings.slip * duration)

    def value(self, positions: Floats) -> float:
        everything = self._all(positions)
        value = self.barrier(self._collisions(positions), self.mesh, everything)
        if self.friction is not None:
            value += self.friction(self.tangential, self.mesh, self._slip(everything))
        return float(value) if math.isfinite(value) else math.inf

    def gradient(self, positions: Floats) -> tuple[float, Floats]:
        everything = self._all(positions)
        collisions = self._collisions(positions)
        value = self.barrier(collisions, self.mesh, everything)
        gradient = self.barrier.gradient(collisions, self.mesh, everything)
        if self.friction is not None:
            slip = self._slip(everything)
            value += self.friction(self.tangential, self.mesh, slip)
            gradient = gradient + self.friction.gradient(self.tangential, self.mesh, slip)
        return float(value), gradient.reshape(-1, 3)[: self.count]

    def hessian(self, positions: Floats) -> tuple[Integers, Floats]:
        everything = self._all(positions)
        clamp = ipctk.PSDProjectionMethod.CLAMP
        found = [self.barrier.hessian(self._collisions(positions), self.mesh, everything, clamp)]
        if self.friction is not None:
            found.append(self.friction.hessian(self.tangential, self.mesh, self._slip(everything), clamp))
        size = 3 * self.count
        keys, entries = [], []
        for matrix in found:
            full = matrix.tocoo()
            lower = (full.row >= full.col) & (full.row < size)
            keys.append(full.col[lower].astype(np.int64) * size + full.row[lower])
            entries.append(full.data[lower])
        return np.concatenate(keys), np.concatenate(entries)

    def bound(self, positions: Floats, step: Floats) -> float:
        start, end = self._all(positions), self._all(positions + step)
        self.candidates.build(self.mesh, start, end, 0.5 * self.settings.thickness)
        self.path = (positions.copy(), step.copy())
        fraction = self.candidates.compute_collision_free_stepsize(self.mesh, start, end, 0.0, self.narrow)
        return 1.0 if fraction >= 1.0 else _SAFE * float(fraction)

    def closest(self, positions: Floats) -> float:
        square = self._collisions(positions).compute_minimum_distance(self.mesh, self._all(positions))
        return math.sqrt(square)

    def intersects(self, positions: Floats) -> bool:
        return bool(ipctk.has_intersections(self.mesh, self._all(positions)))

    def _all(self, positions: Floats) -> Floats:
        """Vertices of the cloth and of the obstacles, in the order of memory that ``ipctk`` wants."""
        return np.asfortranarray(np.concatenate([positions, self.fixed]))

    def _slip(self, everything: Floats) -> Floats:
        return np.asfortranarray(everything - self.origin)

    def _collisions(self, positions: Floats) -> ipctk.NormalCollisions:
        """Pairs closer than the thickness; candidates are searched anew only off the path they were built for."""
        if not self._covered(positions):
            inflation = 0.5 * self.settings.thickness + self.slack
            self.candidates.build(self.mesh, self._all(positions), inflation)
            self.path = (positions.copy(), np.zeros_like(positions))
        collisions = ipctk.NormalCollisions()
        collisions.use_area_weighting = True
        collisions.build(self.candidates, self.mesh, self._all(positions), self.settings.thickness)
        return collisions

    def _covered(self, positions: Floats) -> bool:
        """Whether the candidates include every pair that may be near at these positions."""
        if self.path is None:
            return False
        start, step = self.path
        moved = positions - start
        length = float(np.vdot(step, step))
        if length == 0.0:
            return bool(np.abs(moved).max() < self.slack / math.sqrt(3))
        fraction = float(np.vdot(moved, step)) / length
        off = np.abs(moved - fraction * step).max()
        return bool(-1e-9 <= fraction <= 1 + 1e-9 and off <= 1e-9 * (1.0 + np.abs(moved).max()))


def _outer(vectors: Floats) -> Floats:
    return vectors[:, :, None] * vectors[:, None, :]
