"""Measurements of a fabric from a file; docs/reference/measurement_format.md describes the formats."""

from __future__ import annotations

import os
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

from yarnscale.checked import checked
from yarnscale.errors import InputError, quoted
from yarnscale.files.fields import Fields, toml_file
from yarnscale.files.measurements_biaxial import read_biaxial
from yarnscale.files.measurements_csv import read_bend, read_logs
from yarnscale.files.measurements_swatches import LogSettings, direction_named
from yarnscale.files.measurements_u3m import SUFFIXES as U3M_SUFFIXES
from yarnscale.files.measurements_u3m import read_u3m
from yarnscale.swatches.construction import KnownConstruction, YarnComposition
from yarnscale.swatches.loading import CYCLES
from yarnscale.swatches.measurements import SwatchMeasurements

_FIELDS = (
    "name", "fabric", "stretch", "bend", "biaxial", "single_run", "area_density", "pattern", "photographs", "yarn",
)  # fmt: skip
_COUNTS = {
    "wales_per_cm": ("wales", 1e2),
    "courses_per_cm": ("courses", 1e2),
    "loop_length_mm": ("loop_length", 1e-3),
    "tex": ("yarn_count", 1e-6),
}
"""Field → what of the construction it gives, and factor to SI."""
_PRESETS = (".zfab", ".jfab", ".fab")
_LOG_FIELDS = ("file", "direction", "run", "swatch_width_mm", "swatch_length_mm", "cycle")


@checked
def read_measurements(
    path: str | os.PathLike[str], *, sample: str | None = None, single_run: bool = False,
    settings: LogSettings | None = None,
) -> SwatchMeasurements:  # fmt: skip
    """Measurements of one fabric: a TOML file that names tables, or a table of stretch readings alone.

    sample: beginning of the fabric's name where a table has several. single_run: no notice of directions
    measured once. settings: what logs of testing machines leave out, where the file does not say it.
    Raises InputError with file, row and column.
    """
    path = Path(path)
    if path.suffix.lower() in _PRESETS:
        expected = "a table of readings: such files hold presets of a simulation, whose units are not published"
        raise InputError("fabric of CLO", where=path, expected=expected, found=path.suffix)
    if path.suffix.lower() in U3M_SUFFIXES:
        settings = settings or LogSettings()
        unused = {"sample": sample, "width of the swatch": settings.swatch_width, "length": settings.swatch_length}
        for name, value in unused.items():
            if value is not None:
                raise InputError(name, where=path, expected="none: U3M files say it themselves", found=value)
        return read_u3m(path, cycle=settings.cycle, single_run=single_run)
    if path.suffix.lower() == ".toml":
        return _from_toml(path, sample, single_run, settings or LogSettings())
    readings = read_logs([(path, settings or LogSettings())], fabric=sample, single_run=single_run)
    measured = SwatchMeasurements(readings.fabric or path.stem, readings.tests, notes=readings.notes)
    return measured.knowing(readings.known)


def fabric_files(folder: Path) -> dict[str, Path]:
    """Files of the fabrics of a folder by name: ``NAME.toml``, ``NAME.u3m`` or ``NAME/fabric.toml``.

    Raises InputError where there are none, or two of one name.
    """
    found: dict[str, Path] = {}
    suffixes = (".toml", *(suffix for suffix in U3M_SUFFIXES if suffix != ".json"))
    for path in sorted([*folder.iterdir(), *folder.glob("*/fabric.toml")]):
        if not path.is_file() or path.suffix.lower() not in suffixes:
            continue
        name = path.stem if path.parent == folder else path.parent.name
        if name in found:
            raise InputError("fabrics of a folder", where=path, expected="other names", found=found[name])
        found[name] = path
    if not found:
        expected = "fabrics: NAME.toml, NAME.u3m or NAME/fabric.toml"
        raise InputError("folder", where=folder, expected=expected, found="none")
    return found


def _from_toml(path: Path, sample: str | None, single_run: bool, settings: LogSettings) -> SwatchMeasurements:
    with toml_file(path) as table:
        table.known(*_FIELDS, *_COUNTS)
        fabric = sample or table.text_or("fabric", None)
        single_run = single_run or table.flag_or("single_run", False)
        tests, bend, notes, known = (), (), (), KnownConstruction()
        if "stretch" in table.content:
            logs = [_log(path, entry, settings) for entry in _logs(table)]
            readings = read_logs(logs, fabric=fabric, single_run=single_run)
            tests, notes, known = readings.tests, readings.notes, readings.known
        if "bend" in table.content:
            bend, remarks = read_bend(path.parent / table.text("bend"), fabric=fabric)
            notes = tuple(dict.fromkeys((*notes, *remarks)))
        photographs = table.content.get("photographs", [])
        if not isinstance(photographs, list) or not all(isinstance(name, str) for name in photographs):
            raise table.fault("photographs", expected="names of files", found=quoted(photographs))
        said = {
            name: factor * table.number(key, positive=True)
            for key, (name, factor) in _COUNTS.items()
            if key in table.content
        }
        yarns = tuple(_yarn(entry) for entry in table.items("yarn", optional=True))
        density = table.number_or("area_density", known.area_density)
        if density is not None and not 0.005 <= density <= 5.0:
            raise table.fault("area_density", expected="0.005 to 5 kg/m²: 210 g/m² are 0.21", found=density)
        measured = SwatchMeasurements(
            table.text_or("name", path.stem), tests, bend, yarns, density, table.text_or("pattern", None),
            tuple(photographs), notes,
            biaxial=read_biaxial(path.parent / table.text("biaxial")) if "biaxial" in table.content else None,
        )  # fmt: skip
        return measured.knowing(replace(known, area_density=None)).knowing(KnownConstruction(**said))


def _logs(table: Fields) -> list[Fields]:
    """The tables of readings that a fabric file names: a file, or tables [[stretch]]."""
    given = table.content["stretch"]
    listed = given if isinstance(given, list) else [given]
    entries = [{"file": entry} if isinstance(entry, str) else entry for entry in listed]
    if not entries or not all(isinstance(entry, dict) for entry in entries):
        raise table.fault("stretch", expected="the name of a file or tables [[stretch]]", found=quoted(given))
    return [Fields(entry, table.path, "stretch") for entry in entries]


def _log(path: Path, entry: Fields, settings: LogSettings) -> tuple[Path, LogSettings]:
    """A table of readings, and what the fabric file says of it."""
    entry.known(*_LOG_FIELDS)
    said: dict[str, Any] = {}
    if "run" in entry.content:
        said["run"] = entry.text("run")
    if "cycle" in entry.content:
        said["cycle"] = entry.choice("cycle", CYCLES)
    if "direction" in entry.content:
        said["direction"] = direction_named(entry.text("direction"))
        if said["direction"] is None:
            raise entry.fault("direction", expected="weft, bias or warp", found=quoted(entry.get("direction")))
    for size in ("swatch_width", "swatch_length"):
        if f"{size}_mm" in entry.content:
            said[size] = 1e-3 * entry.number(f"{size}_mm", positive=True)
    return path.parent / entry.text("file"), replace(settings, **said)


def _yarn(entry: Fields) -> YarnComposition:
    entry.known(*(field.name for field in fields(YarnComposition)))
    entry.number("denier")
    readers = {"material": entry.text, "coating": entry.text, "filaments": entry.integer}
    values = {key: readers.get(key, entry.number)(key) for key in ("material", *entry.content)}
    return YarnComposition(**values)  # type: ignore[arg-type]
