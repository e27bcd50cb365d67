"""Contact of cloth with itself and with bodies of triangles; frames are tested for crossings by another search."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from yarnscale.motion.obstacles import TriangleObstacle
from yarnscale.shell.contact.barrier import ContactSettings
from yarnscale.shell.contact.crossings import CLOTH, Crossing, crossing_triangles, surface_crossings
from yarnscale.shell.contact.pair_contact import PairContact
from yarnscale.shell.contact.pair_search import PairSearch
from yarnscale.shell.mesh import TriangleMesh

Floats = NDArray[np.float64]


class SurfaceContact(PairContact):
    """Contact of surfaces; bodies have the row of their first point, or None if they are at rest."""

    def __init__(
        self,
        mesh: TriangleMesh,
        bodies: Sequence[tuple[TriangleObstacle, int | None]],
        settings: ContactSettings,
        rows: int,
    ) -> None:
        still = [body.points(0.0) for body, first in bodies if first is None]
        fixed = np.concatenate([np.zeros((0, 3)), *still])
        rest = np.zeros((rows + len(fixed), 3))
        rest[: mesh.vertex_count] = mesh.assembled
        faces, next_row = [mesh.triangles], rows
        for body, first in bodies:
            points = body.points(0.0)
            start = next_row if first is None else first
            next_row += len(points) if first is None else 0
            rest[start : start + len(points)] = points
            faces.append(body.triangles + start)
        triangles = np.concatenate(faces).astype(np.int64)
        self.pairs = PairSearch(triangles, len(mesh.triangles), rest, settings)
        super().__init__(self.pairs, settings, rows, fixed)
        sizes = [len(body.triangles) for body, _ in bodies]
        self._owners = np.repeat(np.arange(CLOTH, len(sizes)), [len(mesh.triangles), *sizes])

    def intersects(self, positions: Floats) -> bool:
        triangles, cloth = self.pairs.surfaces.triangles, self.pairs.surfaces.cloth
        within = self.settings.self_contact
        everything = self.everything(positions)
        return len(crossing_triangles(everything, triangles, cloth, within_cloth=within)[0]) > 0

    def crossings(self, positions: Floats, numbers: Sequence[int], names: Sequence[str]) -> list[Crossing]:
        """Crossings, found as by ``intersects``; numbers, names: of the bodies among the obstacles."""
        found = surface_crossings(
            self.everything(positions), self.pairs.surfaces.triangles, self._owners, names,
            within_cloth=self.settings.self_contact,
        )  # fmt: skip
        return [c if c.body == CLOTH else replace(c, body=numbers[c.body]) for c in found]
