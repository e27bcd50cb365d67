"""How fine tubes of yarns are in a file: sides and points as many as its size allows, no curve far from its points."""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np

from yarnscale.arrays import Array, Flags, Integers
from yarnscale.errors import InputError
from yarnscale.files.curve_frames import CurveSet
from yarnscale.files.tube_sweep import TubeSweep, tube_triangles

BYTES_PER_VERTEX = 36
"""Position and normal in single precision, and two triangles of three short indices."""
LARGEST_PIECE = 65_535
"""Vertices that short indices count."""
_LONGEST = 24
"""Most points that one segment takes the place of."""


@dataclass(frozen=True)
class TubeDetail:
    """Corners of a tube's section, and how far points that are left out may lie from the curve drawn, in radii."""

    sides: int = 8
    tolerance: float = 0.0


LEVELS = tuple(
    TubeDetail(*level)
    for level in (
        (8, 0.0), (8, 0.03), (6, 0.05), (6, 0.1), (5, 0.15), (4, 0.2), (4, 0.3), (4, 0.4), (3, 0.4), (3, 0.5),
        (3, 0.7), (3, 1.0), (3, 1.5),
    )
)  # fmt: skip
"""From fine to coarse."""


def fitting_detail(curves: CurveSet, points: Array, size: float) -> tuple[TubeDetail, float]:
    """The finest tubes of a frame that take no more than a size [bytes], and the size that they take.

    points: positions (n, 3) [m] of a frame. Raises InputError where the coarsest take more.
    """
    taken = np.inf
    for level in LEVELS:
        few, _ = level_of(curves, points, level)
        taken = float(few.point_count * level.sides * BYTES_PER_VERTEX)
        if taken <= size:
            return level, taken
    raise InputError(
        "tubes of these yarns are larger than asked",
        expected=f"--megabytes {np.ceil(taken / 1e6):.0f} or more, --yarns-as lines, or --format usd",
        found=f"{curves.point_count} points, a limit of {size / 1e6:.4g} MB a frame",
    )


def level_of(curves: CurveSet, points: Array, level: TubeDetail) -> tuple[CurveSet, Integers]:
    """The curves that tubes of a level are drawn about, and the points (m,) that they need of all."""
    return thinned(curves, points, level.tolerance * float(curves.radii.min()))


@dataclass(frozen=True, eq=False)
class Tubes:
    """Tubes of a level about curves, those of one colour together.

    sweep: of the points ``chosen`` (m,) of all. pieces: rows of vertices, the triangles among them counted from the
    first row, and the number of the colour; none has more than ``LARGEST_PIECE`` vertices unless one curve has.
    """

    sweep: TubeSweep
    chosen: Integers
    pieces: list[tuple[slice, Integers, int]]

    @classmethod
    def of(cls, curves: CurveSet, points: Array, level: TubeDetail) -> Tubes:
        """From positions (n, 3) [m] in the first frame."""
        order = np.argsort(curves.yarn, kind="stable")
        lengths = np.diff(curves.offsets)
        runs = zip(curves.offsets[order].tolist(), curves.offsets[order + 1].tolist(), strict=True)
        rows = np.concatenate([np.arange(first, end) for first, end in runs])
        ordered = CurveSet(
            np.concatenate([[0], np.cumsum(lengths[order])]), curves.radii[rows], closed=curves.closed[order],
            yarn=curves.yarn[order],
        )  # fmt: skip
        few, kept = level_of(ordered, points[rows], level)
        return cls(TubeSweep(few, sides=level.sides), rows[kept], list(_pieces(few, level.sides)))

    def surface(self, points: Array, radii: Array) -> tuple[Array, Array]:
        """Vertices [m] and normals of all pieces, of all points (n, 3) and radii (n,) [m] of a frame."""
        return self.sweep.surface(points[self.chosen], radii[self.chosen])


def _pieces(curves: CurveSet, sides: int):  # type: ignore[no-untyped-def]
    """Runs of curves of one colour."""
    first = 0
    for k in range(1, len(curves) + 1):
        size = sides * int(curves.offsets[min(k + 1, len(curves))] - curves.offsets[first])
        if k < len(curves) and curves.yarn[k] == curves.yarn[first] and size <= LARGEST_PIECE:
            continue
        which = np.zeros(len(curves), bool)
        which[first:k] = True
        part, _ = curves.chosen(which)
        rows = slice(sides * int(curves.offsets[first]), sides * int(curves.offsets[k]))
        yield rows, tube_triangles(part, sides), int(curves.yarn[first])
        first = k


def thinned(curves: CurveSet, points: Array, tolerance: float) -> tuple[CurveSet, Integers]:
    """Curves of some of the points, and which ones (m,), increasing: ends stay, others lie within a tolerance [m].

    points: positions (n, 3) [m] in one frame; in others the tolerance holds as far as curves keep their shape.
    """
    if not tolerance > 0.0:
        return curves, np.arange(curves.point_count)
    kept = _kept(np.ascontiguousarray(points, dtype=np.float64), curves.offsets, curves.closed, tolerance)
    counts = np.add.reduceat(kept.astype(np.int64), curves.offsets[:-1])
    chosen = np.flatnonzero(kept)
    offsets = np.concatenate([[0], np.cumsum(counts)])
    return CurveSet(offsets, curves.radii[chosen], closed=curves.closed, yarn=curves.yarn), chosen


@numba.njit(cache=True, error_model="numpy")
def _kept(points: Array, offsets: Integers, closed: Flags, tolerance: float) -> Flags:
    """From every point kept, the farthest next one to which a straight segment passes all between closely enough."""
    kept = np.zeros(len(points), np.bool_)
    for curve in range(len(closed)):
        low, last = offsets[curve], offsets[curve + 1] - 1
        kept[low] = kept[last] = True
        if closed[curve]:
            # A loop stays one: three points at least.
            kept[low + (last - low) // 2] = True
        here = low
        while here < last:
            ahead = here + 1
            while ahead < last and not kept[ahead] and ahead - here < _LONGEST:
                if not _straight(points, here, ahead + 1, tolerance):
                    break
                ahead += 1
            kept[ahead] = True
            here = ahead
    return kept


@numba.njit(cache=True, error_model="numpy")
def _straight(points: Array, first: int, last: int, tolerance: float) -> bool:
    """Whether all points between two lie within a tolerance of the segment that joins them."""
    ax, ay, az = points[first, 0], points[first, 1], points[first, 2]
    ux, uy, uz = points[last, 0] - ax, points[last, 1] - ay, points[last, 2] - az
    square = ux * ux + uy * uy + uz * uz
    for i in range(first + 1, last):
        px, py, pz = points[i, 0] - ax, points[i, 1] - ay, points[i, 2] - az
        share = min(max((px * ux + py * uy + pz * uz) / square, 0.0), 1.0) if square > 0.0 else 0.0
        dx, dy, dz = px - share * ux, py - share * uy, pz - share * uz
        if dx * dx + dy * dy + dz * dz > tolerance * tolerance:
            return False
    return True
