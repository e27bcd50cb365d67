"""How fine tubes of yarns are in a file: sides and points as many as its size allows."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from yarnscale.arrays import Array, Integers
from yarnscale.errors import InputError
from yarnscale.files.curve_frames import CurveSet
from yarnscale.files.curve_thinning import thinned
from yarnscale.files.tube_sweep import TubeSweep, tube_triangles

BYTES_PER_VERTEX = 36
"""Position and normal in single precision, and two triangles of three short indices."""
LARGEST_PIECE = 65_535
"""Vertices that short indices count."""


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
