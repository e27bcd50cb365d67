"""The error of a chart or draft that cannot be made, with its place."""

from __future__ import annotations

from yarnscale.errors import InputError


class ChartError(InputError):
    """A fault at a row (course or pick) and column (wale or end), both counted from 0; None where there is none.

    Columns count the symbols of a row as it is written, without the bar between two beds.
    """

    def __init__(
        self,
        what: str,
        *,
        row: int | None = None,
        column: int | None = None,
        expected: object = None,
        found: object = None,
    ) -> None:
        super().__init__(what, expected=expected, found=found)
        self.row, self.column = row, column
