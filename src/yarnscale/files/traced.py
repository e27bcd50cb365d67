"""Centre lines that were traced over photographs elsewhere: the visible parts of both sides, from SVG or CSV."""

from __future__ import annotations

import csv
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from yarnscale.arrays import Array
from yarnscale.errors import InputError, quoted
from yarnscale.files.source_text import read_source

SIDES = ("front", "back")
COLUMNS = ("side", "curve", "x", "y")
MOST_POINTS = 200_000
_PARTS = 16
"""Straight pieces of every segment of a path."""
_LABELS = ("id", "{http://www.inkscape.org/namespaces/inkscape}label")
_MILLIMETRE = 96.0 / 25.4
"""CSS pixels, the units of a drawing whose size has a unit."""


@dataclass(frozen=True, eq=False)
class Traced:
    """lines: by side, polylines (k, 2) [m], y upwards; the back as photographed. period: (2,) [m], None if unknown."""

    lines: dict[str, list[Array]]
    period: Array | None


def read_traced(path: Path, pixel: float | None) -> Traced:
    """The curves of an SVG (groups ``front`` and ``back``, a rectangle ``period``) or CSV (side, curve, x, y in mm).

    pixel: size of the user unit of an SVG [m]; None takes the size that the drawing states in mm, cm or in.
    Raises InputError for files that are none, and for sides without curves.
    """
    suffix = path.suffix.lower()
    if suffix not in (".svg", ".csv"):
        raise InputError("unknown file type", where=path, expected=".svg or .csv", found=repr(path.suffix))
    text = read_source(path)
    found = _csv(path, text) if suffix == ".csv" else _svg(path, text, pixel)
    for side in SIDES:
        if not found.lines[side]:
            raise InputError(f"{side} has no curve", where=path, expected="one or more traced curves on each side")
    return found


def _csv(path: Path, text: str) -> Traced:
    rows = list(csv.reader(text.splitlines()))
    if not rows or [name.strip().lower() for name in rows[0]] != list(COLUMNS):
        found = quoted(",".join(rows[0])) if rows else "nothing"
        raise InputError("header of the table", where=f"{path}:1", expected=",".join(COLUMNS), found=found)
    points: dict[str, dict[str, list[tuple[float, float]]]] = {side: {} for side in SIDES}
    for number, row in enumerate(rows[1:], start=2):
        if not any(cell.strip() for cell in row):
            continue
        where = f"{path}:{number}"
        if len(row) != len(COLUMNS):
            raise InputError("row of the table", where=where, expected=f"{len(COLUMNS)} cells", found=len(row))
        side, curve = row[0].strip().lower(), row[1].strip()
        if side not in SIDES:
            raise InputError("side", where=where, expected="front or back", found=quoted(row[0]))
        try:
            place = float(row[2]), float(row[3])
        except ValueError:
            place = (np.nan, np.nan)
        if not np.isfinite(place).all():
            raise InputError("x, y", where=where, expected="two numbers [mm]", found=quoted(",".join(row[2:])))
        points[side].setdefault(curve, []).append(place)
    lines: dict[str, list[Array]] = {}
    for side, curves in points.items():
        for curve, places in curves.items():
            if len(places) < 2:
                what = f"curve {quoted(curve)} of {side} has too few points"
                raise InputError(what, where=path, expected="two or more", found=len(places))
        lines[side] = [1e-3 * np.array(places) for places in curves.values()]
    return Traced(lines, None)


def _svg(path: Path, text: str, pixel: float | None) -> Traced:
    try:
        import svgelements
    except ImportError:
        expected = "pip install 'yarnscale[trace]'"
        raise InputError("svg files need the package svgelements", expected=expected, found="none") from None
    if "<!ENTITY" in text:
        raise InputError("file has entities", where=path, expected="a plain SVG drawing")
    try:
        drawing: Any = svgelements.SVG.parse(str(path), reify=True)
    except Exception as error:  # the parser raises whatever a fault leads to
        raise InputError("file is no SVG drawing", where=path, found=quoted(str(error))) from None
    unit = pixel
    if unit is None:
        stated = str(drawing.values.get("attributes", {}).get("width", ""))
        if not stated.strip().endswith(("mm", "cm", "in")):
            expected = "a width in mm, cm or in, or --scale for its units"
            raise InputError("size of the drawing is unknown", where=path, expected=expected, found=quoted(stated))
        unit = 1e-3 / _MILLIMETRE
    layers: dict[str, list[Any]] = {side: [] for side in SIDES}
    boxes: dict[bool, list[Any]] = {True: [], False: []}
    _sorted(svgelements, drawing, None, layers, boxes)
    chosen = boxes[True] or boxes[False]
    if len(chosen) > 1:
        expected = "one rectangle named period"
        raise InputError("period of the drawing is not clear", where=path, expected=expected, found=len(chosen))
    lines = {side: [line for shape in shapes for line in _lines(path, shape, unit)] for side, shapes in layers.items()}
    period = unit * np.array([abs(float(chosen[0].width)), abs(float(chosen[0].height))]) if chosen else None
    return Traced(lines, period)


def _sorted(svg: Any, group: Any, side: str | None, layers: dict[str, list[Any]], boxes: dict[bool, list[Any]]) -> None:
    """Shapes below a group by the side whose name their layer, or one above it, has; boxes by whether named period."""
    for entry in group:
        labels = " ".join(str(entry.values.get(key, "")) for key in _LABELS).lower()
        words = re.findall("[a-z]+", labels)
        named = next((word for word in (*SIDES, "period") if word in words), side)
        if isinstance(entry, svg.Group):
            _sorted(svg, entry, named, layers, boxes)
        elif isinstance(entry, svg.Rect):
            if named == "period" or side is None:
                boxes[named == "period"].append(entry)
        elif isinstance(entry, svg.Shape) and named in layers:
            layers[named].append(svg.Path(entry))


def _lines(path: Path, shape: Any, unit: float) -> list[Array]:
    """Points along every stroke of a path, y upwards."""
    found = []
    for stroke in shape.as_subpaths():
        drawn = [segment for segment in stroke if type(segment).__name__ != "Move" and segment.end is not None]
        points = [segment.point(share) for segment in drawn for share in np.linspace(0.0, 1.0, _PARTS + 1)]
        if len(points) > MOST_POINTS:
            raise InputError("path has too many points", where=path, expected=f"≤ {MOST_POINTS}")
        if points:
            found.append(unit * np.array([(float(p.x), -float(p.y)) for p in points]))
    return found
