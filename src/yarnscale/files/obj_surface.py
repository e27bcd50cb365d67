"""Read polygons of Wavefront OBJ files: obstacles, animated obstacles, and what garments are made of.

Other readers keep neither the lines that faces come from nor texture coordinates apart from vertices, and stop at
continued lines or names that are not UTF-8.
"""

from __future__ import annotations

import math
import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from yarnscale.arrays import Array, Integers
from yarnscale.errors import InputError
from yarnscale.files.source_text import finite_number, read_source
from yarnscale.shell.garments.polygons import PolygonError, in_own_plane, triangulated

_LARGEST_NUMBER = 10**9


@dataclass(frozen=True, eq=False)
class ObjSurface:
    """The contents of an OBJ file.

    vertices: (n, 3); points: texture coordinates (k, 2). Polygon i has the corners starts[i] … starts[i + 1] − 1,
    with corner_vertices (nc,) among the vertices and corner_points (nc,) among the points, −1 where a corner has none.
    lines: of the file where each polygon begins, (nf,).
    """

    path: Path
    vertices: Array
    points: Array
    starts: Integers
    corner_vertices: Integers
    corner_points: Integers
    lines: Integers

    def place(self, face: int) -> str:
        """File and line of a polygon."""
        return f"{self.path}:{self.lines[face]}"

    def triangulated(self, coordinates: Array, starts: Integers | None = None) -> tuple[Integers, Integers]:
        """Corners of triangles (m, 3) and the polygon of each (m,), cut in the plane of ``coordinates`` (nc, 2).

        starts: first corners of the same polygons, where some have got more. Raises InputError with the line of a
        polygon that cannot be cut.
        """
        try:
            return triangulated(coordinates, self.starts if starts is None else starts)
        except PolygonError as error:
            raise error.at(self.place(error.face)) from None


def read_obj(path: str | os.PathLike[str]) -> ObjSurface:
    """The surface in an OBJ file; everything but ``v``, ``vt`` and ``f`` is skipped.

    Corners that follow their equals are left out, and so are polygons of fewer than three others. Raises InputError
    naming file, line and field, with numbers as the file counts them.
    """
    vertices: list[list[float]] = []
    points: list[list[float]] = []
    corners: list[tuple[int, int]] = []
    sizes: list[int] = []
    lines: list[int] = []
    for number, line in _logical_lines(read_source(path, any_encoding=True)):
        words = line.split("#", 1)[0].split()
        if not words:
            continue
        where = f"{path}:{number}"
        if words[0] == "v":
            vertices.append(_coordinates("vertex", words[1:4], 3, where))
        elif words[0] == "vt":
            points.append(_coordinates("texture coordinates", words[1:3], 2, where))
        elif words[0] == "f":
            if len(words) < 4:
                raise InputError("face", where=where, expected="three or more vertices", found=len(words) - 1)
            polygon = [_corner(word, len(vertices), len(points), where) for word in words[1:]]
            polygon = [corner for k, corner in enumerate(polygon) if corner[0] != polygon[k - 1][0]]
            if len(polygon) > 2:
                corners += polygon
                sizes.append(len(polygon))
                lines.append(number)
    if not sizes:
        raise InputError("file has no faces", where=path, expected="lines 'v x y z' and 'f a b c'")
    starts = np.concatenate([[0], np.cumsum(sizes)])
    numbers = np.array(corners, dtype=np.int64)
    # Texture points that are named but not in the file matter only to garments, which check them.
    named = numbers[:, 1] if points else np.full(len(numbers), -1)
    surface = ObjSurface(
        Path(path), np.array(vertices).reshape(-1, 3), np.array(points).reshape(-1, 2), starts, numbers[:, 0],
        named, np.array(lines, dtype=np.int64),
    )  # fmt: skip
    _check_numbers(surface)
    return surface


def _logical_lines(text: str) -> Iterator[tuple[int, str]]:
    """Lines with the number of the first of those that backslashes at line ends join."""
    begun, first = "", 0
    for number, line in enumerate(text.replace("\r\n", "\n").replace("\r", "\n").split("\n"), start=1):
        first = first if begun else number
        content = line.rstrip()
        # A comment may end with a backslash: paths of the systems that write them so.
        if content.endswith("\\") and "#" not in content:
            begun += content[:-1] + " "
        else:
            yield first, begun + content
            begun = ""
    yield first, begun


def _check_numbers(surface: ObjSurface) -> None:
    """Every number that a face names is in the file, before or after it."""
    for named, count, what in (
        (surface.corner_vertices, len(surface.vertices), "vertices"),
        (surface.corner_points, len(surface.points), "texture coordinates"),
    ):
        wrong = np.flatnonzero(named >= count)
        if len(wrong):
            face = int(np.searchsorted(surface.starts, wrong[0], side="right")) - 1
            expected = f"{what} 1..{count}" if count else f"{what}, of which the file has none"
            raise InputError("face", where=surface.place(face), expected=expected, found=int(named[wrong[0]]) + 1)


def read_obj_surface(path: str | os.PathLike[str]) -> tuple[Array, Integers]:
    """Vertices (n, 3) and triangles (m, 3) of an OBJ file. Raises InputError naming file, line and field."""
    surface = read_obj(path)
    return surface.vertices, _in_space(surface)


def _in_space(surface: ObjSurface) -> Integers:
    """Triangles (m, 3) of the vertices, every polygon cut in its own plane."""
    seen = in_own_plane(surface.vertices[surface.corner_vertices], surface.starts)
    return surface.corner_vertices[surface.triangulated(seen)[0]]


def read_obj_poses(paths: Sequence[Path]) -> tuple[Array, Integers]:
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
        if not (
            np.array_equal(surface.starts, first.starts)
            and np.array_equal(surface.corner_vertices, first.corner_vertices)
        ):
            raise InputError("faces", where=path, expected=f"those of {first.path.name}", found="others")
        poses.append(surface.vertices)
    if first is None:
        raise InputError("animation", expected="one or more OBJ files", found="none")
    return np.array(poses), _in_space(first)


def _coordinates(what: str, words: list[str], count: int, where: str) -> list[float]:
    values = [finite_number(word) for word in words]
    if len(values) != count or any(map(math.isnan, values)):
        names = {2: "two", 3: "three"}[count]
        raise InputError(what, where=where, expected=f"{names} finite numbers", found=" ".join(words)[:60])
    return values


def _corner(word: str, vertices: int, points: int, where: str) -> tuple[int, int]:
    """Zero-based vertex and texture point (or −1) of a corner such as 7, 7/1/3, 7//3 or -1 (counted from the last)."""
    parts = word.split("/")
    point = _index(parts[1], points, "texture coordinates", where) if len(parts) > 1 and parts[1] else -1
    return _index(parts[0], vertices, "vertices", where), point


def _index(text: str, count: int, names: str, where: str) -> int:
    """Zero-based number, which may be that of a row still to come; negative ones count back from the last so far."""
    try:
        index = int(text)
    except ValueError:
        raise InputError("face", where=where, expected="vertex numbers", found=text[:60]) from None
    if index == 0 or index < -count or index > _LARGEST_NUMBER:
        raise InputError("face", where=where, expected=f"{names} 1..{count}", found=index)
    return index - 1 if index > 0 else count + index
