"""Loads and handles of a sheet of yarns: it hangs, is stretched between two grips, or drapes over a ball."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from yarnscale.arrays import Array, Integers
from yarnscale.errors import InputError, not_negative
from yarnscale.fabric.direct_obstacles import Pushes
from yarnscale.fabric.holds import Holds, YarnPoints
from yarnscale.fabric.sheet import NO_PATTERN, YarnSheet
from yarnscale.kinematics import GRAVITY
from yarnscale.motion.handles import Handle
from yarnscale.motion.obstacles import Obstacle, Sphere
from yarnscale.motion.rigid import STILL, Motion
from yarnscale.motion.schedule import Schedule

_GRIP = 5.0
"""Width of a grip [radii]."""
_PULLED = 0.7
"""Share of the time in which grips move."""
SECOND = "second grip"


@dataclass(frozen=True, eq=False)
class SheetScene:
    """Gravity [m/s²], handles, obstacles and the friction of yarns on them.

    axis: along which the handle ``SECOND`` is pulled away from the other one; None where none pulls.
    """

    gravity: tuple[float, float, float]
    handles: tuple[Handle, ...] = ()
    obstacles: tuple[Obstacle, ...] = ()
    friction: float = 0.0
    axis: int | None = None

    def holds(self, time: float) -> Holds:
        """Held vertices and their targets at a time [s]."""
        nodes = np.concatenate([*(handle.vertices for handle in self.handles), np.empty(0, np.int64)])
        places = np.concatenate([*(handle.places(time) for handle in self.handles), np.empty((0, 3))])
        owner = np.repeat(np.arange(len(self.handles)), [len(handle.vertices) for handle in self.handles])
        return Holds(nodes, places, handles={h.name: owner == k for k, h in enumerate(self.handles)})

    def pushes(self, energy: YarnPoints) -> tuple[Pushes, ...]:
        """The obstacles as contacts of the simulation."""
        return tuple(Pushes(energy, obstacle, friction=self.friction) for obstacle in self.obstacles)

    def force(self, energy: YarnPoints, x: Array, time: float) -> float:
        """Mean force by which springs pull the handles apart [N], else NaN."""
        holds = self.holds(time)
        return self.pull(holds, holds.forces(energy, x))

    def pull(self, holds: Holds, forces: Array) -> float:
        """Mean of forces on held vertices (k, 3) [N] that pulls the handles apart [N], else NaN."""
        if self.axis is None:
            return math.nan
        along, second = forces[:, self.axis], holds.handles[SECOND]
        return 0.5 * float(along[second].sum() - along[~second].sum())


@dataclass(frozen=True, eq=False)
class HandleRegion:
    """Vertices of a fabric with a common prescribed motion.

    bounds: of a box of the fabric as it is laid, from its middle (2, 2) [m]; or of a box of space (2, 3) [m]; or a
    point of the fabric (2,) [m] whose nearest vertex is held.
    """

    name: str
    bounds: Array
    motion: Motion = STILL

    def nodes(self, sheet: YarnSheet, middle: Array) -> Integers:
        """The vertices (k,). Raises InputError where there are none."""
        places = sheet.vertices if self.bounds.shape == (2, 3) else (sheet.vertices - middle)[:, :2]
        if self.bounds.ndim == 1:
            return np.array([np.argmin(np.linalg.norm(places - self.bounds, axis=1))])
        low, high = self.bounds
        found = np.flatnonzero(((places >= low - 1e-9) & (places <= high + 1e-9)).all(axis=1))
        if not len(found):
            ends = " to ".join(str(tuple(float(f"{v:.3g}") for v in end)) for end in (places.min(0), places.max(0)))
            raise InputError(f"handle '{self.name}'", expected="vertices in its region", found=f"all from {ends} m")
        return found


@dataclass(frozen=True, eq=False)
class PlannedScene:
    """A scene for any sheet: gravity [m/s²], handles, obstacles and friction on these, schedule, damping [1/s].

    position: of the middle of the sheet at the start [m]. may_give_way: whether handles may miss their places.
    """

    schedule: Schedule
    gravity: tuple[float, float, float] = (0.0, 0.0, -GRAVITY)
    handles: tuple[HandleRegion, ...] = ()
    obstacles: tuple[Obstacle, ...] = ()
    friction: float = 0.0
    position: tuple[float, float, float] = (0.0, 0.0, 0.0)
    damping: float = 1.0
    may_give_way: bool = False

    def __post_init__(self) -> None:
        for name in ("friction", "damping"):
            not_negative(name, getattr(self, name))

    def laid(self, sheet: YarnSheet) -> YarnSheet:
        """The sheet with its middle in place."""
        return sheet.moved(sheet.vertices + np.array(self.position) - _middle(sheet))

    def of(self, sheet: YarnSheet) -> SheetScene:
        """The scene of a sheet in place. Raises InputError where handles have no vertices, or the same one."""
        held = [
            _handle(f"handle '{h.name}'", sheet, h.nodes(sheet, np.array(self.position)), h.motion)
            for h in self.handles
        ]
        scene = SheetScene(self.gravity, tuple(held), self.obstacles, self.friction)
        nodes = scene.holds(0.0).nodes
        if len(np.unique(nodes)) < len(nodes):
            raise InputError("handles", expected="different vertices each", found="vertices that two hold")
        return scene


def _handle(name: str, sheet: YarnSheet, nodes: Integers, motion: Motion = STILL) -> Handle:
    return Handle(name, nodes, sheet.vertices[nodes], motion)


def _middle(sheet: YarnSheet) -> Array:
    return 0.5 * (sheet.vertices.min(axis=0) + sheet.vertices.max(axis=0))


def hang(sheet: YarnSheet) -> SheetScene:
    """Held along its last row, under gravity down the wales."""
    return SheetScene((0.0, -GRAVITY, 0.0), (_handle("held row", sheet, _border(sheet, 1, last=True)),))


def stretch(sheet: YarnSheet, *, amount: float = 0.2, axis: int = 0, duration: float = 1.0) -> SheetScene:
    """Two grips along opposite borders move apart by ``amount`` of the length between them, and then stop.

    axis: 0 along the courses (weft), 1 along the wales (warp). Raises InputError for an amount that is no stretch.
    """
    if not (math.isfinite(amount) and -0.5 < amount <= 3.0):
        raise InputError("stretch", expected="a number from -0.5 to 3", found=amount)
    sides = _border(sheet, axis, last=False), _border(sheet, axis, last=True)
    low, high = _ends(sheet, axis)
    travel = 0.5 * amount * (high - low - 2.0 * _GRIP * sheet.radius)
    return pulled_apart(sheet, sides, travel, axis=axis, duration=_PULLED * duration)


def pulled_apart(
    sheet: YarnSheet,
    grips: tuple[Integers, Integers],
    travel: float,
    *,
    axis: int,
    duration: float,
    gravity: tuple[float, float, float] = (0.0, 0.0, 0.0),
) -> SheetScene:
    """Two grips, each with its vertices, move by ``travel`` [m] down and up an axis in ``duration`` [s], and stop."""
    upwards = tuple(travel * float(k == axis) for k in range(3))
    held = tuple(
        _handle(name, sheet, nodes, Motion(tuple(sign * w for w in upwards), 0.0, duration, ease=False))  # type: ignore[arg-type]
        for name, nodes, sign in zip(("first grip", SECOND), grips, (-1.0, 1.0), strict=True)
    )
    return SheetScene(gravity, held, axis=axis)


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
    middle = _middle(sheet)
    top = float(low[2] - 1.5 * sheet.radius)
    centre = (float(middle[0]) + aside[0], float(middle[1]) + aside[1], top - ball)
    return SheetScene((0.0, 0.0, -GRAVITY), (), (Sphere(centre, ball),), friction)


def _ends(sheet: YarnSheet, axis: int) -> tuple[float, float]:
    """Lowest and highest place of the fabric along an axis, without turns and ends of yarn at a selvedge."""
    fabric = sheet.source != NO_PATTERN
    place = sheet.vertices[fabric if fabric.any() else slice(None), axis]
    return float(place.min()), float(place.max())


def _border(sheet: YarnSheet, axis: int, *, last: bool) -> Integers:
    place, (low, high) = sheet.vertices[:, axis], _ends(sheet, axis)
    width = _GRIP * sheet.radius
    return np.flatnonzero(place > high - width if last else place < low + width)
