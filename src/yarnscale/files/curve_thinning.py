"""Fewer points for curves that are seen from afar: no point that is left out lies far from what is drawn."""

from __future__ import annotations

import numba
import numpy as np

from yarnscale.arrays import Array, Flags, Integers
from yarnscale.files.curve_frames import CurveSet

_LONGEST = 24
"""Most points that one segment takes the place of."""


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
