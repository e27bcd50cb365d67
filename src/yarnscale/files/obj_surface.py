"""Read triangles of Wavefront OBJ files: obstacles, animated obstacles, and what garments are made of."""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from yarnscale.errors import InputError
from yarnscale.files.source_text import read_source

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class ObjSurface:
    """What an OBJ file holds.

    vertices: (n, 3); points: texture coordinates (k, 2); triangles: (m, 3) among the vertices; corners: (m, 3) among
    the points, −1 where a face has none; lines: of the file that each triangle comes from, (m,).
    """

    path: Path
    vertices: Floats
    points: Floats
    triangles: Integers
    corners: Integers
    lines: Integers

    def place(self, triangle: int) -> str:
        """File and line of a triangle."""
        return f"{self.path}:{self.lines[triangle]}"


def read_obj(path: str | os.PathLike[str]) -> ObjSurface:
    """The surface in an OBJ file; polygons become fans, everything but ``v``, ``vt`` and ``f`` is skipped.

    Raises InputError naming file, line and field.
    """
    vertices: list[list[float]] = []
    points: list[list[float]] = []
    triangles: list[list[int]] = []
    corners: list[list[int]] = []
    lines: list[int] = []
    for number, line in enumerate(read_source(path).splitlines(), start=1):
        words = line.split("#", 1)[0].split()
        if not words:
            continue
        where = f"{path}:{number}"
        if words[0] == "v":
            vertices.append(_coordinates("vertex", words[1:4], 3, where))
        elif words[0] == "vt":
            points.append(_coordinates("texture coordinates", words[1:3], 2, where))
        elif words[0] == "f":
            fan = [_corner(word, len(vertices), len(points), where) for word in words[1:]]
            if len(fan) < 3:
                raise InputError("face", where=where, expected="three or more vertices", found=len(fan))
            for b, c in pairwise(fan[1:]):
                triangles.append([fan[0][0], b[0], c[0]])
                corners.append([fan[0][1], b[1], c[1]])
                lines.append(number)
    if not triangles:
        raise InputError("file has no faces", where=path, expected="lines 'v x y z' and 'f a b c'")
    return ObjSurface(
        Path(path),
        np.array(vertices),
        np.array(points).reshape(-1, 2),
        np.array(triangles, dtype=np.int64),
        np.array(corners, dtype=np.int64),
        np.array(lines, dtype=np.int64),
    )


def read_obj_surface(path: str | os.PathLike[str]) -> tuple[Floats, Integers]:
    """Vertices (n, 3) and triangles (m, 3) of an OBJ file. Raises InputError naming file, line and field."""
    surface = read_obj(path)
    return surface.vertices, surface.triangles


def read_obj_poses(paths: Sequence[Path]) -> tuple[Floats, Integers]:
    """Vertices (k, n, 3) of files that differ in nothing else, and their triangles (m, 3). Raises InputError."""
    poses, first = [], None
    for path in paths:
        surface = read_obj(path)
        if first is None:
            first = surface
        if len(surface.vertices) != len(first.vertices):
            raise InputError(
                "vertices", where=path, expected=f"{len(first.vertices)} as in {first.path.name}",
                found=len(surface.vertices),
            )  # fmt: skip
        if not np.array_equal(surface.triangles, first.triangles):
            raise InputError("faces", where=path, expected=f"those of {first.path.name}", found="others")
        poses.append(surface.vertices)
    if first is None:
        raise InputError("animation", expected="one or more OBJ files", found="none")
    return np.array(poses), first.triangles


def _coordinates(what: str, words: list[str], count: int, where: str) -> list[float]:
    names = {2: "two", 3: "three"}[count]
    try:
        values = [float(word) for word in words]
    except ValueError:
        raise InputError(what, where=where, expected=f"{names} numbers", found=" ".join(words)[:60]) from None
    if len(values) != count or not all(math.isfinite(v) for v in values):
        raise InputError(what, where=where, expected=f"{names} finite numbers", found=" ".join(words)[:60])
    return values


def _corner(word: str, vertices: int, points: int, where: str) -> tuple[int, int]:
    """Zero-based vertex and texture point (or −1) of a corner such as 7, 7/1/3, 7//3 or -1 (counted from the last)."""
    parts = word.split("/")
    vertex = _index(parts[0], vertices, "vertices", where)
    # Texture points that are named but not in the file matter only to garments, which ask for them.
    textured = len(parts) > 1 and parts[1] and points
    return vertex, _index(parts[1], points, "texture coordinates", where) if textured else -1


def _index(text: str, count: int, names: str, where: str) -> int:
    try:
        index = int(text)
    except ValueError:
        raise InputError("face", where=where, expected="vertex numbers", found=text[:60]) from None
    place = count + index if index < 0 else index - 1
    if not 0 <= place < count:
        raise InputError("face", where=where, expected=f"{names} 1..{count}", found=index)
    return place
