"""Woven patterns from a draft: which warp ends lie over which weft picks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import breadth_first_order

from yarnscale.drawing.chart_error import ChartError
from yarnscale.drawing.curves import PeriodicCurve, pattern_from_curves
from yarnscale.drawing.stitch_size import (
    check_drawn,
    checked_size,
    drawable,
    relative_radii,
    vertex_count,
    yarn_letters,
)
from yarnscale.errors import InputError
from yarnscale.yarn.pattern import YarnPattern

SAMPLES_PER_CROSSING = 200
LARGEST_DRAFT = 64


def weave(
    draft: Sequence[Sequence[int]] | np.ndarray,
    *,
    radius: float = 1e-3,
    warp_spacing: float | Sequence[float] = 3.2,
    weft_spacing: float | Sequence[float] = 3.2,
    half_thickness: float = 1.1,
    weft_yarns: Sequence[str] | None = None,
    warp_yarns: Sequence[str] | None = None,
    yarn_radius: Mapping[str, float] | None = None,
    vertices_per_stitch: float | None = None,
    rest_shape: str = "straight",
    name: str = "weave",
) -> YarnPattern:
    """A woven pattern from a binary draft: rows are weft picks, columns warp ends.

    ``draft[i][j] = 1``: warp end j is over (on the +z side of) weft pick i. Weft yarns run along x and are listed
    first, warp yarns run along y.

    radius: of the yarn [m]. warp_spacing, weft_spacing: distance between neighbouring warp ends and weft
    picks, in radii; several numbers are those from each yarn to the next. half_thickness: height of the centre lines
    above the middle plane where yarns cross, in radii.
    weft_yarns, warp_yarns: a letter for the kind of yarn of each pick and end; kinds are numbered in the order
    of their letters (`YarnPattern.yarn_material`).
    yarn_radius: radius of some kinds [m], by letter; the others have ``radius``. Heights and single spacings are
    then multiples of the mean radius of the yarns that meet.
    vertices_per_stitch: vertices per crossing along a yarn; by default edges are about as long as the radius.
    rest_shape: see `curves.pattern_from_curves`. Yarns touch or nearly touch where they cross: a first guess for
    an equilibrium.

    Raises InputError for a draft that is not binary or not one layer (a yarn that never changes sides, or yarns
    above all others that they cross), and for sizes at which the yarns would overlap.
    """
    table = _draft_table(draft)
    radius = checked_size("radius", radius)
    height = checked_size("half_thickness", half_thickness) * radius
    picks, ends = table.shape
    kinds = _kinds(weft_yarns, warp_yarns, picks, ends)
    letters = [*(weft_yarns or "a" * picks), *(warp_yarns or "a" * ends)]
    relative = relative_radii(letters, radius, yarn_radius)
    thick, high = relative[:picks], relative[picks:]
    x, wide = _places("warp_spacing", warp_spacing, high, thick, table)
    y, tall = _places("weft_spacing", weft_spacing, thick, high, table.T)
    period = np.array([wide, tall]) * radius
    side = (2 * table - 1) * (0.5 * (thick[:, None] + high))
    curves = [
        *(_wave(-side[i] * height, 0, x * radius, period[0], y[i] * radius) for i in range(picks)),
        *(_wave(side[:, j] * height, 1, y * radius, period[1], x[j] * radius) for j in range(ends)),
    ]
    counts = [
        vertex_count(curve.length(period), crossings, vertices_per_stitch, radius * share)
        for curve, crossings, share in zip(curves, [ends] * picks + [picks] * ends, relative, strict=True)
    ]
    drawable(sum(counts))
    sampled = [curve.vertices(count, period) for curve, count in zip(curves, counts, strict=True)]
    level = np.concatenate([curve.points for curve in sampled])[:, 2].mean()
    centred = [PeriodicCurve(curve.points - [0.0, 0.0, level], curve.shift) for curve in sampled]
    pattern = pattern_from_curves(
        centred,
        period,
        radius * relative.max(),
        name=name,
        rest_shape=rest_shape,
        yarn_material=kinds,
        yarn_radius=radius * relative,
    )
    return check_drawn(pattern)


def plain_draft() -> np.ndarray:
    """Over one, under one."""
    return np.array([[1, 0], [0, 1]])


def basket_draft(size: int = 2) -> np.ndarray:
    """Plain weave of groups of `size` yarns."""
    return np.kron(plain_draft(), np.ones((size, size), dtype=int))


def twill_draft(over: int = 2, under: int = 2) -> np.ndarray:
    """Over `over`, under `under`, one step to the side from pick to pick."""
    row = np.array([1] * over + [0] * under)
    return np.stack([np.roll(row, pick) for pick in range(over + under)])


def herringbone_draft(over: int = 2, under: int = 2, ends: int = 4) -> np.ndarray:
    """Twill that turns after every `ends` ends with a cut: the ends on its two sides lie opposite to each other."""
    if ends < 1:
        raise InputError("herringbone needs ends to turn after", expected="≥ 1", found=ends)
    half = (over + under) // 2
    steps = [*range(ends), *range(ends - 1 + half, half - 1, -1)]
    first = twill_draft(over, under)[:, 0]
    return np.stack([np.roll(first, step) for step in steps], axis=1)


def satin_draft(ends: int = 5, move: int = 2) -> np.ndarray:
    """Warp-faced satin: each pick goes over one end in `ends`, `move` ends further from pick to pick."""
    if np.gcd(ends, move) != 1:
        raise InputError("satin move has a common divisor with the ends", expected="none", found=(ends, move))
    draft = np.ones((ends, ends), dtype=int)
    draft[np.arange(ends), np.arange(ends) * move % ends] = 0
    return draft


def _draft_table(draft: Sequence[Sequence[int]] | np.ndarray) -> np.ndarray:
    try:
        table = np.asarray(draft)
    except ValueError:
        raise InputError("draft rows differ in length", expected="a rectangular table") from None
    if table.ndim != 2 or table.size == 0 or max(table.shape) > LARGEST_DRAFT:
        expected = f"rows × columns, 1 to {LARGEST_DRAFT} each"
        raise InputError("draft has the wrong shape", expected=expected, found=table.shape)
    if table.dtype.kind not in "biuf" or not np.isin(table, (0, 1)).all():
        raise InputError("draft is not binary", expected="0 (weft over) or 1 (warp over)")
    table = table.astype(np.int64)
    for axis, label in ((1, "weft pick"), (0, "warp end")):
        for index in np.flatnonzero(table.min(axis=axis) == table.max(axis=axis)):
            raise ChartError(
                f"draft does not hold together: {label} {index + 1} never changes sides",
                row=int(index) if axis == 1 else None,
                column=None if axis == 1 else int(index),
                expected="both 0 and 1 in every row and column",
            )
    _check_layers(table)
    return table


def _check_layers(table: np.ndarray) -> None:
    """InputError if some yarns are above all others that they cross (Clapham 1980).

    The draft is one piece when "lies over", followed from yarn to yarn, leads from every yarn to every other.
    """
    picks = len(table)
    over = np.zeros((sum(table.shape),) * 2, dtype=bool)
    over[:picks, picks:] = table == 0
    over[picks:, :picks] = table.T == 1
    for link, side in ((over, "top"), (over.T, "bottom")):
        reached = breadth_first_order(csr_array(link), 0, return_predecessors=False)
        # Nothing that is reached lies over what is not: those yarns are a layer of their own.
        if loose := np.setdiff1d(np.arange(len(over)), reached).tolist():
            names = [f"weft pick {y + 1}" if y < picks else f"warp end {y - picks + 1}" for y in loose[:6]]
            raise ChartError(
                f"draft does not hold together: {', '.join(names)}{' …' if len(loose) > 6 else ''} lie at the "
                f"{side} of all others that they cross",
                row=loose[0] if loose[0] < picks else None,
                column=None if loose[0] < picks else loose[0] - picks,
                expected="yarns that interlace in one layer",
            )


def _kinds(weft: Sequence[str] | None, warp: Sequence[str] | None, picks: int, ends: int) -> np.ndarray | None:
    """Number of the kind of each yarn, weft first."""
    if weft is None and warp is None:
        return None
    weft = ["a"] * picks if weft is None else list(weft)
    warp = ["a"] * ends if warp is None else list(warp)
    yarn_letters("weft_yarns", weft, picks, most=1)
    yarn_letters("warp_yarns", warp, ends, most=1)
    letters = yarn_letters("yarns", weft + warp, picks + ends, most=1)
    return np.array([kind for (kind,) in letters], dtype=np.int64)


def _places(
    field: str, spacing: float | Sequence[float], own: np.ndarray, others: np.ndarray, table: np.ndarray
) -> tuple[np.ndarray, float]:
    """Where parallel yarns lie, and their period [radii].

    spacing: from each yarn to the next, or one number, which is multiplied by the mean radius of the two or by that
    of a yarn which changes sides between them. own: radii of the columns of the table, others: of its rows.
    """
    if isinstance(spacing, (list, tuple, np.ndarray)):
        if len(spacing) != len(own):
            expected = f"one number, or one for each of {len(own)}"
            raise InputError(f"{field} has the wrong length", expected=expected, found=len(spacing))
        gaps = np.array([checked_size(field, value) for value in spacing])
    else:
        mean = 0.5 * (own + np.roll(own, -1))
        between = np.where(side_changes(table), 0.5 * (mean + others[:, None]), 0.0).max(axis=0)
        gaps = np.maximum(mean, between) * checked_size(field, spacing)
    return 0.5 * gaps[-1] + np.concatenate([[0.0], np.cumsum(gaps[:-1])]), float(gaps.sum())


def side_changes(table: np.ndarray) -> np.ndarray:
    """Whether each row's yarn changes sides between a column and the next one, of the table's shape."""
    return table != np.roll(table, -1, axis=1)


def _wave(heights: np.ndarray, axis: int, places: np.ndarray, lap: float, across: float) -> PeriodicCurve:
    """A yarn along x (axis 0) or y (axis 1) that reaches each height at the middle of its crossing.

    places, lap: of the crossings and of the period [m].
    Between two crossings the height follows 3u² - 2u³, level at both.
    """
    u = (np.arange(SAMPLES_PER_CROSSING) / SAMPLES_PER_CROSSING)[None, :]
    step = (np.roll(heights, -1) - heights)[:, None]
    z = heights[:, None] + step * (3.0 * u**2 - 2.0 * u**3)
    pitch = np.diff(places, append=places[0] + lap)
    along = places[:, None] + pitch[:, None] * u
    points = np.empty((z.size, 3))
    points[:, axis] = along.ravel()
    points[:, 1 - axis] = across
    points[:, 2] = z.ravel()
    return PeriodicCurve(points, (1, 0) if axis == 0 else (0, 1))
