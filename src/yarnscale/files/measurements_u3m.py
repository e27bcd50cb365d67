"""Raw measurements of fabric in the U3M format (schema 1.1): JSON, or a zip archive that contains it.

The machine (Browzwear FAB) pulls strips along the length (L), width (W) and bias (B) of a fabric from two distances of
the clamps, in cycles that go farther each time, loading and unloading apart. Readings alternate between distance [cm]
and force [g]. In strips of 2 cm clamps cause most of the force, which tells how the fabric resists contraction.
"""

from __future__ import annotations

import lzma
import zipfile
import zlib
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from io import BytesIO
from pathlib import Path

import numpy as np

from yarnscale.arrays import Array
from yarnscale.errors import InputError, quoted
from yarnscale.files.fields import Fields, json_file, json_text
from yarnscale.kinematics import GRAM_FORCE
from yarnscale.swatches.loading import Cycle, stretch_run
from yarnscale.swatches.measurements import BendingRigidity, Direction, StretchTest, SwatchMeasurements
from yarnscale.swatches.strip_bending import mean_rigidity

SUFFIXES = (".u3m", ".u3ma", ".json")
SCHEMA = "1.1"
DIRECTIONS = {"W": Direction.WEFT, "B": Direction.BIAS, "L": Direction.WARP}
"""Names of the format → directions of a knit or weave, whose warp runs along the length."""
_LONG, _SHORT, _BENT = "S2", "S1", ("U1", "D1")
_UNUSED = "bending from 8 cm (D2), which is mostly weight, and thickness (T)"
_LARGEST, _MOST = 64 * 1024 * 1024, 10_000
"""Largest size of a JSON file in an archive when unpacked, and most files in one."""
_CENTIMETRE = 1e-2


def read_u3m(path: Path, *, cycle: Cycle, single_run: bool) -> SwatchMeasurements:
    """The stretch tests and the mass of a fabric; InputError with file, line and field."""
    with _physics(path) as table:
        if table.text("schema") != SCHEMA:
            raise table.fault("schema", expected=f"'{SCHEMA}'", found=quoted(table.get("schema")))
        raw, tests, notes = table.fields("raw_data"), [], [f"not used: {_UNUSED}"]
        short, rigidity = [], []
        for name, direction in DIRECTIONS.items():
            if name not in raw.content:
                continue
            strips = raw.fields(name)
            test, remarks = _test(strips.fields(_LONG), direction, cycle)
            tests.append(test)
            notes += [f"{direction.value} ({name}): {remark}" for remark in remarks]
            if _SHORT in strips.content:
                short.append(_test(strips.fields(_SHORT), direction, cycle)[0])
            if bent := [strips.fields(key) for key in _BENT if key in strips.content]:
                try:
                    rigidity.append(BendingRigidity(direction, *mean_rigidity(_cycles(bent))))
                except InputError as error:
                    notes.append(f"{direction.value} ({name}): bending is not used: {error}")
        if not tests:
            raise table.fault("raw_data", expected=f"one of {', '.join(DIRECTIONS)}", found="none")
        if not single_run:
            notes.append("one strip a direction, whose spread is unknown")
        mass = 1e-3 * raw.number("M", positive=True) if "M" in raw.content else None
        return SwatchMeasurements(
            _name(table, path), tuple(tests), area_density=mass, notes=tuple(notes), short=tuple(short),
            rigidity=tuple(rigidity),
        )  # fmt: skip


def _name(table: Fields, path: Path) -> str:
    custom = table.content.get("custom")
    product = custom.get("browzwear") if isinstance(custom, dict) else None
    name = product.get("name") if isinstance(product, dict) else None
    return name if isinstance(name, str) and name.strip() else path.stem


def _test(part: Fields, along: Direction, cycle: Cycle) -> tuple[StretchTest, tuple[str, ...]]:
    """The stretch test of one strip, and remarks."""
    width, branches = _CENTIMETRE * part.number("width", positive=True), _branches(part)
    length, force = np.concatenate(branches).T
    try:
        run, remarks = stretch_run("1", force, length, None, swatch_width=width, cycle=cycle)
    except InputError as error:
        raise part.fault("samplesTree", expected=error.expected, found=error.found) from None
    return StretchTest(along, width, (run,)), remarks


def _cycles(tests: list[Fields]) -> list[tuple[Array, Array]]:
    """Ways in and out of strips bent up and down, in whose mean their weight has no part: lengths [m], loads [N/m]."""
    cycles: list[tuple[Array, Array]] = []
    for test in tests:
        width = _CENTIMETRE * test.number("width", positive=True)
        branches = [branch / [1.0, width] for branch in _branches(test) if len(branch) > 2]
        cycles += list(zip(branches[::2], branches[1::2], strict=False))
    return cycles


def _branches(part: Fields) -> list[Array]:
    """Ways in and out of every cycle: length [m] and force [N], (n, 2) each."""
    readings = part.get("samplesTree")
    if not isinstance(readings, list) or not readings:
        raise part.fault("samplesTree", expected="lists of distance [cm] and force [g]", found=quoted(readings))
    pairs = []
    for k, values in enumerate(readings):
        key = f"samplesTree[{k}]"
        branch = Fields({key: values}, part.path, part.name).numbers(key)
        if len(branch) % 2:
            expected = "pairs of distance [cm] and force [g]"
            raise part.fault(key, expected=expected, found=f"{len(branch)} numbers")
        if (branch[::2] <= 0).any():
            raise part.fault(key, expected="distances above zero [cm]", found=float(branch[::2].min()))
        pairs.append(branch.reshape(-1, 2) * [_CENTIMETRE, GRAM_FORCE])
    if not any(len(branch) for branch in pairs):
        raise part.fault("samplesTree", expected="three readings or more", found="none")
    return pairs


@contextmanager
def _physics(path: Path) -> Iterator[Fields]:
    """The object with raw data: a JSON file, or the one of an archive that has it."""
    if not zipfile.is_zipfile(path):
        with path.open("rb") if path.is_file() else nullcontext(BytesIO()) as file:
            if file.read(2) == b"PK":
                raise InputError("archive is cut off or damaged", where=path, expected="a whole zip archive")
        with json_file(path) as table:
            yield _holding_raw_data(table)
        return
    name, text = _unpacked(path)
    with json_text(f"{path}[{name}]", text) as table:
        yield _holding_raw_data(table)


def _unpacked(path: Path) -> tuple[str, str]:
    """Name and text of the first JSON file with raw data; of all files together never more than the largest size."""
    left = _LARGEST
    try:
        with zipfile.ZipFile(path) as archive:
            entries = [e for e in archive.infolist() if Path(e.filename).suffix.lower() in (".json", ".u3m")]
            if len(archive.infolist()) > _MOST or not entries:
                expected = f"an archive of at most {_MOST} files with a JSON file"
                raise InputError("no measurements", where=path, expected=expected, found=len(archive.infolist()))
            for entry in entries:
                with archive.open(entry) as file:
                    content = file.read(left + 1)
                left -= len(content)
                if left < 0:
                    raise InputError("file is too large", where=path, expected=f"≤ {_LARGEST} bytes", found="more")
                if b'"raw_data"' in content:
                    return entry.filename, content.decode("utf-8-sig")
    except InputError:
        raise
    except (OSError, ValueError, RuntimeError, EOFError, zipfile.BadZipFile, zlib.error, lzma.LZMAError) as error:
        raise InputError("file cannot be unpacked", where=path, expected="UTF-8 text", found=error) from None
    raise InputError("no measurements", where=path, expected="raw_data in a JSON file", found="none")


def _holding_raw_data(table: Fields) -> Fields:
    """The object itself, or the first one within it that has the field raw_data."""
    waiting: list[tuple[object, str]] = [(table.content, "")]
    found = "none"
    while waiting:
        content, label = waiting.pop(0)
        if isinstance(content, dict):
            if "raw_data" in content:
                return Fields(content, table.path, label)
            if {"bend", "stretch"} <= content.keys():
                found = f"summary values in '{label}', whose units are not published"
            waiting += [(v, f"{label}.{k}" if label else k) for k, v in content.items()]
    raise table.fault("raw_data", expected="measurements of the U3M format", found=found)
