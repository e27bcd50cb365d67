"""Obstacles to cloth and yarns: spheres and half-spaces, and triangle meshes, rigid or animated.

The place of an obstacle is given by points: the centre of a sphere, a point of a plane, the vertices of a
mesh. During a step the points move along straight lines; their places at the ends of a step are exact.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from yarnscale.arrays import Array, Integers
from yarnscale.errors import InputError, positive
from yarnscale.motion.rigid import STILL, Motion


class Obstacle(Protocol):
    """A body with a prescribed motion, given by points."""

    @property
    def moves(self) -> bool:
        """Whether the points ever change."""
        ...

    def points(self, time: float) -> Array:
        """Places of the points at a time [s], (n, 3) [m]."""
        ...


class TriangleObstacle(Obstacle, Protocol):
    """An obstacle with a surface of triangles between its points."""

    @property
    def triangles(self) -> Integers:
        """Corners (m, 3), among the points."""
        ...


class _Rigid:
    """What moves as a whole."""

    motion: Motion

    @property
    def moves(self) -> bool:
        return self.motion.moves


@dataclass(frozen=True)
class Sphere(_Rigid):
    """A ball: centre [m] before its motion, radius [m]; friction acts on its rotation too."""

    centre: tuple[float, float, float]
    radius: float
    motion: Motion = STILL

    def __post_init__(self) -> None:
        object.__setattr__(self, "centre", _vector("sphere centre", self.centre))
        positive("sphere radius", self.radius, "a positive length [m]")

    def points(self, time: float) -> Array:
        return self.motion.place(np.array([self.centre]), time)


@dataclass(frozen=True)
class Plane(_Rigid):
    """The half-space below a plane: a point [m] and the normal on the side of the cloth.

    It may move, also along itself (a belt); rotating planes must be given as meshes. Raises InputError.
    """

    point: tuple[float, float, float] = (0.0, 0.0, 0.0)
    normal: tuple[float, float, float] = (0.0, 0.0, 1.0)
    motion: Motion = STILL

    def __post_init__(self) -> None:
        object.__setattr__(self, "point", _vector("plane point", self.point))
        normal = np.array(_vector("plane normal", self.normal))
        length = np.linalg.norm(normal)
        if length == 0:
            raise InputError("plane normal", expected="a direction", found=self.normal)
        object.__setattr__(self, "normal", tuple(normal / length))
        if any(self.motion.rotation):
            raise InputError("plane motion", expected="no rotation", found=self.motion.rotation)

    def points(self, time: float) -> Array:
        return np.array([self.point]) + self.motion.offset(time)


@dataclass(frozen=True, eq=False)
class MeshObstacle(_Rigid):
    """A rigid obstacle given by triangles: vertices (n, 3) [m] before its motion, triangles (m, 3)."""

    vertices: Array
    triangles: Integers
    motion: Motion = STILL

    def __post_init__(self) -> None:
        vertices = np.asarray(self.vertices, float)
        if vertices.ndim != 2 or vertices.shape[1] != 3 or not np.isfinite(vertices).all():
            raise InputError("obstacle vertices", expected="finite, shape (n, 3)", found=vertices.shape)
        object.__setattr__(self, "vertices", vertices)
        object.__setattr__(self, "triangles", _triangles(self.triangles, len(vertices)))

    def points(self, time: float) -> Array:
        return self.motion.place(self.vertices, time) if self.moves else self.vertices


@dataclass(frozen=True, eq=False)
class AnimatedMesh:
    """An obstacle whose vertices move: poses (k, n, 3) [m] at increasing times (k,) [s], triangles (m, 3).

    Between two poses vertices move along straight lines; before the first and after the last they are at rest.
    """

    times: Array
    poses: Array
    triangles: Integers

    def __post_init__(self) -> None:
        times, poses = np.asarray(self.times, float), np.asarray(self.poses, float)
        if poses.ndim != 3 or poses.shape[2] != 3 or len(poses) == 0 or not np.isfinite(poses).all():
            raise InputError("animation poses", expected="finite, shape (k, n, 3)", found=poses.shape)
        if times.shape != (len(poses),) or not np.isfinite(times).all() or (np.diff(times) <= 0).any():
            raise InputError("animation times", expected=f"{len(poses)} increasing numbers [s]", found=times.shape)
        object.__setattr__(self, "times", times)
        object.__setattr__(self, "poses", poses)
        object.__setattr__(self, "triangles", _triangles(self.triangles, poses.shape[1]))

    @property
    def moves(self) -> bool:
        return len(self.times) > 1

    def points(self, time: float) -> Array:
        last = len(self.times) - 1
        if time >= self.times[last]:
            return self.poses[last]
        before = int(np.searchsorted(self.times, time, side="right")) - 1
        if before < 0:
            return self.poses[0]
        share = (time - self.times[before]) / (self.times[before + 1] - self.times[before])
        return (1.0 - share) * self.poses[before] + share * self.poses[before + 1]


Shape = Sphere | Plane


def current_points(obstacles: Sequence[Obstacle], time: float, moved: Array | None) -> list[Array]:
    """Points of every obstacle [m]; moved: those of all moving ones, as in ``ClothState.obstacles``."""
    places, start = [], 0
    for obstacle in obstacles:
        points = obstacle.points(time)
        if obstacle.moves and moved is not None:
            points, start = moved[start : start + len(points)], start + len(points)
        places.append(points)
    return places


def obstacle_name(obstacle: Obstacle, number: int) -> str:
    """Name of an obstacle in messages; number: from 0 in the list of obstacles."""
    shapes = {Sphere: "sphere", Plane: "plane"}
    return f"obstacles[{number}] ({shapes.get(type(obstacle), 'mesh')})"


def _triangles(triangles: object, count: int) -> Integers:
    array = np.asarray(triangles)
    if array.ndim != 2 or array.shape[1] != 3 or not np.issubdtype(array.dtype, np.integer):
        raise InputError("obstacle triangles", expected="integers, shape (m, 3)", found=array.shape)
    if len(array) == 0 or array.min() < 0 or array.max() >= count:
        raise InputError("obstacle triangles", expected=f"vertices 0..{count - 1}", found="an index outside")
    return array.astype(np.int64)


def _vector(name: str, value: object) -> tuple[float, ...]:
    array = np.asarray(value, dtype=float)
    if array.shape != (3,) or not np.isfinite(array).all():
        raise InputError(name, expected="three finite numbers", found=value)
    return tuple(float(v) for v in array)
