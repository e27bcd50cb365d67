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
    polar = np.pi * np.arange(1, rings) / rings
    around = 2 * np.pi * np.arange(sectors) / sectors
    circle = np.stack([np.cos(around), np.sin(around)], axis=1)
    body = np.concatenate(
        [np.sin(polar)[:, None, None] * circle, np.broadcast_to(np.cos(polar)[:, None, None], (rings - 1, sectors, 1))],
        axis=2,
    ).reshape(-1, 3)
    top, bottom = len(body), len(body) + 1
    here, following = np.arange(sectors), (np.arange(sectors) + 1) % sectors
    upper = (sectors * np.arange(rings - 2))[:, None]
    a, b = upper + here, upper + following
    c, d = a + sectors, b + sectors
    last = sectors * (rings - 2)
    triangles = np.vstack(
        [
            np.stack([a, c, d], axis=-1).reshape(-1, 3),
            np.stack([a, d, b], axis=-1).reshape(-1, 3),
            np.stack([np.full(sectors, top), here, following], axis=1),
            np.stack([np.full(sectors, bottom), last + following, last + here], axis=1),
        ]
    )
    return np.vstack([body, [[0.0, 0.0, 1.0], [0.0, 0.0, -1.0]]]), triangles.astype(np.int64)
