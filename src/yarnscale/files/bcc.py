"""BCC, the binary curve collection of C. Yuksel's yarn-level models, whose format his page on them describes."""

from __future__ import annotations

import os
import struct
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from yarnscale.errors import InputError
from yarnscale.files.array_file import checked
from yarnscale.files.atomic import write_bytes
from yarnscale.files.curve_frames import CurveSet

Floats = NDArray[np.float64]

_HEADER = struct.Struct("<3sB2sBBQQ40s")
_SIZES = 0x44
"""Four bytes an integer, four bytes a float."""
_KINDS = {"smooth": b"C0", "polyline": b"PL"}
"""Uniform Catmull-Rom curves and polylines."""
_UP = 2
"""The z-axis."""


def write_bcc(
    path: str | os.PathLike[str],
    curves: CurveSet,
    positions: Floats,
    *,
    comment: str = "",
    smooth: bool = True,
) -> None:
    """Write points (n, 3) [m] of curves as single-precision control points.

    The format has no radii: the first one is written into the comment, of which 40 bytes are kept. smooth: uniform
    Catmull-Rom curves, else polylines. Raises InputError where the file cannot be written.
    """
    positions = checked(np.asarray(positions), name="positions", shape=(curves.point_count, 3))
    note = (comment or f"yarnscale, m, radius {curves.radii[0]:.6g}").encode()
    # A multi-byte character is not cut in two.
    note = note[:40].decode(errors="ignore").encode()
    kind = _KINDS["smooth" if smooth else "polyline"]
    parts = [_HEADER.pack(b"BCC", _SIZES, kind, 3, _UP, len(curves), curves.point_count, note)]
    points = positions.astype("<f4")
    for k, closed in enumerate(curves.closed.tolist()):
        first, last = int(curves.offsets[k]), int(curves.offsets[k + 1])
        # A negative number of points says that the curve is a loop.
        parts += [struct.pack("<i", first - last if closed else last - first), points[first:last].tobytes()]
    write_bytes(path, b"".join(parts))


def read_bcc(path: str | os.PathLike[str], *, radius: float) -> tuple[CurveSet, Floats, str]:
    """Curves, their points (n, 3) in the unit of the file, and the comment; ``radius`` is given to all points.

    Raises InputError where the file is none, is cut off, or holds other than 3D curves of 4-byte numbers.
    """
    try:
        content = Path(path).read_bytes()
    except OSError as error:
        raise InputError("file cannot be read", where=path, found=error.strerror) from None
    if len(content) < _HEADER.size or content[:3] != b"BCC":
        raise InputError("file is no binary curve collection", where=path, expected="'BCC' and 61 bytes more")
    _, sizes, kind, dimensions, _, count, total, note = _HEADER.unpack_from(content)
    if sizes != _SIZES or dimensions != 3 or kind not in _KINDS.values():
        raise InputError(
            "kind of curves",
            where=path,
            expected="sizes 0x44, type C0 or PL, 3 dimensions",
            found=f"sizes {sizes:#x}, type {kind!r}, {dimensions} dimensions",
        )
    if _HEADER.size + 4 * count + 12 * total != len(content):
        raise InputError(
            "file has a wrong size",
            where=path,
            expected=f"{_HEADER.size + 4 * count + 12 * total} bytes",
            found=len(content),
        )
    offsets, closed, points, place = [0], [], [], _HEADER.size
    for _ in range(count):
        (length,) = struct.unpack_from("<i", content, place)
        if offsets[-1] + abs(length) > total:
            raise InputError("curve is longer than the file says", where=path, found=abs(length))
        points.append(np.frombuffer(content, "<f4", 3 * abs(length), place + 4))
        place += 4 + 12 * abs(length)
        offsets.append(offsets[-1] + abs(length))
        closed.append(length < 0)
    curves = CurveSet(offsets, radius, closed=closed)
    positions = np.concatenate(points).reshape(-1, 3).astype(float)
    comment = note.split(b"\0")[0].decode(errors="replace")
    return curves, checked(positions, name="control points", shape=(total, 3), where=path), comment
