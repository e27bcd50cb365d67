"""Measurements of a fabric from a TOML or CSV file; the form is described in docs/reference/measurement_format.md."""

from __future__ import annotations

import os
import re
import tomllib
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

from yarnscale.checked import checked
from yarnscale.errors import InputError
from yarnscale.estimate.loading import CYCLES
from yarnscale.estimate.measurements import SwatchMeasurements, YarnComposition
from yarnscale.files.measurements_csv import read_bend, read_logs
from yarnscale.files.measurements_swatches import LogSettings, direction_named
from yarnscale.files.source_text import read_source

_FIELDS = {
    "name": str,
    "fabric": str,
    "stretch": (str, dict, list),
    "bend": str,
    "single_run": bool,
    "area_density": float,
    "pattern": str,
    "photographs": list,
    "yarn": list,
}
_LOG_FIELDS = ("file", "direction", "run", "swatch_width_mm", "swatch_length_mm", "cycle")
_YARN_FIELDS = tuple(field.name for field in fields(YarnComposition))


@checked
def read_measurements(
    path: str | os.PathLike[str], *, sample: str | None = None, single_run: bool = False,
    settings: LogSettings | None = None,
) -> SwatchMeasurements:  # fmt: skip
    """Measurements of one fabric: a TOML file that names tables, or a table of stretch readings alone.

    sample: beginning of the fabric's name where a table holds several. single_run: make no remark on directions
    measured once. settings: what logs of testing machines leave out, where the file does not say it.
    Raises InputError with file, row and column.
    """
    path = Path(path)
    if path.suffix.lower() == ".toml":
        return _from_toml(path, sample, single_run, settings or LogSettings())
    readings = read_logs([(path, settings or LogSettings())], fabric=sample, single_run=single_run)
    return SwatchMeasurements(readings.fabric or path.stem, readings.tests, notes=readings.notes)


def _from_toml(path: Path, sample: str | None, single_run: bool, settings: LogSettings) -> SwatchMeasurements:
    table = _table(path)
    fabric = sample or table.get("fabric")
    single_run = single_run or table.get("single_run", False)
    tests, bend, notes = (), (), ()
    if "stretch" in table:
        entries = table["stretch"] if isinstance(table["stretch"], list) else [table["stretch"]]
        logs = [_log(path, entry, settings) for entry in entries]
        readings = read_logs(logs, fabric=fabric, single_run=single_run)
        tests, notes = readings.tests, readings.notes
    if "bend" in table:
        bend, remarks = read_bend(path.parent / table["bend"], fabric=fabric)
        notes = tuple(dict.fromkeys((*notes, *remarks)))
    try:
        return SwatchMeasurements(
            table.get("name", path.stem), tests, bend, tuple(_yarn(entry) for entry in table.get("yarn", ())),
            table.get("area_density"), table.get("pattern"), tuple(table.get("photographs", ())), notes,
        )  # fmt: skip
    except InputError as error:
        raise InputError(error.what, where=path, expected=error.expected, found=error.found) from None


def _table(path: Path) -> dict:
    text = read_source(path)
    try:
        table = tomllib.loads(text)
    except (tomllib.TOMLDecodeError, RecursionError, ValueError) as error:
        line = re.search(r"at line (\d+)", str(error))
        number = int(line.group(1)) if line else text.rstrip().count("\n") + 1
        raise InputError("file is not TOML", where=f"{path}:{number}", found=str(error)) from None
    for key, value in table.items():
        if key not in _FIELDS:
            raise InputError(f"unknown field {key!r:.60}", where=path, expected=", ".join(_FIELDS))
        kind = _FIELDS[key]
        number = kind is float and isinstance(value, (int, float)) and not isinstance(value, bool)
        right = number or (kind is not float and isinstance(value, kind))
        if not right or (key == "stretch" and not value):
            expected = (
                "the name of a file or tables [[stretch]]" if key == "stretch" else f"a {kind.__name__}"
            )
            raise InputError(f"field '{key}'", where=path, expected=expected, found=f"{value!r:.60}")
    if not all(isinstance(name, str) for name in table.get("photographs", ())):
        raise InputError("field 'photographs'", where=path, expected="names of files", found="something else")
    return table


def _log(path: Path, entry: object, settings: LogSettings) -> tuple[Path, LogSettings]:
    """A table of readings that a fabric file names, and what it says of it."""
    if isinstance(entry, str):
        entry = {"file": entry}
    if not isinstance(entry, dict) or not isinstance(entry.get("file"), str) or not entry["file"]:
        raise InputError(
            "field 'stretch'", where=path, expected='file = "NAME.csv" in it', found=f"{entry!r:.60}"
        )
    for key, value in entry.items():
        if key not in _LOG_FIELDS:
            raise InputError(f"unknown field stretch.{key:.40}", where=path, expected=", ".join(_LOG_FIELDS))
        number = isinstance(value, int | float) and not isinstance(value, bool) and 0 < value < 1e6
        right = number if key.endswith("_mm") else isinstance(value, str)
        if key == "direction":
            right = direction_named(str(value)) is not None
        if key == "cycle":
            right = value in CYCLES
        if not right:
            choices = {"direction": "weft, bias or warp", "cycle": "first or last"}
            expected = choices.get(key, "a positive number" if key.endswith("_mm") else "text")
            raise InputError(f"field stretch.{key}", where=path, expected=expected, found=f"{value!r:.60}")
    said: dict[str, Any] = {key: entry[key] for key in ("run", "cycle") if key in entry}
    sizes = ("swatch_width", "swatch_length")
    said |= {size: 1e-3 * float(entry[f"{size}_mm"]) for size in sizes if f"{size}_mm" in entry}
    if "direction" in entry:
        said["direction"] = direction_named(str(entry["direction"]))
    return path.parent / entry["file"], replace(settings, **said)


def _yarn(entry: object) -> YarnComposition:
    if not isinstance(entry, dict):
        raise InputError("yarn", expected="tables [[yarn]]", found=f"{entry!r:.60}")
    for key, value in entry.items():
        if key not in _YARN_FIELDS:
            raise InputError(f"unknown field yarn.{key:.40}", expected=", ".join(_YARN_FIELDS))
        text = key in ("material", "coating")
        right = (
            isinstance(value, str)
            if text
            else isinstance(value, (int, float)) and not isinstance(value, bool)
        )
        if not right:
            raise InputError(f"yarn.{key}", expected="text" if text else "a number", found=f"{value!r:.60}")
    for key in ("material", "denier"):
        if key not in entry:
            raise InputError(f"yarn.{key} is missing", expected="material and denier of every yarn")
    return YarnComposition(**entry)
