"""Pieces of plain knitting made of one yarn: cast on, knitted to and fro, bound off (the edges of hand knitting).

The yarn begins with a row of twisted loops (backward-loop cast-on), each of which a loop of the first course is drawn
through; it turns at either selvedge into the next course; and the loops of a last row are each drawn through the course
below *and* the loop before (chained bind-off), the end through the last of them. Between its borders the piece is the
pattern, vertex by vertex. Borders are drawn with room for the yarn, and find their shape in an equilibrium.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import PchipInterpolator

from yarnscale.errors import InputError
from yarnscale.fabric.boundary import Springs
from yarnscale.fabric.sheet import LARGEST_SHEET, NO_PATTERN, YarnSheet
from yarnscale.yarn.material import YarnMaterial
from yarnscale.yarn.pattern import YarnPattern

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

TAIL = 8.0
"""Length of yarn left over at either end of the piece [r]."""
_STRAIGHT = 1e-9
_UNLIKE = 0.25
"""Largest difference of heights of a plain pattern's loops, as a share."""


@dataclass(frozen=True, eq=False)
class _Row:
    """A course across the piece, from left to right: points (k, 3) [r], sources and tiles, and its stitches.

    low, high: heights of sinkers and heads [r]. rise, fall: (s,) for every stitch the first vertex above the middle
    between them, and the first one below it again.
    """

    points: Array
    source: Indices
    tile: Indices
    low: float
    high: float
    rise: Indices
    fall: Indices


@dataclass(frozen=True, eq=False)
class _Piece:
    """Points along the yarn in order [r]; source NO_PATTERN where drawn anew."""

    points: Array
    source: Indices
    tile: Indices

    @classmethod
    def drawn(cls, points: Array) -> _Piece:
        return cls(points, np.full(len(points), NO_PATTERN), np.zeros((len(points), 2), np.int64))

    def reversed(self) -> _Piece:
        return _Piece(self.points[::-1], self.source[::-1], self.tile[::-1])


def knitted_sheet(pattern: YarnPattern, columns: int, rows: int, *, bound_off: bool = True) -> YarnSheet:
    """``columns`` by ``rows`` periods of a pattern of knit and purl stitches, as one yarn with borders.

    Every course of the pattern is a yarn along x whose loops reach into the next course. bound_off: False leaves the
    last row open, its loops upright, and the piece would unravel. The sheet is flat, and its borders are as drawn.

    Raises InputError for patterns with other stitches, several yarns, or yarns that are bent at rest, and for sizes
    that are no piece.
    """
    for name, value in (("columns", columns), ("rows", rows)):
        if isinstance(value, bool) or not isinstance(value, (int, np.integer)) or value < 1:
            raise InputError(
                f"{name} of a knitted piece", expected="a whole number of periods, 1 or more", found=value
            )
    courses = len(pattern.yarns)
    if columns * (rows * courses + 2) / courses * len(pattern.edges) > LARGEST_SHEET:
        raise InputError("knitted piece is too large", expected=f"at most {LARGEST_SHEET} vertices")
    _check_plain(pattern)
    count = rows * courses
    lines = [_row(pattern, columns, k) for k in range(-1, count + 1)]
    if len({len(line.rise) for line in lines}) != 1 or not len(lines[0].rise):
        raise _not_plain("other numbers of loops in its courses")
    width = columns * float(pattern.period[0]) / pattern.radius
    pieces = [_cast_on(lines[0], width)]
    for number, line in enumerate(lines[1:-1], start=1):
        pieces.append(_selvedge(lines[number - 1], line, right=number % 2 == 1))
        whole = _Piece(line.points, line.source, line.tile)
        pieces.append(whole.reversed() if number % 2 else whole)
    backward = (count + 1) % 2 == 1
    pieces.append(_selvedge(lines[-2], lines[-1], right=backward))
    pieces.append(_last_row(lines[-1], width, backward, bound_off))
    return _assembled(pattern, pieces, columns, rows)


def woven_in(sheet: YarnSheet, material: YarnMaterial) -> Springs:
    """Springs that hold both ends of a piece's yarn to the fabric where they lie, as ends that are woven in.

    Each end is tied to the nearest vertex of the pattern proper.
    """
    ends = np.array([0, sheet.vertex_count - 1])
    fabric = np.flatnonzero(sheet.source != NO_PATTERN)
    apart = np.linalg.norm(sheet.vertices[fabric][None] - sheet.vertices[ends][:, None], axis=2)
    nearest = np.argmin(apart, axis=1)
    stiffness = material.stretch_stiffness(sheet.radius) / sheet.radius
    return Springs(np.stack([ends, fabric[nearest]], 1), apart.min(axis=1), np.full(2, stiffness))


def _not_plain(found: object) -> InputError:
    return InputError(
        "pattern of a knitted piece",
        expected="courses of knit and purl stitches of one straight yarn, each a yarn along x",
        found=found,
    )


def _check_plain(pattern: YarnPattern) -> None:
    if (pattern.yarn_shift != np.array([1, 0])).any():
        raise _not_plain(f"yarns that move {pattern.yarn_shift.tolist()} periods")
    assert pattern.yarn_material is not None
    if len(set(pattern.yarn_material.tolist())) > 1:
        raise _not_plain("several materials")
    if np.abs(pattern.rest_curvature).max() > _STRAIGHT or np.abs(pattern.rest_twist).max() > _STRAIGHT:
        raise _not_plain("a yarn that is bent at rest")
    heights = [float(np.ptp(pattern.vertices[chain, 1])) for chain in pattern.yarns]
    course = float(pattern.period[1]) / len(heights)
    if max(heights) > (1 + _UNLIKE) * min(heights) or not course < min(heights) < 2 * course:
        raise _not_plain("loops of other heights")


def _row(pattern: YarnPattern, columns: int, number: int) -> _Row:
    """Course ``number`` from the lowest of the piece, −1 the row below it."""
    tall, course = divmod(number, len(pattern.yarns))
    chain = pattern.yarns[course]
    # Begin in the middle of a sinker: the lowest vertex near the left border of the period.
    walked = pattern.tile_along_yarn[chain]
    x = pattern.vertices[chain, 0] + walked[:, 0] * pattern.period[0]
    first = int(np.argmin(np.abs(x - pattern.period[0] * np.round(x / pattern.period[0]))))
    lap = int(np.round(x[first] / pattern.period[0]))
    order = np.arange(first, first + columns * len(chain) + 1)
    turns, place = np.divmod(order, len(chain))
    tile = walked[place] + np.stack([turns - lap, np.full(len(order), tall)], 1)
    source = chain[place]
    points = pattern.vertices[source].copy()
    points[:, :2] += tile * pattern.period
    points /= pattern.radius
    low, high = float(points[:, 1].min()), float(points[:, 1].max())
    above = points[:, 1] > 0.5 * (low + high)
    change = np.flatnonzero(above[1:] != above[:-1]) + 1
    if above[0] or len(change) % 2:
        raise _not_plain("a course that does not begin with a sinker")
    return _Row(points, source, tile, low, high, change[::2], change[1::2])


# --- borders: all lengths in radii --------------------------------------------------------------------


def _curve(controls: Array) -> Array:
    """A smooth line through points (k, 3), at steps of about a radius, without both ends."""
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(controls, axis=0), axis=1))])
    line = PchipInterpolator(along, controls)
    fine = line(np.linspace(0.0, along[-1], 40 * len(controls)))
    length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(fine, axis=0), axis=1))])
    count = max(1, round(length[-1] / 1.03))
    at = np.linspace(0.0, length[-1], count + 1)[1:-1]
    return np.stack([np.interp(at, length, fine[:, c]) for c in range(3)], axis=1)


def _joined(controls: Sequence[ArrayLike]) -> Array:
    return np.concatenate([np.atleast_2d(np.asarray(c, np.float64)) for c in controls])


def _part(row: _Row, begin: int, end: int) -> _Piece:
    return _Piece(row.points[begin:end], row.source[begin:end], row.tile[begin:end])


def _merged(pieces: list[_Piece]) -> _Piece:
    return _Piece(
        np.concatenate([p.points for p in pieces]),
        np.concatenate([p.source for p in pieces]),
        np.concatenate([p.tile for p in pieces]),
    )


def _selvedge(below: _Row, above: _Row, *, right: bool) -> _Piece:
    """The turn from the end of one course into the next, around half a circle outside."""
    end = -1 if right else 0
    start, stop = below.points[end], above.points[end]
    side = 1.0 if right else -1.0
    middle, half = 0.5 * (start + stop), 0.5 * (stop[1] - start[1])
    angle = np.linspace(-0.5 * np.pi, 0.5 * np.pi, 9)[1:-1]
    arc = np.stack(
        [
            middle[0] + side * (half * np.cos(angle) + 0.5),
            middle[1] + half * np.sin(angle),
            middle[2] + 0.5 * (stop[2] - start[2]) * np.sin(angle),
        ],
        axis=1,
    )
    return _Piece.drawn(_curve(_joined([start, arc, stop])))


def _cast_on(row: _Row, width: float) -> _Piece:
    """Heads of the row below the first course; their legs cross and go on to the neighbours' (twisted loops).

    From left to right: the yarn comes in under the loop, goes up its right leg, over the head, down the left leg, and
    out over itself to the right.
    """
    pitch = width / len(row.rise)
    base, lean = row.low - 0.3, 0.25 * pitch
    start = np.array([-TAIL, base, 0.0])
    pieces = [_Piece.drawn(start[None])]
    for stitch, (rise, fall) in enumerate(zip(row.rise, row.fall, strict=True)):
        middle = (stitch + 0.5) * pitch
        left, right = row.points[rise], row.points[fall - 1]
        across = base + 0.45 * (left[1] - base)
        under = [
            [middle - lean, base + 0.1, -0.7],
            [middle, across, -1.05],
            [middle + 0.2 * pitch, across + 1.3, 0.0],
        ]
        over = [
            [middle - 0.2 * pitch, across + 1.3, 1.05],
            [middle, across, 1.05],
            [middle + lean, base + 0.1, 0.7],
        ]
        pieces.append(_Piece.drawn(_curve(_joined([start, *under, right]))))
        pieces.append(_part(row, int(rise), int(fall)).reversed())
        last = stitch + 1 == len(row.rise)
        end = row.points[-1] if last else np.array([(stitch + 1) * pitch, base, 0.0])
        pieces.append(_Piece.drawn(_curve(_joined([left, *over, end]))))
        pieces.append(_part(row, len(row.points) - 1, len(row.points)) if last else _Piece.drawn(end[None]))
        start = end
    return _merged(pieces)


def _last_row(row: _Row, width: float, backward: bool, bound_off: bool) -> _Piece:
    """Feet of the row above the last course, whose loops lie along the border, each drawn through the one before."""
    if backward:
        row = _mirrored(row, width)
    pitch = width / len(row.rise)
    pieces, begin = [], 0
    for stitch, (rise, fall) in enumerate(zip(row.rise, row.fall, strict=True)):
        middle = (stitch + 0.5) * pitch
        left, right = row.points[rise], row.points[fall - 1]
        pieces.append(_part(row, begin, int(rise) + 1))
        if bound_off:
            pieces.append(_Piece.drawn(_curve(_chain_link(left, right, middle, pitch))))
        else:
            pieces.append(_part(row, int(rise) + 1, int(fall) - 1))
        begin = int(fall) - 1
    pieces.append(_part(row, begin, len(row.points)))
    last = row.points[-1]
    middle, level = width + 0.5 * pitch, row.points[row.rise[-1], 1]
    if bound_off:
        way = [
            [middle - 1.2, last[1] + 0.2, -0.5],
            [middle, last[1] + 2.0, -0.8],
            [middle, level + 2.1, -1.05],
            [middle + 0.4, level + 3.8, 0.0],
            [middle + 1.8, level + 4.3, 1.0],
            [middle + 0.5 * pitch, level + 4.3, 1.05],
            [middle + 0.5 * pitch + TAIL, level + 4.3, 0.0],
        ]
    else:
        way = [[last[0] + TAIL, last[1], 0.0]]
    tail = _joined([last, *way])
    pieces.append(_Piece.drawn(np.concatenate([_curve(tail), tail[-1:]])))
    whole = _merged(pieces)
    if backward:
        points = whole.points * [-1.0, 1.0, 1.0] + [width, 0.0, 0.0]
        whole = replace(whole, points=points)
    return whole


def _mirrored(row: _Row, width: float) -> _Row:
    """The row seen from the other end, x measured from there."""
    count = len(row.points)
    points = (row.points * [-1.0, 1.0, 1.0] + [width, 0.0, 0.0])[::-1]
    return _Row(
        points, row.source[::-1], row.tile[::-1], row.low, row.high, count - row.fall[::-1], count - row.rise[::-1]
    )  # fmt: skip


_LINK = np.array(
    [
        # x from the stitch's middle (the second column in pitches), y over the legs' ends, z.
        [-1.5, 0.0, 2.1, -1.05],
        [-1.2, 0.0, 3.7, 0.0],
        [-0.3, 0.05, 5.0, 0.8],
        [-1.8, 0.5, 5.3, 1.05],
        [0.0, 0.5, 5.4, 1.05],
        [2.5, 0.5, 6.4, 0.3],
        [1.0, 1.0, 6.6, -0.6],
        [-0.7, 1.5, 5.8, -1.05],
        [0.0, 1.5, 4.3, -1.05],
        [-0.8, 1.5, 2.6, -0.5],
        [1.6, 1.0, 2.1, 1.05],
        [-1.5, 1.0, 2.1, 1.05],
        [0.2, 0.5, 3.2, 1.05],
        [-1.6, 0.5, 3.5, 0.9],
        [1.6, 0.0, 3.2, -0.4],
        [1.5, 0.0, 2.1, -1.05],
    ]
)
"""A loop of the bind-off from its left leg to its right one: up through the loop before, along the border around the
neck of the loop after it, and back."""


def _chain_link(left: Array, right: Array, middle: float, pitch: float) -> Array:
    level = max(left[1], right[1])
    points = np.stack([middle + _LINK[:, 0] + pitch * _LINK[:, 1], level + _LINK[:, 2], _LINK[:, 3]], axis=1)
    return _joined([left, points, right])


def _assembled(pattern: YarnPattern, pieces: list[_Piece], columns: int, rows: int) -> YarnSheet:
    whole = _merged(pieces)
    size = columns * float(pattern.period[0]), rows * float(pattern.period[1])
    line = YarnSheet.from_lines(
        [whole.points * pattern.radius], pattern.radius, name=f"{pattern.name} {columns}×{rows}, knitted"
    )
    rest = line.rest_length.copy()
    # The pattern's edges keep their rest lengths, in whichever direction they are knitted.
    source, tile = whole.source, whole.tile
    here, there = source[:-1], source[1:]
    both = (here != NO_PATTERN) & (there != NO_PATTERN)
    step = tile[1:] - tile[:-1]
    onward = both & (pattern.edges[here, 1] == there) & (pattern.edges[here, 2:] == step).all(axis=1)
    back = both & (pattern.edges[there, 1] == here) & (pattern.edges[there, 2:] == -step).all(axis=1)
    rest[:-1][onward] = pattern.rest_length[here[onward]]
    rest[:-1][back] = pattern.rest_length[there[back]]
    assert pattern.yarn_material is not None
    return replace(
        line, rest_length=rest, source=source, tile=tile, area=size[0] * size[1], size=size,
        yarn_material=pattern.yarn_material[:1].copy(),
    )  # fmt: skip
