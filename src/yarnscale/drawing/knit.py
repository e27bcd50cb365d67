"""Weft-knitted patterns from a chart.

Charts of knit and purl stitches alone have the plan of a classical closed form (as Peirce's, Leaf and Glaskin's
and later loop models): with t from 0 (middle of the sinker) over π (top of the head) to 2π (middle of the next
sinker),

    x = w t/2π + a sin 2t,   y = -(h/2) cos t,

w the wale spacing, h the loop height, a the overhang of the heads and sinkers over the leaning legs. Every
leg crosses four yarns in plan: low down the legs and the head of the loop it is drawn through, high up the
foot and the leg of the loop drawn through it. The height z follows from which yarn lies in front there: a
knit stitch (seen from +z) is drawn through from behind, so that its foot lies behind the old loop's leg and
its leg in front of the old loop's head; a purl stitch the other way round.

All other charts (see `stitches`), and sizes for which the closed form does not fit, are drawn schematically
(`loop_paths`) and then relaxed to their yarn radius (`swell`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from scipy.interpolate import PchipInterpolator

from yarnscale.drawing.curves import PeriodicCurve, pattern_from_curves
from yarnscale.drawing.loop_paths import line_crossings, row_paths
from yarnscale.drawing.stitch_size import (
    EDGE_LENGTH,
    check_drawn,
    checked_size,
    drawable,
    has_room,
    relative_radii,
    vertex_count,
    yarn_letters,
)
from yarnscale.drawing.stitches import StitchChart, signs
from yarnscale.errors import InputError
from yarnscale.yarn.pattern import YarnPattern

SAMPLES_PER_STITCH, FINE = 400, 60
MOST_STITCHES = 1024
"""Stitches that are drawn schematically."""
PLATING = 0.45
"""Distance of two plated yarns from the middle between them, before there is room for them [r]."""
DIGITS = 6
"""Digits kept of swollen lines [r], so that machines that round differently draw the same pattern."""


def knit(
    chart: Sequence[str] | str | StitchChart,
    *,
    radius: float = 1e-3,
    wale_spacing: float = 9.0,
    course_spacing: float = 6.0,
    loop_height: float | None = None,
    overhang: float | None = None,
    half_thickness: float | None = None,
    tightness: float = 1.0,
    yarns: Sequence[str] | None = None,
    yarn_radius: Mapping[str, float] | None = None,
    vertices_per_stitch: float | None = None,
    rest_shape: str = "straight",
    name: str = "knit",
) -> YarnPattern:
    """A knitted pattern from a chart: a text of stitches per course, seen from the right side (+z).

    The first text is the lowest course (the first one knitted), columns are wales along x. Every course is
    one yarn along x. The symbols, and courses of two needle beds, are described in `stitches`.

    radius: of the yarn [m]. All other lengths in radii: wale_spacing, course_spacing: size of a stitch along
    x and y; with two beds the wale spacing is that from a front needle to the back needle facing it, half
    that of a bed. half_thickness: height of the centre lines above the middle plane where yarns cross, 1.4 (1.1
    for schematic loops). tightness: target length of the yarns over that of the schematic loops.
    loop_height, overhang: h and a above, 1.6 course spacings and 0.24 wale spacings; only for charts of k and p.
    yarns: for each course a letter, the kind of its yarn, or two, one plated in front of the other; kinds are
    numbered in the order of their letters (`YarnPattern.yarn_material`).
    yarn_radius: radius of some kinds [m], by letter; the others have ``radius``, the unit of the other lengths.
    vertices_per_stitch: by default edges are about as long as the radius. rest_shape: see
    `curves.pattern_from_curves`. The loops touch or nearly touch: a first guess for an equilibrium.

    Raises InputError for a chart that cannot be knitted, and for sizes at which the loops do not interlock or
    the yarns would overlap.
    """
    chart = chart if isinstance(chart, StitchChart) else StitchChart.read(chart)
    radius = checked_size("radius", radius)
    wale = checked_size("wale_spacing", wale_spacing)
    course = checked_size("course_spacing", course_spacing)
    checked_size("tightness", tightness)
    thickness = None if half_thickness is None else checked_size("half_thickness", half_thickness)
    height = None if loop_height is None else checked_size("loop_height", loop_height)
    width = None if overhang is None else checked_size("overhang", overhang)
    kinds = yarn_letters("yarns", yarns, chart.courses, most=2)
    period = np.array([chart.wales * wale, chart.courses * course])
    letters = ["a"] * chart.courses if yarns is None else list("".join(yarns))
    relative = relative_radii(letters, radius, yarn_radius)
    alike = bool((relative == 1.0).all())
    shaped = height is not None or width is not None
    if shaped and not (alike and chart.plain and all(len(kind) == 1 for kind in kinds)):
        raise InputError(
            "loop_height and overhang shape plain loops only",
            expected="a chart of k and p of one radius without plated yarns",
        )

    def assembled(curves: list[PeriodicCurve]) -> YarnPattern:
        level = np.concatenate([curve.points for curve in curves])[:, 2].mean()
        scaled = [PeriodicCurve((curve.points - [0.0, 0.0, level]) * radius, curve.shift) for curve in curves]
        material = np.array([number for kind in kinds for number in kind], dtype=np.int64)
        return pattern_from_curves(
            scaled, period * radius, radius * relative.max(), name=name, rest_shape=rest_shape,
            yarn_material=material, yarn_radius=radius * relative,
        )  # fmt: skip

    if alike and chart.plain and all(len(kind) == 1 for kind in kinds):
        loop = _LoopPlan(wale, 1.6 * course if height is None else height, 0.24 * wale if width is None else width)
        if shaped or loop.interlocks(course):
            dense = _classical_curves(signs(chart), loop, course, 1.4 if thickness is None else thickness)
            # Corners of coarsely cut yarns come nearer than the yarns do.
            fine = assembled(_sampled(dense, period, chart.wales, FINE))
            if shaped or has_room(fine):
                check_drawn(fine)
                return assembled(_sampled(dense, period, chart.wales, vertices_per_stitch))
    return check_drawn(
        assembled(_swollen_curves(chart, kinds, relative, period, thickness or 1.1, tightness, vertices_per_stitch))
    )


def _classical_curves(stitches: np.ndarray, loop: _LoopPlan, course: float, thickness: float) -> list[PeriodicCurve]:
    """Dense closed-form lines, one a course [r]."""
    courses, wales = stitches.shape
    low, high = loop.crossings(course)
    curves = []
    for j in range(courses):
        knots, heights = _height_knots(stitches[j], stitches[(j + 1) % courses], low, high)
        curves.append(_course_curve(loop, knots, heights * thickness, wales, (j + 0.5) * course))
    return curves


def _sampled(
    curves: list[PeriodicCurve], period: np.ndarray, wales: int, per_stitch: float | None
) -> list[PeriodicCurve]:
    counts = [vertex_count(curve.length(period), wales, per_stitch, 1.0) for curve in curves]
    drawable(sum(counts))
    return [curve.vertices(count, period) for curve, count in zip(curves, counts, strict=True)]


def _swollen_curves(
    chart: StitchChart,
    kinds: list[tuple[int, ...]],
    relative: np.ndarray,
    period: np.ndarray,
    thickness: float,
    tightness: float,
    per_stitch: float | None,
) -> list[PeriodicCurve]:
    """Schematic loops relaxed to their radius; plated yarns follow one path, the first in front [r]."""
    from yarnscale.drawing.swell import swollen

    if chart.courses * chart.wales > MOST_STITCHES:
        raise InputError(
            "chart is too large", expected=f"at most {MOST_STITCHES} stitches", found=chart.courses * chart.wales
        )
    size = np.array([*(period / [chart.wales, chart.courses]), thickness])
    curves = []
    for path, kind in zip(row_paths(chart), kinds, strict=True):
        sides = [0.0] if len(kind) == 1 else [PLATING, -PLATING]
        curves += [PeriodicCurve(path * size + [0.0, 0.0, side], (1, 0)) for side in sides]
    counts = None
    if per_stitch is not None:
        counts = [vertex_count(curve.length(period), chart.wales, per_stitch, 1.0) for curve in curves]
    # Small against the distances of the schematic loops, so that sampling cuts no corner off through another yarn.
    finest = float(min(0.06 * size[0], 0.1 * size[1])) * min(1.0, 3.0 / max(1, chart.most_tucks))
    drawable(sum(curve.length(period) for curve in curves) / min(finest, EDGE_LENGTH))
    curves = swollen(curves, period, tightness=tightness, counts=counts, finest=finest, radii=relative)
    return [PeriodicCurve(curve.points.round(DIGITS), curve.shift) for curve in curves]


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
        found = self._crossings(course)
        if found is None:
            raise InputError(
                "loops of this size do not interlock",
                expected="each leg crossing its neighbours above and below twice: a loop_height of about 1.6 "
                "course_spacing, an overhang of about 0.24 wale_spacing",
                found=f"wale_spacing {self.wale:g}, course_spacing {course:g}, loop_height {self.height:g}, "
                f"overhang {self.overhang:g}",
            )
        return found

    def interlocks(self, course: float) -> bool:
        """Whether loops cross just as they should."""
        return self._crossings(course) is not None

    def _crossings(self, course: float) -> tuple[tuple[float, float], tuple[float, float]] | None:
        t = np.linspace(0.0, np.pi, 401)
        upper, lower = self.at(t), self.at(t) - [0.0, course]
        on_upper, on_lower = line_crossings(upper, lower)
        step = t[1]
        if len(on_upper) == 2:
            foot, leg = np.sort(on_upper) * step
            old_leg, old_head = on_lower[np.argsort(on_upper)] * step
            if foot < leg < old_leg < old_head:
                return (foot, leg), (old_leg, old_head)
        return None


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


def _course_curve(loop: _LoopPlan, knots: np.ndarray, heights: np.ndarray, wales: int, middle: float) -> PeriodicCurve:
    """The dense centre line of one course; its height is monotone between crossings."""
    lap = 2.0 * np.pi * wales
    height = PchipInterpolator(np.concatenate([knots - lap, knots, knots + lap]), np.tile(heights, 3))
    t = np.arange(SAMPLES_PER_STITCH * wales) * lap / (SAMPLES_PER_STITCH * wales)
    plan = loop.at(t) + np.array([0.0, middle])
    return PeriodicCurve(np.column_stack([plan, height(t)]), (1, 0))
