"""TOML files that a user names: read with the line of what is wrong, and errors of their fields put to its line."""

from __future__ import annotations

import os
import re
import tomllib
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from yarnscale.errors import InputError
from yarnscale.files.source_text import read_source

_HEADER = re.compile(r"\s*(\[\[?)\s*([^\[\]#]+?)\s*\]\]?")
_KEY = re.compile(r"\s*([A-Za-z0-9_.\"' -]+?)\s*=")


def read_toml(path: str | os.PathLike[str]) -> tuple[dict[str, Any], str]:
    """The tables of a file and its text; InputError with the line where it is not TOML."""
    text = read_source(path)
    try:
        return tomllib.loads(text), text
    except (tomllib.TOMLDecodeError, RecursionError, ValueError) as error:
        line = re.search(r"at line (\d+)", str(error))
        number = int(line.group(1)) if line else text.rstrip().count("\n") + 1
        raise InputError("file is not TOML", where=f"{path}:{number}", found=str(error)) from None


@contextmanager
def fields_of(path: str | os.PathLike[str], text: str) -> Iterator[None]:
    """Errors without a place, or with no more than the file, get the line of the field that they name."""
    try:
        yield
    except InputError as error:
        if error.where is not None and str(error.where) != str(path):
            raise
        line = _line(text, error.what)
        where = path if line is None else f"{path}:{line}"
        raise InputError(error.what, where=where, expected=error.expected, found=error.found) from None


def _line(text: str, what: str) -> int | None:
    """The first line whose key or table a message names, such as ``[contact] friction`` or ``obstacles[1].radius``."""
    lines = _lines(text)
    section = re.match(r"\[([\w.\[\]-]+)\] ", what)
    words = re.findall(r"[A-Za-z_][\w.-]*(?:\[\d+\][\w.-]*)*", what)
    names = [f"{section[1]}.{word}" for word in words] if section else []
    for name in [*names, *words]:
        if name in lines:
            return lines[name]
    return lines.get(section[1]) if section else None


def _lines(text: str) -> dict[str, int]:
    """Line of every key and table, by its full name."""
    lines: dict[str, int] = {}
    section, counts = "", dict[str, int]()
    for number, line in enumerate(text.splitlines(), start=1):
        if header := _HEADER.match(line):
            section = header[2].replace(" ", "")
            if header[1] == "[[":
                counts[section] = counts.get(section, -1) + 1
                section += f"[{counts[section]}]"
            lines.setdefault(section, number)
        elif key := _KEY.match(line):
            name = re.sub(r"[ \"']", "", key[1])
            lines.setdefault(f"{section}.{name}" if section else name, number)
    return lines
