"""Tables of readings: names and units of columns, in the languages that machines write, and numbers of rows in SI."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.resources import files

import numpy as np

from yarnscale.arrays import Array
from yarnscale.errors import InputError

_TABLES = tomllib.loads((files("yarnscale") / "files" / "measurements_names.toml").read_text(encoding="utf-8"))
QUANTITIES: dict[str, list[str]] = _TABLES["quantities"]
"""Quantity → names of its column, the own one first, without capitals, accents and units."""
UNITS: dict[str, dict[str, float]] = _TABLES["units"]
"""Kind of quantity → unit in small letters → factor to SI."""
KINDS = {
    "force": ("force", "line load"),
    "extension": ("length", "strain"),
    **dict.fromkeys(("clamp_distance", "mid_width", "swatch_width", "swatch_length"), ("length",)),
    "stress": ("stress",),
    **{
        f"{name}_{along}": kinds
        for along in ("weft", "warp")
        for name, kinds in (("force", ("force", "line load")), ("strain", ("strain",)), ("width", ("length",)))
    },
    **dict.fromkeys(("wales", "courses"), ("count",)),
    "loop_length": ("length",),
    "yarn_count": ("yarn count",),
    "area_density": ("mass per area",),
}
"""Quantity → kinds of its units; none: no number."""
CONSTRUCTION = ("wales", "courses", "loop_length", "yarn_count", "area_density")
"""What lines above a table may say of the fabric."""
USUAL_UNITS = {
    "force": "N, cN, mN, kN, gf, lbf, N/m or N/cm",
    "extension": "mm, cm, m, % or 1",
    "stress": "N_per_mm",
    **{f"{name}_{along}": units for along in ("weft", "warp")
       for name, units in (("force", "N, cN, N/m or N/cm"), ("strain", "% or 1"))},
}  # fmt: skip
"""Quantity → units to name in an error; lengths of other quantities have mm, cm, m or in."""

_PLAIN = str.maketrans("äöüéèêáàóíñúâô", "aoueeeaaoinuao")
_BRACKETS = re.compile(r"^(.*?)\s*[\[(<{]\s*([^\])>}]*?)\s*[\])>}]\s*$")
_LAST = re.compile(r"^(.+?)(?:\s*/\s*|\s*,\s*|\s+in\s+|[_\s]+)([^_\s]+)$")


def _plain(text: str) -> str:
    """A name without capitals, accents, punctuation, remarks in brackets and a number at its end."""
    plain = re.sub(r"\(.*?\)", " ", text.lower()).translate(_PLAIN)
    plain = plain.replace("ae", "a").replace("oe", "o").replace("ue", "u")
    words = " ".join(re.split(r"[\s_.\-:]+", plain)).strip()
    return re.sub(r"(?<=\w) \d+$", "", words)


_OF_NAME = {_plain(name): quantity for quantity, names in QUANTITIES.items() for name in names}


@dataclass(frozen=True)
class ColumnName:
    """What a column's name says: its quantity, None for others, and its unit as written, None where there is none."""

    text: str
    quantity: str | None
    unit: str | None


def column_name(text: str) -> ColumnName:
    """Quantity and unit of a name such as ``force_N``, ``Load (N)``, ``Kraft in N`` or ``Tensile strain [%]``."""
    if (bracketed := _BRACKETS.match(text)) is not None:
        quantity = _OF_NAME.get(_plain(bracketed.group(1)))
        return ColumnName(text, quantity, bracketed.group(2) or None)
    if (quantity := _OF_NAME.get(_plain(text))) is not None:
        return ColumnName(text, quantity, None)
    if text.startswith("stress_"):
        return ColumnName(text, "stress", text.removeprefix("stress_"))
    if (last := _LAST.match(text.strip())) is not None:
        return ColumnName(text, _OF_NAME.get(_plain(last.group(1))), last.group(2))
    return ColumnName(text, None, None)


def is_unit(text: str) -> bool:
    """Whether a cell is a unit alone, in brackets or not."""
    bare = text.strip("[]()<>{} ").lower()
    return any(bare in units for units in UNITS.values())


def factor(quantity: str, unit: str | None) -> tuple[str, float] | None:
    """Kind and factor to SI of a quantity's unit, None where it has no such unit."""
    bare = (unit or "").strip("[]()<>{} ").lower().replace("μ", "µ")
    for kind in KINDS[quantity]:
        if bare in UNITS[kind]:
            return kind, UNITS[kind][bare]
    return None


Row = tuple[int, tuple[str, ...]]

SPACES = re.compile("(?<=\\d)[ '\u00a0\u202f\u2019](?=\\d{3}(?!\\d))")
"""Marks of thousands that are no decimal mark."""
DECIMALS = {
    mark: re.compile(rf"[+-]?(\d+|[1-9]\d{{0,2}}(\{group}\d{{3}})+)?(\{mark}\d*)?(e[+-]?\d+)?", re.I)
    for mark, group in ((".", ","), (",", "."))
}
"""Decimal mark → what numbers with it look like, thousands set apart by the other mark or not."""


@dataclass(frozen=True)
class Column:
    """Where a quantity is found in a table: name, place and kind of the column, factor to SI."""

    name: str
    place: int
    kind: str = ""
    factor: float = 1.0


@dataclass(frozen=True)
class MeasuredTable:
    """Readings below one line of column names.

    names: contents of the columns; header: line of the names. rows: line in the file and cells. decimal: mark of
    decimals. lines: lines of text above since the last table; title: the last of them. settings: quantity → value in
    SI, from the lines of text above. remarks: lines of the file that are not read.
    """

    path: str
    header: int
    names: tuple[ColumnName, ...]
    rows: tuple[Row, ...] = ()
    decimal: str = "."
    title: str = ""
    settings: tuple[tuple[str, float], ...] = ()
    lines: tuple[Row, ...] = ()
    remarks: tuple[str, ...] = ()

    @property
    def above(self) -> tuple[str, ...]:
        """Cells of the last line of text above."""
        return self.lines[-1][1] if self.lines else ()

    @property
    def text(self) -> str:
        """All text above since the last table."""
        return " ".join(cell for _, cells in self.lines for cell in cells)

    def column(self, quantity: str) -> Column:
        """The column of a quantity with its unit; InputError where it occurs twice, lacks a unit or is missing."""
        if (found := self.find(quantity)) is None:
            raise self.missing(quantity)
        return found

    def find(self, quantity: str) -> Column | None:
        """``column``, or None where it is missing."""
        found = [k for k, name in enumerate(self.names) if name.quantity == quantity]
        if not found:
            return None
        texts = [self.names[k].text for k in found]
        own = [k for k, text in zip(found, texts, strict=True) if quantity in (text, text.rpartition("_")[0])]
        if (twice := len(set(texts)) < len(texts)) or len(own) > 1:
            raise InputError(
                f"column '{texts[0]:.60}'" if twice else f"mixed units of {quantity}",
                where=f"{self.path}:{self.header}",
                expected="one column (specimens below each other, not side by side)",
                found=f"{', '.join(texts):.80}",
            )  # fmt: skip
        return self._with_unit(quantity, (own or found)[0])

    def _with_unit(self, quantity: str, place: int) -> Column:
        name = self.names[place]
        if quantity not in KINDS:
            return Column(name.text, place)
        found = factor(quantity, name.unit)
        if found is None:
            raise InputError(
                f"unit of column '{name.text:.60}'", where=f"{self.path}:{self.header}",
                expected=f"{USUAL_UNITS.get(quantity, 'mm, cm, m or in')}, as in 'force_N' or 'Load [N]', "
                "or in a line of units below the names",
                found=f"'{name.unit:.20}'" if name.unit else "none",
            )  # fmt: skip
        return Column(name.text, place, *found)

    def missing(self, quantity: str, expected: str = "") -> InputError:
        """The error of a quantity that the table does not have."""
        names = ", ".join(name.text for name in self.names)
        return InputError(
            f"column {quantity} is missing", where=f"{self.path}:{self.header}",
            expected=expected or f"a column of that name ({quantity}_UNIT where it has a unit)", found=f"{names:.160}",
        )  # fmt: skip

    def numbers(self, column: Column, rows: Sequence[Row], *, positive: bool = False) -> Array:
        """The cells of a column in SI, (n,); InputError with the line of the first bad one."""
        cells = [cells[column.place] for _, cells in rows]
        try:
            values = np.array(cells).astype(np.float64) if self.decimal == "." else None
        except ValueError:
            values = None
        if values is None:
            values = np.array([self._number(cell) for cell in cells])
        bad = np.flatnonzero(~np.isfinite(values) | ((values <= 0) if positive else False))
        if len(bad):
            number = np.isfinite(values[bad[0]])
            expected = "more than zero" if number else "a number alone, its unit in the column's name"
            raise self.fault(rows[int(bad[0])][0], column, expected, f"'{cells[bad[0]]:.40}'")
        return values * column.factor

    def _number(self, cell: str) -> float:
        text = SPACES.sub("", cell)
        if not any(character.isdigit() for character in text) or not DECIMALS[self.decimal].fullmatch(text):
            return np.nan
        return float(text.replace("," if self.decimal == "." else ".", "").replace(",", "."))

    def fault(self, line: int, column: Column | str, expected: str, found: object) -> InputError:
        """The error of one cell."""
        name = column if isinstance(column, str) else column.name
        return InputError(f"column '{name}'", where=f"{self.path}:{line}", expected=expected, found=found)
