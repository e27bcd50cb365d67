"""Contact of cloth with itself and with obstacles of triangles; frames are tested for crossings by another search."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from yarnscale.arrays import Array
from yarnscale.motion.obstacles import TriangleObstacle, obstacle_name
from yarnscale.shell.contact.barrier import ContactSettings
from yarnscale.shell.contact.crossings import CLOTH, Crossing, crossing_triangles, surface_crossings
from yarnscale.shell.contact.pair_contact import PairContact
from yarnscale.shell.contact.pair_search import PairSearch
from yarnscale.shell.mesh import TriangleMesh


class SurfaceContact(PairContact):
    """Contact of surfaces; obstacles have their number and the row of their first point, None if they are at rest."""

    def __init__(
        self,
        mesh: TriangleMesh,
        obstacles: Sequence[tuple[TriangleObstacle, int, int | None]],
        settings: ContactSettings,
        rows: int,
    ) -> None:
        still = [obstacle.points(0.0) for obstacle, _, first in obstacles if first is None]
        fixed = np.concatenate([np.zeros((0, 3)), *still])
        rest = np.zeros((rows + len(fixed), 3))
        rest[: mesh.vertex_count] = mesh.assembled
        faces, next_row = [mesh.triangles], rows
        for obstacle, _, first in obstacles:
            points = obstacle.points(0.0)
            start = next_row if first is None else first
            next_row += len(points) if first is None else 0
            rest[start : start + len(points)] = points
            faces.append(obstacle.triangles + start)
        triangles = np.concatenate(faces).astype(np.int64)
        self.pairs = PairSearch(triangles, len(mesh.triangles), rest, settings)
        super().__init__(self.pairs, settings, rows, fixed)
        sizes = [len(mesh.triangles), *(len(obstacle.triangles) for obstacle, _, _ in obstacles)]
        self._owners = np.repeat([CLOTH, *(number for _, number, _ in obstacles)], sizes)
        self._names = {number: obstacle_name(obstacle, number) for obstacle, number, _ in obstacles}

    def intersects(self, positions: Array) -> bool:
        triangles, cloth = self.pairs.surfaces.triangles, self.pairs.surfaces.cloth
        within = self.settings.self_contact
        everything = self.everything(positions)
        return len(crossing_triangles(everything, triangles, cloth, within_cloth=within)[0]) > 0

    def crossings(self, positions: Array) -> list[Crossing]:
        """Crossings, found as by ``intersects``."""
        return surface_crossings(
            self.everything(positions), self.pairs.surfaces.triangles, self._owners, self._names,
            within_cloth=self.settings.self_contact,
        )  # fmt: skip
