"""Knit and purl stitches as jersey in LOD03: one spline yarn a row, joined by contacts of two points each.

A yarn of jersey of n stitches has 8 segments a stitch, so 8 n + 3 control points, and two contacts a stitch: where
the legs of a loop lie on the head of the loop that it is drawn through. Where knit and purl stitches meet, loops turn
out of the fabric, and their feet would pass through the legs below: these are contacts too, four a stitch. The first
row has nothing to be drawn through; its loops are closed by contacts of the yarn with itself, as a cast-on does.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from yarnscale.arrays import Array, Flags, Integers
from yarnscale.drawing.curves import PeriodicCurve
from yarnscale.drawing.knit import knit
from yarnscale.drawing.loop_paths import line_crossings
from yarnscale.drawing.stitches import SIGNS, StitchChart
from yarnscale.errors import InputError
from yarnscale.fabric.bspline import ORDER, blending, control_of_periodic, segment_and_place
from yarnscale.fabric.spline_period import SplinePeriod
from yarnscale.yarn.material import YarnMaterial
from yarnscale.yarn.pattern import YarnPattern

JERSEYS = ("jersey", "single-jersey", "stockinette")
"""Names of built-in patterns that ``jersey`` makes."""
JERSEY_SEGMENTS = 8
"""Segments of a stitch of jersey (LOD03)."""
SEGMENTS_PER_STITCH = 16
"""Segments of a stitch where knit and purl stitches adjoin: with 8, sinkers between them would cut through loops."""
_DENSE = 512
"""Points per stitch of the polylines that crossings are looked for on."""
_CROSSINGS = 4
"""Crossings of a loop and the one that it is drawn through, in the plan."""
_LEGS = slice(1, 3)
"""Crossings of its legs with the head; the others are those of its feet with the legs."""


@dataclass(frozen=True, eq=False)
class CurvePoints:
    """Points on yarns: of yarn ``yarn`` (k,) at curve parameter ``place`` (k,), in segments from its beginning."""

    yarn: Integers
    place: Array

    def __len__(self) -> int:
        return len(self.yarn)

    def some(self, kept: Flags) -> CurvePoints:
        """Those of the points that are kept (k,)."""
        return CurvePoints(self.yarn[kept], self.place[kept])


@dataclass(frozen=True, eq=False)
class SplineFabric:
    """Yarns of equal length as uniform cubic B-splines, and the contacts between them.

    control: control points at rest [m], (yarns, points, 3); radius: of the yarn [m]; first, second: the two points
    of every contact; top: points by which the fabric can be hung, one a stitch; period: one period of the stitches,
    of which the first yarn is the course ``first_course``.
    """

    control: Array
    radius: float
    material: YarnMaterial
    first: CurvePoints
    second: CurvePoints
    top: CurvePoints
    period: SplinePeriod | None = None
    first_course: int = 0
    segments: Integers = field(init=False, repr=False)

    def __post_init__(self) -> None:
        yarns, points, _ = self.control.shape
        begin = np.arange(points - ORDER + 1)
        segments = (np.arange(yarns)[:, None] * points + begin)[:, :, None] + np.arange(ORDER)
        object.__setattr__(self, "segments", segments.reshape(-1, ORDER))

    @property
    def yarn_count(self) -> int:
        return self.control.shape[0]

    @property
    def points_per_yarn(self) -> int:
        return self.control.shape[1]

    @property
    def segments_per_yarn(self) -> int:
        return self.points_per_yarn - ORDER + 1

    def counts(self) -> dict[str, int]:
        """Sizes of the full model (LOD03 Figure 9)."""
        points, constraints = self.yarn_count * self.points_per_yarn, 3 * len(self.first)
        return {
            "control_points_per_yarn": self.points_per_yarn,
            "dofs_per_yarn": 3 * self.points_per_yarn,
            "control_points": points,
            "dofs": 3 * points,
            "constraints": constraints,
            "unknowns": 3 * points + constraints,
        }

    def unclosed(self) -> SplineFabric:
        """Without the contacts that close the first row's loops with itself, a chain that cannot be extended."""
        kept = self.first.yarn != self.second.yarn
        return replace(self, first=self.first.some(kept), second=self.second.some(kept))

    def part(self, begin: int, end: int) -> SplineFabric:
        """The yarns begin … end − 1, with the contacts between them."""
        yarns = np.arange(begin, end)
        kept = np.isin(self.first.yarn, yarns) & np.isin(self.second.yarn, yarns)
        sides = self.first.some(kept), self.second.some(kept), self.top.some(np.isin(self.top.yarn, yarns))
        first, second, top = (CurvePoints(points.yarn - begin, points.place) for points in sides)
        return replace(
            self, control=self.control[begin:end], first=first, second=second, top=top,
            first_course=self.first_course + begin,
        )  # fmt: skip

    def rows(self, points: CurvePoints, derivative: int = 0) -> tuple[Integers, Array]:
        """Control points (k, 4) that determine points of the yarns, and their weights (k, 4)."""
        segment, u = segment_and_place(points.place, self.segments_per_yarn)
        return self.segments[points.yarn * self.segments_per_yarn + segment], blending(u, derivative)

    def at(self, control: Array, points: CurvePoints, derivative: int = 0) -> Array:
        """Positions [m], or derivatives by the curve parameter, of points: (k, 3), for control points (n, 3)."""
        index, weights = self.rows(points, derivative)
        return np.einsum("kj,kjc->kc", weights, control[index])

    def lines(self, control: Array, per_segment: int = 2) -> Array:
        """The yarns as polylines (yarns, k, 3) with ``per_segment`` points a segment."""
        place = np.arange(self.segments_per_yarn * per_segment + 1) / per_segment
        points = CurvePoints(np.repeat(np.arange(self.yarn_count), len(place)), np.tile(place, self.yarn_count))
        return self.at(control.reshape(-1, 3), points).reshape(self.yarn_count, -1, 3)


def jersey(
    rows: int,
    columns: int,
    material: YarnMaterial,
    *,
    radius: float = 1e-3,
) -> SplineFabric:
    """Jersey of ``rows`` × ``columns`` stitches, flat, right side up (+z), centred on the origin; rows lie along x.

    radius [m]; a stitch is 9 radii wide and 6 high. Raises InputError.
    """
    pattern = knit("k", radius=radius, name="jersey")
    return spline_fabric(
        pattern, StitchChart.read("k"), rows, columns, material, segments_per_stitch=JERSEY_SEGMENTS, feet=False
    )


def spline_fabric(
    pattern: YarnPattern,
    chart: StitchChart,
    rows: int,
    columns: int,
    material: YarnMaterial,
    *,
    segments_per_stitch: int = SEGMENTS_PER_STITCH,
    feet: bool = True,
) -> SplineFabric:
    """``rows`` × ``columns`` periods of a pattern drawn from a chart of knit and purl stitches, flat; rows lie along x.

    feet: whether feet of loops have contacts too, with the legs of the loops that they are drawn through.

    Raises InputError for other stitches, and where loops do not cross each other as in knitting.
    """
    for name, value in (("rows", rows), ("columns", columns)):
        if not (isinstance(value, int | np.integer) and 1 <= value <= 1000):
            raise InputError(name, expected="a whole number from 1 to 1000", found=value)
    _check_stitches(pattern, chart)
    width, height = pattern.period
    lap = np.array([width, 0.0, 0.0])
    if segments_per_stitch not in (8, 16, 32):
        raise InputError("segments per stitch", expected="8, 16 or 32", found=segments_per_stitch)
    period = segments_per_stitch * chart.wales
    courses = [_course(pattern, place, period) for place in range(chart.courses)]
    middle_x = columns * width / 2 + float(courses[0][0][0, 0])
    lines = [_row(loop, lap, columns) - [middle_x, 0.0, 0.0] for _, loop in courses]
    step, count = height / chart.courses, rows * chart.courses
    tall = np.arange(count) // chart.courses * height - (count - 1) / 2 * step
    control = np.array([lines[n % chart.courses] + [0.0, tall[n], 0.0] for n in range(count)])
    fine = _DENSE // segments_per_stitch
    middle = [_dense(_row(loop, lap, 3), fine) for _, loop in courses]
    places, crossings = [], []
    for place, line in enumerate(middle):
        below = middle[place - 1] - [0.0, 0.0 if place else height, 0.0]
        low, high = _crossings(line, below, chart, place)
        places.append((low, high))
        crossings.append((_repeated(low / fine, columns, period), _repeated(high / fine, columns, period)))
    kept = slice(None) if feet else _LEGS
    contacts = _contacts(crossings, count, kept)
    last = (count - 1) % chart.courses
    _, heads = crossings[(last + 1) % chart.courses]
    tops = _tops(_dense(lines[last], fine), fine * heads.reshape(-1, _CROSSINGS)[:, _LEGS]) / fine
    stitches = [
        ((low / fine).reshape(-1, _CROSSINGS)[:, kept].ravel(), (high / fine).reshape(-1, _CROSSINGS)[:, kept].ravel())
        for low, high in places
    ]
    return SplineFabric(
        control, pattern.radius, material, *contacts, CurvePoints(np.full(len(tops), count - 1), tops),
        SplinePeriod.of([loop for _, loop in courses], lap, height, stitches),
    )  # fmt: skip


def _check_stitches(pattern: YarnPattern, chart: StitchChart) -> None:
    for row, text in enumerate(chart.rows):
        for column, symbol in enumerate(text):
            if symbol not in SIGNS:
                raise InputError(
                    f"chart {chart.place(row, column)}: stitch of spline yarns",
                    expected="k or p",
                    found=repr(symbol),
                )
    assert pattern.yarn_material is not None
    if pattern.yarn_radius is not None:
        raise InputError(
            "yarns of splines", expected="one radius", found=f"{len(set(pattern.yarn_radius.tolist()))} radii"
        )
    last = int(pattern.yarn_material.max())
    if last > 0:
        raise InputError("yarns of a spline fabric", expected="one material", found=f"{last + 1} materials")
    alike = len(pattern.yarns) == chart.courses and (pattern.yarn_shift == np.array([1, 0])).all()
    if chart.beds > 1 or not alike:
        raise InputError(
            "pattern of spline yarns",
            expected="one needle bed, a yarn a course",
            found=f"{len(pattern.yarns)} yarns in {chart.courses} courses of {chart.beds} needle beds",
        )


def _course(pattern: YarnPattern, place: int, count: int) -> tuple[Array, Array]:
    """Points at the knots of a course of one period, and its control points, both (count, 3) [m]."""
    chain = pattern.yarns[place]
    points = pattern.vertices[chain].copy()
    points[:, :2] += pattern.tile_along_yarn[chain] * pattern.period
    line = PeriodicCurve(points, (1, 0))
    if not pattern.polyline:
        line = line.smooth(pattern.period)
    knots = line.resampled(count, pattern.period).points
    lean = np.arange(count)[:, None] / count * np.array([pattern.period[0], 0.0, 0.0])
    # A spline reproduces straight lines, so only the periodic part of the course needs a solve.
    return knots, control_of_periodic(knots - lean)


def _row(loop: Array, lap: Array, columns: int) -> Array:
    """Control points of a row from those of one period, periodic up to ``lap`` [m]."""
    knots = np.arange(-1, len(loop) * columns + 2)  # control point j acts most at knot j − 1
    return loop[knots % len(loop)] + knots[:, None] / len(loop) * lap


def _repeated(place: Array, columns: int, period: int) -> Array:
    """Places on one period of so many segments, on all periods of a row."""
    return (period * np.arange(columns)[:, None] + place).ravel()


def _dense(control: Array, per_segment: int) -> Array:
    """The line of control points (k, 3), with so many points a segment."""
    along = np.arange((len(control) - ORDER + 1) * per_segment + 1) / per_segment
    segment, u = segment_and_place(along, len(control) - ORDER + 1)
    return np.einsum("kj,kjc->kc", blending(u), control[segment[:, None] + np.arange(ORDER)])


def _crossings(line: Array, below: Array, chart: StitchChart, place: int) -> tuple[Array, Array]:
    """Where a course crosses the one below, (4 a stitch): points on it, and on that; counted from a period's first.

    line, below: three periods of each, of which the middle one has all its neighbours. In the plan a loop crosses the
    one below with a foot, its two legs and the other foot; with its legs in front of the head for a knit stitch, behind
    it for a purl stitch, with its feet on the other side.
    """
    index, lap = np.arange(len(line)), (len(line) - 1) // 3
    stitch, on_line, on_below = lap // chart.wales, [], []
    for wale, symbol in enumerate(chart.rows[place]):
        begin = lap + wale * stitch
        # A stitch crosses the stitch below it, or loops that lean over from that one's neighbours.
        first, second = line[begin : begin + stitch + 1], below[begin - stitch : begin + 2 * stitch + 1]
        low, high = line_crossings(first[:, :2], second[:, :2])
        order = np.argsort(low)
        low, high = low[order] + begin, high[order] + begin - stitch
        above = np.interp(low, index, line[:, 2]) > np.interp(high, index, below[:, 2])
        own = SIGNS[symbol] > 0
        if above.tolist() != [not own, own, own, not own]:
            raise InputError(
                f"chart {chart.place(place, wale)}: loop that does not interlock with the one below",
                expected="legs that cross its head on the side of the stitch, feet that cross its legs on the other",
                found=f"{len(low)} crossings, {int(above.sum())} in front",
            )
        on_line.append(low - lap)
        on_below.append(high - lap)
    return np.concatenate(on_line), np.concatenate(on_below)


def _tops(line: Array, heads: Array) -> Array:
    """The highest point of every loop of a line, between both points (s, 2) at which legs lie on its head."""
    found = []
    for pair in heads:
        begin, end = np.sort(np.round(pair).astype(np.int64))
        found.append(begin + int(line[begin : end + 1, 1].argmax()))
    return np.array(found)


def _contacts(crossings: list[tuple[Array, Array]], rows: int, kept: slice) -> tuple[CurvePoints, CurvePoints]:
    """Each row on the row below; the first row's loops closed with itself, and its beginning tied.

    crossings: for every course of the chart the places on it and on the course below; kept: which of the four.
    """
    own = crossings[0][0].reshape(-1, _CROSSINGS)[:, _LEGS]
    closing = (
        np.concatenate([own[:, 0], own[:-1, 1], [0.0]]),
        np.concatenate([own[:, 1], own[1:, 0], [own[0, 0]]]),
    )
    low, high = (
        [crossings[n % len(crossings)][k].reshape(-1, _CROSSINGS)[:, kept].ravel() for n in range(1, rows)]
        for k in range(2)
    )
    upper = np.repeat(np.arange(1, rows), [len(places) for places in low])
    still = np.zeros(len(closing[0]), np.int64)
    first = CurvePoints(np.concatenate([still, upper]), np.concatenate([closing[0], *low]))
    second = CurvePoints(np.concatenate([still, upper - 1]), np.concatenate([closing[1], *high]))
    return first, second
