"""Contact of cloth with itself and with obstacles: a barrier that is infinite at zero distance.

The barrier of Li et al. 2020 (incremental potential contact), b(d) = −(d² − t²)² ln(d²/t²) for distances d
below the thickness t. It is weighted with area and scaled so that
surfaces at a distance of t/2 have a given pressure. Steps are shortened before surfaces touch, so that they never
cross. Friction uses the normal forces at the start of a step. Sticking contacts do not creep, see ``stick``.

Points of moving obstacles are unknowns like the vertices of the cloth, in rows after them, and stiff springs of
limited force pull them to their prescribed places: Newton's method moves cloth and obstacles together, the bound of a
step holds for both, and a cloth between two obstacles can push them back.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from yarnscale.arrays import Array, Integers
from yarnscale.motion.obstacles import Obstacle, Plane, Sphere
from yarnscale.shell.contact.barrier import ContactSettings
from yarnscale.shell.contact.crossings import Crossing
from yarnscale.shell.contact.shape_contact import ShapeContact
from yarnscale.shell.contact.surface_contact import SurfaceContact
from yarnscale.shell.mesh import TriangleMesh
from yarnscale.shell.state import Attachment, Slips

__all__ = ["ClothContact", "ContactSettings"]


_ROOM = 1.5
"""Distance, in thicknesses, within which pairs have entries in the matrix before they are in contact."""


class ClothContact:
    """All contact of one mesh with itself and with obstacles.

    Positions are those of the cloth followed by ``guests`` rows, the points of moving obstacles (``places``).
    """

    def __init__(self, mesh: TriangleMesh, settings: ContactSettings, obstacles: Sequence[Obstacle] = ()) -> None:
        self.count, self.settings = mesh.vertex_count, settings
        self._moving = tuple(o for o in obstacles if o.moves)
        sizes = [len(obstacle.points(0.0)) if obstacle.moves else 0 for obstacle in obstacles]
        self.guests = sum(sizes)
        rows = self.count + self.guests
        self.parts: list[ShapeContact | SurfaceContact] = []
        meshes = []
        for number, obstacle in enumerate(obstacles):
            first = self.count + sum(sizes[:number]) if obstacle.moves else None
            if isinstance(obstacle, Sphere | Plane):
                self.parts.append(ShapeContact(obstacle, number, mesh, settings, first, rows))
            else:
                meshes.append((obstacle, number, first))
        if settings.self_contact or meshes:
            self.parts.append(SurfaceContact(mesh, meshes, settings, rows))

    def places(self, time: float) -> Array:
        """Prescribed places of the points of moving obstacles at a time, (guests, 3) [m]."""
        return np.concatenate([np.zeros((0, 3)), *(o.points(time) for o in self._moving)])

    def attachment(self, time: float) -> Attachment:
        """Springs [N/m] of limited force that pull the points of moving obstacles to their prescribed places."""
        vertices = np.arange(self.count, self.count + self.guests)
        return Attachment(vertices, self.places(time), limit=self.settings.holding_force)

    def start_step(
        self, positions: Array, duration: float, time: float = 0.0, until: float | None = None,
        slips: Slips | None = None,
    ) -> None:  # fmt: skip
        """Set normal forces and origin of slip for friction at the start of a step of ``duration`` [s].

        until: time up to which obstacles move [s], by default the end of the step. slips: elastic slips at the end of
        the step before.
        """
        until = time + duration if until is None else until
        for number, part in enumerate(self.parts):
            part.start_step(positions, duration, (time, until), number, slips)

    def slips(self, positions: Array) -> Slips | None:
        """Elastic slips at the end of a step; None without friction."""
        if self.settings.friction == 0.0 or not self.parts:
            return None
        found = [part.slips(positions) for part in self.parts]
        return Slips(*(np.concatenate(arrays) for arrays in zip(*((s.between, s.amounts) for s in found), strict=True)))

    def value(self, positions: Array) -> float:
        """Energy [J], inf at zero distance."""
        return sum(part.value(positions) for part in self.parts)

    def gradient(self, positions: Array) -> tuple[float, Array]:
        """Energy [J] and gradient, of the shape of the positions [N]."""
        total, gradient = 0.0, np.zeros_like(positions)
        for part in self.parts:
            total += part.gradient(positions, gradient)
        return total, gradient

    def hessian(self, positions: Array) -> tuple[Integers, Array]:
        """Positive semi-definite Hessian: increasing keys ``column·rows + row`` of vertices, blocks (m, 9) [N/m].

        Of the lower triangle; blocks row by row.
        """
        found = [part.hessian(positions) for part in self.parts]
        if not found:
            return np.zeros(0, np.int64), np.zeros((0, 9))
        if len(found) == 1:
            return found[0]
        keys = np.concatenate([k for k, _ in found])
        order = np.argsort(keys, kind="stable")  # sorted runs merge in linear time
        keys = keys[order]
        first = np.flatnonzero(np.diff(keys, prepend=-1) > 0)
        return keys[first], np.add.reduceat(np.concatenate([e for _, e in found])[order], first)

    def room(self, positions: Array) -> Integers:
        """Keys, as of ``hessian``, of pairs that are near, with repetitions."""
        within = _ROOM * self.settings.thickness
        return np.concatenate([np.zeros(0, np.int64), *(part.room(positions, within) for part in self.parts)])

    def bound(self, positions: Array, step: Array) -> float:
        """Fraction of a step, of the shape of the positions, without contact at zero distance, in (0, 1]."""
        return min([1.0, *(part.bound(positions, step) for part in self.parts)])

    def closest(self, positions: Array) -> float:
        """Smallest distance [m] between surfaces; inf beyond the thickness, negative inside an obstacle."""
        return min([math.inf, *(part.closest(positions) for part in self.parts)])

    def intersects(self, positions: Array) -> bool:
        """Whether any surfaces cross, tested independently of the contact search."""
        return any(part.intersects(positions) for part in self.parts)

    def crossings(self, positions: Array) -> list[Crossing]:
        """Crossing surfaces and places, one entry for each pair of objects; slow."""
        return [crossing for part in self.parts for crossing in part.crossings(positions)]
