"""Wavefront OBJ files: a surface with its material coordinates, or a frame with cloth, bodies and yarns."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from yarnscale.arrays import Array, Integers
from yarnscale.files.animation import Animation, Moment
from yarnscale.files.atomic import write_text
from yarnscale.files.curve_frames import CurveSet


def obj_text(
    positions: Array, triangles: Integers, material: Array | None = None, corners: Integers | None = None,
    *, before: int = 0,
) -> str:  # fmt: skip
    """Vertices (n, 3) [m] and triangles (m, 3); material points (k, 2) [m] become ``vt``.

    corners: material points of the triangles' corners (m, 3); None where they are numbered as the vertices. before:
    number of vertices above in the file.
    """
    faces = triangles + 1 + before
    if material is None:
        return _rows("v", positions) + _faces(faces, "f %d %d %d")
    points = (triangles if corners is None else corners) + 1
    pairs = _faces(np.stack([faces, points], axis=2), "f %d/%d %d/%d %d/%d")
    return _rows("v", positions) + _rows("vt", material) + pairs


def write_obj_frame(path: Path, animation: Animation, moment: Moment) -> None:
    """Write one moment [m]; objects are called cloth, bodies and yarn0, yarn1, … ."""
    parts, before = ["# yarnscale, metres, z up\n"], 0
    for name, surface, vertices in (
        ("cloth", animation.cloth, moment.cloth),
        ("bodies", animation.bodies, moment.bodies),
    ):
        if surface is not None and vertices is not None:
            text = obj_text(vertices, surface.triangles, surface.material, surface.corners, before=before)
            parts.append(f"o {name}\n{text}")
            before += len(vertices)
    if animation.yarns is not None and moment.yarns is not None:
        parts.append(_rows("v", moment.yarns) + _polylines(animation.yarns, before + 1))
    write_text(path, "".join(parts))


def _rows(keyword: str, values: Array) -> str:
    """Lines of numbers, put into a text in one go."""
    line = keyword + " %.9g" * values.shape[1] + "\n"
    return (line * len(values)) % tuple(values.ravel().tolist())


def _faces(indices: Integers, form: str) -> str:
    return ((form + "\n") * len(indices)) % tuple(indices.ravel().tolist())


def _polylines(curves: CurveSet, first: int) -> str:
    lines = []
    for k, closed in enumerate(curves.closed.tolist()):
        start, stop = int(curves.offsets[k]) + first, int(curves.offsets[k + 1]) + first
        points = [*range(start, stop), *([start] if closed else [])]
        lines.append(f"o yarn{k}\nl " + " ".join(map(str, points)) + "\n")
    return "".join(lines)
