"""Contact of cloth with itself and with bodies of triangles; frames are tested for crossings by another search."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from yarnscale.motion.obstacles import TriangleObstacle, obstacle_name
from yarnscale.shell.contact.barrier import ContactSettings
from yarnscale.shell.contact.crossings import CLOTH, Crossing, crossing_triangles, surface_crossings
from yarnscale.shell.contact.pair_contact import PairContact
from yarnscale.shell.contact.pair_search import PairSearch
from yarnscale.shell.mesh import TriangleMesh

Floats = NDArray[np.float64]


class SurfaceContact(PairContact):
    """Contact of surfaces; bodies have their number and the row of their first point, None if they are at rest."""

    def __init__(
        self,
        mesh: TriangleMesh,
        bodies: Sequence[tuple[TriangleObstacle, int, int | None]],
        settings: ContactSettings,
        rows: int,
    ) -> None:
        still = [body.points(0.0) for body, _, first in bodies if first is None]
        fixed = np.concatenate([np.zeros((0, 3)), *still])
        rest = np.zeros((rows + len(fixed), 3))
        rest[: mesh.vertex_count] = mesh.assembled
        faces, next_row = [mesh.triangles], rows
        for body, _, first in bodies:
            points = body.points(0.0)
            start = next_row if first is None else first
            next_row += len(points) if first is None else 0
            rest[start : start + len(points)] = points
            faces.append(body.triangles + start)
        triangles = np.concatenate(faces).astype(np.int64)
        self.pairs = PairSearch(triangles, len(mesh.triangles), rest, settings)
        super().__init__(self.pairs, settings, rows, fixed)
        sizes = [len(mesh.triangles), *(len(body.triangles) for body, _, _ in bodies)]
        self._owners = np.repeat([CLOTH, *(number for _, number, _ in bodies)], sizes)
        self._names = {number: obstacle_name(body, number) for body, number, _ in bodies}

    def intersects(self, positions: Floats) -> bool:
        triangles, cloth = self.pairs.surfaces.triangles, self.pairs.surfaces.cloth
        within = self.settings.self_contact
        everything = self.everything(positions)
        return len(crossing_triangles(everything, triangles, cloth, within_cloth=within)[0]) > 0

    def crossings(self, positions: Floats) -> list[Crossing]:
        """Crossings, found as by ``intersects``."""
        return surface_crossings(
            self.everything(positions), self.pairs.surfaces.triangles, self._owners, self._names,
            within_cloth=self.settings.self_contact,
        )  # fmt: skip
