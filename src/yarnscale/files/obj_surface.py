"""Read the triangles of a Wavefront OBJ file, as an obstacle for cloth."""

from __future__ import annotations

import math
import os
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from yarnscale.errors import InputError
from yarnscale.files.source_text import read_source


def read_obj_surface(path: str | os.PathLike[str]) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Vertices (n, 3) and triangles (m, 3) of an OBJ file; polygons become fans, everything else is skipped.

    Raises InputError naming file, line and field.
    """
    vertices: list[list[float]] = []
    triangles: list[list[int]] = []
    for number, line in enumerate(read_source(path).splitlines(), start=1):
        where = f"{path}:{number}"
        words = line.split("#", 1)[0].split()
        if not words:
            continue
        if words[0] == "v":
            vertices.append(_coordinates(words[1:4], where))
        elif words[0] == "f":
            corners = [_index(word, len(vertices), where) for word in words[1:]]
            if len(corners) < 3:
                raise InputError("face", where=where, expected="three or more vertices", found=len(corners))
            triangles += [[corners[0], b, c] for b, c in pairwise(corners[1:])]
    if not triangles:
        raise InputError("file has no faces", where=path, expected="lines 'v x y z' and 'f a b c'")
    return np.array(vertices), np.array(triangles, dtype=np.int64)


def _coordinates(words: list[str], where: str) -> list[float]:
    try:
        values = [float(word) for word in words]
    except ValueError:
        raise InputError(
            "vertex", where=where, expected="three numbers", found=" ".join(words)[:60]
        ) from None
    if len(values) != 3 or not all(math.isfinite(v) for v in values):
        raise InputError("vertex", where=where, expected="three finite numbers", found=" ".join(words)[:60])
    return values


def _index(word: str, count: int, where: str) -> int:
    """Zero-based vertex of a face corner such as 7, 7/1/3 or -1 (counted from the last vertex)."""
    try:
        index = int(word.split("/", 1)[0])
    except ValueError:
        raise InputError("face", where=where, expected="vertex numbers", found=word[:60]) from None
    place = count + index if index < 0 else index - 1
    if not 0 <= place < count:
        raise InputError("face", where=where, expected=f"vertices 1..{count}", found=index)
    return place
