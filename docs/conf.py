"""The documentation as a site: ``make docs`` builds it, without network, into build/docs."""

from __future__ import annotations

import inspect
import re
from pathlib import Path
from typing import Any

import yarnscale

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


(Path(__file__).parent / "docstrings.rst").write_text(docstrings(), encoding="utf-8")
