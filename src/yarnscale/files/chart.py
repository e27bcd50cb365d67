"""`.chart` files: a user's own knitting chart or weaving draft as text, described in docs/reference/chart_format.md."""

from __future__ import annotations

import os
import re
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from yarnscale.drawing.chart_error import ChartError
from yarnscale.drawing.library import Structure
from yarnscale.drawing.stitches import LARGEST_CHART
from yarnscale.errors import InputError, located, quoted
from yarnscale.files.source_text import finite_number, read_source
from yarnscale.files.structure_file import StructureFile
from yarnscale.yarn.units import FACTORS, to_si

NUMBERS = {
    "knit": (
        "wale_spacing",
        "course_spacing",
        "loop_height",
        "overhang",
        "half_thickness",
        "tightness",
        "vertices_per_stitch",
    ),
    "weave": ("warp_spacing", "weft_spacing", "half_thickness", "vertices_per_stitch"),
}
"""Keys that hold a plain number, by kind."""
LENGTHS = list(dict.fromkeys(key for keys in NUMBERS.values() for key in keys))
SPACINGS = ("warp_spacing", "weft_spacing")
"""Keys of NUMBERS that may hold several: from each yarn to the next."""
TEXTS = {"knit": ("kind", "name", "radius"), "weave": ("kind", "name", "radius", "warp_yarns")}
WEAVE_SYMBOLS = {"x": 1, ".": 0}
LARGEST_CHART_FILE = 100_000


@dataclass
class _Row:
    """A row as written: its symbols, the column of each (from 1), and its kinds of yarn."""

    line: int
    symbols: str
    columns: list[int]
    yarns: str | None


@dataclass
class _Chart:
    """The contents of a file; rows from the top one down."""

    keys: dict[str, tuple[int, str]] = field(default_factory=dict)
    rows: list[_Row] = field(default_factory=list)


def read_chart(path: str | os.PathLike[str]) -> StructureFile:
    """The structure of a chart file; its name is the file's stem unless the file says another.

    Raises InputError with file, line, column and reason for anything that cannot be knitted or woven.
    """
    path = Path(path)
    chart = _read(path)
    kind = _kind(path, chart)
    options = _options(path, chart, kind)
    rows = chart.rows[::-1]
    if any(row.yarns is not None for row in rows):
        options["yarns" if kind == "knit" else "weft_yarns"] = [row.yarns or "a" for row in rows]

    def place(error: InputError) -> str:
        if isinstance(error, ChartError):
            return _place(path, rows, error)
        # Yarns that overlap or do not interlock do so because of a size, mostly of a spacing.
        sizes = sorted((key for key in chart.keys if key in LENGTHS), key=LENGTHS.index)
        named = (error.what.split(" ", 1)[0], *sizes)
        line = next((chart.keys[key][0] for key in named if key in chart.keys), None)
        return str(path) if line is None else f"{path}:{line}"

    if kind == "knit":
        structure = Structure(f"Chart file {path.name}", tuple(row.symbols for row in rows), sizes=options)
    else:
        with located(place):
            structure = Structure(f"Chart file {path.name}", draft=np.array(_draft(rows)), sizes=options)
    return StructureFile(path, structure, place)


def _read(path: Path) -> _Chart:
    """Keys up to the line ``rows:``, rows after it."""
    chart, in_rows, text = _Chart(), False, read_source(path)
    if len(text) > LARGEST_CHART_FILE:
        expected = f"≤ {LARGEST_CHART_FILE} characters"
        raise InputError("chart file is too long", where=path, expected=expected, found=len(text))
    for number, line in enumerate(text.splitlines(), start=1):
        content = line.split("#", 1)[0]
        if not content.strip():
            continue
        where = f"{path}:{number}"
        if in_rows:
            chart.rows.append(_row(where, number, content))
            if len(chart.rows) > LARGEST_CHART:
                raise InputError("chart has too many rows", where=where, expected=f"≤ {LARGEST_CHART}")
        elif content.strip() == "rows:":
            in_rows = True
        else:
            key, equals, value = (part.strip() for part in content.partition("="))
            if not equals or not key or not value:
                raise InputError(
                    "line is no setting", where=where, expected="key = value, or rows:", found=quoted(content.strip())
                )
            if key in chart.keys:
                raise InputError(f"{quoted(key)} occurs twice", where=where, expected=f"only line {chart.keys[key][0]}")
            chart.keys[key] = (number, value)
    if not chart.rows:
        expected = "a line 'rows:' and a row of symbols on each line after it"
        raise InputError("chart has no rows", where=path, expected=expected)
    return chart


def _row(where: str, line: int, content: str) -> _Row:
    """Symbols, which may be spaced out, and after a colon the letters of the yarn."""
    symbols, colon, yarns = content.partition(":")
    columns = [place for place, letter in enumerate(symbols, start=1) if not letter.isspace() and letter != "|"]
    if not columns:
        raise InputError("row has no stitches", where=where, expected="symbols", found=quoted(content.strip()))
    letters = "".join(yarns.split())
    if colon and not (letters.isalpha() and letters.isascii() and len(letters) <= 2):
        raise InputError(
            "row names no yarn",
            where=f"{where}:{len(symbols) + 1}",
            expected="a letter after the colon, or two for plated yarns",
            found=quoted(yarns.strip()),
        )
    return _Row(line, "".join(symbols.split()), columns, letters if colon else None)


def _kind(path: Path, chart: _Chart) -> str:
    if "kind" not in chart.keys:
        raise InputError("kind is missing", where=path, expected="kind = knit or kind = weave")
    line, kind = chart.keys["kind"]
    if kind not in NUMBERS:
        raise InputError("kind is unknown", where=f"{path}:{line}", expected="knit or weave", found=quoted(kind))
    return kind


def _options(path: Path, chart: _Chart, kind: str) -> dict:
    """Keyword arguments of `knit` or `weave`."""
    options: dict = {"name": path.stem}
    for key, (line, value) in chart.keys.items():
        where = f"{path}:{line}"
        if key in SPACINGS and len(numbers := value.split()) > 1:
            options[key] = [_number(where, key, number) for number in numbers]
        elif key in NUMBERS[kind]:
            options[key] = _number(where, key, value)
        elif key == "radius":
            options[key] = _length(where, key, value)
        elif re.fullmatch("radius_[A-Za-z]", key):
            options.setdefault("yarn_radius", {})[key[-1]] = _length(where, key, value)
        elif key == "name":
            options[key] = value
        elif key in TEXTS[kind]:
            if key == "warp_yarns":
                options[key] = value.split() if any(letter.isspace() for letter in value) else list(value)
        else:
            known = ", ".join((*TEXTS[kind], "radius_A (of yarn A)", *NUMBERS[kind]))
            raise InputError(f"{quoted(key)}: unknown key", where=where, expected=known)
    return options


def _number(where: str, key: str, value: str) -> float:
    number = finite_number(value)
    if not number > 0.0:
        expected = "a number of radii"
        raise InputError(f"{key} is no positive number", where=where, expected=expected, found=quoted(value))
    return number


def _length(where: str, key: str, value: str) -> float:
    """A length with its unit, as ``1 mm``."""
    words = value.split()
    units = [unit for unit, (quantity, _) in FACTORS.items() if quantity == "length"]
    if len(words) != 2 or words[1] not in units:
        expected = f"as in 1 mm ({', '.join(units)})"
        raise InputError(f"{key} needs a number and a unit", where=where, expected=expected, found=quoted(value))
    return to_si(_number(where, key, words[0]), words[1])


def _draft(rows: list[_Row]) -> list[list[int]]:
    """A binary table, the first pick first."""
    for number, row in enumerate(rows):
        if len(row.symbols) != len(rows[0].symbols):
            what, expected = (f"draft row {number + 1} has another length", f"{len(rows[0].symbols)} ends as in row 1")
            raise ChartError(what, row=number, expected=expected, found=len(row.symbols))
        for end, symbol in enumerate(row.symbols):
            if symbol not in WEAVE_SYMBOLS:
                raise ChartError(
                    f"draft row {number + 1} column {end + 1}: unknown symbol",
                    row=number,
                    column=end - row.symbols[:end].count("|"),  # a bar has no column of its own
                    expected="x (warp over) or . (weft over)",
                    found=repr(symbol),
                )
    return [[WEAVE_SYMBOLS[symbol] for symbol in row.symbols] for row in rows]


def _place(path: Path, rows: list[_Row], error: ChartError) -> str:
    """File, line and column of a fault; a fault of a whole column points at the first row."""
    row = rows[error.row if error.row is not None else 0]
    if error.column is None or error.column >= len(row.columns):
        return f"{path}:{row.line}"
    return f"{path}:{row.line}:{row.columns[error.column]}"
