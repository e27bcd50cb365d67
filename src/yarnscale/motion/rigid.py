"""Prescribed rigid motion of handles and obstacles: a shift and a turn that begin and end at given times."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from yarnscale.arrays import Array
from yarnscale.errors import InputError


@dataclass(frozen=True)
class Motion:
    """A displacement and a rotation, smooth at both ends: from time ``start`` for ``duration`` [s].

    displacement: [m]; rotation: axis times angle [rad], about ``pivot`` [m], which is carried along by the
    displacement; ease: whether the speed is zero at both ends (else constant). Raises InputError.
    """

    displacement: tuple[float, float, float] = (0.0, 0.0, 0.0)
    start: float = 0.0
    duration: float = 0.0
    rotation: tuple[float, float, float] = (0.0, 0.0, 0.0)
    pivot: tuple[float, float, float] = (0.0, 0.0, 0.0)
    ease: bool = True

    def __post_init__(self) -> None:
        for name, unit in (("displacement", "m"), ("rotation", "rad"), ("pivot", "m")):
            value = getattr(self, name)
            if len(value) != 3 or not np.isfinite(value).all():
                raise InputError(f"motion {name}", expected=f"three finite numbers [{unit}]", found=value)
        if not (math.isfinite(self.duration) and self.duration >= 0 and math.isfinite(self.start)):
            raise InputError("motion duration", expected="a finite start and zero or more seconds", found=self.duration)

    @property
    def end(self) -> float:
        """Time at which the motion is over [s]."""
        return self.start + self.duration

    @property
    def moves(self) -> bool:
        """Whether anything moves at all."""
        return any(self.displacement) or any(self.rotation)

    def share(self, time: float) -> float:
        """Part of the motion that is done at a time, in [0, 1]."""
        if time >= self.end:
            return 1.0
        if time <= self.start:
            return 0.0
        share = max(time - self.start, 0.0) / self.duration
        return share * share * (3.0 - 2.0 * share) if self.ease else share

    def offset(self, time: float) -> Array:
        """Displacement at a time [m], (3,)."""
        return self.share(time) * np.asarray(self.displacement)

    def turn(self, time: float) -> Array:
        """Matrix of the rotation at a time, (3, 3)."""
        return rotation_matrix(self.share(time) * np.asarray(self.rotation))

    def place(self, points: Array, time: float) -> Array:
        """Where points (n, 3) [m] before the motion are at a time."""
        if not any(self.rotation):
            return points + self.offset(time)
        pivot = np.asarray(self.pivot)
        return (points - pivot) @ self.turn(time).T + pivot + self.offset(time)


def rotation_matrix(vector: Array) -> Array:
    """Rotation (3, 3) about a vector (3,) by its length [rad] (Rodrigues' formula)."""
    angle = float(np.linalg.norm(vector))
    if angle == 0.0:
        return np.eye(3)
    x, y, z = np.asarray(vector) / angle
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + math.sin(angle) * cross + (1.0 - math.cos(angle)) * (cross @ cross)


STILL = Motion()
"""No motion."""
