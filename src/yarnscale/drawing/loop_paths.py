"""Schematic centre lines of a chart's rows: thin and angular, with the topology of the knitted fabric.

Every row crosses every wale inside the wale's own strip, its left half mirrored on the right. In the plan an
older loop is an arch. The new loop enters from the side across the arch's leg, turns up inside and leaves across
the arch's head; tuck loops are arches around the held loop's, and a float runs straight across the legs. The chart
determines which yarn is above where two cross; the plan is checked to have no other crossings.
The lines do not touch; `swell` gives them the yarns' radius.
"""

from __future__ import annotations

from itertools import pairwise

import numba
import numpy as np
from scipy.interpolate import PchipInterpolator

from yarnscale.drawing.stitches import SIGNS, StitchChart
from yarnscale.errors import InputError

LEG, HEAD = 0.365, 0.45
"""Distance of a loop's legs from the wale's middle [wale spacings]; height of heads over the row that takes them up."""
TUCK_STEP, TUCK_RISE = 0.105, 0.33
"""How much wider [wale spacings] and higher [rows] the outermost of three or more tuck loops lies."""
NECK = 0.15
STEP = 0.02
"""Distance of points along the plan [wale or course spacings]."""


def row_paths(chart: StitchChart) -> list[np.ndarray]:
    """For each row a dense line (x, y, z), shape (k, 3), from wale to wale and without its closing image.

    x in wale spacings, y in course spacings (row i's sinkers lie at y = i), z = ±1 at crossings.
    """
    plans = [_rounded(_plan(chart, row), chart.wales) for row in range(chart.courses)]
    words = chart.words
    paths = []
    for row, plan in enumerate(plans):
        at = _crossings(chart, plans, row)
        if len(at) != len(words[row]):
            raise InputError(
                f"chart row {row + 1} cannot be drawn",
                expected=f"{len(words[row])} crossings",
                found=f"{len(at)} crossings",
            )
        heights = np.array([1.0 if letter == "O" else -1.0 for letter in words[row]])
        count = len(plan)
        # Words begin at the sinker left of the first wale; cut corners let a line begin a little to its right.
        late = at >= count - np.count_nonzero(plan[-count // 4 :, 0] >= chart.wales)
        at = np.sort(np.where(late, at - count, at))
        knots = np.concatenate([at - count, at, at + count])
        z = PchipInterpolator(knots, np.tile(heights, 3))(np.arange(count)) if len(at) else np.zeros(count)
        paths.append(np.column_stack([plan, z]))
    return paths


def _plan(chart: StitchChart, row: int) -> np.ndarray:
    """Corner points of a row in the plan, from the sinker left of the first wale on."""
    corners = []
    for column in range(chart.wales):
        left = np.array(_left_half(chart, row, column))
        right = left[::-1][1:-1] * [-1.0, 1.0]
        corners.append(np.concatenate([left, right]) + np.array([column + 0.5, row]))
    return np.concatenate(corners)


def _left_half(chart: StitchChart, row: int, column: int) -> list[tuple[float, float]]:
    """Corners from the sinker (-0.5, 0) to the wale's middle x = 0, relative to the row's base."""
    symbol = chart.rows[row][column]
    if symbol not in SIGNS and symbol != "t":
        return [(-0.5, 0.0), (-0.25, 0.0), (0.0, 0.0)]
    end = chart.next_knit(row, column)
    held = chart.held(row + end, column)
    # Tucks share the room between the held loop and the next wale.
    order = held.index(end) / max(3, len(held) - 1)
    leg = LEG + TUCK_STEP * order
    if symbol == "t":
        points = [(-0.5, 0.0), (-leg - 0.01, 0.05), (-leg, 0.15)]
    else:
        points = [(-0.5, 0.0), (-0.3, 0.0), (-NECK, 0.12), (-NECK - 0.02, 0.3), (-0.25, 0.6), (-LEG, 0.88)]
    rise = TUCK_RISE * order
    points += [
        (-leg, end + 0.08),
        (-0.85 * leg, end + 0.25 + 0.66 * rise),
        (-0.5 * leg, end + 0.40 + rise),
        (0.0, end + HEAD + rise),
    ]
    return points


def _rounded(corners: np.ndarray, wales: int) -> np.ndarray:
    """Corners cut twice (Chaikin), then points at even steps; the line ends before its image."""
    for _ in range(2):
        following = _closed(corners, wales)[1:]
        corners = np.stack([0.75 * corners + 0.25 * following, 0.25 * corners + 0.75 * following], 1).reshape(-1, 2)
    closed = _closed(corners, wales)
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(closed, axis=0), axis=1))])
    count = int(np.ceil(along[-1] / STEP))
    at = np.arange(count) * along[-1] / count
    return np.stack([np.interp(at, along, closed[:, k]) for k in range(2)], axis=1)


def _crossings(chart: StitchChart, plans: list[np.ndarray], row: int) -> np.ndarray:
    """Places along a row (index plus fraction) where it crosses any row's copy in the plan, sorted."""
    line = _closed(plans[row], chart.wales)
    low, high = line[:, 1].min(), line[:, 1].max()
    copies = []
    for other, plan in enumerate(plans):
        copy = _closed(plan, chart.wales)
        first = int(np.floor((low - copy[:, 1].max()) / chart.courses))
        last = int(np.ceil((high - copy[:, 1].min()) / chart.courses))
        laps = [lap for lap in range(first, last + 1) if other != row or lap != 0]
        tiles = [(side, lap) for side in (-1, 0, 1) for lap in laps]
        copies += [copy + np.multiply(tile, (chart.wales, chart.courses)) for tile in tiles]
    # Yarns meet well inside the wales only, so that nothing is missed strip by strip.
    strips = [(copy, _strips(copy)) for copy in copies]
    places = []
    for strip, (begin, end) in _strips(line).items():
        for copy, ranges in strips:
            if strip in ranges:
                a, b = ranges[strip]
                places.append(begin + line_crossings(line[begin : end + 1], copy[a : b + 1])[0])
    return np.sort(np.concatenate(places)) if places else np.empty(0)


def _strips(line: np.ndarray) -> dict[int, tuple[int, int]]:
    """Range of the segments of a line in each wale's strip; wales follow each other along a row."""
    strip = np.floor(0.5 * (line[1:, 0] + line[:-1, 0])).astype(int)
    change = np.flatnonzero(np.diff(strip)) + 1
    bounds = np.concatenate([[0], change, [len(strip)]])
    return {int(strip[a]): (int(a), int(b)) for a, b in pairwise(bounds)}


def _closed(plan: np.ndarray, wales: int) -> np.ndarray:
    return np.concatenate([plan, plan[:1] + np.array([wales, 0.0])])


def line_crossings(first: np.ndarray, second: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Crossings of two plane polylines (k, 2), (m, 2): places (index plus fraction) on the first and the second."""
    return _line_crossings(np.ascontiguousarray(first), np.ascontiguousarray(second))


@numba.njit(cache=True, error_model="numpy")
def _line_crossings(first, second):
    low, high = second[0].copy(), second[0].copy()
    for point in second:
        low, high = np.minimum(low, point), np.maximum(high, point)
    on_first, on_second = [0.0][:0], [0.0][:0]
    for i in range(len(first) - 1):
        x, y = first[i]
        dx, dy = first[i + 1, 0] - x, first[i + 1, 1] - y
        if max(x, x + dx) < low[0] or min(x, x + dx) > high[0] or max(y, y + dy) < low[1] or min(y, y + dy) > high[1]:
            continue
        for k in range(len(second) - 1):
            ex, ey = second[k + 1, 0] - second[k, 0], second[k + 1, 1] - second[k, 1]
            gx, gy = second[k, 0] - x, second[k, 1] - y
            size = dx * ey - dy * ex
            s, u = (gx * ey - gy * ex) / size, (gx * dy - gy * dx) / size
            if 0.0 <= s < 1.0 and 0.0 <= u < 1.0:
                on_first.append(i + s)
                on_second.append(k + u)
    return np.array(on_first), np.array(on_second)
