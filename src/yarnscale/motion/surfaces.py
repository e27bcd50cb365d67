"""Surfaces of obstacles: how far points are from them, and where what sticks to them is carried."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from scipy.spatial import KDTree

from yarnscale.arrays import Array, Integers
from yarnscale.motion.obstacles import Obstacle, Plane, Sphere, TriangleObstacle
from yarnscale.numerics.pair_distance import triangle_weights


class ObstacleSurface(Protocol):
    """The surface of an obstacle at a time [s]; points (n, 3) [m]."""

    def at(self, points: Array, time: float) -> tuple[Array, Array]:
        """Signed distances (n,) [m] and outward normals (n, 3)."""
        ...

    def carried(self, points: Array, start: float, end: float) -> Array:
        """Where points that stick to the surface go from one time to another (n, 3)."""
        ...


def surface_of(obstacle: Obstacle, *, reach: float) -> ObstacleSurface:
    """The surface of an obstacle; distances from triangles, which face outwards, are exact within ``reach`` [m]."""
    if isinstance(obstacle, Sphere):
        return _Ball(obstacle)
    return _HalfSpace(obstacle) if isinstance(obstacle, Plane) else _Triangles(obstacle, reach)  # type: ignore[arg-type]


class _Ball:
    def __init__(self, ball: Sphere) -> None:
        self._ball = ball

    def at(self, points: Array, time: float) -> tuple[Array, Array]:
        away = points - self._ball.points(time)
        size = np.linalg.norm(away, axis=1)
        return size - self._ball.radius, away / np.maximum(size, 1e-12)[:, None]

    def carried(self, points: Array, start: float, end: float) -> Array:
        motion = self._ball.motion
        turn = motion.turn(end) @ motion.turn(start).T
        return (points - self._ball.points(start)) @ turn.T + self._ball.points(end)


class _HalfSpace:
    def __init__(self, plane: Plane) -> None:
        self._plane, self._up = plane, np.array(plane.normal)

    def at(self, points: Array, time: float) -> tuple[Array, Array]:
        return (points - self._plane.points(time)) @ self._up, np.broadcast_to(self._up, points.shape)

    def carried(self, points: Array, start: float, end: float) -> Array:
        return points + self._plane.points(end) - self._plane.points(start)


class _Triangles:
    def __init__(self, obstacle: TriangleObstacle, reach: float) -> None:
        self._obstacle, self._reach, self._time = obstacle, reach, np.nan

    def _place(self, time: float) -> None:
        """Corners, normals and a tree of the middles of triangles, made anew where the obstacle moves."""
        if time == self._time or (not self._obstacle.moves and not np.isnan(self._time)):
            return
        self._time, self._corner = time, self._obstacle.points(time)[self._obstacle.triangles]
        middle = self._corner.mean(axis=1)
        self._widest = float(np.linalg.norm(self._corner - middle[:, None], axis=2).max())
        sides = self._corner[:, 1:] - self._corner[:, :1]
        normal = np.cross(sides[:, 0], sides[:, 1])
        self._normal = normal / np.maximum(np.linalg.norm(normal, axis=1), 1e-300)[:, None]
        self._tree = KDTree(middle)

    def _nearest(self, points: Array, time: float) -> tuple[Integers, Integers, Array]:
        """Points within reach (k,), the nearest triangle of each (k,) and the weights of its closest point (k, 3)."""
        self._place(time)
        near = self._tree.query_ball_point(points, self._reach + self._widest)
        counts = np.array([len(found) for found in near], np.int64)
        which = np.concatenate([np.empty(0, np.int64), *(np.array(found, np.int64) for found in near)])
        owner = np.repeat(np.arange(len(points)), counts)
        weights = triangle_weights(points[owner], self._corner[which])
        gap = np.linalg.norm(points[owner] - _combined(weights, self._corner[which]), axis=1)
        order = np.lexsort((gap, owner))
        first = order[np.unique(owner[order], return_index=True)[1]]
        return owner[first], which[first], weights[first]

    def at(self, points: Array, time: float) -> tuple[Array, Array]:
        own, which, weights = self._nearest(points, time)
        signed, direction = np.full(len(points), self._reach), np.zeros_like(points)
        direction[:, 2] = 1.0
        away, outward = points[own] - _combined(weights, self._corner[which]), self._normal[which]
        gap = np.linalg.norm(away, axis=1)
        sign = np.where(np.einsum("ij,ij->i", away, outward) < 0, -1.0, 1.0)
        signed[own] = sign * gap
        unit = sign[:, None] * away / np.maximum(gap, 1e-12)[:, None]
        direction[own] = np.where(gap[:, None] > 1e-12, unit, outward)
        return signed, direction

    def carried(self, points: Array, start: float, end: float) -> Array:
        if not self._obstacle.moves:
            return points
        own, which, weights = self._nearest(points, start)
        moved = self._obstacle.points(end) - self._obstacle.points(start)
        gone = points.copy()
        gone[own] += _combined(weights, moved[self._obstacle.triangles[which]])
        return gone


def _combined(weights: Array, corners: Array) -> Array:
    """Σ weights·corners, (n, 3), of triangles (n, 3, 3)."""
    return np.einsum("nk,nki->ni", weights, corners)
