"""Stretch and pear-loop readings of tables; the form is described in docs/reference/measurement_format.md.

Tables of the project's own form, tables of tracked pins, whose samples end in X (course) or Y (wale), and logs of
testing machines are read alike. What a log leaves out, such as the size of the swatch, is given by ``LogSettings``.
"""

from __future__ import annotations

import difflib
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from yarnscale.arrays import Array
from yarnscale.errors import InputError
from yarnscale.files.measurements_reader import read_tables
from yarnscale.files.measurements_swatches import LogSettings, Swatch, chosen_fabric, constant, one_unit, swatches_of
from yarnscale.files.measurements_table import CONSTRUCTION, Column, MeasuredTable, Row, factor
from yarnscale.files.source_text import read_source
from yarnscale.files.workbook import WORKBOOKS, sheets
from yarnscale.swatches.construction import KnownConstruction
from yarnscale.swatches.loading import stretch_run
from yarnscale.swatches.measurements import BendTest, Direction, StretchRun, StretchTest

_READ = ("force", "clamp_distance", "extension")
"""Quantities that a table of stretch readings holds."""
_ALIKE = 4.0
"""Runs of one swatch differ by less than this factor; more is a wrong unit."""
_OTHER_SIZE = 1.2
"""Swatches of a direction differ in width by less than this factor; forces are scaled to their mean width."""
_LONGEST = 8.0
"""Longest length of a swatch over that before the test; what is longer is a wrong unit."""
_NOISE = 0.1
"""Part of a run's extension by which a length may fall while the force grows."""


@dataclass(frozen=True)
class StretchReadings:
    """Tests of one fabric, and remarks on them."""

    fabric: str
    tests: tuple[StretchTest, ...]
    notes: tuple[str, ...]
    known: KnownConstruction


def read_logs(
    logs: Iterable[tuple[Path, LogSettings]], *, fabric: str | None = None, single_run: bool = False
) -> StretchReadings:
    """Stretch tests of one fabric: the only one, or the one whose name begins with ``fabric``.

    logs: tables of readings and what they leave out. single_run: make no remark on directions measured once, whose
    spread is unknown. Raises InputError with row and column.
    """
    name, chosen, notes = _gathered(logs, _READ, _stretch_columns, fabric)
    tests = []
    for direction, swatches in chosen.items():
        test, remarks = _stretch_test(direction, swatches, single_run=single_run)
        tests.append(test)
        notes += remarks
    said = {key: value for group in chosen.values() for swatch in group for key, value in swatch.table.settings}
    known = KnownConstruction(**{key: said[key] for key in CONSTRUCTION if key in said})
    return StretchReadings(name, tuple(tests), tuple(dict.fromkeys(notes)), known)


def read_bend(path: Path, *, fabric: str | None = None) -> tuple[tuple[BendTest, ...], tuple[str, ...]]:
    """Pear-loop tests of one fabric, chosen as in ``read_logs``, and remarks; runs are averaged at equal distance."""
    needed = ("loop_ratio", "clamp_distance")
    _, chosen, notes = _gathered([(path, LogSettings())], needed, _bend_columns, fabric)
    return tuple(_bend_test(*test) for test in chosen.items()), tuple(notes)


def _gathered(
    logs: Iterable[tuple[Path, LogSettings]],
    needed: tuple[str, ...],
    columns_of: Callable[[MeasuredTable, LogSettings], dict[str, Column]],
    fabric: str | None,
) -> tuple[str, dict[Direction, list[Swatch]], list[str]]:
    """Name of the fabric, its swatches by direction, and remarks on the tables."""
    swatches: list[Swatch] = []
    notes: list[str] = []
    for path, settings in logs:
        tables = tables_of(path, needed)
        for number, table in enumerate(tables, 1):
            swatches += swatches_of(table, columns_of(table, settings), settings, number)
        notes += _unread(tables)
    name = chosen_fabric({swatch.fabric for swatch in swatches}, fabric, swatches[0].table.path)
    own = [swatch for swatch in swatches if swatch.fabric == name]
    chosen = {along: [swatch for swatch in own if swatch.direction is along] for along in Direction}
    return name, {along: found for along, found in chosen.items() if found}, notes


def tables_of(path: Path, needed: Sequence[str]) -> tuple[MeasuredTable, ...]:
    """The tables of a text file, or of all sheets of a workbook that have some."""
    if path.suffix.lower() not in WORKBOOKS:
        return read_tables(path, read_source(path, other_encodings=True), needed=needed)
    found, faults = [], []
    for name, text in sheets(path):
        try:
            found += read_tables(name, text, needed=needed)
        except InputError as error:
            if error.what not in ("column names", "readings"):
                raise
            faults.append(error)
    if not found:
        raise (faults[0] if faults else InputError("workbook is empty", where=path, expected="a sheet of readings"))
    return tuple(found)


def _bend_columns(table: MeasuredTable, _: LogSettings) -> dict[str, Column]:
    """The columns that a table of pear loops needs and has."""
    quantities = ("clamp_distance", "swatch_length", "swatch_width", "direction", "loop_ratio", "run")
    columns = {name: table.column(name) for name in quantities}
    if (sample := table.find("fabric")) is not None:
        columns["fabric"] = sample
    one_unit(table, columns)
    return columns


def _bend_test(direction: Direction, swatches: Sequence[Swatch]) -> BendTest:
    length, width = (_one_size(swatches, name) for name in ("swatch_length", "swatch_width"))
    distance, ratio = (
        np.concatenate([s.table.numbers(s.columns[name], s.rows, positive=True) for s in swatches])
        for name in ("clamp_distance", "loop_ratio")
    )
    levels, place = np.unique(distance.round(7), return_inverse=True)
    return BendTest(direction, length, width, levels, np.bincount(place, ratio) / np.bincount(place))


def _one_size(swatches: Sequence[Swatch], quantity: str) -> float:
    """The length or width that all swatches of a pear-loop test share [m]."""
    sizes = [constant(swatch.table, swatch.columns[quantity], swatch.rows) for swatch in swatches]
    for swatch, size in zip(swatches, sizes, strict=True):
        if abs(size - sizes[0]) > 1e-6 * sizes[0]:
            expected = f"one size of a swatch, {sizes[0]:g} m"
            raise swatch.table.fault(swatch.rows[0][0], swatch.columns[quantity], expected, f"{size:g} m")
    return sizes[0]


def _stretch_columns(table: MeasuredTable, settings: LogSettings) -> dict[str, Column]:
    """The columns that a stretch table needs and has. InputError for what neither it nor the settings say."""
    for name in table.names:
        near = difflib.get_close_matches(name.text.rpartition("_")[0], ("mid_width", "swatch_width"), 1, 0.8)
        if name.quantity is None and near:
            where = f"{table.path}:{table.header}"
            raise InputError(f"unknown column '{name.text:.60}'", where=where, expected=f"{near[0]}_mm")
    sizes = ("mid_width", "swatch_width", "swatch_length")
    quantities = ("fabric", "direction", "run", *_READ, *sizes, "stress")
    columns = {name: column for name in quantities if (column := _column(table, name)) is not None}
    if "force" not in columns:
        raise table.missing("force", "force_N, or a machine's name for it, such as Load (N) or Kraft [N]")
    if "clamp_distance" in columns:
        columns.pop("extension", None)
    elif "extension" not in columns:
        raise table.missing("clamp_distance", "clamp_distance_mm, or Extension (mm) or Strain (%)")
    known = dict(table.settings)
    for name, needed in (("swatch_width", True), ("swatch_length", "extension" in columns)):
        if needed and name not in columns and getattr(settings, name) is None and name not in known:
            raise table.missing(
                name,
                f"a column {name}_mm, '{name}_mm = …' under [[stretch]] in a fabric file, "
                "or --swatch LENGTHxWIDTH in mm",
            )
    if "direction" in columns and "run" not in columns and settings.run is None:
        raise table.missing("run")
    one_unit(table, columns)
    return columns


def _column(table: MeasuredTable, quantity: str) -> Column | None:
    """A column that may be missing; a stress in a unit that is no force per width is not read."""
    if quantity == "stress":
        found = [name for name in table.names if name.quantity == "stress" and name.unit == "N_per_mm"]
        return table.find("stress") if found else None
    return table.find(quantity)


def _stretch_test(
    direction: Direction, swatches: Sequence[Swatch], *, single_run: bool
) -> tuple[StretchTest, list[str]]:
    """The test along a direction, and what is to be said of it."""
    notes = []
    widths = np.array([_size(swatch, "swatch_width") for swatch in swatches])
    width = float(widths.mean())
    for swatch, own in zip(swatches, widths, strict=True):
        if not width / _OTHER_SIZE < own < width * _OTHER_SIZE:
            expected = f"swatches of about one width along {direction.value}, {width:.3g} m"
            raise swatch.table.fault(swatch.rows[0][0], "swatch_width", expected, f"{own:.3g} m")
    names = [swatch.run for swatch in swatches]
    if len(set(names)) < len(names):
        names = [f"{Path(swatch.table.path).stem} {swatch.run}" for swatch in swatches]
    _refuse_unlike(swatches)
    runs, said = [], {}
    for swatch, name, own in zip(swatches, names, widths, strict=True):
        run, remarks = _run(swatch, name, float(own), width)
        runs.append(run)
        for remark in remarks:
            said.setdefault(remark, []).append(name)
    notes += [f"{direction.value}, {', '.join(of)}: {remark}" for remark, of in said.items()]
    if len(runs) == 1 and not single_run:
        notes.append(f"{direction.value}: one run only, whose spread over swatches is unknown")
    test = StretchTest(direction, width, tuple(runs))
    return test, notes + _remarks(test)


def _refuse_unlike(swatches: Sequence[Swatch]) -> None:
    """InputError where one swatch of a direction was far longer or wider, or pulled far harder, than the others."""
    for quantity in ("clamp_distance", "mid_width", "force"):
        if not all(quantity in swatch.columns for swatch in swatches):
            continue
        values = []
        for swatch in swatches:
            column, rows = swatch.columns[quantity], swatch.rows
            pulled = quantity == "force"
            numbers = swatch.table.numbers(column, rows if pulled else rows[:1], positive=not pulled)
            values.append(float(numbers.max()))
        middle = np.median(values) if len(values) > 2 else values[0]
        for swatch, value in zip(swatches, values, strict=True):
            if middle > 0 and not middle / _ALIKE < value < middle * _ALIKE:
                expected = f"values like the other runs', about {middle:.3g} (SI)"
                column = swatch.columns[quantity]
                raise swatch.table.fault(swatch.rows[0][0], column, expected, f"{value:.3g}: mixed units?")


def _size(swatch: Swatch, quantity: str) -> float:
    """Width of a swatch, or its length between the clamps before the test [m]: of the table, else of the settings."""
    if quantity in swatch.columns:
        return constant(swatch.table, swatch.columns[quantity], swatch.rows)
    given = getattr(swatch.settings, quantity)
    return dict(swatch.table.settings)[quantity] if given is None else given


def _run(swatch: Swatch, name: str, width: float, mean_width: float) -> tuple[StretchRun, tuple[str, ...]]:
    table, columns, rows = swatch.table, swatch.columns, swatch.rows
    if len(rows) < 3:
        where = f"{table.path}:{rows[0][0]}"
        raise InputError(f"run '{name:.40}'", where=where, expected="three readings or more", found=len(rows))
    force = table.numbers(columns["force"], rows) * mean_width / width
    _refuse_other_forces(table, columns["force"], rows)
    if columns["force"].kind == "line load":
        force = force * width
    if -force[worst := int(np.argmin(force))] >= max(force.max(), 0.0):
        expected = "tension that counts as positive"
        raise table.fault(rows[worst][0], columns["force"], expected, f"{force[worst]:g} N")
    if "stress" in columns:
        _check_stress(table, columns, rows, width)
    length = _length(swatch)
    middle = table.numbers(columns["mid_width"], rows, positive=True) if "mid_width" in columns else None
    if middle is not None and not width / _ALIKE < middle[0] < width * _ALIKE:
        expected = f"about the width of the swatch, {width:.3g} m"
        raise table.fault(rows[0][0], columns["mid_width"], expected, f"{middle[0]:.3g} m")
    _refuse_shrinking(table, columns.get("clamp_distance") or columns["extension"], rows, force, length)
    try:
        return stretch_run(name, force, length, middle, swatch_width=mean_width, cycle=swatch.settings.cycle)
    except InputError as error:
        where = f"{table.path}:{rows[0][0]}"
        raise InputError(
            f"{error.what} of run '{name:.40}'" if name not in error.what else error.what, where=where,
            expected=error.expected, found=error.found,
        ) from None  # fmt: skip


def _length(swatch: Swatch) -> Array:
    """Length between the clamps of every reading [m]."""
    if "clamp_distance" in swatch.columns:
        return swatch.table.numbers(swatch.columns["clamp_distance"], swatch.rows, positive=True)
    column, gauge = swatch.columns["extension"], _size(swatch, "swatch_length")
    values = swatch.table.numbers(column, swatch.rows)
    length = gauge * (1.0 + values) if column.kind == "strain" else gauge + values
    expected = f"an extension of a swatch of {gauge:g} m"
    if length[shortest := int(np.argmin(length))] <= 0.5 * gauge:
        raise swatch.table.fault(swatch.rows[shortest][0], column, expected, f"{values[shortest]:g} (SI)")
    if length[farthest := int(np.argmax(length))] > _LONGEST * gauge:
        expected += f" below {_LONGEST:g} times its length"
        found = f"{length[farthest] - gauge:.4g} m: a strain in percent, or another unit of length?"
        raise swatch.table.fault(swatch.rows[farthest][0], column, expected, found)
    return length


def _refuse_other_forces(table: MeasuredTable, column: Column, rows: list[Row]) -> None:
    """InputError where another column of forces of the same kind says something else: which one counts is unknown."""
    mine = table.numbers(column, rows)
    for place, name in enumerate(table.names):
        unit = factor("force", name.unit) if name.quantity == "force" and place != column.place else None
        if unit is None or unit[0] != column.kind:
            continue
        other = table.numbers(Column(name.text, place, *unit), rows)
        wrong = np.flatnonzero(np.abs(other - mine) > 0.02 * np.abs(mine).max())
        if len(wrong):
            k = int(wrong[0])
            expected = f"the force of column '{column.name:.40}', {mine[k]:.4g} N, or one column of forces alone"
            raise table.fault(rows[k][0], name.text, expected, f"{other[k]:.4g} N")


def _check_stress(table: MeasuredTable, columns: dict[str, Column], rows: list[Row], width: float) -> None:
    """Stress of tracked pins repeats force over width."""
    load, given = table.numbers(columns["force"], rows) / width, table.numbers(columns["stress"], rows)
    wrong = np.flatnonzero(np.abs(given - load) > 0.01 * np.abs(load))
    if len(wrong):
        k = int(wrong[0])
        expected = f"force over width, {load[k] / 1e3:.4g} N/mm"
        raise table.fault(rows[k][0], columns["stress"], expected, f"{given[k] / 1e3:.4g}")


def _refuse_shrinking(table: MeasuredTable, column: Column, rows: list[Row], force: Array, length: Array) -> None:
    """InputError where the length falls much from one reading to the next while the force grows much."""
    fall, rise = -np.diff(length), np.diff(force)
    wrong = (fall > _NOISE * np.ptp(length)) & (rise > _NOISE * np.ptp(force))
    if wrong.any():
        k = int(np.argmax(wrong)) + 1
        found = f"{length[k]:.4g} m after {length[k - 1]:.4g} m"
        raise table.fault(rows[k][0], column, "a length that grows with the force", found)


def _unread(tables: Sequence[MeasuredTable]) -> list[str]:
    """Columns that nothing is known of, and lines that are no readings."""
    file = Path(tables[0].path).name
    names = dict.fromkeys(name.text for table in tables for name in table.names if name.quantity is None)
    notes = [f"columns not read: {', '.join(names)}"] if names else []
    notes += dict.fromkeys(remark for table in tables for remark in table.remarks)
    return [f"{file}: {note}" for note in notes]


def _remarks(test: StretchTest) -> list[str]:
    """What looks odd and may yet be right."""
    widths = [run.rest_width for run in test.runs if run.rest_width is not None]
    if widths and np.mean(widths) > 1.15 * test.swatch_width:
        return [
            f"{test.direction.value}: the fabric is {1e3 * np.mean(widths):.0f} mm wide at the middle but "
            f"{1e3 * test.swatch_width:.0f} mm at the clamps; line loads count the width at the clamps"
        ]
    return []
