"""The native pattern format: JSON with a version and units, described in docs/reference/pattern_format.md."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path

from yarnscale.drawing.proportions import check_proportions
from yarnscale.errors import quoted
from yarnscale.files.atomic import write_json
from yarnscale.files.fields import Fields, json_file
from yarnscale.files.material_toml import material_of
from yarnscale.yarn.clearance import check_clearance
from yarnscale.yarn.pattern import YarnPattern
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
OPTIONAL = ("yarn_material", "yarn_radius", "materials", "polyline")
FIELDS = ("format", "version", "name", "units", "period", "radius", *TABLES)


def read_pattern_json(path: str | os.PathLike[str]) -> YarnPattern:
    """Read a pattern in the native format.

    Raises InputError with file, line of the field, field, expected and found for anything that is no pattern, and for
    yarns that run through each other.
    """
    path = Path(path)
    with json_file(path) as document:
        pattern = pattern_of(document)
    check_proportions(pattern, where=path)
    check_clearance(pattern, where=path)
    return pattern


def read_yarns_json(path: str | os.PathLike[str]) -> Materials | None:
    """The yarn materials in a pattern file of the native format, None where there are none.

    Raises InputError as ``read_pattern_json``.
    """
    with json_file(Path(path)) as document:
        return yarns_of(document, lambda: pattern_of(document))


def yarns_of(document: Fields, pattern: Callable[[], YarnPattern]) -> Materials | None:
    """The yarn materials in a pattern's content, None where there are none; pattern: of the same content."""
    if "materials" not in document.content:
        return None
    found = [material_of(entry) for entry in document.items("materials")]
    if not found:
        raise document.fault("materials", expected="one or more yarn materials", found="none")
    return found[0] if len(found) == 1 else materials_of(pattern(), found)


def write_pattern_json(pattern: YarnPattern, path: str | os.PathLike[str], *, yarns: Materials | None = None) -> None:
    """Write a pattern in the native format with every digit, a row a line; whole or not at all.

    yarns: the materials of its yarns, one for all or one for each number in ``yarn_material``.
    """
    write_json(path, pattern_content(pattern, yarns))


def pattern_content(pattern: YarnPattern, yarns: Materials | None = None) -> dict[str, object]:
    """What a file of a pattern holds."""
    content: dict[str, object] = {
        "format": FORMAT,
        "version": VERSION,
        "name": pattern.name,
        "units": UNITS,
        "period": pattern.period.tolist(),
        "radius": pattern.radius,
        **{field: getattr(pattern, field).tolist() for field in TABLES},
    }
    if pattern.yarn_material is not None and pattern.material_of_vertex.any():
        content["yarn_material"] = pattern.yarn_material.tolist()
    if pattern.yarn_radius is not None:
        content["yarn_radius"] = pattern.yarn_radius.tolist()
    if pattern.polyline:
        content["polyline"] = True
    if yarns is not None:
        content["materials"] = [asdict(material) for material in materials_of(pattern, yarns)]
    return content


def pattern_of(document: Fields) -> YarnPattern:
    """The pattern in the content of a file; InputError with its field where it is none."""
    for key, expected in (("format", FORMAT), ("version", VERSION), ("units", UNITS)):
        found = document.get(key)
        if found != expected or isinstance(found, bool):
            raise document.fault(key, expected=repr(expected), found=quoted(found))
    document.known(*FIELDS, *OPTIONAL)
    vertices = document.get("vertices")
    count = len(vertices) if isinstance(vertices, list) else 0
    tables = {
        field: document.numbers(field, shape=(count,) if columns == 1 else (count, columns))
        for field, columns in TABLES.items()
        if field != "edges"
    }
    optional = {"yarn_material": document.integers, "yarn_radius": document.numbers}
    tables |= {field: read(field) for field, read in optional.items() if field in document.content}
    return YarnPattern(
        **tables, edges=document.integers("edges", shape=(count, 4)), period=document.numbers("period", shape=(2,)),
        radius=document.number("radius"), name=document.text("name"),
        polyline=document.flag_or("polyline", False),
    )  # fmt: skip
