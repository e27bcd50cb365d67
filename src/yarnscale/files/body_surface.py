"""Surfaces of the obstacles of a scene as triangles, where the obstacles are."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from yarnscale.arrays import Array, Integers
from yarnscale.motion.obstacles import Obstacle, Sphere, current_points


class BodySurface:
    """All obstacles that have a surface, in one list of triangles; a plane has none, for it has no end.

    triangles: (m, 3). It counts as false without any.
    """

    def __init__(self, obstacles: Sequence[Obstacle]) -> None:
        self._obstacles = tuple(obstacles)
        self._shown: list[int] = []
        lists, start = [np.zeros((0, 3), np.int64)], 0
        for number, obstacle in enumerate(obstacles):
            if isinstance(obstacle, Sphere):
                triangles, count = ball()[1], len(ball()[0])
            else:
                triangles, count = getattr(obstacle, "triangles", None), len(obstacle.points(0.0))
            if triangles is None:
                continue
            self._shown.append(number)
            lists.append(np.asarray(triangles) + start)
            start += count
        self.triangles: Integers = np.vstack(lists)

    def __bool__(self) -> bool:
        return bool(self._shown)

    def vertices(self, time: float, moved: Array | None = None) -> Array:
        """Vertices at a time [s], (n, 3) [m].

        moved: where the points of moving obstacles are, as in ``ClothState``; None: where their motion takes them.
        """
        places = [np.zeros((0, 3))]
        everything = current_points(self._obstacles, time, moved)
        for number in self._shown:
            part, points = self._obstacles[number], everything[number]
            places.append(points[:1] + part.radius * ball()[0] if isinstance(part, Sphere) else points)
        return np.vstack(places)


def ball(*, rings: int = 24, sectors: int = 48) -> tuple[Array, Integers]:
    """A sphere of radius one about the origin: vertices (n, 3) and triangles (m, 3) that face outwards."""
    polar, around = np.pi * np.arange(1, rings) / rings, 2 * np.pi * np.arange(sectors) / sectors
    height, angle = (grid.ravel() for grid in np.meshgrid(np.cos(polar), around, indexing="ij"))
    width = np.sqrt(1.0 - height**2)
    body = np.column_stack([width * np.cos(angle), width * np.sin(angle), height])
    top, bottom = np.full(sectors, len(body)), np.full(sectors, len(body) + 1)
    here = np.arange(len(body)).reshape(rings - 1, sectors)
    following = np.roll(here, -1, axis=1)
    a, b, c, d = here[:-1], following[:-1], here[1:], following[1:]
    walls = np.stack([a, c, d, a, d, b], axis=-1).reshape(-1, 3)
    lids = [np.column_stack([top, here[0], following[0]]), np.column_stack([bottom, following[-1], here[-1]])]
    return np.vstack([body, [[0.0, 0.0, 1.0], [0.0, 0.0, -1.0]]]), np.vstack([walls, *lids])
