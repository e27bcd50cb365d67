"""Rows of tables gathered by fabric, direction and run: the readings of one swatch each."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from yarnscale.errors import InputError
from yarnscale.files.measurements_table import Column, MeasuredTable, Row
from yarnscale.swatches.loading import Cycle
from yarnscale.swatches.measurements import Direction

DIRECTIONS = {
    **dict.fromkeys(("weft", "course", "x", "0", "crosswise", "quer", "schuss", "maschenreihe"), Direction.WEFT),
    **dict.fromkeys(("bias", "45", "diagonal"), Direction.BIAS),
    **dict.fromkeys(("warp", "wale", "y", "90", "lengthwise", "längs", "laengs", "kette"), Direction.WARP),
}
"""Names a direction goes by in files; in titles and names of files those of four letters or more."""


@dataclass(frozen=True)
class LogSettings:
    """What a log may leave out: direction and run, width of the swatch and length between the clamps [m].

    cycle: which of several loadings of a swatch counts, the first or the last that reaches the full force.
    """

    direction: Direction | None = None
    run: str | None = None
    swatch_width: float | None = None
    swatch_length: float | None = None
    cycle: Cycle = "first"


@dataclass(frozen=True, eq=False)
class Swatch:
    """The readings of one swatch."""

    fabric: str
    direction: Direction
    run: str
    table: MeasuredTable
    columns: dict[str, Column]
    rows: list[Row]
    settings: LogSettings


def swatches_of(table: MeasuredTable, columns: dict[str, Column], settings: LogSettings, number: int) -> list[Swatch]:
    """The readings of a table, one swatch each."""
    direction, run = columns.get("direction"), columns.get("run")
    sample = columns.get("fabric")
    if run is None and sample is not None and sample.name.lower() != "fabric":
        # Machines call a swatch a sample.
        run, sample = sample, None
    by_name = direction is None and settings.direction is None and sample is not None
    known = None if direction is not None or by_name else settings.direction or _direction_of(table)
    groups: dict[tuple[str, str, str], list[Row]] = {}
    for row in table.rows:
        cells = row[1]
        key = (
            "" if sample is None else cells[sample.place],
            "" if direction is None else cells[direction.place],
            (settings.run or table.title or str(number)) if run is None else cells[run.place],
        )
        if (group := groups.get(key)) is None:
            groups[key] = group = []
        group.append(row)
    found = []
    for (fabric, text, name), rows in groups.items():
        along = known
        if by_name and sample is not None:
            fabric, _, axis = fabric.rpartition(" ")
            along = DIRECTIONS.get(axis.lower()) if axis in ("X", "Y") else None
            if along is None:
                raise table.fault(rows[0][0], sample, "a name that ends in X or Y", f"'{fabric} {axis}'")
        elif direction is not None:
            along = direction_named(text)
            if along is None:
                raise table.fault(rows[0][0], direction, "weft, bias or warp", f"'{text:.40}'")
        assert along is not None
        found.append(Swatch(fabric, along, name, table, columns, rows, settings))
    return found


def direction_named(text: str) -> Direction | None:
    """The direction of a name such as weft, Course, walewise or 45°, None for others."""
    plain = text.lower().strip("° ")
    return DIRECTIONS.get(plain) or DIRECTIONS.get(plain.removesuffix("wise").rstrip("- "))


def _direction_of(table: MeasuredTable) -> Direction:
    """The direction that the title of a table or the name of its file says."""
    for text in (table.title, table.text, Path(table.path).name):
        words = re.split(r"[\W\d_]+", text.lower())
        words += [word.removesuffix(end) for word in words for end in ("s", "wise")]
        found = {DIRECTIONS[word] for word in words if len(word) > 3 and word in DIRECTIONS}
        if len(found) == 1:
            return found.pop()
    raise table.missing(
        "direction",
        "a column, a title such as 'Specimen 1 - weft' above, or direction = \"weft\" under [[stretch]] "
        "in a fabric file",
    )


def chosen_fabric(names: set[str], fabric: str | None, path: str) -> str:
    """The fabric whose name begins so."""
    known = sorted(names)
    wanted = [name for name in known if name == fabric] or [n for n in known if n.startswith(fabric or "")]
    if len(wanted) != 1:
        expected = f"the beginning of one of: {', '.join(known)}"
        found = f"'{fabric}'" if fabric else "none chosen"
        raise InputError("sample", where=path, expected=f"{expected:.200}", found=f"{found:.80}")
    return wanted[0]


def one_unit(table: MeasuredTable, columns: dict[str, Column]) -> None:
    """InputError where columns of length differ in their unit."""
    lengths = [c for name, c in columns.items() if c.kind == "length"]
    for column in lengths[1:]:
        if column.factor != lengths[0].factor:
            raise InputError(
                "mixed units of length", where=f"{table.path}:{table.header}", expected="one unit in a file",
                found=f"{lengths[0].name} and {column.name}",
            )  # fmt: skip


def constant(table: MeasuredTable, column: Column, rows: list[Row]) -> float:
    """The value that all rows of a swatch share."""
    values = table.numbers(column, rows, positive=True)
    other = np.flatnonzero(np.abs(values - values[0]) > 1e-6 * values[0])
    if len(other):
        expected = f"one size of a swatch, {values[0]:g} m"
        raise table.fault(rows[int(other[0])][0], column, expected, f"{values[other[0]]:g} m")
    return float(values[0])
