"""Sheets of an XLSX workbook as text of cells between tabs, row for line."""

from __future__ import annotations

import zipfile
from collections.abc import Iterator
from pathlib import Path

from yarnscale.errors import InputError
from yarnscale.files.source_text import LARGEST_FILE

WORKBOOKS = (".xlsx", ".xlsm")


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
                raise InputError(
                    "file is too large", where=path, expected=f"≤ {LARGEST_FILE} bytes", found=size
                )
        book = load_workbook(path, read_only=True, data_only=True)
        for sheet in book.worksheets:
            rows = [[_text(cell) for cell in row] for row in sheet.iter_rows(values_only=True)]
            if any(any(row) for row in rows):
                yield f"{path}[{sheet.title}]", "\n".join("\t".join(row) for row in rows)
        book.close()
    except InputError:
        raise
    except Exception as error:  # whatever broken XML and archives make of the libraries
        raise InputError("file is no workbook", where=path, expected="XLSX", found=f"{error!s:.80}") from None


def _text(cell: object) -> str:
    if cell is None:
        return ""
    if isinstance(cell, float):
        return f"{cell:.15g}"
    return " ".join(str(cell).replace('"', "'").split())
