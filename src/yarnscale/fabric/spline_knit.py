"""Plain jersey as LOD03 has it: one spline yarn a row, held together by contacts of two points each.

A yarn of n stitches has 8 segments a stitch, so 8 n + 3 control points, and two contacts a stitch: where the legs of
a loop lie on the head of the loop that it is drawn through. The first row has nothing to be drawn through; its loops
are closed by contacts of the yarn with itself, as a cast-on does.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from yarnscale.errors import InputError
from yarnscale.fabric.bspline import ORDER, blending, control_of_periodic, located
from yarnscale.yarn.curves import PeriodicCurve
from yarnscale.yarn.knit import knit
from yarnscale.yarn.loop_paths import line_crossings
from yarnscale.yarn.material import YarnMaterial

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

SEGMENTS_PER_STITCH = 8
_DENSE = 64
"""Points per segment of the polylines that crossings are looked for on."""


@dataclass(frozen=True, eq=False)
class CurvePoints:
    """Points on yarns: of yarn ``yarn`` (k,) at curve parameter ``place`` (k,), in segments from its beginning."""

    yarn: Indices
    place: Array

    def __len__(self) -> int:
        return len(self.yarn)


@dataclass(frozen=True, eq=False)
class SplineFabric:
    """Yarns of equal length as uniform cubic B-splines, and the contacts between them.

    control: control points at rest [m], (yarns, points, 3); radius: of the yarn [m]; first, second: the two points
    of every contact; top: points by which the fabric can be hung, one a stitch.
    """

    control: Array
    radius: float
    material: YarnMaterial
    first: CurvePoints
    second: CurvePoints
    top: CurvePoints
    segments: Indices = field(init=False, repr=False)

    def __post_init__(self) -> None:
        yarns, points, _ = self.control.shape
        begin = np.arange(points - ORDER + 1)
        segments = (np.arange(yarns)[:, None] * points + begin)[:, :, None] + np.arange(ORDER)
        object.__setattr__(self, "segments", segments.reshape(-1, ORDER))

    @property
    def yarn_count(self) -> int:
        """Number of yarns."""
        return self.control.shape[0]

    @property
    def points_per_yarn(self) -> int:
        """Control points of each yarn."""
        return self.control.shape[1]

    @property
    def segments_per_yarn(self) -> int:
        """Spline segments of each yarn."""
        return self.points_per_yarn - ORDER + 1

    def counts(self) -> dict[str, int]:
        """Sizes of the full model, as LOD03 Figure 9 has them."""
        points, constraints = self.yarn_count * self.points_per_yarn, 3 * len(self.first)
        return {
            "control_points_per_yarn": self.points_per_yarn,
            "dofs_per_yarn": 3 * self.points_per_yarn,
            "control_points": points,
            "dofs": 3 * points,
            "constraints": constraints,
            "unknowns": 3 * points + constraints,
        }

    def rows(self, points: CurvePoints, derivative: int = 0) -> tuple[Indices, Array]:
        """Control points (k, 4) that act on points of the yarns, and with what weights (k, 4)."""
        segment, u = located(points.place, self.segments_per_yarn)
        return self.segments[points.yarn * self.segments_per_yarn + segment], blending(u, derivative)

    def at(self, control: Array, points: CurvePoints, derivative: int = 0) -> Array:
        """Positions [m], or derivatives by the curve parameter, of points: (k, 3), for control points (n, 3)."""
        index, weights = self.rows(points, derivative)
        return np.einsum("kj,kjc->kc", weights, control[index])

    def lines(self, control: Array, per_segment: int = 2) -> Array:
        """The yarns as polylines (yarns, k, 3) with ``per_segment`` points a segment."""
        place = np.arange(self.segments_per_yarn * per_segment + 1) / per_segment
        points = CurvePoints(
            np.repeat(np.arange(self.yarn_count), len(place)), np.tile(place, self.yarn_count)
        )
        return self.at(control.reshape(-1, 3), points).reshape(self.yarn_count, -1, 3)


def jersey(
    rows: int,
    columns: int,
    material: YarnMaterial,
    *,
    radius: float = 1e-3,
    wale_spacing: float = 9.0,
    course_spacing: float = 6.0,
) -> SplineFabric:
    """Jersey of ``rows`` × ``columns`` stitches, flat, right side up (+z), centred on the origin; rows lie along x.

    radius [m]; wale_spacing, course_spacing [radii], see ``yarn.knit``. Raises InputError.
    """
    for name, value in (("rows", rows), ("columns", columns)):
        if not (isinstance(value, int | np.integer) and 1 <= value <= 1000):
            raise InputError(name, expected="a whole number from 1 to 1000", found=value)
    pattern = knit("k", radius=radius, wale_spacing=wale_spacing, course_spacing=course_spacing)
    width, height = pattern.period
    stitch = PeriodicCurve(pattern.vertices[pattern.yarns[0]], (1, 0)).resampled(
        SEGMENTS_PER_STITCH, pattern.period
    )
    lean = np.arange(SEGMENTS_PER_STITCH)[:, None] / SEGMENTS_PER_STITCH * np.array([width, 0.0, 0.0])
    # A spline reproduces straight motion, so only the periodic part of the stitch asks for a solve.
    loop = control_of_periodic(stitch.points - lean)
    lap = np.array([width, 0.0, 0.0])
    row = _row(loop, lap, columns) - [columns * width / 2 + stitch.points[0, 0], 0.0, 0.0]
    control = row + (np.arange(rows)[:, None, None] - (rows - 1) / 2) * np.array([0.0, height, 0.0])
    low, high, top = _stitch_places(_row(loop, lap, 3), radius, material, height)
    contacts = _contacts(_repeated(low, columns), _repeated(high, columns), rows)
    tops = _repeated(top, columns)
    return SplineFabric(control, radius, material, *contacts, CurvePoints(np.full(len(tops), rows - 1), tops))


def _row(loop: Array, lap: Array, columns: int) -> Array:
    """Control points of a row from those of one stitch, periodic up to ``lap`` [m]."""
    knots = np.arange(-1, SEGMENTS_PER_STITCH * columns + 2)  # control point j acts most at knot j − 1
    return loop[knots % SEGMENTS_PER_STITCH] + knots[:, None] / SEGMENTS_PER_STITCH * lap


def _repeated(place: Array, columns: int) -> Array:
    """Places on one stitch, on all stitches of a row."""
    return (SEGMENTS_PER_STITCH * np.arange(columns)[:, None] + place).ravel()


def _stitch_places(
    row: Array, radius: float, material: YarnMaterial, height: float
) -> tuple[Array, Array, Array]:
    """Where a stitch takes part in contacts: on its legs (2), on its head (2); and its top (1).

    In the plan a row crosses the one below four times a stitch; twice it lies in front of it: legs on a head.
    ``row``: control points of three stitches, of which the middle one has all its neighbours.
    """
    none = CurvePoints(np.empty(0, np.int64), np.empty(0))
    line = SplineFabric(row[None], radius, material, none, none, none).lines(row, _DENSE)[0]
    below = line - [0.0, height, 0.0]
    on_row, on_below = line_crossings(line[:, :2], below[:, :2])
    index, stitch = np.arange(len(line)), _DENSE * SEGMENTS_PER_STITCH
    front = np.interp(on_row, index, line[:, 2]) > np.interp(on_below, index, below[:, 2])
    chosen = front & (on_row >= stitch) & (on_row < 2 * stitch)
    if chosen.sum() != 2:
        raise InputError(
            "loops of the jersey do not interlock", expected="2 contacts", found=int(chosen.sum())
        )
    top = stitch + int(line[stitch : 2 * stitch, 1].argmax())
    low, high = ((on[chosen] - stitch) / _DENSE for on in (on_row, on_below))
    return low, high, np.array([top - stitch]) / _DENSE


def _contacts(low: Array, high: Array, rows: int) -> tuple[CurvePoints, CurvePoints]:
    """Legs of each row on heads of the row below; the first row's loops closed with itself, and its beginning tied."""
    legs = low.reshape(-1, 2)  # left and right leg of each stitch
    closing = (
        np.concatenate([legs[:, 0], legs[:-1, 1], [0.0]]),
        np.concatenate([legs[:, 1], legs[1:, 0], [legs[0, 0]]]),
    )
    upper = np.repeat(np.arange(1, rows), len(low))
    still = np.zeros(len(closing[0]), np.int64)
    first = CurvePoints(np.concatenate([still, upper]), np.concatenate([closing[0], np.tile(low, rows - 1)]))
    second = CurvePoints(
        np.concatenate([still, upper - 1]), np.concatenate([closing[1], np.tile(high, rows - 1)])
    )
    return first, second
