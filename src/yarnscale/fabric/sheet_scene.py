"""What happens to a sheet of yarns: it hangs, is stretched between two grips, or drapes over a ball."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from yarnscale.errors import InputError
from yarnscale.fabric.direct_energy import FabricEnergy
from yarnscale.fabric.direct_obstacles import Pushes
from yarnscale.fabric.direct_static import Holds
from yarnscale.fabric.sheet import NO_PATTERN, YarnSheet
from yarnscale.motion.obstacles import Obstacle, Sphere

Array = NDArray[np.float64]

_GRIP = 5.0
"""Width of a grip [radii]."""
_PULLED = 0.7
"""Share of the time in which grips move."""


@dataclass(frozen=True, eq=False)
class SheetScene:
    """gravity [m/s²], holds at a time [s], obstacles and the friction of yarns on them.

    pulled: (k,) which of the held vertices are in the second grip, axis: along which it moves.
    """

    gravity: tuple[float, float, float]
    holds: Callable[[float], Holds]
    obstacles: tuple[Obstacle, ...] = ()
    friction: float = 0.0
    pulled: NDArray[np.bool_] | None = None
    axis: int = 0

    def pushes(self, energy: FabricEnergy) -> tuple[Pushes, ...]:
        """The obstacles, as the simulation meets them."""
        return tuple(Pushes(energy, obstacle, friction=self.friction) for obstacle in self.obstacles)

    def force(self, energy: FabricEnergy, x: Array, time: float, *, led: bool = False) -> float:
        """With which both grips are pulled apart, their mean [N]; NaN where none is pulled. led: by explicit steps."""
        if self.pulled is None:
            return math.nan
        holds = self.holds(time)
        forces = (holds.reactions(energy, x) if led else holds.forces(energy, x))[:, self.axis]
        return 0.5 * float(forces[self.pulled].sum() - forces[~self.pulled].sum())


def hang(sheet: YarnSheet) -> SheetScene:
    """Held along its last row, under gravity down the wales."""
    top = _border(sheet, 1, last=True)
    targets = sheet.vertices[top]
    grips = {"held row": np.ones(len(top), bool)}
    return SheetScene((0.0, -9.81, 0.0), lambda time: Holds(top, targets, grips=grips))


def stretch(sheet: YarnSheet, *, amount: float = 0.2, axis: int = 0, duration: float = 1.0) -> SheetScene:
    """Two grips along opposite borders move apart, by ``amount`` of the length between them, and then stand still.

    axis: 0 along the courses (weft), 1 along the wales (warp). Raises InputError for an amount that is no stretch.
    """
    if not (math.isfinite(amount) and -0.5 < amount <= 3.0):
        raise InputError("stretch", expected="a number from -0.5 to 3", found=amount)
    sides = _border(sheet, axis, last=False), _border(sheet, axis, last=True)
    low, high = _ends(sheet, axis)
    way = 0.5 * amount * (high - low - 2.0 * _GRIP * sheet.radius)
    return pulled_apart(sheet, sides, way, axis=axis, duration=_PULLED * duration)


def pulled_apart(
    sheet: YarnSheet,
    grips: tuple[NDArray[np.int64], NDArray[np.int64]],
    way: float,
    *,
    axis: int,
    duration: float,
    gravity: tuple[float, float, float] = (0.0, 0.0, 0.0),
) -> SheetScene:
    """Two grips, each with its vertices, go so far [m] down and up an axis in so long [s], and then stand still."""
    nodes, second = np.concatenate(grips), np.repeat([False, True], [len(grip) for grip in grips])
    places = sheet.vertices[nodes]

    def holds(time: float) -> Holds:
        share = min(1.0, max(0.0, time / duration))
        targets = places.copy()
        targets[:, axis] += way * share * np.where(second, 1.0, -1.0)
        return Holds(nodes, targets, grips={"first grip": ~second, "second grip": second})

    return SheetScene(gravity, holds, pulled=second, axis=axis)


def drape(
    sheet: YarnSheet,
    *,
    radius: float | None = None,
    aside: tuple[float, float] = (0.0, 0.0),
    friction: float = 0.0,
) -> SheetScene:
    """Over a ball under its middle, which it touches, under gravity through the thickness.

    radius: of the ball [m], by default a fifth of the sheet's width. aside: of it from under the middle, (x, y) [m].
    friction: of yarns on it.
    """
    low, high = sheet.vertices.min(axis=0), sheet.vertices.max(axis=0)
    ball = 0.2 * float(min(high[0] - low[0], high[1] - low[1])) if radius is None else radius
    middle = 0.5 * (low + high)
    top = float(low[2] - 1.5 * sheet.radius)
    centre = (float(middle[0]) + aside[0], float(middle[1]) + aside[1], top - ball)
    return SheetScene((0.0, 0.0, -9.81), lambda time: Holds.none(), (Sphere(centre, ball),), friction)


def _ends(sheet: YarnSheet, axis: int) -> tuple[float, float]:
    """Where the fabric begins and ends; turns and ends of yarn at a selvedge lie farther out."""
    fabric = sheet.source != NO_PATTERN
    place = sheet.vertices[fabric if fabric.any() else slice(None), axis]
    return float(place.min()), float(place.max())


def _border(sheet: YarnSheet, axis: int, *, last: bool) -> NDArray[np.int64]:
    place, (low, high) = sheet.vertices[:, axis], _ends(sheet, axis)
    width = _GRIP * sheet.radius
    return np.flatnonzero(place > high - width if last else place < low + width)
