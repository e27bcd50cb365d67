"""Knitting charts: which stitch stands where, and which loops each stitch takes up.

A chart has rows (courses, the first knitted first) and columns (wales); both repeat. Every row is one yarn that
runs along x. Seen from the right side (+z):

    k  knit: a loop drawn through the held loop from the back to the front
    p  purl: a loop drawn through from the front to the back
    t  tuck: the yarn is laid over the needle beside the held loop; the next k or p takes up both
    b  slip: the held loop stays on its needle, the yarn floats behind it
    f  slip: the held loop stays on its needle, the yarn floats in front of it
    -  miss: a slip whose float runs on the back of the held loop (behind a knit loop, in front of a purled one)

A column of slips only is a needle out of work: it has no loop, and the yarns pass straight on (a ladder).

A row of a fabric of two needle beds is written ``front|back``, both beds with as many needles. Needle j of the
front bed becomes column 2j, the needle of the back bed that faces it column 2j + 1; ``-`` floats then run
between the beds. On the back bed the loops are drawn towards the back: write ``p``.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from yarnscale.drawing.chart_error import ChartError
from yarnscale.errors import InputError

SIGNS = {"k": 1, "p": -1}
SLIPS = "bf-"
SYMBOLS = "kpt" + SLIPS
LARGEST_CHART = 64
MOST_TUCKS = 8
"""Most tuck loops on one held loop; a needle has no room for more."""
MOST_HELD = 12
"""Rows that a loop may be held."""


@dataclass(frozen=True)
class StitchChart:
    """A checked chart: texts of equal length, one a row, first knitted first; `beds` needle beds (1 or 2).

    In the texts of two beds front and back needles alternate. Raises InputError with row and column (counted
    from 1, rows from the first knitted) for charts that cannot be knitted periodically.
    """

    rows: tuple[str, ...]
    beds: int = 1

    @classmethod
    def read(cls, chart: Sequence[str] | str) -> StitchChart:
        """A chart from texts, of one bed or ``front|back``."""
        if not isinstance(chart, Iterable):
            raise InputError("chart is no text of stitches", expected="a text, or several", found=f"{chart!r:.60}")
        rows = [chart] if isinstance(chart, str) else list(chart)
        if not 1 <= len(rows) <= LARGEST_CHART:
            expected = f"1 to {LARGEST_CHART}"
            raise InputError("chart has the wrong number of rows", expected=expected, found=len(rows))
        beds, texts = 1, []
        for row, text in enumerate(rows):
            if not isinstance(text, str) or not text:
                expected = f"a text of 1 to {LARGEST_CHART} stitches"
                what = f"chart row {row + 1} is no row of stitches"
                raise ChartError(what, row=row, expected=expected, found=repr(text)[:40])
            count = text.count("|") + 1
            if count > 2:
                what = f"chart row {row + 1} has too many needle beds"
                raise ChartError(what, row=row, expected="front or front|back", found=count)
            if row > 0 and count != beds:
                what = f"chart row {row + 1} is for another number of needle beds"
                raise ChartError(what, row=row, expected=f"{beds} as in row 1", found=count)
            beds = count
            texts.append(_interleaved(row, text) if beds == 2 else text)
        return cls(tuple(texts), beds)

    def __post_init__(self) -> None:
        """Check symbols, then that every wale can be knitted."""
        width = len(self.rows[0])
        for row, text in enumerate(self.rows):
            if not 1 <= len(text) <= LARGEST_CHART:
                what = f"chart row {row + 1} is no row of stitches"
                raise ChartError(what, row=row, expected=f"1 to {LARGEST_CHART} stitches", found=len(text))
            if len(text) != width:
                what = f"chart row {row + 1} has another length"
                expected = f"{width // self.beds} stitches as in row 1"
                raise ChartError(what, row=row, expected=expected, found=len(text) // self.beds)
            for column, symbol in enumerate(text):
                if symbol not in SYMBOLS:
                    expected = ", ".join(SYMBOLS)
                    raise self._error("unknown stitch", row, column, expected=expected, found=repr(symbol))
        for column in range(width):
            if not self.empty[column]:
                self._check_wale(column)
        if all(self.empty):
            expected = "k or p in at least one column"
            raise self._error("no needle knits", 0, 0, expected=expected, found=repr(self.rows[0]))

    def _error(self, reason: str, row: int, column: int, *, expected: object, found: object) -> ChartError:
        written = column
        if self.beds == 2:
            written = column // 2 + (len(self.rows[row]) // 2 if column % 2 else 0)
        what = f"chart {self.place(row, column)}: {reason}"
        return ChartError(what, row=row, column=written, expected=expected, found=found)

    @property
    def courses(self) -> int:
        """Number of rows."""
        return len(self.rows)

    @property
    def wales(self) -> int:
        """Number of columns."""
        return len(self.rows[0])

    @property
    def plain(self) -> bool:
        """Whether it has knit and purl stitches only."""
        return all(symbol in SIGNS for row in self.rows for symbol in row)

    def place(self, row: int, column: int) -> str:
        """A cell in words, counted from 1."""
        if self.beds == 1:
            return f"row {row + 1} column {column + 1}"
        return f"row {row + 1} {'back' if column % 2 else 'front'} needle {column // 2 + 1}"

    @cached_property
    def most_tucks(self) -> int:
        """Largest number of tucks on one held loop."""
        cells = [(row, column) for row in range(self.courses) for column in range(self.wales)]
        return max(len(self.held(*cell)) - 1 for cell in cells if not self.empty[cell[1]])

    @cached_property
    def empty(self) -> tuple[bool, ...]:
        """Whether the needle of a column is out of work: slips only."""
        return tuple(all(row[column] in SLIPS for row in self.rows) for column in range(self.wales))

    def next_knit(self, row: int, column: int) -> int:
        """Rows until the wale is knitted again after `row`, 1 to the number of rows."""
        for ahead in range(1, self.courses + 1):
            if self.rows[(row + ahead) % self.courses][column] in SIGNS:
                return ahead
        raise InputError(f"chart {self.place(row, column)}: the wale is never knitted", expected="k or p")

    def held(self, row: int, column: int) -> list[int]:
        """Loops held at the wale, as numbers of rows before `row`: held loop, then tucks."""
        tucks = []
        for back in range(1, self.courses + 1):
            symbol = self.rows[(row - back) % self.courses][column]
            if symbol in SIGNS:
                return [back, *reversed(tucks)]
            if symbol == "t":
                tucks.append(back)
        raise InputError(f"chart {self.place(row, column)}: the wale is never knitted", expected="k or p")

    def float_sign(self, row: int, column: int) -> int:
        """Side on which the yarn of a slip passes, +1 in front, -1 behind."""
        symbol = self.rows[row % self.courses][column]
        if symbol == "-":
            # The loop's own face decides: its float lies where its sinkers lie.
            back = self.held(row, column)[0]
            return -SIGNS[self.rows[(row - back) % self.courses][column]]
        return 1 if symbol == "f" else -1

    @cached_property
    def words(self) -> list[str]:
        """Crossings that the chart implies, a text per row along its yarn: O(ver) or U(nder), seen from +z."""
        return ["".join(self._stitch_word(row, column) for column in range(self.wales)) for row in range(self.courses)]

    def _stitch_word(self, row: int, column: int) -> str:
        """Left half in order, right half mirrored: first the older loops that it meets, then the newer ones."""
        symbol = self.rows[row][column]
        signs: list[int] = []
        if symbol in SIGNS:
            count = len(self.held(row, column))
            signs = [-SIGNS[symbol]] * count + [SIGNS[symbol]] * count
        elif symbol != "t" and not self.empty[column]:
            signs = [self.float_sign(row, column)] * len(self.held(row, column))
        if symbol in SIGNS or symbol == "t":
            end = self.next_knit(row, column)
            for ahead in range(1, end):
                if self.rows[(row + ahead) % self.courses][column] != "t":
                    signs.append(-self.float_sign(row + ahead, column))
            own = SIGNS[self.rows[(row + end) % self.courses][column]]
            signs += [own, -own]
        half = "".join("O" if sign > 0 else "U" for sign in signs)
        return half + half[::-1]

    def _check_wale(self, column: int) -> None:
        symbols = "".join(row[column] for row in self.rows)
        knitted = [row for row, symbol in enumerate(symbols) if symbol in SIGNS]
        if not knitted:
            expected = "k or p in at least one row"
            raise self._error("the wale is never knitted", 0, column, expected=expected, found=repr(symbols))
        for row in knitted:
            held = self.held(row, column)
            if len(held) - 1 > MOST_TUCKS:
                raise self._error(
                    "too many tucks on one loop",
                    (row - held[-1]) % self.courses,
                    column,
                    expected=f"at most {MOST_TUCKS} before the next k or p",
                    found=len(held) - 1,
                )
            if held[0] > MOST_HELD:
                raise self._error(
                    "the loop is held too long",
                    (row - held[0]) % self.courses,
                    column,
                    expected=f"at most {MOST_HELD} rows",
                    found=held[0],
                )


def _interleaved(row: int, text: str) -> str:
    front, back = text.split("|")
    if len(front) != len(back):
        raise ChartError(
            f"chart row {row + 1} has beds of different length",
            row=row,
            expected=f"{len(front)} needles on the back bed",
            found=len(back),
        )
    return "".join(a + b for a, b in zip(front, back, strict=True))


def signs(chart: StitchChart) -> np.ndarray:
    """+1 for knit and -1 for purl, shape (courses, wales); only for plain charts."""
    return np.array([[SIGNS[symbol] for symbol in row] for row in chart.rows])
