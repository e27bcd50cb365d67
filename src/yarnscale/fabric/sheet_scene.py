"""What happens to a sheet of yarns: it hangs, is stretched between two grips, or drapes over a ball."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from yarnscale.errors import InputError
from yarnscale.fabric.direct_energy import FabricEnergy
from yarnscale.fabric.direct_obstacles import Pushes, sphere
from yarnscale.fabric.direct_static import Holds
from yarnscale.fabric.sheet import NO_PATTERN, YarnSheet

Array = NDArray[np.float64]

_GRIP = 5.0
"""Width of a grip [radii]."""
_PULLED = 0.7
"""Share of the time in which grips move."""


@dataclass(frozen=True, eq=False)
class SheetScene:
    """gravity [m/s²], holds at a time [s], a ball (centre [m], radius [m]) or None.

    pulled: (k,) which of the held vertices are in the second grip, axis: along which it moves.
    """

    gravity: tuple[float, float, float]
    holds: Callable[[float], Holds]
    ball: tuple[tuple[float, float, float], float] | None = None
    pulled: NDArray[np.bool_] | None = None
    axis: int = 0

    def obstacles(self, energy: FabricEnergy, *, friction: float = 0.0) -> tuple[Pushes, ...]:
        """The ball, as the simulation meets it; friction: coefficient of yarns on it."""
        return () if self.ball is None else (Pushes(energy, sphere(*self.ball), friction=friction),)

    def force(self, energy: FabricEnergy, x: Array, time: float) -> float:
        """Force on the second grip along its way [N]; NaN where none is pulled."""
        if self.pulled is None:
            return math.nan
        return float(self.holds(time).forces(energy, x)[self.pulled, self.axis].sum())


def hang(sheet: YarnSheet) -> SheetScene:
    """Held along its last row, under gravity down the wales."""
    top = _border(sheet, 1, last=True)
    targets = sheet.vertices[top]
    return SheetScene((0.0, -9.81, 0.0), lambda time: Holds(top, targets))


def stretch(sheet: YarnSheet, *, amount: float = 0.2, axis: int = 0, duration: float = 1.0) -> SheetScene:
    """Two grips along opposite borders move apart, by ``amount`` of the length between them, and then stand still.

    axis: 0 along the courses (weft), 1 along the wales (warp). Raises InputError for an amount that is no stretch.
    """
    if not (math.isfinite(amount) and -0.5 < amount <= 3.0):
        raise InputError("stretch", expected="a number from -0.5 to 3", found=amount)
    sides = _border(sheet, axis, last=False), _border(sheet, axis, last=True)
    nodes, second = np.concatenate(sides), np.repeat([False, True], [len(s) for s in sides])
    places = sheet.vertices[nodes]
    low, high = _ends(sheet, axis)
    between = high - low - 2.0 * _GRIP * sheet.radius

    def holds(time: float) -> Holds:
        share = min(1.0, max(0.0, time / (_PULLED * duration)))
        targets = places.copy()
        targets[:, axis] += 0.5 * amount * between * share * np.where(second, 1.0, -1.0)
        return Holds(nodes, targets)

    return SheetScene((0.0, 0.0, 0.0), holds, pulled=second, axis=axis)


def drape(sheet: YarnSheet) -> SheetScene:
    """Over a ball of a fifth of its width, which its middle touches, under gravity through the thickness."""
    low, high = sheet.vertices.min(axis=0), sheet.vertices.max(axis=0)
    radius = 0.2 * float(min(high[0] - low[0], high[1] - low[1]))
    middle = 0.5 * (low + high)
    centre = (float(middle[0]), float(middle[1]), float(low[2] - radius - 1.5 * sheet.radius))
    return SheetScene((0.0, 0.0, -9.81), lambda time: Holds.none(), (centre, radius))


def _ends(sheet: YarnSheet, axis: int) -> tuple[float, float]:
    """Where the fabric begins and ends; turns and ends of yarn at a selvedge lie farther out."""
    fabric = sheet.source != NO_PATTERN
    place = sheet.vertices[fabric if fabric.any() else slice(None), axis]
    return float(place.min()), float(place.max())


def _border(sheet: YarnSheet, axis: int, *, last: bool) -> NDArray[np.int64]:
    place, (low, high) = sheet.vertices[:, axis], _ends(sheet, axis)
    width = _GRIP * sheet.radius
    return np.flatnonzero(place > high - width if last else place < low + width)
