"""BCC, the binary curve collection of C. Yuksel's yarn-level models, whose format his page on them describes."""

from __future__ import annotations

import os
import struct

import numpy as np

from yarnscale.arrays import Array
from yarnscale.files.array_file import checked_array
from yarnscale.files.atomic import write_bytes
from yarnscale.files.curve_frames import CurveSet

_HEADER = struct.Struct("<3sB2sBBQQ40s")
_SIZES = 0x44
"""Four bytes an integer, four bytes a float."""
_SMOOTH = b"C0"
"""Uniform Catmull-Rom curves."""
_UP = 2
"""The z-axis."""


def write_bcc(path: str | os.PathLike[str], curves: CurveSet, positions: Array) -> None:
    """Write points (n, 3) [m] of curves as single-precision control points of Catmull-Rom curves.

    The format has no radii: the first one is written into the comment. InputError where the file cannot be written.
    """
    positions = checked_array(np.asarray(positions), name="positions", shape=(curves.point_count, 3))
    note = f"yarnscale, m, radius {curves.radii[0]:.6g}".encode()
    parts = [_HEADER.pack(b"BCC", _SIZES, _SMOOTH, 3, _UP, len(curves), curves.point_count, note)]
    points = positions.astype("<f4")
    for k, closed in enumerate(curves.closed.tolist()):
        first, last = int(curves.offsets[k]), int(curves.offsets[k + 1])
        # A negative number of points says that the curve is a loop.
        parts += [struct.pack("<i", first - last if closed else last - first), points[first:last].tobytes()]
    write_bytes(path, b"".join(parts))
