"""Stretch and pear-loop readings as CSV files; the form is described in docs/measurement_format.md.

Read too: tables of tracked pins with the columns sample, video, force_N, stress_N_per_mm, axial_length_mm,
lateral_length_mm, fabric_width_at_clamp_mm, whose samples end in X (course) or Y (wale).
"""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from yarnscale.errors import InputError
from yarnscale.estimate.measurements import BendTest, Direction, StretchRun, StretchTest
from yarnscale.files.measurements_table import Column, MeasuredTable
from yarnscale.files.source_text import read_source

STRETCH_COLUMNS = ("fabric", "direction", "run", "force", "clamp_distance", "mid_width", "swatch_width")
BEND_COLUMNS = ("fabric", "direction", "run", "clamp_distance", "loop_ratio", "swatch_length", "swatch_width")
DIRECTIONS = {
    **dict.fromkeys(("weft", "course", "x", "0"), Direction.WEFT),
    **dict.fromkeys(("bias", "45"), Direction.BIAS),
    **dict.fromkeys(("warp", "wale", "y", "90"), Direction.WARP),
}
"""Names a direction goes by in files."""

_ALIKE = 4.0
"""Runs of one swatch differ by less than this factor; more is a wrong unit."""
_NOISE = 0.1
"""Part of a run's extension by which a length may fall while the force grows."""

_Row = tuple[int, tuple[str, ...]]


@dataclass(frozen=True)
class StretchReadings:
    """Tests of one fabric, and remarks on them."""

    fabric: str
    tests: tuple[StretchTest, ...]
    notes: tuple[str, ...]


def read_stretch(
    path: str | os.PathLike[str], *, fabric: str | None = None, single_run: bool = False
) -> StretchReadings:
    """Stretch tests of one fabric: the only one, or the one whose name begins with ``fabric``.

    single_run: accept directions measured once, whose spread is unknown. Raises InputError with row and column.
    """
    table = MeasuredTable.parse(path, read_source(path))
    pins = "axial_length_mm" in table.names
    columns = _pin_columns(table) if pins else _stretch_columns(table)
    name, rows = _of_fabric(table, columns, fabric, _pin_place if pins else _place)
    tests, notes = [], []
    for direction in Direction:
        chosen = [row for row, found in rows if found is direction]
        if chosen:
            test = _stretch_test(table, columns, direction, chosen, single_run=single_run)
            tests.append(test)
            notes += _remarks(test)
    return StretchReadings(name, tuple(tests), tuple(notes))


def read_bend(path: str | os.PathLike[str], *, fabric: str | None = None) -> tuple[BendTest, ...]:
    """Pear-loop tests of one fabric, chosen as in ``read_stretch``; runs are averaged at equal distance."""
    table = MeasuredTable.parse(path, read_source(path))
    table.refuse_others(BEND_COLUMNS)
    columns = {
        name: table.find(name, "length") for name in ("clamp_distance", "swatch_length", "swatch_width")
    } | {name: table.find(name) for name in ("direction", "loop_ratio", "run")}
    found = {name: column for name, column in columns.items() if column is not None}
    if (sample := table.find("fabric", needed=False)) is not None:
        found["fabric"] = sample
    _one_unit(table, found)
    _, rows = _of_fabric(table, found, fabric, _place)
    tests = []
    for direction in Direction:
        chosen = [row for row, place in rows if place is direction]
        if chosen:
            tests.append(_bend_test(table, found, direction, chosen))
    return tuple(tests)


def _bend_test(
    table: MeasuredTable, columns: dict[str, Column], direction: Direction, rows: list[_Row]
) -> BendTest:
    length = _constant(table, columns["swatch_length"], rows, direction)
    width = _constant(table, columns["swatch_width"], rows, direction)
    distance = np.array([_positive(table, row, columns["clamp_distance"]) for row in rows])
    ratio = np.array([_positive(table, row, columns["loop_ratio"]) for row in rows])
    levels, place = np.unique(distance.round(7).astype(np.float64), return_inverse=True)
    groups = [ratio[place == k] for k in range(len(levels))]
    spread = [float(group.std(ddof=1)) if len(group) > 1 else 0.0 for group in groups]
    mean = np.array([group.mean() for group in groups])
    return BendTest(direction, length, width, levels, mean, np.array(spread))


def _stretch_columns(table: MeasuredTable) -> dict[str, Column]:
    table.refuse_others(STRETCH_COLUMNS)
    columns = {
        "direction": table.find("direction"),
        "run": table.find("run"),
        "force": table.find("force", "force"),
        "clamp_distance": table.find("clamp_distance", "length"),
        "swatch_width": table.find("swatch_width", "length"),
        "mid_width": table.find("mid_width", "length", needed=False),
        "fabric": table.find("fabric", needed=False),
    }
    found = {name: column for name, column in columns.items() if column is not None}
    _one_unit(table, found)
    return found


def _pin_columns(table: MeasuredTable) -> dict[str, Column]:
    """Columns of the tables of tracked pins, after a check of their stress, which repeats force and width."""
    columns = {
        "fabric": table.find("sample"),
        "run": table.find("video"),
        "force": table.find("force", "force"),
        "clamp_distance": table.find("axial_length", "length"),
        "mid_width": table.find("lateral_length", "length"),
        "swatch_width": table.find("fabric_width_at_clamp", "length"),
        "stress": table.find("stress_N_per_mm"),
    }
    found = {name: column for name, column in columns.items() if column is not None}
    stress = found.pop("stress")
    for row in table.rows:
        load = table.number(row, found["force"]) / max(table.number(row, found["swatch_width"]), 1e-9)
        given = 1e3 * table.number(row, stress)
        if abs(given - load) > 0.01 * load:
            raise table.fault(
                row[0], stress, f"force over width, {load / 1e3:.4g} N/mm", f"{given / 1e3:.4g}"
            )
    return found


def _one_unit(table: MeasuredTable, columns: dict[str, Column]) -> None:
    lengths = [c for name, c in columns.items() if name.startswith(("clamp", "mid", "swatch"))]
    for column in lengths[1:]:
        if column.factor != lengths[0].factor:
            raise InputError(
                "mixed units of length", where=table.path, expected="one unit in a file",
                found=f"{lengths[0].name} and {column.name}",
            )  # fmt: skip


_Place = Callable[[MeasuredTable, _Row, dict[str, Column]], tuple[str, Direction]]


def _place(table: MeasuredTable, row: _Row, columns: dict[str, Column]) -> tuple[str, Direction]:
    text = row[1][columns["direction"].place]
    if text.lower() not in DIRECTIONS:
        raise table.fault(row[0], columns["direction"], "weft, bias or warp", f"'{text:.40}'")
    sample = row[1][columns["fabric"].place] if "fabric" in columns else ""
    return sample, DIRECTIONS[text.lower()]


def _pin_place(table: MeasuredTable, row: _Row, columns: dict[str, Column]) -> tuple[str, Direction]:
    sample, _, axis = row[1][columns["fabric"].place].rpartition(" ")
    if axis not in ("X", "Y"):
        raise table.fault(row[0], columns["fabric"], "a name that ends in X or Y", f"'{sample} {axis}'")
    return sample, DIRECTIONS[axis.lower()]


def _of_fabric(
    table: MeasuredTable, columns: dict[str, Column], fabric: str | None, place: _Place
) -> tuple[str, list[tuple[_Row, Direction]]]:
    """Name of the fabric, and its rows with their direction."""
    rows = [(row, *place(table, row, columns)) for row in table.rows]
    names = sorted({name for _, name, _ in rows})
    wanted = [name for name in names if name == fabric] or [n for n in names if n.startswith(fabric or "")]
    if len(wanted) != 1:
        expected = f"the beginning of one of: {', '.join(names)}"
        found = f"'{fabric}'" if fabric else "none chosen"
        raise InputError("sample", where=table.path, expected=f"{expected:.200}", found=f"{found:.80}")
    return wanted[0], [(row, direction) for row, name, direction in rows if name == wanted[0]]


def _stretch_test(
    table: MeasuredTable,
    columns: dict[str, Column],
    direction: Direction,
    rows: list[_Row],
    *,
    single_run: bool,
) -> StretchTest:
    groups: dict[str, list[_Row]] = {}
    for row in rows:
        groups.setdefault(row[1][columns["run"].place], []).append(row)
    if len(groups) == 1 and not single_run:
        raise InputError(
            f"one run only along {direction.value}", where=f"{table.path}:{rows[0][0]}",
            expected="two or more, for a spread (or 'single_run = true')", found=f"run '{next(iter(groups)):.40}'",
        )  # fmt: skip
    runs = [_run(table, columns, name, group) for name, group in groups.items()]
    for quantity, values in (
        ("clamp_distance", [run.length[0] for run in runs]),
        ("mid_width", [run.width[0] for run in runs if run.width is not None]),
        ("force", [run.force[-1] for run in runs]),
    ):
        middle = 0.0 if not values else np.median(values) if len(values) > 2 else values[0]
        for group, value in zip(groups.values(), values, strict=False):
            if not middle / _ALIKE < value < middle * _ALIKE:
                expected = f"values like the other runs', about {middle:.3g} (SI)"
                raise table.fault(group[0][0], columns[quantity], expected, f"{value:.3g}: mixed units?")
    return StretchTest(direction, _constant(table, columns["swatch_width"], rows, direction), tuple(runs))


def _run(table: MeasuredTable, columns: dict[str, Column], name: str, rows: list[_Row]) -> StretchRun:
    force = np.array([table.number(row, columns["force"]) for row in rows])
    length = np.array([_positive(table, row, columns["clamp_distance"]) for row in rows])
    width = None
    if "mid_width" in columns:
        width = np.array([_positive(table, row, columns["mid_width"]) for row in rows])
    falls = np.flatnonzero(np.diff(force) < 0)
    if len(falls):
        at = int(falls[0]) + 1
        found = f"{force[at]:g} N after {force[at - 1]:g} N in run '{name}'"
        raise table.fault(rows[at][0], columns["force"], "loading only: force that does not fall", found)
    _refuse_shrinking(table, columns["clamp_distance"], rows, length)
    try:
        return StretchRun(name, force, length, width)
    except InputError as error:
        where = f"{table.path}:{rows[0][0]}"
        raise InputError(error.what, where=where, expected=error.expected, found=error.found) from None


def _refuse_shrinking(
    table: MeasuredTable, column: Column, rows: list[_Row], length: NDArray[np.float64]
) -> None:
    highest = np.maximum.accumulate(length)
    drop = highest - length
    worst = int(np.argmax(drop))
    if drop[worst] > _NOISE * (highest[-1] - length[0]):
        found = f"{length[worst]:.4g} m after {highest[worst]:.4g} m"
        raise table.fault(rows[worst][0], column, "a length that grows with the force", found)


def _constant(table: MeasuredTable, column: Column, rows: list[_Row], direction: Direction) -> float:
    """The value that all rows of a test share."""
    value = _positive(table, rows[0], column)
    for row in rows[1:]:
        if abs(_positive(table, row, column) - value) > 1e-6 * value:
            expected = f"one size of swatches along {direction.value}, {value:g} m"
            raise table.fault(row[0], column, expected, f"{table.number(row, column):g} m")
    return value


def _positive(table: MeasuredTable, row: _Row, column: Column) -> float:
    value = table.number(row, column)
    if value == 0:
        raise table.fault(row[0], column, "more than zero", "0")
    return value


def _remarks(test: StretchTest) -> list[str]:
    """What looks odd and may yet be right."""
    widths = [run.rest_width for run in test.runs if run.rest_width is not None]
    if widths and np.mean(widths) > 1.15 * test.swatch_width:
        return [
            f"{test.direction.value}: the fabric is {1e3 * np.mean(widths):.0f} mm wide at the middle but "
            f"{1e3 * test.swatch_width:.0f} mm at the clamps; line loads count the width at the clamps"
        ]
    return []
