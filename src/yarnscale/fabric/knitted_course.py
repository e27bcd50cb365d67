"""Courses of a knitted pattern across a piece, cut into wales, and the loops that borders take from them.

A piece is cut out of an endless pattern. Every wale begins with the loop that its first stitch is drawn through,
however far below that was knitted, and ends with the stitch that would next be drawn through the loops held there,
however far above. The other courses beyond a border are left out, which leaves the rest entangled as it was.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import PchipInterpolator

from yarnscale.arrays import Array, Integers
from yarnscale.drawing.curves import PeriodicCurve
from yarnscale.drawing.loop_paths import row_paths
from yarnscale.drawing.stitches import SIGNS, StitchChart
from yarnscale.errors import InputError
from yarnscale.fabric.sheet import NO_PATTERN
from yarnscale.yarn.pattern import YarnPattern

HALF_THICKNESS = 1.1
"""Height of drawn yarns from the middle plane at crossings [r]."""
_CLEAR = 0.25
"""Distance at which border loops are cut from the loops that they cross [course spacings, heights of a loop]."""
_UNLIKE = 0.25
"""Largest difference of heights of a plain pattern's loops, as a share."""


def not_knitted(found: object) -> InputError:
    """The error of a pattern that is no knitting of the kind that pieces are made of."""
    return InputError(
        "pattern of a knitted piece",
        expected="courses of one straight yarn each, a yarn along x; with other stitches than knit and purl, "
        "a chart of the pattern",
        found=found,
    )


@dataclass(frozen=True, eq=False)
class Strand:
    """Points (k, 3) along a yarn [r], with the vertex and tile of the pattern that they are; NO_PATTERN: drawn anew."""

    points: Array
    source: Integers
    tile: Integers

    @classmethod
    def drawn(cls, points: ArrayLike) -> Strand:
        """Points that no pattern has, (k, 3) or (3,)."""
        points = np.atleast_2d(np.asarray(points, np.float64))
        return cls(points, np.full(len(points), NO_PATTERN), np.zeros((len(points), 2), np.int64))

    @classmethod
    def merged(cls, parts: Sequence[Strand]) -> Strand:
        """Parts one after another."""
        return cls(
            np.concatenate([p.points for p in parts]),
            np.concatenate([p.source for p in parts]),
            np.concatenate([p.tile for p in parts]),
        )

    def __len__(self) -> int:
        return len(self.points)

    def part(self, begin: int, end: int) -> Strand:
        """Points begin … end − 1."""
        return Strand(self.points[begin:end], self.source[begin:end], self.tile[begin:end])

    def reversed(self) -> Strand:
        """The same from its other end."""
        return Strand(self.points[::-1], self.source[::-1], self.tile[::-1])

    def mirrored(self, width: float) -> Strand:
        """The same seen from the other side of a piece, x measured from there."""
        return Strand(self.points * [-1.0, 1.0, 1.0] + [width, 0.0, 0.0], self.source, self.tile)


def smooth(controls: Sequence[ArrayLike]) -> Strand:
    """A smooth line through points or tables of points, at steps of about a radius, without both ends."""
    points = np.concatenate([np.atleast_2d(np.asarray(c, np.float64)) for c in controls])
    along = _along(points)
    fine = PchipInterpolator(along, points)(np.linspace(0.0, along[-1], 40 * len(points)))
    length = _along(fine)
    count = max(1, round(length[-1] / 1.03))
    at = np.linspace(0.0, length[-1], count + 1)[1:-1]
    return Strand.drawn(np.stack([np.interp(at, length, fine[:, c]) for c in range(3)], axis=1).reshape(-1, 3))


def _along(points: Array) -> Array:
    return np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])


@dataclass(frozen=True, eq=False)
class Course:
    """A course across the piece from left to right; bounds (w + 1,): points at which wales begin, and the last one."""

    yarn: Strand
    bounds: Integers

    def wale(self, number: int) -> Strand:
        """The part of a course in a wale, its first and last point included."""
        return self.yarn.part(self.bounds[number], self.bounds[number + 1] + 1)


@dataclass(frozen=True, eq=False)
class BorderRow:
    """Loops along a border, from left to right; rise, fall (w,): first point above its cut, and behind it."""

    yarn: Strand
    rise: Integers
    fall: Integers

    def mirrored(self, width: float) -> BorderRow:
        """The row seen from the other end, x measured from there."""
        count = len(self.yarn)
        yarn = self.yarn.reversed().mirrored(width)
        return BorderRow(yarn, count - self.fall[::-1], count - self.rise[::-1])


@dataclass(eq=False)
class KnittedCourses:
    """The courses of a pattern over ``columns`` periods: number 0 is the lowest of the piece, those below negative.

    chart: what the pattern was drawn from; None for knit and purl stitches alone. Raises InputError for other patterns.
    """

    pattern: YarnPattern
    columns: int
    chart: StitchChart | None = None
    wales: int = field(init=False)
    _paths: list[Array] = field(init=False, default_factory=list)
    _found: dict[int, Course] = field(init=False, default_factory=dict)

    def __post_init__(self) -> None:
        pattern, chart = self.pattern, self.chart
        if (pattern.yarn_shift != np.array([1, 0])).any():
            raise not_knitted(f"yarns that move {pattern.yarn_shift.tolist()} periods")
        if chart is None or (chart.plain and chart.beds == 1):
            self.chart, self._per_period = None, _plain_loops(pattern)
        else:
            if chart.courses != len(pattern.yarns):
                raise not_knitted(f"{len(pattern.yarns)} yarns in {chart.courses} courses (plated yarns)")
            self._per_period = chart.wales
            size = np.array([self.width / self.columns / chart.wales, self.height, HALF_THICKNESS])
            self._paths = [path * size for path in row_paths(chart)]
        self.wales = self.columns * self._per_period

    @property
    def height(self) -> float:
        """Of a course [r]."""
        return float(self.pattern.period[1]) / len(self.pattern.yarns) / self.pattern.radius

    @property
    def width(self) -> float:
        """Of the piece [r]."""
        return self.columns * float(self.pattern.period[0]) / self.pattern.radius

    def kind(self, number: int) -> int:
        """Number of the material of a course's yarn."""
        assert self.pattern.yarn_material is not None
        return int(self.pattern.yarn_material[number % len(self.pattern.yarns)])

    def course(self, number: int) -> Course:
        """A course across the piece."""
        if number not in self._found:
            self._found[number] = self._read(number)
        return self._found[number]

    def lower(self, courses: int) -> list[Strand]:
        """For every wale the head of the loop that its first stitches are drawn through."""
        floor = min(float(self.course(n).yarn.points[:, 1].min()) for n in range(courses + 1))
        heads = []
        for wale in range(self.wales):
            back = 1 if self.chart is None else self.chart.held(0, wale % self._per_period)[0]
            loop = self.course(-back).wale(wale)
            rise, fall = _above(loop, floor - _CLEAR * self.height)
            heads.append(loop.part(rise, fall))
        return heads

    def upper(self, courses: int) -> BorderRow:
        """The row of stitches drawn through the loops held on the needles after so many courses, up to their heads."""
        parts, rises, falls, before, count = [], [], [], None, 0
        for wale in range(self.wales):
            number, waiting = self._next_stitch(courses, wale)
            course = self.course(number)
            if before is not None and before != number:
                # The yarn climbs from one level to the other between the wales.
                end = self.course(before).wale(wale - 1).reversed().part(0, 1)
                climb = smooth([end.points, course.wale(wale).points[0]])
                parts += [end, climb]
                count += 1 + len(climb)
            loop = course.wale(wale)
            own = float(loop.points[:, 1].max())
            met = [float(self.course(n).wale(wale).points[:, 1].max()) for n in waiting]
            rise, fall = _above(loop, max(met) + _CLEAR * (own - max(met)))
            rises.append(count + rise)
            falls.append(count + fall)
            last = wale + 1 == self.wales
            parts.append(loop if last else loop.part(0, len(loop) - 1))
            count, before = count + len(parts[-1]), number
        return BorderRow(Strand.merged(parts), np.array(rises), np.array(falls))

    def _next_stitch(self, courses: int, wale: int) -> tuple[int, list[int]]:
        """The course of the stitch drawn through the loops held at a wale, and the courses of those loops."""
        if self.chart is None:
            return courses, [courses - 1]
        column, row = wale % self._per_period, courses % self.chart.courses
        ahead = 0 if self.chart.rows[row][column] in SIGNS else self.chart.next_knit(row, column)
        held = self.chart.held((row + ahead) % self.chart.courses, column)
        return courses + ahead, [courses + ahead - back for back in held if back > ahead]

    def _read(self, number: int) -> Course:
        pattern = self.pattern
        tall, place = divmod(number, len(pattern.yarns))
        chain = pattern.yarns[place]
        if not self._paths:
            walked, points = pattern.tile_along_yarn[chain], pattern.vertices[chain] / pattern.radius
            first = _bounds(pattern, place, self._per_period)
        else:
            # Loops of such patterns are displaced by each other, so the places of wales are taken from a drawing.
            period = pattern.period / pattern.radius
            walked = np.zeros((len(chain), 2), np.int64)
            points = PeriodicCurve(self._paths[place], (1, 0)).resampled(len(chain), period).points
            begins = np.arange(self._per_period) * self.width / self.wales
            first = np.array([int(np.flatnonzero(points[:, 0] >= begin)[0]) for begin in begins])
        bounds = np.concatenate([first + turn * len(chain) for turn in range(self.columns)])
        bounds = np.append(bounds, first[0] + self.columns * len(chain))
        if (np.diff(bounds) < 2).any():
            raise not_knitted(f"course {place + 1} turns back between its wales")
        order = np.arange(bounds[0], bounds[-1] + 1)
        turn, at = np.divmod(order, len(chain))
        tile = walked[at] + np.stack([turn, np.full(len(order), tall)], 1)
        points = points[at]
        points[:, :2] += tile * pattern.period / pattern.radius
        return Course(Strand(points, chain[at], tile), bounds - bounds[0])


def _bounds(pattern: YarnPattern, place: int, wales: int) -> Integers:
    """Vertices of a course, counted along it, nearest to where its wales begin; where it passes there often, lowest."""
    chain = pattern.yarns[place]
    walked = pattern.tile_along_yarn[chain]
    width = float(pattern.period[0])
    x = pattern.vertices[chain, 0] + walked[:, 0] * width
    y = pattern.vertices[chain, 1] + walked[:, 1] * pattern.period[1]
    laps = np.arange(-2, 3)
    x, y = (x + laps[:, None] * width).ravel(), np.tile(y, len(laps))
    found = []
    for wale in range(wales):
        away = x - wale * width / wales
        passes = np.flatnonzero((away[1:] >= 0) != (away[:-1] >= 0))
        near = passes + (np.abs(away[passes + 1]) < np.abs(away[passes]))
        found.append(int(near[np.argmin(y[near])]) + laps[0] * len(chain))
    return np.array(found)


def _above(loop: Strand, cut: float) -> tuple[int, int]:
    """The first point of a loop's head above a cut, and the one behind the last."""
    below, top = np.flatnonzero(loop.points[:, 1] <= cut), int(loop.points[:, 1].argmax())
    before, after = below[below < top], below[below > top]
    if not len(before) or not len(after):
        raise not_knitted("loops that do not reach through others")
    return int(before[-1]) + 1, int(after[0])


def _plain_loops(pattern: YarnPattern) -> int:
    """Loops in every course of a pattern of knit and purl stitches."""
    heights = [float(np.ptp(pattern.vertices[chain, 1])) for chain in pattern.yarns]
    course = float(pattern.period[1]) / len(heights)
    if max(heights) > (1 + _UNLIKE) * min(heights) or not course < min(heights) < 2 * course:
        raise not_knitted("loops of other heights, and no chart")
    counts = set()
    for chain in pattern.yarns:
        y = pattern.vertices[chain, 1] + pattern.tile_along_yarn[chain, 1] * pattern.period[1]
        above = y > 0.5 * (y.min() + y.max())
        counts.add(int((above != np.roll(above, 1)).sum()) // 2)
    if len(counts) > 1 or counts == {0}:
        raise not_knitted("other numbers of loops in its courses")
    return counts.pop()
