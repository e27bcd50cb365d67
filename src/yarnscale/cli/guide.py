"""Commands ``samples`` and ``help``: small inputs to try, and the pages of ``docs``, which every installation has."""

from __future__ import annotations

import argparse
from pathlib import Path

import yarnscale
from yarnscale.errors import InputError, misspelt
from yarnscale.files.atomic import write_text
from yarnscale.files.run_folder import writable_folder

PACKAGE = Path(yarnscale.__file__).parent
SAMPLES = PACKAGE / "samples"


def pages() -> dict[str, Path]:
    """Pages by topic: ``estimate`` for ``guide/estimate.md``, ``validation/estimate`` for what was measured.

    They are in the package, or, in a checkout, in the folder ``docs`` beside it.
    """
    inside, beside = PACKAGE / "docs", PACKAGE.parents[1] / "docs"
    folder = inside if inside.is_dir() else beside
    found = {"overview": inside / "overview.md" if folder is inside else beside.parent / "README.md"}
    for pattern in ("guide/*.md", "tutorials/*.md", "reference/*.md", "*.md", "validation/*.md"):
        for path in sorted(folder.glob(pattern)):
            topic = path.stem.removesuffix("_format")
            if topic == "index":  # of the site, which includes the overview
                continue
            found.setdefault(f"validation/{topic}" if path.parent.name == "validation" else topic, path)
    return found


def samples(options: argparse.Namespace) -> int:
    """Copy the samples."""
    folder = writable_folder(options.out)
    files = sorted(path for path in SAMPLES.iterdir() if path.is_file())
    if not options.overwrite and (there := [path.name for path in files if (folder / path.name).exists()]):
        raise InputError(f"{there[0]} is there", where=folder, expected="a folder without it, or --overwrite")
    for path in files:
        write_text(folder / path.name, path.read_text(encoding="utf-8"))
    print(f"{folder}: {', '.join(path.name for path in files)}")
    return 0


def help(options: argparse.Namespace) -> int:
    """Print a page, or the topics."""
    found = pages()
    if options.topic is None:
        for topic, path in found.items():
            title = path.read_text(encoding="utf-8").partition("\n")[0].lstrip("# ")
            print(f"{topic:<23} {title}")
        return 0
    if options.topic not in found:
        raise InputError("unknown topic", expected=", ".join(found), found=misspelt(options.topic, found))
    print(found[options.topic].read_text(encoding="utf-8"), end="")
    return 0
