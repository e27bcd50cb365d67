"""Read a text file that a user names, with errors that say what is wrong with it."""

from __future__ import annotations

import os
from pathlib import Path

from yarnscale.errors import InputError

LARGEST_FILE = 256 * 1024 * 1024


def read_source(path: str | os.PathLike[str]) -> str:
    """The text of a file; InputError when missing, a folder, unreadable, empty, binary or far too large."""
    path = Path(path)
    try:
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
    except (OSError, ValueError) as error:
        if isinstance(error, InputError):
            raise
        reason = error.strerror if isinstance(error, OSError) and error.strerror else str(error)
        raise InputError("file cannot be read", where=path, found=reason) from None
    if not content.strip():
        raise InputError("file is empty", where=path, expected="text", found=f"{len(content)} bytes")
    if b"\0" in content:
        raise InputError("file is not text", where=path, expected="text", found="binary data")
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = content[: error.start].count(b"\n") + 1
        raise InputError(
            "file is not text",
            where=f"{path}:{line}",
            expected="UTF-8",
            found=f"byte 0x{content[error.start]:02x}",
        ) from None
