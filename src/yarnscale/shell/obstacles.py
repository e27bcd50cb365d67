"""Bodies that cloth can lie on: spheres and half-spaces given by formulas, and closed or open triangle meshes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from yarnscale.errors import InputError

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Sphere:
    """A ball at rest: centre [m] and radius [m]."""

    centre: tuple[float, float, float]
    radius: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "centre", _vector("sphere centre", self.centre))
        if not (np.isfinite(self.radius) and self.radius > 0):
            raise InputError("sphere radius", expected="a positive length [m]", found=self.radius)

    def distances(self, points: Floats) -> tuple[Floats, Floats]:
        """Signed distances (n,) [m] and outward normals (n, 3) at points (n, 3)."""
        away = points - np.asarray(self.centre)
        length = np.linalg.norm(away, axis=1)
        return length - self.radius, away / np.maximum(length, 1e-300)[:, None]

    def clear_fraction(self, points: Floats, steps: Floats) -> float:
        """Largest fraction of straight steps (n, 3) that leaves every point outside, up to 1."""
        away = points - np.asarray(self.centre)
        a, b = np.einsum("ni,ni->n", steps, steps), np.einsum("ni,ni->n", steps, away)
        c = np.einsum("ni,ni->n", away, away) - self.radius**2
        hits = (b < 0) & (b * b > a * c)
        if not hits.any():
            return 1.0
        # The stable form of the smaller root of a t² + 2 b t + c.
        return float(min(1.0, (c[hits] / (-b[hits] + np.sqrt(b[hits] ** 2 - a[hits] * c[hits]))).min()))


@dataclass(frozen=True)
class Plane:
    """The half-space below a plane at rest: a point [m] and the normal on the side of the cloth."""

    point: tuple[float, float, float] = (0.0, 0.0, 0.0)
    normal: tuple[float, float, float] = (0.0, 0.0, 1.0)

    def __post_init__(self) -> None:
        object.__setattr__(self, "point", _vector("plane point", self.point))
        normal = np.array(_vector("plane normal", self.normal))
        length = np.linalg.norm(normal)
        if length == 0:
            raise InputError("plane normal", expected="a direction", found=self.normal)
        object.__setattr__(self, "normal", tuple(normal / length))

    def distances(self, points: Floats) -> tuple[Floats, Floats]:
        """Signed distances (n,) [m] and normals (n, 3) at points (n, 3)."""
        normal = np.asarray(self.normal)
        return (points - np.asarray(self.point)) @ normal, np.broadcast_to(normal, points.shape)

    def clear_fraction(self, points: Floats, steps: Floats) -> float:
        """Largest fraction of straight steps (n, 3) that leaves every point above, up to 1."""
        height, sinking = self.distances(points)[0], -(steps @ np.asarray(self.normal))
        hits = sinking > height
        return float((height[hits] / sinking[hits]).min(initial=1.0))


@dataclass(frozen=True, eq=False)
class MeshObstacle:
    """A body at rest given by triangles: vertices (n, 3) [m], triangles (m, 3)."""

    vertices: Floats
    triangles: NDArray[np.int64]

    def __post_init__(self) -> None:
        vertices = np.asarray(self.vertices, float)
        triangles = np.asarray(self.triangles)
        if vertices.ndim != 2 or vertices.shape[1] != 3 or not np.isfinite(vertices).all():
            raise InputError("obstacle vertices", expected="finite, shape (n, 3)", found=vertices.shape)
        if triangles.ndim != 2 or triangles.shape[1] != 3 or not np.issubdtype(triangles.dtype, np.integer):
            raise InputError("obstacle triangles", expected="integers, shape (m, 3)", found=triangles.shape)
        if len(triangles) == 0 or triangles.min() < 0 or triangles.max() >= len(vertices):
            raise InputError(
                "obstacle triangles", expected=f"vertices 0..{len(vertices) - 1}", found="an index outside"
            )
        object.__setattr__(self, "vertices", vertices)
        object.__setattr__(self, "triangles", triangles.astype(np.int64))


Shape = Sphere | Plane
Obstacle = Sphere | Plane | MeshObstacle


def _vector(name: str, value: object) -> tuple[float, ...]:
    array = np.asarray(value, dtype=float)
    if array.shape != (3,) or not np.isfinite(array).all():
        raise InputError(name, expected="three finite numbers", found=value)
    return tuple(float(v) for v in array)
