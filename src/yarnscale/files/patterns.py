"""Patterns by name or file, whatever the format."""

from __future__ import annotations

import os
from pathlib import Path

from yarnscale.errors import InputError
from yarnscale.files.pattern_json import read_pattern_json, write_pattern_json
from yarnscale.files.pyp import read_pyp, write_pyp
from yarnscale.files.source_text import read_source
from yarnscale.yarn import library
from yarnscale.yarn.pattern import YarnPattern

READERS = {".pyp": read_pyp, ".json": read_pattern_json}
WRITERS = {".pyp": write_pyp, ".json": write_pattern_json}


def read_pattern(source: str | os.PathLike[str]) -> YarnPattern:
    """A built-in pattern by name, or a pattern file (`.pyp`, `.json`; without a suffix, by its content).

    Raises InputError for an unknown name, an unknown format and whatever the readers refuse.
    """
    if isinstance(source, str) and source in library.names():
        return library.build(source)
    path = Path(source)
    if path.suffix.lower() in READERS:
        return READERS[path.suffix.lower()](path)
    if not os.path.exists(path) and path.suffix == "" and len(path.parts) <= 1:
        expected = f"a .pyp or .json file or one of {', '.join(library.names())}"
        raise InputError("unknown pattern", expected=expected, found=repr(os.fspath(source)))
    start = read_source(path).lstrip()[:1]
    if start == "{":
        return read_pattern_json(path)
    if start in ("*", "#"):
        return read_pyp(path)
    raise InputError(
        "file is no pattern",
        where=path,
        expected="*pattern (.pyp) or a JSON object",
        found=f"{start!r} at its start",
    )


def write_pattern(pattern: YarnPattern, path: str | os.PathLike[str]) -> None:
    """Write a pattern in the format of the suffix, `.pyp` or `.json`; InputError for any other."""
    suffix = Path(path).suffix.lower()
    if suffix not in WRITERS:
        raise InputError(
            "unknown pattern format", where=path, expected=" or ".join(WRITERS), found=repr(suffix)
        )
    WRITERS[suffix](pattern, path)
