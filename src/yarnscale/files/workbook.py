"""Sheets of an XLSX workbook as text of cells between tabs, row for line."""

from __future__ import annotations

import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from yarnscale.errors import InputError
from yarnscale.files.source_text import LARGEST_FILE

if TYPE_CHECKING:
    from openpyxl.worksheet._read_only import ReadOnlyWorksheet

WORKBOOKS = (".xlsx", ".xlsm")
_MOST_CELLS = 1_000_000
"""Cells of a sheet, with one for every row."""


def sheets(path: Path) -> Iterator[tuple[str, str]]:
    """Name, such as ``file.xlsx[Sheet1]``, and text of every sheet that is not empty.

    Values of formulas are those that were saved. Raises InputError for what is no workbook, and without openpyxl.
    """
    try:
        from openpyxl import load_workbook
    except ImportError:
        expected = "pip install 'yarnscale[tables]', or the sheet saved as CSV"
        raise InputError("workbooks need openpyxl", where=path, expected=expected) from None
    if not path.is_file():
        raise InputError("file does not exist", where=path, expected="a readable file")
    try:
        with zipfile.ZipFile(path) as archive:
            if (size := sum(entry.file_size for entry in archive.infolist())) > LARGEST_FILE:
                raise InputError("file is too large", where=path, expected=f"≤ {LARGEST_FILE} bytes", found=size)
        book = load_workbook(path, read_only=True, data_only=True)
        for sheet in book.worksheets:
            rows = _rows(path, sheet)
            if any(any(row) for row in rows):
                yield f"{path}[{sheet.title}]", "\n".join("\t".join(row) for row in rows)
        book.close()
    except InputError:
        raise
    except Exception as error:  # whatever broken XML and archives make of the libraries
        raise InputError("file is no workbook", where=path, expected="XLSX", found=f"{error!s:.80}") from None


def _rows(path: Path, sheet: ReadOnlyWorksheet) -> list[list[str]]:
    """Cells of a sheet as they are, whatever size it says it has."""
    sheet.reset_dimensions()
    rows, cells = [], 0
    for row in sheet.iter_rows(values_only=True):
        rows.append([_text(cell) for cell in row])
        cells += 1 + len(row)
        if cells > _MOST_CELLS:
            raise InputError("sheet is too large", where=path, expected=f"≤ {_MOST_CELLS} cells", found="more")
    return rows


def _text(cell: object) -> str:
    if cell is None:
        return ""
    if isinstance(cell, float):
        return f"{cell:.15g}"
    return " ".join(str(cell).replace('"', "'").split())
