"""Pieces of knitting: cast on, knitted to and fro, bound off (the edges of hand knitting).

A yarn begins with a row of twisted loops (backward-loop cast-on), each of which the first stitch of its wale is drawn
through; it turns at either selvedge into the next course; and the loops of a last row are each drawn through what waits
below *and* the loop before (chained bind-off), the end through the last of them. Between its borders the piece is the
pattern, vertex by vertex. Where the pattern changes its yarn, another one begins at the selvedge, or one that was left
on that side is carried up to there.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.spatial import KDTree

from yarnscale.arrays import Array
from yarnscale.drawing.stitches import StitchChart
from yarnscale.errors import InputError
from yarnscale.fabric.boundary import BorderSprings
from yarnscale.fabric.knitted_border import CARRY_STEP, cast_on, last_row, selvedge, tail
from yarnscale.fabric.knitted_course import KnittedCourses, Strand, not_knitted
from yarnscale.fabric.sheet import LARGEST_SHEET, NO_PATTERN, YarnSheet
from yarnscale.yarn.material import YarnMaterial
from yarnscale.yarn.pattern import YarnPattern

_STRAIGHT = 1e-9


def knitted_sheet(
    pattern: YarnPattern,
    columns: int,
    rows: int,
    *,
    chart: StitchChart | Sequence[str] | str | None = None,
    more_courses: int = 0,
    bound_off: bool = True,
    carried: int = 6,
) -> YarnSheet:
    """``columns`` by ``rows`` periods of a knitted pattern with borders, one yarn for every colour.

    Every course of the pattern is a yarn along x whose loops reach into the next courses. chart: that the pattern was
    drawn from, where it has other stitches than knit and purl; the piece is then drawn from it, each vertex
    corresponding to that of the pattern as far along its course. more_courses: of another period, knitted last.
    bound_off: False leaves the last row open, its loops upright, and the piece would unravel. carried: most courses
    that a yarn is carried past to the next course of its colour; beyond, and on the wrong side, it ends and another
    begins. The sheet is flat, and its borders are as drawn.

    Raises InputError for patterns that are not knitted of such courses, for plated yarns and yarns that are bent at
    rest, and for sizes that are no piece.
    """
    sizes = (
        ("columns", columns, 1), ("rows", rows, 0 if more_courses else 1), ("more courses", more_courses, 0),
        ("courses carried past", carried, 0),
    )  # fmt: skip
    for name, value, least in sizes:
        if isinstance(value, bool) or not isinstance(value, (int, np.integer)) or value < least:
            raise InputError(f"{name} of a knitted piece", expected=f"a whole number, {least} or more", found=value)
    courses = rows * len(pattern.yarns) + more_courses
    if columns * (courses + 2) / len(pattern.yarns) * len(pattern.edges) > LARGEST_SHEET:
        raise InputError("knitted piece is too large", expected=f"at most {LARGEST_SHEET} vertices")
    if np.abs(pattern.rest_curvature).max() > _STRAIGHT or np.abs(pattern.rest_twist).max() > _STRAIGHT:
        raise not_knitted("a yarn that is bent at rest")
    if chart is not None and not isinstance(chart, StitchChart):
        chart = StitchChart.read(chart)
    if pattern.yarn_radius is not None:
        raise not_knitted("yarns of several radii")
    if chart is not None and any(chart.empty):
        raise not_knitted("a chart with needles out of work, which no border holds")
    lines = KnittedCourses(pattern, columns, chart)
    yarns = _Knitting(lines, courses, carried).yarns(bound_off)
    return _assembled(pattern, yarns, columns, courses / len(pattern.yarns))


def woven_in(sheet: YarnSheet, material: YarnMaterial) -> BorderSprings:
    """Springs that fasten both ends of each yarn of a piece to the fabric at their places, as ends that are woven in.

    Each end is tied to the nearest vertex of the pattern proper.
    """
    ends = np.stack([sheet.offsets[:-1], sheet.offsets[1:] - 1], 1).ravel()
    fabric = np.flatnonzero(sheet.source != NO_PATTERN)
    apart, nearest = KDTree(sheet.vertices[fabric]).query(sheet.vertices[ends])
    stiffness = material.stretch_stiffness(sheet.radius) / sheet.radius
    return BorderSprings(np.stack([ends, fabric[nearest]], 1), apart, np.full(len(ends), stiffness))


class _Knitting:
    """Knits course after course; records where each yarn was left."""

    def __init__(self, lines: KnittedCourses, courses: int, carried: int) -> None:
        self.lines, self.courses, self.carried = lines, courses, carried
        self._parts: list[list[Strand]] = []
        self._kinds: list[int] = []
        self._left: dict[int, tuple[int, int]] = {}
        """For every material the yarn that waits, and the course that it knitted last."""
        self._ways: list[tuple[int, int, bool, float]] = []
        """Yarns carried: from course, to course, on the right, at what level."""

    def yarns(self, bound_off: bool) -> list[tuple[Strand, int]]:
        """The yarns of the piece and their materials."""
        lines, width = self.lines, self.lines.width
        start = cast_on(lines.lower(self.courses), width)
        self._begin(lines.kind(0), start)
        at = start.points[-1]
        for number in range(self.courses):
            # The cast-on ends on the right; courses go to the left and to the right in turn.
            right = number % 2 == 0
            course = lines.course(number).yarn
            own = course.reversed() if right else course
            self._turn(number, at, own.points[0], right=right)
            self._add(number, own)
            at = own.points[-1]
        return self._finished(at, bound_off)

    def _begin(self, kind: int, strand: Strand) -> None:
        self._parts.append([strand])
        self._kinds.append(kind)
        self._left[kind] = len(self._parts) - 1, -1

    def _add(self, number: int, strand: Strand) -> None:
        kind = self.lines.kind(number)
        yarn, _ = self._left[kind]
        self._parts[yarn].append(strand)
        self._left[kind] = yarn, number

    def _turn(self, number: int, at: Array, to: Array, *, right: bool) -> None:
        """Bring a yarn to the beginning of a course: the last one around the selvedge, one that waits, or a new one."""
        kind = self.lines.kind(number)
        yarn, before = self._left.get(kind, (-1, number))
        if before == number - 1:
            self._parts[yarn].append(selvedge(at, to, right=right))
        elif yarn >= 0 and (number - before) % 2 == 1 and number - before - 1 <= self.carried:
            level = self._level(before, number, right)
            self._ways.append((before, number, right, level))
            out = 0.5 * self.lines.height + CARRY_STEP
            left = self._parts[yarn][-1].points[-1]
            self._parts[yarn].append(selvedge(left, to, right=right, out=out, level=level))
        else:
            if yarn >= 0:
                self._end(yarn, before)
            self._begin(kind, tail(to, right=right).reversed())

    def _level(self, start: int, stop: int, right: bool) -> float:
        """A height at which this yarn does not collide with others that are carried."""
        taken = {z for a, b, side, z in self._ways if side == right and a < stop and start < b}
        return next(z for n in range(1, 99) for z in (n * CARRY_STEP, -n * CARRY_STEP) if z not in taken)

    def _end(self, yarn: int, course: int) -> None:
        """A yarn that is not needed any more ends where it was left."""
        self._parts[yarn].append(tail(self._parts[yarn][-1].points[-1], right=course % 2 == 1))

    def _finished(self, at: Array, bound_off: bool) -> list[tuple[Strand, int]]:
        lines, count = self.lines, self.courses
        right = count % 2 == 0
        yarn, _ = self._left.pop(lines.kind(count - 1))
        upper = lines.upper(count)
        to = upper.yarn.points[-1 if right else 0]
        self._parts[yarn].append(selvedge(at, to, right=right))
        self._parts[yarn].append(last_row(upper, lines.width, backward=right, bound_off=bound_off))
        for other, course in self._left.values():
            self._end(other, course)
        return [(Strand.merged(parts), kind) for parts, kind in zip(self._parts, self._kinds, strict=True)]


def _assembled(pattern: YarnPattern, yarns: list[tuple[Strand, int]], columns: int, rows: float) -> YarnSheet:
    size = columns * float(pattern.period[0]), rows * float(pattern.period[1])
    sheet = YarnSheet.from_lines(
        [strand.points * pattern.radius for strand, _ in yarns],
        pattern.radius,
        name=f"{pattern.name} {columns}×{rows:g}, knitted",
    )
    whole = Strand.merged([strand for strand, _ in yarns])
    rest = sheet.rest_length.copy()
    # The pattern's edges keep their rest lengths, in whichever direction they are knitted.
    begin = sheet.edges
    end = sheet.following[begin]
    here, there, step = whole.source[begin], whole.source[end], whole.tile[end] - whole.tile[begin]
    both = (here != NO_PATTERN) & (there != NO_PATTERN)
    onward = both & (pattern.edges[here, 1] == there) & (pattern.edges[here, 2:] == step).all(axis=1)
    back = both & (pattern.edges[there, 1] == here) & (pattern.edges[there, 2:] == -step).all(axis=1)
    rest[begin[onward]] = pattern.rest_length[here[onward]]
    rest[begin[back]] = pattern.rest_length[there[back]]
    return replace(
        sheet, rest_length=rest, source=whole.source, tile=whole.tile, area=size[0] * size[1], size=size,
        yarn_material=np.array([kind for _, kind in yarns], np.int64), polyline=pattern.polyline,
    )  # fmt: skip
