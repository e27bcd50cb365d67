"""Yarn materials as TOML files; the format is described in docs/reference/yarn_material_format.md."""

from __future__ import annotations

import os
from dataclasses import fields
from pathlib import Path

from yarnscale.checked import checked
from yarnscale.errors import InputError, located, misspelt
from yarnscale.files.atomic import write_text
from yarnscale.files.fields import Fields, toml_file
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
def read_yarn_material(source: str | os.PathLike[str]) -> YarnMaterial:
    """A material by preset name or from a TOML file; InputError naming file and field for anything else."""
    if isinstance(source, str) and source in PRESETS:
        return PRESETS[source]
    path = Path(source)
    if not os.path.exists(path) and path.suffix == "" and len(path.parts) == 1:
        raise InputError(
            "unknown material", expected=f"a TOML file or one of {', '.join(PRESETS)}", found=misspelt(source, PRESETS)
        )
    with toml_file(path) as table:
        return material_of(table, name=path.stem)


def material_of(table: Fields, *, name: str = "yarn") -> YarnMaterial:
    """The material of a table of fields, as in a TOML file; ``name`` where the table has none.

    Raises InputError for unknown, missing and wrong fields.
    """
    table.known(*TOP_LEVEL)
    for field in NUMBERS:
        table.get(field)
    contact = table.fields("contact", optional=True).known(*CONTACT_FIELDS)
    stretch = table.fields("stretch", optional=True).known(*STRETCH_FIELDS)
    with located(table.path):
        rules = {"contact": ContactRule(**contact.content), "stretch": StretchRule(**stretch.content)}
        return YarnMaterial(**{"name": name, **table.content, **rules})


@checked
def write_yarn_material(material: YarnMaterial, path: str | os.PathLike[str]) -> None:
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
            if (value := getattr(rule, entry.name)) is None:
                continue
            lines.append(f"{entry.name} = {_string(value) if isinstance(value, str) else repr(value)}")
    write_text(path, "\n".join(lines) + "\n")


def _string(text: str) -> str:
    """A TOML basic string."""
    escaped = text.replace("\\", "\\\\").replace('"', '\\"')
    plain = "".join(c if c >= " " and c != "\x7f" else f"\\u{ord(c):04x}" for c in escaped)
    return f'"{plain}"'
