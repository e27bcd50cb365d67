"""The documentation as a site: ``make docs`` builds it, without network, into build/docs."""

from __future__ import annotations

import inspect
import re
import shutil
from pathlib import Path
from typing import Any

import yarnscale
from yarnscale.files.material_library import LIBRARY, MATERIAL, names
from yarnscale.show.material_library import CAPTION, COLUMNS, LibraryMaterial
from yarnscale.show.report import Section, Table, cell_text

project, author, version = "yarnscale", "the yarnscale authors", yarnscale.__version__
html_title = f"yarnscale {version}"
html_theme = "furo"
extensions = ["myst_parser", "sphinx.ext.autodoc"]
exclude_patterns = ["charts/*"]
suppress_warnings = ["misc.highlighting_failure"]  # csv has no colours
myst_heading_anchors = 3
autodoc_typehints = "none"
autodoc_member_order = "bysource"


def docstrings() -> str:
    """A page with the docstrings of all public names; it is written anew for each build."""
    parts = ["Docstrings", "==========", ""]
    for name in sorted(yarnscale.__all__):
        thing = getattr(yarnscale, name)
        if name.startswith("_") or not (inspect.isclass(thing) or inspect.isroutine(thing) or inspect.ismodule(thing)):
            continue
        kind = "module" if inspect.ismodule(thing) else "class" if inspect.isclass(thing) else "function"
        place = thing.__name__ if kind == "module" else f"{thing.__module__}.{thing.__qualname__}"
        title = f"yarnscale.{name}"
        parts += [title, "-" * len(title), "", f".. auto{kind}:: {place}"]
        parts += ["   :members:", ""] if kind != "function" else [""]
    return "\n".join(parts)


def as_plain_text(app: Any, what: str, name: str, thing: Any, options: Any, lines: list[str]) -> None:
    """Docstrings are plain text: no markup by bars and trailing underscores; hanging lines join their paragraph."""
    for k, line in enumerate(lines):
        if k and lines[k - 1].strip() and not lines[k - 1].startswith(" "):
            line = line.lstrip()
        parts = line.split("``")
        parts[::2] = [re.sub(r"(?<=\w)_(?!\w)", r"\\_", part.replace("|", r"\|")) for part in parts[::2]]
        lines[k] = "``".join(parts)


def setup(app: Any) -> None:
    """Hook of the generator."""
    app.connect("autodoc-process-docstring", as_plain_text)


def rst(section: Section) -> str:
    """A section of our pages as restructured text, pictures beside it."""
    parts = [plain(section.title), "-" * (2 * len(section.title) + 1), ""]
    for paragraph in section.text:
        parts += [plain(paragraph), ""]
    for picture in section.pictures:
        assert picture.path is not None
        width = [] if picture.wide else ["   :width: 480px"]
        parts += [f".. figure:: {picture.path.name}", *width, "", f"   {plain(picture.caption)}", ""]
    for table in section.tables:
        parts += [f".. list-table:: {plain(table.caption)}", "   :header-rows: 1", ""]
        for row in (table.columns, *table.rows):
            cells = [plain(cell_text(cell)) for cell in row]
            parts += [f"   {'*' if k == 0 else ' '} - {cell}" for k, cell in enumerate(cells)]
        parts.append("")
    return "\n".join(parts)


def plain(text: str) -> str:
    """Text without markup."""
    return re.sub(r"([\\*`|_])", r"\\\1", text)


def library(folder: Path) -> None:
    """Pages of the material library: one of all, and one of each with its pictures and its file."""
    folder.mkdir(exist_ok=True)
    materials = [LibraryMaterial(name) for name in names()]
    for material in materials:
        name = material.name
        shutil.copyfile(LIBRARY / name / MATERIAL, folder / f"{name}.json")
        use = [
            f":download:`{name}.json <{name}.json>`, or by its name in every command and in Python::", "",
            f"    yarnscale simulate hang --shell {name} --out hung", "",
        ]  # fmt: skip
        sections = "\n".join(map(rst, material.sections(folder)))
        (folder / f"{name}.rst").write_text("\n".join([name, "=" * len(name), "", *use, sections]), encoding="utf-8")
    rows = [[f"REF {row[0]}", *row[1:]] for row in (material.row() for material in materials)]
    table = rst(Section("All materials", [], [Table(COLUMNS, rows, CAPTION)]))
    table = re.sub(r"REF (\S+)", r":doc:`\1`", table)
    entries = [f"   {material.name}" for material in materials]
    seen = [f".. |{m.name}| image:: {m.name}.png\n   :width: 150px\n   :target: {m.name}.html" for m in materials]
    shown = [" ".join(f"|{material.name}|" for material in materials), "", *seen]
    head = [
        "Materials",
        "=========",
        "",
        INTRODUCTION,
        "",
        ".. toctree::",
        "   :hidden:",
        "",
        *entries,
        "",
        *shown,
        "",
        table,
    ]
    (folder / "index.rst").write_text("\n".join(head), encoding="utf-8")


INTRODUCTION = (
    "Built-in patterns in common yarns, which every installation has: the fabric at rest, virtual tests of its yarns, "
    "and the shell material fitted to them. They are schematic fabrics of estimated yarns, not measured ones. The "
    "guide 'The material library' says how to use and to make them."
)
(Path(__file__).parent / "docstrings.rst").write_text(docstrings(), encoding="utf-8")
library(Path(__file__).parent / "library")
