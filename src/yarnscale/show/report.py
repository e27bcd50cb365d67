"""A self-contained page: headings, text, tables of numbers and pictures, readable from any folder or mail."""

from __future__ import annotations

import base64
import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined
from PIL import Image

from yarnscale.errors import InputError
from yarnscale.files.atomic import write_text
from yarnscale.show.pane import Pane, viewer_parts
from yarnscale.version import __version__

MIME = {".png": "image/png", ".jpg": "image/jpeg", ".svg": "image/svg+xml"}

_LARGE = 100_000
"""Size of a PNG file [bytes] that is no diagram."""

Cell = str | int | float | bool | None


@dataclass(frozen=True)
class Picture:
    """A picture file and the line under it. ``wide``: it takes the whole width of the page.

    pane: takes its place where a browser can turn it; without a file for other browsers a line says so.
    """

    path: Path | None
    caption: str = ""
    wide: bool = False
    pane: Pane | None = None


@dataclass(frozen=True)
class Table:
    """Numbers: ``columns`` (with units) and ``rows`` of as many cells; floats show four digits."""

    columns: Sequence[str]
    rows: Sequence[Sequence[Cell]]
    caption: str = ""


@dataclass(frozen=True)
class Section:
    """A part of the page: paragraphs, then tables, then pictures."""

    title: str
    text: Sequence[str] = ()
    tables: Sequence[Table] = ()
    pictures: Sequence[Picture] = ()


def write_report(path: str | Path, title: str, sections: Sequence[Section], **more: Any) -> None:
    """Write ``report_page``. Raises InputError as that does, or when the page cannot be written."""
    write_text(path, report_page(title, sections, **more))


def report_page(
    title: str,
    sections: Sequence[Section],
    *,
    summary: str = "",
    facts: Mapping[str, Cell] | None = None,
    nonce: str = "",
) -> str:
    """An HTML page that needs no other address.

    summary: a line below the title. facts: names and values in a strip on top of the page. nonce: that scripts and
    styles bear. Pictures and panes are in the page. All text is escaped. Raises InputError when a picture is missing or
    a row has the wrong number of cells.
    """
    for section in sections:
        for table in section.tables:
            _check(table)
    environment = Environment(
        loader=PackageLoader("yarnscale.show", "templates"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["cell"] = cell_text
    environment.filters["source"] = lambda picture: picture_source(picture.path)
    panes = [picture.pane for section in sections for picture in section.pictures if picture.pane is not None]
    return environment.get_template("report.html").render(
        title=title, summary=summary, facts=facts or {}, sections=sections, version=__version__, panes=panes,
        parts=viewer_parts() if panes else {}, nonce=nonce,
    )  # fmt: skip


def cell_text(value: Cell) -> str:
    """A cell as text: floats with four significant digits, truth as yes and no, None as a dash."""
    if value is None:
        return "–"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return f"{value:.4g}".replace("-", "−")
    return str(value)


def scaled(value: float | None, factor: float) -> float | None:
    """A number in another unit, None where there is none."""
    return None if value is None else factor * value


def _check(table: Table) -> None:
    for row in table.rows:
        if len(row) != len(table.columns):
            raise InputError("row of a table", where=table.caption or None, expected=len(table.columns), found=len(row))


def picture_source(path: Path) -> str:
    """What an ``img`` refers to: the picture itself as base64; large PNG as WebP, a sixth of their size."""
    kind = MIME.get(Path(path).suffix.lower())
    if kind is None:
        raise InputError("kind of picture", where=path, expected=" or ".join(MIME), found=Path(path).suffix)
    try:
        content = Path(path).read_bytes()
    except OSError as error:
        raise InputError("picture cannot be read", where=path, found=error.strerror) from error
    if kind == "image/png" and len(content) > _LARGE:
        kind, small = "image/webp", io.BytesIO()
        Image.open(io.BytesIO(content)).convert("RGB").save(small, "webp", quality=90)
        content = small.getvalue()
    return f"data:{kind};base64,{base64.b64encode(content).decode('ascii')}"
