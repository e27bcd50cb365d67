"""The page stands alone, escapes what it is given, and says what is wrong."""

from __future__ import annotations

import re
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest

from yarnscale.errors import InputError
from yarnscale.show.canvas import write_png
from yarnscale.show.report import Picture, Section, Table, cell_text, write_report


class Outline(HTMLParser):
    """Collects tags that were opened and not closed, and all addresses."""

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.addresses: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.addresses += [v or "" for k, v in attrs if k in ("src", "href")]
        if tag not in ("meta", "img", "br", "link"):
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag


def sections(folder: Path) -> list[Section]:
    write_png(folder / "dot.png", np.zeros((4, 4, 3), np.uint8))
    table = Table(["state", "Ψ [J/m²]"], [["<script>alert(1)</script>", 0.0552671]], "energies")
    return [
        Section("Yarns & cells", ["a < b"], [table], [Picture(folder / "dot.png", 'a "quoted" caption')]),
        Section("Material"),
        Section("Cloth"),
    ]


def test_page_is_well_formed_and_stands_alone(tmp_path: Path) -> None:
    page = tmp_path / "index.html"
    facts = {"solves": 729, "seconds": 41.23456}
    write_report(page, "Demo <b>", sections(tmp_path), summary="x", facts=facts)
    text = page.read_text()
    outline = Outline()
    outline.feed(text)
    assert outline.open == []
    assert "<script" not in text
    assert "&lt;script&gt;" in text
    assert "0.05527" in text
    assert "41.23" in text
    assert not re.search(r"(https?:)?//[a-z]", text)
    pictures = [a for a in outline.addresses if not a.startswith("#")]
    assert len(pictures) == 1
    assert pictures[0].startswith("data:image/png;base64,")


@pytest.mark.parametrize(
    ("value", "text"),
    [(1.23456789, "1.235"), (-2e-7, "−2e−07"), (3, "3"), (True, "yes"), (None, "–"), ("a", "a")],
)
def test_cells(value: str | int | float | bool | None, text: str) -> None:
    assert cell_text(value) == text


def test_errors_are_one_line(tmp_path: Path) -> None:
    page = tmp_path / "index.html"
    with pytest.raises(InputError, match="picture cannot be read"):
        write_report(page, "t", [Section("s", pictures=[Picture(tmp_path / "none.png")])])
    with pytest.raises(InputError, match="expected 2; found 1"):
        write_report(page, "t", [Section("s", tables=[Table(["a", "b"], [["x"]], "numbers")])])
    with pytest.raises(InputError, match="kind of picture"):
        write_report(page, "t", [Section("s", pictures=[Picture(tmp_path / "a.exe")])])
    assert not page.exists()


def test_cells_say_their_column_where_tables_become_lists(tmp_path: Path) -> None:
    write_report(tmp_path / "page.html", "t", sections(tmp_path))
    text = (tmp_path / "page.html").read_text()
    assert 'data-column="Ψ [J/m²]"' in text and 'data-column="state"' in text
    assert "attr(data-column)" in text
