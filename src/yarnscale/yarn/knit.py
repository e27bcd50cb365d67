"""Weft-knitted patterns from a chart of knit and purl stitches.

The plan of a loop is a classical closed form (as Peirce's, Leaf and Glaskin's and later loop models): with
t from 0 (middle of the sinker) over π (top of the head) to 2π (middle of the next sinker),

    x = w t/2π + a sin 2t,   y = -(h/2) cos t,

w the wale spacing, h the loop height, a the overhang of the heads and sinkers over the leaning legs. Every
leg crosses four yarns in plan: low down the legs and the head of the loop it is drawn through, high up the
foot and the leg of the loop drawn through it. The height z follows from which yarn lies in front there: a
knit stitch (seen from +z) is drawn through from behind, so that its foot lies behind the old loop's leg and
its leg in front of the old loop's head; a purl stitch the other way round.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.interpolate import PchipInterpolator

from yarnscale.errors import InputError
from yarnscale.yarn.curves import PeriodicCurve, pattern_from_curves
from yarnscale.yarn.pattern import YarnPattern
from yarnscale.yarn.stitch_size import check_drawn, positive, vertex_count

SYMBOLS = {"k": 1, "p": -1}
SAMPLES_PER_STITCH = 400
LARGEST_CHART = 64


def knit(
    chart: Sequence[str] | str,
    *,
    radius: float = 1e-3,
    wale_spacing: float = 9.0,
    course_spacing: float = 6.0,
    loop_height: float | None = None,
    overhang: float | None = None,
    half_thickness: float = 1.4,
    vertices_per_stitch: float | None = None,
    rest_shape: str = "straight",
    name: str = "knit",
) -> YarnPattern:
    """A knitted pattern from a chart: a text of ``k`` and ``p`` per course, seen from the right side (+z).

    The first text is the lowest course (the first one knitted), columns are wales along x. Every course is
    one yarn along x.

    radius: of the yarn [m]. All other lengths in radii: wale_spacing, course_spacing: size of a stitch along
    x and y. loop_height: height of the loop's plan, 1.6 course spacings by default. overhang: a above, 0.24
    wale spacings by default. half_thickness: height of the centre lines from the middle plane at crossings.
    vertices_per_stitch: by default edges are about as long as the radius. rest_shape: see
    `curves.pattern_from_curves`. The loops touch or nearly touch; they are a start for a relaxation.

    Raises InputError for a chart with other symbols or unequal rows, and for sizes at which the loops do not
    interlock or the yarns would overlap.
    """
    stitches = _chart_signs(chart)
    courses, wales = stitches.shape
    radius = positive("radius", radius)
    wale = positive("wale_spacing", wale_spacing)
    course = positive("course_spacing", course_spacing)
    loop = _LoopPlan(
        wale,
        1.6 * course if loop_height is None else positive("loop_height", loop_height),
        0.24 * wale if overhang is None else positive("overhang", overhang),
    )
    low, high = loop.crossings(course)
    thickness = positive("half_thickness", half_thickness)
    period = np.array([wales * wale, courses * course])
    curves = []
    for j in range(courses):
        knots, heights = _height_knots(stitches[j], stitches[(j + 1) % courses], low, high)
        dense = _course_curve(loop, knots, heights * thickness, wales, (j + 0.5) * course)
        count = vertex_count(dense.length(period), wales, vertices_per_stitch, 1.0)
        curves.append(dense.resampled(count, period))
    level = np.concatenate([curve.points for curve in curves])[:, 2].mean()
    scaled = [PeriodicCurve((curve.points - [0.0, 0.0, level]) * radius, curve.shift) for curve in curves]
    pattern = pattern_from_curves(scaled, period * radius, radius, name=name, rest_shape=rest_shape)
    return check_drawn(pattern)


def _chart_signs(chart: Sequence[str] | str) -> np.ndarray:
    """+1 for knit and -1 for purl, shape (courses, wales)."""
    rows = [chart] if isinstance(chart, str) else list(chart)
    if not 1 <= len(rows) <= LARGEST_CHART:
        raise InputError(
            "chart has the wrong number of rows", expected=f"1 to {LARGEST_CHART}", found=len(rows)
        )
    for index, row in enumerate(rows):
        if not isinstance(row, str) or not 1 <= len(row) <= LARGEST_CHART:
            expected = f"a text of 1 to {LARGEST_CHART} stitches"
            raise InputError(f"chart row {index} is no row of stitches", expected=expected, found=repr(row))
        if len(row) != len(rows[0]):
            raise InputError(
                f"chart row {index} has another length", expected=f"{len(rows[0])} stitches", found=len(row)
            )
        for column, symbol in enumerate(row):
            if symbol not in SYMBOLS:
                raise InputError(
                    f"chart row {index} column {column}: unknown stitch",
                    expected="k or p",
                    found=repr(symbol),
                )
    return np.array([[SYMBOLS[symbol] for symbol in row] for row in rows])


class _LoopPlan:
    """The plan of a loop, lengths in radii."""

    def __init__(self, wale: float, height: float, overhang: float) -> None:
        self.wale, self.height, self.overhang = wale, height, overhang

    def at(self, t: np.ndarray) -> np.ndarray:
        """Positions (x, y) at parameters t; shape (k, 2)."""
        x = self.wale * t / (2.0 * np.pi) + self.overhang * np.sin(2.0 * t)
        return np.stack([x, -0.5 * self.height * np.cos(t)], axis=1)

    def crossings(self, course: float) -> tuple[tuple[float, float], tuple[float, float]]:
        """Where a left leg crosses the course below (t_foot, t_leg) and the course above (t_foot, t_head).

        The same two crossings in plan, once seen from the upper loop (its foot crosses the old leg, then its
        leg the old head) and once from the lower one. InputError where loops do not cross just so.
        """
        t = np.linspace(0.0, np.pi, 401)
        upper, lower = self.at(t), self.at(t) - [0.0, course]
        on_upper, on_lower = _line_crossings(upper, lower)
        step = t[1]
        if len(on_upper) == 2:
            foot, leg = np.sort(on_upper) * step
            old_leg, old_head = on_lower[np.argsort(on_upper)] * step
            if foot < leg < old_leg < old_head:
                return (foot, leg), (old_leg, old_head)
        raise InputError(
            "loops of this size do not interlock",
            expected="each leg crossing its neighbours above and below twice: a loop_height of about 1.6 "
            "course_spacing, an overhang of about 0.24 wale_spacing",
            found=f"wale_spacing {self.wale:g}, course_spacing {course:g}, loop_height {self.height:g}, "
            f"overhang {self.overhang:g}",
        )


def _line_crossings(first: np.ndarray, second: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Crossings of two plane polylines, as positions (index plus fraction) on the first and on the second."""
    d, e = np.diff(first, axis=0)[:, None, :], np.diff(second, axis=0)[None, :, :]
    gap = second[None, :-1, :] - first[:-1, None, :]

    def cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
        return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]

    with np.errstate(divide="ignore", invalid="ignore"):
        s, u = cross(gap, e) / cross(d, e), cross(gap, d) / cross(d, e)
    i, k = np.nonzero((s >= 0.0) & (s < 1.0) & (u >= 0.0) & (u < 1.0))
    return i + s[i, k], k + u[i, k]


def _height_knots(
    row: np.ndarray, row_above: np.ndarray, low: tuple[float, float], high: tuple[float, float]
) -> tuple[np.ndarray, np.ndarray]:
    """Parameters along a course where its height is prescribed, and the heights as +1 (front) or -1."""
    turn = 2.0 * np.pi
    left = np.array([*low, *high])
    knots, heights = [], []
    for wale, (own, above) in enumerate(zip(row, row_above, strict=True)):
        # Foot behind the old leg, leg before the old head; leg before the new foot, head behind the new leg.
        leg = np.array([-own, own, above, -above])
        knots.append(turn * wale + np.concatenate([left, turn - left[::-1]]))
        heights.append(np.concatenate([leg, leg[::-1]]))
    return np.concatenate(knots), np.concatenate(heights).astype(np.float64)


def _course_curve(
    loop: _LoopPlan, knots: np.ndarray, heights: np.ndarray, wales: int, middle: float
) -> PeriodicCurve:
    """The dense centre line of one course; its height is monotone between crossings."""
    lap = 2.0 * np.pi * wales
    height = PchipInterpolator(np.concatenate([knots - lap, knots, knots + lap]), np.tile(heights, 3))
    t = np.arange(SAMPLES_PER_STITCH * wales) * lap / (SAMPLES_PER_STITCH * wales)
    plan = loop.at(t) + np.array([0.0, middle])
    return PeriodicCurve(np.column_stack([plan, height(t)]), (1, 0))
