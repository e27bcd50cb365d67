"""Patterns by name or file, whatever the format."""

from __future__ import annotations

import os
import re
from pathlib import Path

from yarnscale.checked import checked
from yarnscale.drawing import library
from yarnscale.drawing.library import Structure
from yarnscale.drawing.stitches import StitchChart
from yarnscale.errors import InputError, misspelt
from yarnscale.files import pattern_json
from yarnscale.files.chart import read_chart
from yarnscale.files.knitout import read_knitout
from yarnscale.files.material_library import PATTERN, file_of, names
from yarnscale.files.pattern_json import read_pattern_json, write_pattern_json
from yarnscale.files.pyp import read_pyp, write_pyp
from yarnscale.files.source_text import read_source
from yarnscale.files.structure_export import write_structure
from yarnscale.files.structure_file import StructureFile
from yarnscale.files.wif import read_wif
from yarnscale.yarn.pattern import YarnPattern
from yarnscale.yarn.stiffness import Materials

READERS = {".pyp": read_pyp, ".json": read_pattern_json}
DRAWN = {".chart": read_chart, ".wif": read_wif, ".k": read_knitout}
"""Files of structures, which are drawn."""
WRITERS = (*READERS, *DRAWN)


@checked
def read_pattern(source: str | os.PathLike[str]) -> YarnPattern:
    """A built-in pattern by name, the fabric at rest of a material of the library by name (``material_library``), or a
    pattern file (`.pyp`, `.json`, or a structure to draw: `.chart`, `.wif`, `.k`; without a suffix, by its content).

    Raises InputError for an unknown name, an unknown format and whatever the readers refuse.
    """
    if isinstance(source, str) and source in library.names():
        return library.build(source)
    source = file_of(source, PATTERN)
    drawn = _drawn(source)
    return drawn.pattern() if drawn else READERS[_format(source)](Path(source))


def structure_of(source: str | os.PathLike[str]) -> Structure | None:
    """The structure from which ``read_pattern`` draws a source; None for files of yarns at rest.

    Raises InputError as ``read_pattern`` does.
    """
    if isinstance(source, str) and source in library.names():
        return library.structure(source)
    drawn = _drawn(file_of(source, PATTERN))
    return drawn.structure if drawn else None


def stitches_of(source: str | os.PathLike[str]) -> StitchChart | None:
    """The stitches from which ``read_pattern`` draws a knit (built in, a chart or knitout); None of others.

    Raises InputError as ``read_pattern`` does.
    """
    if isinstance(source, str) and source in library.names():
        chart = library.structure(source).chart
        return StitchChart.read(chart) if chart else None
    drawn = _drawn(file_of(source, PATTERN))
    return drawn.stitches() if drawn else None


def _drawn(source: str | os.PathLike[str]) -> StructureFile | None:
    """What a file of a structure says; None of files of yarns."""
    suffix = _format(source)
    return DRAWN[suffix](source) if suffix in DRAWN else None


def read_yarns(source: str | os.PathLike[str]) -> Materials | None:
    """The yarn materials in a pattern file; None where it has none, as all but ``.json`` files.

    Raises InputError as ``read_pattern`` does.
    """
    drawn = isinstance(source, str) and source in library.names()
    source = file_of(source, PATTERN)
    return pattern_json.read_yarns_json(source) if not drawn and _format(source) == ".json" else None


def is_drawing(source: str | os.PathLike[str]) -> bool:
    """Whether ``read_pattern`` draws this source (built in, a chart, a draft), so that it is no fabric at rest."""
    return source in library.names() or _format(file_of(source, PATTERN)) in DRAWN


def _format(source: str | os.PathLike[str]) -> str:
    """The suffix of a pattern file, else the one that its content calls for; InputError where that is none."""
    path = Path(source)
    if path.suffix.lower() in (*READERS, *DRAWN):
        return path.suffix.lower()
    if not os.path.exists(path) and path.suffix == "" and len(path.parts) <= 1:
        expected = f"a .pyp, .json, .chart, .wif or .k file or one of {', '.join(library.names())}"
        raise InputError("unknown pattern", expected=expected, found=misspelt(source, (*library.names(), *names())))
    text = read_source(path, other_encodings=True)
    start = text.lstrip()[:1]
    if start == "{":
        return ".json"
    if text.lstrip().startswith(";!knitout"):
        return ".k"
    if re.search(r"^\s*\[WIF\]", text, re.MULTILINE | re.IGNORECASE):
        return ".wif"
    if re.search(r"^\s*rows:", text, re.MULTILINE):
        return ".chart"
    if start in ("*", "#"):
        return ".pyp"
    raise InputError(
        "file is no pattern",
        where=path,
        expected="*pattern (.pyp), a JSON object, a chart, a WIF draft or knitout",
        found=f"{start!r} at its start",
    )


@checked
def write_pattern(
    pattern: YarnPattern,
    path: str | os.PathLike[str],
    *,
    yarns: Materials | None = None,
    structure: Structure | None = None,
) -> None:
    """Write a pattern in the format of the suffix: its yarns (`.json`, `.pyp`) or structure (`.chart`, `.wif`, `.k`).

    yarns: the materials of its yarns, which a `.json` file keeps; a `.pyp` file has no place for them. structure: what
    it was drawn from (`structure_of`). Raises InputError for any other format and what the writers refuse.
    """
    suffix = Path(path).suffix.lower()
    if suffix not in WRITERS:
        raise InputError("unknown pattern format", where=path, expected=", ".join(WRITERS), found=repr(suffix))
    if suffix == ".pyp":
        write_pyp(pattern, path)
    elif suffix == ".json":
        write_pattern_json(pattern, path, yarns=yarns)
    elif structure is None:
        expected = "a pattern drawn from a structure: a built-in one, a .chart, .wif or .k file"
        raise InputError("the pattern has no stitches or draft to write", where=path, expected=expected)
    else:
        write_structure(structure, pattern, path)
