"""Tables of readings as machines write them: separators, decimal marks, units, several specimens in a file.

A table begins with a line of column names, which may be followed by a line of units. Lines of text before, between and
after tables are titles; those of the form "width, 50, mm" are kept as settings.
"""

from __future__ import annotations

import csv
import io
import os
import re
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from yarnscale.arrays import Array
from yarnscale.errors import InputError
from yarnscale.files.measurements_blocks import CYCLE_OR_DATE, Block, joined_tables
from yarnscale.files.measurements_table import (
    CONSTRUCTION,
    DECIMALS,
    SPACES,
    ColumnName,
    MeasuredTable,
    Row,
    column_name,
    factor,
    is_unit,
)

_NAMES = {
    "force": "force_N and clamp_distance_mm, or Load (N) and Extension (mm)",
    "loop_ratio": "loop_ratio and clamp_distance_mm",
    "force_weft": "force_weft_N/m, force_warp_N/m, strain_weft_% and strain_warp_%",
}
"""First needed quantity of a table → names of columns to show in an error."""
_IN_TEXT = {
    "swatch_width": re.compile(r"\b(?:strip|width|breite)\b[^\d,;]{0,20}(\d+(?:[.,]\d+)?)\s*mm\b(?!/)", re.I),
    "swatch_length": re.compile(r"\b(?:gauge|gage|clamps)\b[^\d,;]{0,20}(\d+(?:[.,]\d+)?)\s*mm\b(?!/)", re.I),
}
"""Size of the swatch as sentences above a table give it."""
_LONGEST_LINE = 1_000_000
"""Characters of a line; no table of readings has more."""
_IN_QUOTES = 5
"""Lines over which the quoted cells of one row may go; more are due to a quotation mark that nothing closes."""
_SAMPLED = 2000
"""Readings of a table in which the decimal mark is looked for."""


def read_tables(path: str | os.PathLike[str], text: str, *, needed: Sequence[str]) -> tuple[MeasuredTable, ...]:
    """The tables of a file, one or more, whose names contain one of the ``needed`` quantities and another known one.

    Lines that begin with # are comments. Raises InputError with file and line.
    """
    reader = _Reader(str(path), tuple(needed))
    text = text.replace("\r\n", "\n").replace("\r", "\n")
    _refuse_long_lines(str(path), text)
    stated = re.match(r"sep=(.)\n", text)
    separator = stated.group(1) if stated else _separator(text)
    if separator == "," and "," not in text:
        # Columns aligned by spaces.
        separator, text = "\t", re.sub(r"(?<=\S) {2,}(?=\S)", "\t", text)
    lines = csv.reader(io.StringIO(text), delimiter=separator, skipinitialspace=True)
    try:
        before = 0
        for cells in lines:
            if lines.line_num - before > _IN_QUOTES:
                where = f"{path}:{before + 1}"
                raise InputError("quotation mark", where=where, expected="one that closes it", found="none")
            before = lines.line_num
            reader.take(before, tuple([cell.strip() for cell in cells]))
    except csv.Error as error:
        raise InputError("no CSV text", where=f"{path}:{lines.line_num}", found=str(error)) from None
    return reader.tables(separator)


def _refuse_long_lines(path: str, text: str) -> None:
    """InputError for a line that would become millions of cells."""
    begin = 0
    while len(text) - begin > _LONGEST_LINE:
        end = text.rfind("\n", begin, begin + _LONGEST_LINE)
        if end < 0:
            line = text.count("\n", 0, begin) + 1
            found = "more"
            raise InputError("line", where=f"{path}:{line}", expected=f"≤ {_LONGEST_LINE} characters", found=found)
        begin = end + 1


def _separator(text: str) -> str:
    """Tab or semicolon where half of the lines have one, else comma."""
    lines = [line for line in text[:100_000].splitlines() if line.strip() and not line.startswith("#")]
    for separator in "\t;":
        if sum(separator in line for line in lines) >= 0.5 * len(lines):
            return separator
    return ","


class _Reader:
    """Sorts the lines of a file into titles, names, units and readings."""

    def __init__(self, path: str, needed: tuple[str, ...]) -> None:
        self.path, self.needed = path, needed
        self.found: list[MeasuredTable] = []
        self.rows: list[list[Row]] = []
        self.text: list[tuple[int, tuple[str, ...]]] = []
        self.settings: dict[str, float] = {}
        self.told: list[str] = []
        self.first: tuple[int, tuple[str, ...]] | None = None
        self.width, self.numeric = 0, ()

    def take(self, line: int, cells: tuple[str, ...]) -> None:
        """One line of the file."""
        if self._goes_on(cells):
            self.rows[-1].append((line, cells))
            return
        while cells and not cells[-1] and len(cells) > self.width:
            cells = cells[:-1]
        if not any(cells) or cells[0].startswith("#"):
            return
        self.first = self.first or (line, cells)
        if (names := self._names(cells)) is not None:
            self._begin(line, names)
        elif self.found and not self.rows[-1] and not self.text and all(is_unit(c) or not c for c in cells):
            old = self.found[-1]
            units = (*cells, *[""] * len(old.names))
            names = tuple(replace(name, unit=unit or name.unit) for name, unit in zip(old.names, units, strict=False))
            self.found[-1] = replace(old, names=names)
        elif self.found and self._is_reading(line, cells):
            if self.text:
                old = self.found[-1]
                self._begin(old.header, old.names)
            self.rows[-1].append((line, cells))
        else:
            self._keep_text(line, cells)

    def _goes_on(self, cells: tuple[str, ...]) -> bool:
        """Whether cells are plainly another reading of the last table."""
        if len(cells) != self.width or self.text or not self.rows[-1]:
            return False
        if cells[0][:1].isalpha() != self.rows[-1][0][1][0][:1].isalpha():
            return False
        try:
            for k in self.numeric:
                float(cells[k].replace(",", "."))
        except ValueError:
            return False
        return True

    def _names(self, cells: tuple[str, ...]) -> tuple[ColumnName, ...] | None:
        """The names of columns that cells are, None where they are none."""
        if len(cells) < 2 or any(_looks_like_number(cell) for cell in cells):
            return None
        names = tuple(column_name(cell) for cell in cells)
        known = {name.quantity for name in names} - {None, "ignored"}
        return names if len(known) > 1 and known & set(self.needed) else None

    def _begin(self, line: int, names: tuple[ColumnName, ...]) -> None:
        title = " ".join(filter(None, self.text[-1][1])) if self.text else ""
        self.found.append(
            MeasuredTable(
                self.path, line, names, title=title, settings=tuple(self.settings.items()), lines=tuple(self.text),
                remarks=tuple(self.told),
            )
        )  # fmt: skip
        self.told = []
        self.rows.append([])
        self.text, self.width = [], len(names)
        self.numeric = tuple(k for k, n in enumerate(names) if n.quantity in self.needed)

    def _is_reading(self, line: int, cells: tuple[str, ...]) -> bool:
        """Whether cells are a reading, not text; InputError for a reading of the wrong number of cells."""
        numbers = [k for k, cell in enumerate(cells) if _looks_like_number(cell)]
        if not numbers:
            return False
        earlier = self.rows[-1][0][1] if self.rows[-1] else None
        if earlier is not None and _looks_like_number(earlier[0]) and 0 not in numbers and cells[0][:1].isalpha():
            return False
        if len(cells) == self.width:
            return True
        if self.text or not set(self.numeric) & set(numbers):
            return False
        hint = ", decimal commas where commas separate columns?" if len(cells) > self.width else ""
        raise InputError(
            "row", where=f"{self.path}:{line}", expected=f"{self.width} cells", found=f"{len(cells)}{hint}"
        )

    def _keep_text(self, line: int, cells: tuple[str, ...]) -> None:
        label = cells[0].rstrip(":= ")
        name = column_name(label)
        quantity = name.quantity
        of_fabric = quantity in CONSTRUCTION and len(cells) > 1
        if not of_fabric:
            self.text.append((line, cells))
        sizes = (*CONSTRUCTION, "swatch_width", "swatch_length")
        if quantity is None or quantity not in sizes or len(cells) < 2:
            self._read_sentence(line, " ".join(cells))
            return
        # Names such as tex are units themselves.
        parts = [*cells[1].split(), *cells[2:3], name.unit or label]
        found = factor(quantity, next((part for part in parts[1:] if part), None))
        number = parts[0].replace(",", ".") if parts else ""
        if found is not None and _looks_like_number(number):
            if not float(number) > 0:
                raise InputError(
                    f"'{label:.60}'", where=f"{self.path}:{line}", expected="a number above zero", found=number
                )
            self.settings[quantity] = float(number) * found[1]

    def _read_sentence(self, line: int, text: str) -> None:
        for quantity, form in _IN_TEXT.items():
            if quantity not in self.settings and (found := form.search(text)) is not None:
                self.settings[quantity] = 1e-3 * float(found[1].replace(",", "."))
                self.told.append(f"{quantity.replace('_', ' ')} {found[1]} mm, as line {line} says")

    def tables(self, separator: str) -> tuple[MeasuredTable, ...]:
        """What was found. Raises InputError where that is nothing."""
        tables = [replace(table, rows=tuple(rows)) for table, rows in zip(self.found, self.rows, strict=True) if rows]
        if not self.found and self.first is not None:
            line, cells = self.first
            names = ", ".join(cells)
            raise InputError(
                "column names", where=f"{self.path}:{line}",
                expected=f"a line of names such as {_NAMES[self.needed[0]]}, separated by commas, semicolons or tabs",
                found=f"{names:.160}",
            )  # fmt: skip
        if not tables:
            where = f"{self.path}:{self.found[-1].header}" if self.found else self.path
            raise InputError("readings", where=where, expected="a line of column names and rows", found="none")
        for table, rows in zip(self.found, self.rows, strict=True):
            again = [other for other in tables if other.names == table.names]
            if table.title and not rows and again and all(other.header != table.header for other in again):
                raise _empty_specimen(table, table.header)
        # A few numbers below a line of text, without names of their own, may be results in another form.
        long = [
            table
            for k, table in enumerate(tables)
            if not k or len(table.rows) > 2 or table.header != tables[k - 1].header
        ]
        mark = _decimal_mark(long, self.needed, separator)
        tables = [replace(table, decimal=mark) for table in tables]
        tables = joined_tables(tables, [_block(table) for table in tables]) if len(tables) > 1 else tables
        return tuple(single for table in tables for single in _side_by_side(table))


def _block(table: MeasuredTable) -> Block:
    """The readings of a table, or of its first specimen side by side, as numbers; nan where a cell has none."""

    def numbers(*quantities: str) -> Array:
        places = (k for k, name in enumerate(table.names) if name.quantity in quantities)
        place = next((k for k in places if not CYCLE_OR_DATE.match(table.names[k].text)), None)
        return np.array([np.nan if place is None else table._number(cells[place]) for _, cells in table.rows])

    count = numbers("ignored")
    above = table.above
    other = len(above) == len(table.names) and all(c and not _looks_like_number(c) and not is_unit(c) for c in above)
    return Block(
        table.lines[-1][0] if table.lines else table.header,
        tuple(" ".join(filter(None, cells)) for _, cells in table.lines),
        numbers("clamp_distance", "extension"), numbers("force", "loop_ratio"),
        count if np.isfinite(count).all() else None, other,
    )  # fmt: skip


def _side_by_side(table: MeasuredTable) -> list[MeasuredTable]:
    """The tables of specimens whose columns are side by side under the same names."""
    texts = [name.text for name in table.names]
    size = next(k for k in range(1, len(texts) + 1) if texts == (texts[:k] * len(texts))[: len(texts)])
    known = [name.quantity for name in table.names[:size] if name.quantity is not None]
    if size == len(texts) or len(known) < 2:
        return [table]
    found = []
    for number, first in enumerate(range(0, len(texts), size), 1):
        cut = slice(first, first + size)
        rows = tuple((line, cells[cut]) for line, cells in table.rows if any(cells[cut]))
        title = table.above[first] if len(table.above) > first else ""
        if not rows:
            raise _empty_specimen(replace(table, title=title or f"number {number}"), table.header)
        title = title or f"{table.title} {number}".strip()
        found.append(replace(table, names=table.names[cut], rows=rows, title=title))
    return found


def _empty_specimen(table: MeasuredTable, line: int) -> InputError:
    return InputError(
        f"specimen '{table.title:.40}'", where=f"{table.path}:{line}", expected="readings below its column names",
        found="none",
    )  # fmt: skip


def _looks_like_number(cell: str) -> bool:
    text = SPACES.sub("", cell)
    digits = text[-1:].isdigit() and any(form.fullmatch(text) for form in DECIMALS.values())
    return digits or text in ("nan", "inf")


def _decimal_mark(tables: Sequence[MeasuredTable], needed: Sequence[str], separator: str) -> str:
    """The decimal mark of the readings. Raises InputError where there are two."""
    only: dict[str, tuple[int, str]] = {}
    commas = False
    for table in tables:
        places = [k for k, name in enumerate(table.names) if name.quantity in needed]
        for line, cells in table.rows[:_SAMPLED]:
            for cell in (SPACES.sub("", cells[k]) for k in places):
                fits = [mark for mark, form in DECIMALS.items() if form.fullmatch(cell)]
                commas |= "," in cell
                if len(fits) == 1:
                    only.setdefault(fits[0], (line, cell))
    if len(only) > 1:
        (line, cell), (other, mixed) = only.values()
        raise InputError(
            "decimal marks", where=f"{tables[0].path}:{max(line, other)}", expected="one mark in all numbers of a file",
            found=f"'{cell:.20}' and '{mixed:.20}'",
        )  # fmt: skip
    return next(iter(only), "," if commas and separator != "," else ".")
