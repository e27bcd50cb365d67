"""Cloth against itself and against bodies of triangles, through ``ipctk``."""

from __future__ import annotations

import math
from collections.abc import Sequence

import ipctk
import numba
import numpy as np
from numpy.typing import NDArray

from yarnscale.shell.barrier import ContactSettings
from yarnscale.shell.mesh import TriangleMesh
from yarnscale.shell.obstacles import Body

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

_SAFE = 0.9

# One warning for every pair of a state that intersects says nothing that ``intersects`` does not say.
ipctk.set_logger_level(ipctk.LoggerLevel.error)


class SurfaceContact:
    """Contact of surfaces; bodies come with the row of their first point, or None where they stand still.

    Vertices for ``ipctk``: all rows of the positions, then those of bodies that stand still.
    """

    def __init__(
        self,
        mesh: TriangleMesh,
        bodies: Sequence[tuple[Body, int | None]],
        settings: ContactSettings,
        rows: int,
    ) -> None:
        self.settings, self.rows = settings, rows
        still = [body.points(0.0) for body, first in bodies if first is None]
        self.fixed = np.concatenate([np.zeros((0, 3)), *still])
        rest = np.zeros((rows + len(self.fixed), 3))
        rest[: mesh.vertex_count] = mesh.assembled
        faces, next_row = [mesh.triangles], rows
        for body, first in bodies:
            points = body.points(0.0)
            start = next_row if first is None else first
            next_row += len(points) if first is None else 0
            rest[start : start + len(points)] = points
            faces.append(body.triangles + start)
        triangles = np.asfortranarray(np.concatenate(faces).astype(np.int32))
        self.mesh = ipctk.CollisionMesh(np.asfortranarray(rest), ipctk.edges(triangles), triangles)
        if not settings.self_contact:
            self.mesh.can_collide = ipctk.make_vertex_patches_filter(
                (np.arange(len(rest)) >= mesh.vertex_count).astype(np.int32)
            )
        elif bodies:
            self.mesh.can_collide = ipctk.make_static_obstacle_filter(mesh.vertex_count)
        self.barrier = ipctk.BarrierPotential(settings.thickness, settings.stiffness)
        self.narrow = ipctk.AdditiveCCD()
        self.candidates = ipctk.Candidates()
        self.path: tuple[Floats, Floats] | None = None
        self._found: tuple[Floats, ipctk.NormalCollisions] | None = None
        self.slack = settings.thickness
        self.tangential, self.friction, self.origin = ipctk.TangentialCollisions(), None, np.zeros((0, 3))

    def start_step(self, positions: Floats, duration: float, time: float) -> None:
        if self.settings.friction == 0.0:
            return
        everything = self.everything(positions)
        self.origin = everything
        self.tangential = ipctk.TangentialCollisions()
        self.tangential.build(
            self.mesh, everything, self._collisions(positions), self.barrier, self.settings.friction
        )
        self.friction = ipctk.FrictionPotential(self.settings.slip * duration)

    def value(self, positions: Floats) -> float:
        everything = self.everything(positions)
        value = self.barrier(self._collisions(positions), self.mesh, everything)
        if self.friction is not None:
            value += self.friction(self.tangential, self.mesh, self._slip(everything))
        return float(value) if math.isfinite(value) else math.inf

    def gradient(self, positions: Floats, gradient: Floats) -> float:
        everything = self.everything(positions)
        collisions = self._collisions(positions)
        value = self.barrier(collisions, self.mesh, everything)
        push = self.barrier.gradient(collisions, self.mesh, everything)
        if self.friction is not None:
            slip = self._slip(everything)
            value += self.friction(self.tangential, self.mesh, slip)
            push = push + self.friction.gradient(self.tangential, self.mesh, slip)
        gradient += push.reshape(-1, 3)[: self.rows]
        return float(value)

    def hessian(self, positions: Floats) -> tuple[Integers, Floats]:
        everything = self.everything(positions)
        clamp = ipctk.PSDProjectionMethod.CLAMP
        matrix = self.barrier.hessian(self._collisions(positions), self.mesh, everything, clamp)
        if self.friction is not None:
            matrix = matrix + self.friction.hessian(self.tangential, self.mesh, self._slip(everything), clamp)
        matrix.sort_indices()
        return _lower_entries(matrix.indptr, matrix.indices, matrix.data, 3 * self.rows)

    def bound(self, positions: Floats, step: Floats) -> float:
        start, end = self.everything(positions), self.everything(positions + step)
        self.candidates.build(self.mesh, start, end, 0.5 * self.settings.thickness)
        self.path = (positions.copy(), step.copy())
        fraction = self.candidates.compute_collision_free_stepsize(self.mesh, start, end, 0.0, self.narrow)
        return 1.0 if fraction >= 1.0 else _SAFE * float(fraction)

    def closest(self, positions: Floats) -> float:
        square = self._collisions(positions).compute_minimum_distance(self.mesh, self.everything(positions))
        return math.sqrt(square)

    def intersects(self, positions: Floats) -> bool:
        return bool(ipctk.has_intersections(self.mesh, self.everything(positions)))

    def everything(self, positions: Floats) -> Floats:
        """Every vertex, in the order of memory that ``ipctk`` wants."""
        return np.asfortranarray(np.concatenate([positions, self.fixed]))

    def _slip(self, everything: Floats) -> Floats:
        return np.asfortranarray(everything - self.origin)

    def _collisions(self, positions: Floats) -> ipctk.NormalCollisions:
        """Pairs closer than the thickness; candidates are searched anew only off the path they were built for."""
        if self._found is not None and np.array_equal(self._found[0], positions):
            return self._found[1]
        if not self._covered(positions):
            inflation = 0.5 * self.settings.thickness + self.slack
            self.candidates.build(self.mesh, self.everything(positions), inflation)
            self.path = (positions.copy(), np.zeros_like(positions))
        collisions = ipctk.NormalCollisions()
        collisions.use_area_weighting = True
        collisions.build(self.candidates, self.mesh, self.everything(positions), self.settings.thickness)
        self._found = (positions.copy(), collisions)
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


@numba.njit(cache=True, error_model="numpy")
def _lower_entries(starts, rows, values, size):
    """Keys ``column·size + row`` and entries of the lower triangle of the leading ``size`` rows, by columns."""
    count = 0
    for column in range(size):
        for k in range(starts[column], starts[column + 1]):
            count += column <= rows[k] < size
    keys, entries = np.empty(count, np.int64), np.empty(count)
    place = 0
    for column in range(size):
        for k in range(starts[column], starts[column + 1]):
            row = rows[k]
            if column <= row < size:
                keys[place] = np.int64(column) * size + row
                entries[place] = values[k]
                place += 1
    return keys, entries
