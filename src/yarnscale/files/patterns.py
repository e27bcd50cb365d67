"""Patterns by name or file, whatever the format."""

from __future__ import annotations

import os
import re
from pathlib import Path

from yarnscale.checked import checked
from yarnscale.drawing import library
from yarnscale.drawing.stitches import StitchChart
from yarnscale.errors import InputError
from yarnscale.files import pattern_json
from yarnscale.files.chart import read_chart, read_stitches
from yarnscale.files.pattern_json import read_pattern_json, write_pattern_json
from yarnscale.files.pyp import read_pyp, write_pyp
from yarnscale.files.source_text import read_source
from yarnscale.yarn.pattern import YarnPattern
from yarnscale.yarn.stiffness import Materials

READERS = {".pyp": read_pyp, ".json": read_pattern_json, ".chart": read_chart}
WRITERS = (".pyp", ".json")


@checked
def read_pattern(source: str | os.PathLike[str]) -> YarnPattern:
    """A built-in pattern by name, or a pattern file (`.pyp`, `.json`, or a chart to draw, `.chart`;
    without a suffix, by its content).

    Raises InputError for an unknown name, an unknown format and whatever the readers refuse.
    """
    if isinstance(source, str) and source in library.names():
        return library.build(source)
    return READERS[_format(source)](Path(source))


def stitches_of(source: str | os.PathLike[str]) -> StitchChart | None:
    """The stitches from which ``read_pattern`` draws a knit (a built-in one or a chart); None of anything else.

    Raises InputError as ``read_pattern`` does.
    """
    if isinstance(source, str) and source in library.names():
        chart = library.structure(source).chart
        return StitchChart.read(chart) if chart else None
    return read_stitches(source) if _format(source) == ".chart" else None


def read_yarns(source: str | os.PathLike[str]) -> Materials | None:
    """The yarn materials that a pattern file holds; None where it has none, as all but ``.json`` files.

    Raises InputError as ``read_pattern`` does.
    """
    drawn = isinstance(source, str) and source in library.names()
    return pattern_json.read_yarns(source) if not drawn and _format(source) == ".json" else None


def is_drawing(source: str | os.PathLike[str]) -> bool:
    """Whether ``read_pattern`` draws this source (a built-in pattern or a chart), so that it is not fabric at rest."""
    return source in library.names() or _format(source) == ".chart"


def _format(source: str | os.PathLike[str]) -> str:
    """The suffix of a pattern file, else the one that its content calls for; InputError where that is none."""
    path = Path(source)
    if path.suffix.lower() in READERS:
        return path.suffix.lower()
    if not os.path.exists(path) and path.suffix == "" and len(path.parts) <= 1:
        expected = f"a .pyp, .json or .chart file or one of {', '.join(library.names())}"
        raise InputError("unknown pattern", expected=expected, found=repr(os.fspath(source)))
    text = read_source(path)
    start = text.lstrip()[:1]
    if start == "{":
        return ".json"
    if re.search(r"^\s*rows:", text, re.MULTILINE):
        return ".chart"
    if start in ("*", "#"):
        return ".pyp"
    raise InputError(
        "file is no pattern",
        where=path,
        expected="*pattern (.pyp), a JSON object or a chart",
        found=f"{start!r} at its start",
    )


@checked
def write_pattern(
    pattern: YarnPattern, path: str | os.PathLike[str], *, yarns: Materials | None = None
) -> None:
    """Write a pattern in the format of the suffix, `.pyp` or `.json`; InputError for any other.

    yarns: the materials of its yarns, which a `.json` file keeps; a `.pyp` file has no place for them.
    """
    suffix = Path(path).suffix.lower()
    if suffix not in WRITERS:
        raise InputError(
            "unknown pattern format", where=path, expected=" or ".join(WRITERS), found=repr(suffix)
        )
    if suffix == ".pyp":
        write_pyp(pattern, path)
    else:
        write_pattern_json(pattern, path, yarns=yarns)
