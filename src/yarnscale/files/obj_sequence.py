"""One OBJ file a frame: cloth with its material coordinates, bodies, and yarns as polylines."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from yarnscale.files.animation import Animation, Moment
from yarnscale.files.atomic import write_text
from yarnscale.files.curve_frames import CurveSet

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]


def write_obj_frame(path: Path, animation: Animation, moment: Moment) -> None:
    """Write one moment [m]; objects are called cloth, bodies and yarn0, yarn1, … ."""
    parts, before = ["# yarnscale, metres, z up\n"], 0
    if animation.cloth is not None and moment.cloth is not None:
        cloth = animation.cloth
        parts.append("o cloth\n" + _rows("v", moment.cloth))
        if cloth.material is not None:
            parts.append(_rows("vt", cloth.material))
            points = cloth.triangles if cloth.corners is None else cloth.corners
            pairs = np.stack([cloth.triangles, points], axis=2) + 1
            parts.append(_faces(pairs, "{}/{} {}/{} {}/{}"))
        else:
            parts.append(_faces(cloth.triangles + 1, "{} {} {}"))
        before += len(moment.cloth)
    if animation.bodies is not None and moment.bodies is not None:
        parts.append("o bodies\n" + _rows("v", moment.bodies))
        parts.append(_faces(animation.bodies.triangles + 1 + before, "{} {} {}"))
        before += len(moment.bodies)
    if animation.yarns is not None and moment.yarns is not None:
        parts.append(_rows("v", moment.yarns) + _polylines(animation.yarns, before + 1))
    write_text(path, "".join(parts))


def _rows(keyword: str, values: Floats) -> str:
    """Lines of numbers, put into a text in one go."""
    line = keyword + " %.9g" * values.shape[1] + "\n"
    return (line * len(values)) % tuple(values.ravel().tolist())


def _faces(indices: Integers, form: str) -> str:
    line = "f " + form.replace("{}", "%d") + "\n"
    return (line * len(indices)) % tuple(indices.ravel().tolist())


def _polylines(curves: CurveSet, first: int) -> str:
    lines = []
    for k, closed in enumerate(curves.closed.tolist()):
        start, stop = int(curves.offsets[k]) + first, int(curves.offsets[k + 1]) + first
        points = [*range(start, stop), *([start] if closed else [])]
        lines.append(f"o yarn{k}\nl " + " ".join(map(str, points)) + "\n")
    return "".join(lines)
