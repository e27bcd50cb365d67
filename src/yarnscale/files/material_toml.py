"""Yarn materials as TOML files; the format is described in docs/reference/yarn_material_format.md."""

from __future__ import annotations

import os
from dataclasses import fields
from pathlib import Path
from typing import Any

from yarnscale.checked import checked
from yarnscale.errors import InputError
from yarnscale.files.atomic import write_text
from yarnscale.files.toml_text import fields_of, read_toml
from yarnscale.yarn.material import (
    CONTACT_FIELDS,
    NUMBERS,
    PRESETS,
    STRETCH_FIELDS,
    ContactRule,
    StretchRule,
    YarnMaterial,
)

TOP_LEVEL = (*NUMBERS, "name", "contact", "stretch")


@checked
def read_material(source: str | os.PathLike[str]) -> YarnMaterial:
    """A material by preset name or from a TOML file; InputError naming file and field for anything else."""
    if isinstance(source, str) and source in PRESETS:
        return PRESETS[source]
    path = Path(source)
    if not os.path.exists(path) and path.suffix == "" and len(path.parts) == 1:
        raise InputError(
            "unknown material",
            expected=f"a TOML file or one of {', '.join(PRESETS)}",
            found=repr(str(source)),
        )
    return read_material_file(path)


def read_material_file(path: str | os.PathLike[str]) -> YarnMaterial:
    """A material from a TOML file; InputError with file, line where known, field, expected and found."""
    path = Path(path)
    table, text = read_toml(path)
    with fields_of(path, text):
        return material_of_table(table, path, name=path.stem)


def material_of_table(
    table: dict[str, Any], path: str | os.PathLike[str], *, name: str = "yarn"
) -> YarnMaterial:
    """The material whose fields a table holds, as in a TOML file; ``name`` where the table has none.

    path: of the file that errors name. Raises InputError for unknown, missing and wrong fields.
    """
    _known(path, table, TOP_LEVEL, "")
    for field in NUMBERS:
        if field not in table:
            raise InputError(f"{field} is missing", where=path, expected=", ".join(NUMBERS))
        if isinstance(table[field], bool) or not isinstance(table[field], (int, float)):
            raise InputError(
                f"{field} must be a number", where=path, expected="a number", found=f"{table[field]!r:.60}"
            )
    contact = _table(path, table, "contact", CONTACT_FIELDS)
    stretch = _table(path, table, "stretch", STRETCH_FIELDS)
    values = {field: table[field] for field in NUMBERS}
    try:
        return YarnMaterial(
            **values,
            name=table.get("name", name),
            contact=ContactRule(**contact),
            stretch=StretchRule(**stretch),
        )
    except InputError as error:
        raise InputError(error.what, where=path, expected=error.expected, found=error.found) from None


@checked
def write_material(material: YarnMaterial, path: str | os.PathLike[str]) -> None:
    """Write a material as TOML with every digit; whole or not at all."""
    lines = [
        "# yarnscale yarn material; SI units, see yarnscale help yarn_material",
        f"name = {_string(material.name)}",
        *(f"{name} = {getattr(material, name)!r}" for name in NUMBERS),
    ]
    for name in ("contact", "stretch"):
        rule = getattr(material, name)
        lines += ["", f"[{name}]"]
        for entry in fields(rule):
            value = getattr(rule, entry.name)
            lines.append(f"{entry.name} = {_string(value) if isinstance(value, str) else repr(value)}")
    write_text(path, "\n".join(lines) + "\n")


def _table(
    path: str | os.PathLike[str], table: dict[str, Any], name: str, known: tuple[str, ...]
) -> dict[str, Any]:
    """The sub-table of this name, empty where there is none."""
    entry = table.get(name, {})
    if not isinstance(entry, dict):
        raise InputError(f"{name} must be a table", where=path, expected=f"[{name}]", found=repr(entry))
    _known(path, entry, known, f"{name}.")
    return entry


def _known(
    path: str | os.PathLike[str], table: dict[str, object], names: tuple[str, ...], prefix: str
) -> None:
    for key in table:
        if key not in names:
            raise InputError(f"unknown field {prefix}{key}", where=path, expected=", ".join(names))


def _string(text: str) -> str:
    """A TOML basic string."""
    escaped = text.replace("\\", "\\\\").replace('"', '\\"')
    plain = "".join(c if c >= " " and c != "\x7f" else f"\\u{ord(c):04x}" for c in escaped)
    return f'"{plain}"'
