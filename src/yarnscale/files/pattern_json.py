"""The native pattern format: JSON with a version and units, described in docs/reference/pattern_format.md."""

from __future__ import annotations

import json
import math
import os
import re
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from yarnscale.errors import InputError
from yarnscale.files.atomic import write_text
from yarnscale.files.material_toml import material_of_table
from yarnscale.files.source_text import read_source
from yarnscale.yarn.clearance import check_clearance
from yarnscale.yarn.material import YarnMaterial
from yarnscale.yarn.pattern import YarnPattern
from yarnscale.yarn.proportions import check_proportions
from yarnscale.yarn.stiffness import Materials, materials_of

FORMAT = "yarnscale-pattern"
VERSION = 1
UNITS = {"length": "m", "angle": "rad"}
TABLES = {
    "vertices": 3,
    "twist": 1,
    "edges": 4,
    "rest_length": 1,
    "rest_curvature": 2,
    "rest_twist": 1,
    "reference_director": 3,
    "reference_twist": 1,
}
"""Field -> numbers per row; every table has one row per vertex."""
OPTIONAL = ("yarn_material", "yarn_radius", "materials")
FIELDS = ("format", "version", "name", "units", "period", "radius", *TABLES)


def read_pattern_json(path: str | os.PathLike[str], *, check_crossings: bool = True) -> YarnPattern:
    """Read a pattern in the native format.

    Raises InputError with file, line of the field, field, expected and found for anything that is no
    pattern, and, unless `check_crossings` is false, for yarns that run through each other.
    """
    path = Path(path)
    text = read_source(path)
    document = _parse(path, text)
    try:
        pattern = _assemble(document)
    except InputError as error:
        field = re.match(r"[a-z_]+", error.what)
        line = _line_of(text, field.group()) if field else None
        where = path if line is None else f"{path}:{line}"
        raise InputError(error.what, where=where, expected=error.expected, found=error.found) from None
    if check_crossings:
        check_proportions(pattern, where=path)
        check_clearance(pattern, where=path)
    return pattern


def read_yarns(path: str | os.PathLike[str]) -> Materials | None:
    """The yarn materials that a pattern file in the native format holds, None where it holds none.

    Raises InputError as ``read_pattern_json``.
    """
    path = Path(path)
    document = _parse(path, read_source(path))
    if "materials" not in document:
        return None
    return _yarns(document["materials"], path, _assemble(document))


def write_pattern_json(
    pattern: YarnPattern, path: str | os.PathLike[str], *, yarns: Materials | None = None
) -> None:
    """Write a pattern in the native format with every digit, a row a line; whole or not at all.

    yarns: the materials of its yarns, one for all or one for each number in ``yarn_material``.
    """
    head: dict[str, Any] = {
        "format": FORMAT,
        "version": VERSION,
        "name": pattern.name,
        "units": UNITS,
        "period": pattern.period.tolist(),
        "radius": pattern.radius,
    }
    entries = [f'  "{key}": {json.dumps(value, ensure_ascii=False)}' for key, value in head.items()]
    for field in TABLES:
        rows = ",\n".join("    " + json.dumps(row) for row in getattr(pattern, field).tolist())
        entries.append(f'  "{field}": [\n{rows}\n  ]')
    if pattern.material_of_vertex.any():
        assert pattern.yarn_material is not None
        entries.append(f'  "yarn_material": {json.dumps(pattern.yarn_material.tolist())}')
    if pattern.yarn_radius is not None:
        entries.append(f'  "yarn_radius": {json.dumps(pattern.yarn_radius.tolist())}')
    if yarns is not None:
        rows = ",\n".join(
            "    " + json.dumps(asdict(m), ensure_ascii=False) for m in materials_of(pattern, yarns)
        )
        entries.append(f'  "materials": [\n{rows}\n  ]')
    write_text(path, "{\n" + ",\n".join(entries) + "\n}\n")


def _parse(path: Path, text: str) -> dict[str, Any]:
    """The document's fields; no field may stand twice."""

    def no_constant(token: str) -> float:
        raise InputError("number is not finite", expected="a finite number", found=token)

    def no_repetition(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
        fields = dict(pairs)
        if len(fields) < len(pairs):
            keys = [key for key, _ in pairs]
            repeated = next(key for key in keys if keys.count(key) > 1)
            raise InputError(f"field {_short(repeated)} stands twice", expected="every field once")
        return fields

    try:
        document = json.loads(text, parse_constant=no_constant, object_pairs_hook=no_repetition)
    except InputError as error:
        token = str(error.found) if error.found is not None else ""
        line = _line_containing(text, token)
        where = path if line is None else f"{path}:{line}"
        raise InputError(error.what, where=where, expected=error.expected, found=error.found) from None
    except json.JSONDecodeError as error:
        raise InputError("file is not JSON", where=f"{path}:{error.lineno}", found=error.msg) from None
    except (RecursionError, ValueError) as error:
        raise InputError("file is not JSON", where=path, found=error) from None
    if not isinstance(document, dict):
        raise InputError(
            "file is no pattern", where=path, expected="a JSON object", found=type(document).__name__
        )
    return document


def _assemble(document: dict[str, Any]) -> YarnPattern:
    if document.get("format") != FORMAT:
        raise InputError("format is not known", expected=repr(FORMAT), found=_short(document.get("format")))
    version = document.get("version")
    if version != VERSION or isinstance(version, bool):
        raise InputError("version is not known", expected=VERSION, found=_short(version))
    for key in document:
        if key not in (*FIELDS, *OPTIONAL):
            raise InputError(f"{_short(key)}: unknown field", expected=", ".join((*FIELDS, *OPTIONAL)))
    for key in FIELDS:
        if key not in document:
            raise InputError(f"{key} is missing", expected=", ".join(FIELDS))
    if document["units"] != UNITS:
        raise InputError("units are not SI", expected=UNITS, found=_short(document["units"]))
    if not isinstance(document["name"], str):
        raise InputError("name is no text", expected="a text", found=_short(document["name"]))
    vertices = document["vertices"]
    if not isinstance(vertices, list) or not vertices:
        raise InputError("vertices is no table", expected="a list of rows", found=_short(vertices))
    tables = {
        field: _table(document[field], field, len(vertices), columns) for field, columns in TABLES.items()
    }
    return YarnPattern(
        **tables,
        period=_table(document["period"], "period", 2, 1),
        radius=_number(document["radius"], "radius"),
        name=document["name"],
        yarn_material=_materials(document.get("yarn_material")),
        yarn_radius=_radii(document.get("yarn_radius")),
    )


def _radii(value: object) -> np.ndarray | None:
    """Radius of each yarn; a pattern of one radius leaves it out."""
    if value is None:
        return None
    if not isinstance(value, list):
        raise InputError("yarn_radius is no list", expected="a number per yarn", found=_short(value))
    return np.array([_number(x, f"yarn_radius[{i}]") for i, x in enumerate(value)])


def _materials(value: object) -> np.ndarray | None:
    """Number of the material of each yarn; a pattern of one material may leave it out."""
    if value is None:
        return None
    if not isinstance(value, list):
        raise InputError("yarn_material is no list", expected="an integer per yarn", found=_short(value))
    return np.array([_integer(x, f"yarn_material[{i}]") for i, x in enumerate(value)], dtype=np.int64)


def _yarns(value: object, path: Path, pattern: YarnPattern) -> Materials:
    """One material for all yarns, or one for each number."""
    if not isinstance(value, list) or not value or not all(isinstance(entry, dict) for entry in value):
        raise InputError("materials is no list", where=path, expected="yarn materials", found=_short(value))
    found: list[YarnMaterial] = [material_of_table(entry, path) for entry in value]
    return found[0] if len(found) == 1 else materials_of(pattern, found)


def _table(value: object, field: str, rows: int, columns: int) -> np.ndarray:
    """A list of numbers (one column) or of rows of numbers, as an array."""
    if not isinstance(value, list):
        raise InputError(f"{field} is no list", expected=f"{rows} rows", found=_short(value))
    if len(value) != rows:
        raise InputError(f"{field} has the wrong number of rows", expected=rows, found=len(value))
    read = _integer if field == "edges" else _number
    if columns == 1:
        return np.array([read(entry, f"{field}[{index}]") for index, entry in enumerate(value)])
    for index, row in enumerate(value):
        if not isinstance(row, list) or len(row) != columns:
            found = len(row) if isinstance(row, list) else _short(row)
            raise InputError(f"{field}[{index}] is no row", expected=f"{columns} numbers", found=found)
    return np.array(
        [[read(x, f"{field}[{i}][{k}]") for k, x in enumerate(row)] for i, row in enumerate(value)]
    )


def _number(value: object, label: str) -> float:
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        raise InputError(f"{label} is no number", expected="a number", found=_short(value))
    try:
        number = float(value)
    except OverflowError:
        number = math.inf
    if not math.isfinite(number):
        raise InputError(f"{label} is not finite", expected="a finite number", found=_short(value))
    return number


def _integer(value: object, label: str) -> int:
    if isinstance(value, bool) or not isinstance(value, int):
        raise InputError(f"{label} is no integer", expected="an integer", found=_short(value))
    if abs(value) > 2**53:
        raise InputError(f"{label} is out of range", expected="a small integer", found=_short(value))
    return value


def _short(value: object) -> str:
    """A quotation that keeps the error on one readable line."""
    try:
        text = ascii(value)
    except (RecursionError, ValueError):
        text = type(value).__name__
    return text if len(text) <= 60 else text[:57] + "..."


def _line_of(text: str, field: str) -> int | None:
    """The line where a field begins."""
    found = re.search(rf'"{re.escape(field)}"\s*:', text)
    return None if found is None else text.count("\n", 0, found.start()) + 1


def _line_containing(text: str, token: str) -> int | None:
    """The first line that holds a token."""
    start = text.find(token) if token else -1
    return None if start < 0 else text.count("\n", 0, start) + 1
