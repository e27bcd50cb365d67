"""A table of readings as CSV text: numbers with units in the names of the columns, faults by row and column."""

from __future__ import annotations

import csv
import io
import math
import os
from dataclasses import dataclass

from yarnscale.errors import InputError

UNITS = {
    "length": {"m": 1.0, "cm": 1e-2, "mm": 1e-3},
    "force": {"N": 1.0, "cN": 1e-2, "mN": 1e-3, "gf": 9.80665e-3},
}
"""Unit → factor to SI, by kind of quantity."""


@dataclass(frozen=True)
class Column:
    """Where a quantity is found in a table: name and place of the column, factor to SI."""

    name: str
    place: int
    factor: float = 1.0


@dataclass(frozen=True)
class MeasuredTable:
    """Rows of text with their line in the file; ``names`` are those of the columns."""

    path: str
    names: tuple[str, ...]
    rows: tuple[tuple[int, tuple[str, ...]], ...]

    @classmethod
    def parse(cls, path: str | os.PathLike[str], text: str) -> MeasuredTable:
        """Table of CSV text; lines that start with # are comments. Raises InputError with file and line."""
        names: tuple[str, ...] | None = None
        rows: list[tuple[int, tuple[str, ...]]] = []
        reader = csv.reader(io.StringIO(text))
        try:
            for cells in reader:
                cells = tuple(cell.strip() for cell in cells)
                if not any(cells) or cells[0].startswith("#"):
                    continue
                if names is None:
                    names = cells
                elif len(cells) != len(names):
                    raise InputError(
                        "row",
                        where=f"{path}:{reader.line_num}",
                        expected=f"{len(names)} cells",
                        found=len(cells),
                    )
                else:
                    rows.append((reader.line_num, cells))
        except csv.Error as error:
            raise InputError("no CSV text", where=f"{path}:{reader.line_num}", found=str(error)) from None
        if names is None or not rows:
            raise InputError("readings", where=path, expected="a line of column names and rows", found="none")
        for name in names:
            if names.count(name) > 1:
                raise InputError(f"column '{name:.60}'", where=path, expected="once", found=names.count(name))
        return cls(str(path), names, tuple(rows))

    def refuse_others(self, known: tuple[str, ...]) -> None:
        """InputError where a column is none of these; quantities with units are given without."""
        for name in self.names:
            if name not in known and name.rpartition("_")[0] not in known:
                raise InputError(f"unknown column '{name:.60}'", where=self.path, expected=", ".join(known))

    def find(self, quantity: str, kind: str | None = None, *, needed: bool = True) -> Column | None:
        """The column of a quantity: ``quantity`` itself, or with a kind of unit ``quantity_unit``."""
        if kind is None:
            if quantity in self.names:
                return Column(quantity, self.names.index(quantity))
            return self._missing(quantity, quantity) if needed else None
        units = UNITS[kind]
        found = [n for n in self.names if n == quantity or n.rpartition("_")[0] == quantity]
        expected = " or ".join(f"{quantity}_{unit}" for unit in units)
        if len(found) > 1:
            raise InputError(
                f"mixed units of {quantity}", where=self.path, expected="one column", found=", ".join(found)
            )
        if not found:
            return self._missing(quantity, expected) if needed else None
        unit = found[0].removeprefix(quantity).removeprefix("_")
        if unit not in units:
            found_unit = f"'{unit:.20}'" if unit else "none"
            raise InputError(
                f"unit of column '{found[0]:.60}'", where=self.path, expected=expected, found=found_unit
            )
        return Column(found[0], self.names.index(found[0]), units[unit])

    def _missing(self, quantity: str, expected: str) -> None:
        raise InputError(
            f"column {quantity} is missing",
            where=self.path,
            expected=expected,
            found=f"{', '.join(self.names):.120}",
        )

    def number(self, row: tuple[int, tuple[str, ...]], column: Column) -> float:
        """A cell as a number in SI that is not negative; InputError with line and column."""
        line, cells = row
        text = cells[column.place]
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if not math.isfinite(value) or value < 0:
            expected = (
                "a number, zero or more"
                if math.isfinite(value)
                else "a number alone, its unit in the column's name"
            )
            raise self.fault(line, column, expected, f"'{text:.40}'")
        return value * column.factor

    def fault(self, line: int, column: Column | str, expected: str, found: object) -> InputError:
        """The error of one cell."""
        name = column if isinstance(column, str) else column.name
        return InputError(f"column '{name}'", where=f"{self.path}:{line}", expected=expected, found=found)
