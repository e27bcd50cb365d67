"""Read a text file that a user names, with errors that say what is wrong with it."""

from __future__ import annotations

import contextlib
import math
import os
from pathlib import Path

from yarnscale.errors import InputError, system_errors

LARGEST_FILE = 256 * 1024 * 1024


def read_source(path: str | os.PathLike[str], *, other_encodings: bool = False, any_encoding: bool = False) -> str:
    """The text of a file; InputError when missing, a folder, unreadable, empty, binary or far too large.

    other_encodings: accept UTF-16 and Windows-1252 (Latin-1), which machines write, beside UTF-8. any_encoding: of
    files where only names and comments go beyond ASCII; letters that are not UTF-8 are replaced.
    """
    path = Path(path)
    with system_errors(path, "file cannot be read"):
        if path.is_dir():
            raise InputError("path is a folder", where=path, expected="a file")
        if not path.is_file():
            exists = path.exists()
            raise InputError(
                "no regular file" if exists else "file does not exist", where=path, expected="a readable file"
            )
        if (size := path.stat().st_size) > LARGEST_FILE:
            raise InputError("file is too large", where=path, expected=f"≤ {LARGEST_FILE} bytes", found=size)
        content = path.read_bytes()
    if not content.strip():
        raise InputError("file is empty", where=path, expected="text", found=f"{len(content)} bytes")
    if content.startswith((b"PK\3\4", b"\xd0\xcf\x11\xe0")):
        raise InputError(
            "file is a spreadsheet or archive", where=path, expected="text: save the sheet as CSV", found="binary data"
        )
    if other_encodings and (encoding := _utf_16(content)) is not None:
        try:
            text = content.decode(encoding).removeprefix("\ufeff")
        except UnicodeDecodeError as error:
            raise InputError("file is not text", where=path, expected="UTF-16", found=error.reason) from None
        if "\0" not in text:
            return text
    if b"\0" in content:
        raise InputError("file is not text", where=path, expected="text", found="binary data")
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        if any_encoding:
            return content.decode("utf-8-sig", errors="replace")
        line = content[: error.start].count(b"\n") + 1
        if other_encodings:
            # Windows-1252 leaves five bytes undefined; text has none of them, nor control characters.
            with contextlib.suppress(UnicodeDecodeError):
                return content.decode("cp1252")
        raise InputError(
            "file is not text",
            where=f"{path}:{line}",
            expected="UTF-8, UTF-16 or Windows-1252 (Latin-1)" if other_encodings else "UTF-8",
            found=f"byte 0x{content[error.start]:02x}",
        ) from None


def finite_number(text: str) -> float:
    """A finite number, NaN for any other text; Python would also take 1_0, inf and digits of other scripts."""
    try:
        value = float(text) if text.isascii() and "_" not in text else math.nan
    except ValueError:
        return math.nan
    return value if math.isfinite(value) else math.nan


def _utf_16(content: bytes) -> str | None:
    """The UTF-16 encoding of a file, by its mark or by zeros in every second byte of the beginning; None for others."""
    if content.startswith((b"\xff\xfe", b"\xfe\xff")):
        return "utf-16"
    head = content[:1000]
    for encoding, zeros in (("utf-16-le", head[1::2]), ("utf-16-be", head[::2])):
        if zeros.count(0) > 0.8 * len(zeros) > 1:
            return encoding
    return None
