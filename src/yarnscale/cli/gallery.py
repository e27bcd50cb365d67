"""Command ``gallery``: a page of built-in patterns."""

from __future__ import annotations

import argparse
import glob
from contextlib import nullcontext
from pathlib import Path

from yarnscale.cli.console import ProgressLine, report
from yarnscale.cli.workers import worker_count
from yarnscale.drawing import library
from yarnscale.files.run_folder import RunFolder
from yarnscale.homogenize.executors import local_workers
from yarnscale.show.canvas import require_renderer
from yarnscale.show.gallery import checked_names, write_gallery


def gallery(options: argparse.Namespace) -> int:
    """Relax, draw, write the page."""
    names = checked_names(options.patterns) or None
    require_renderer()
    drawn = (*library.names(), *(Path(name).stem for name in names or ()))
    makes = ["index.html", *(f"{glob.escape(name)}-[0-9].png" for name in drawn)]
    workers = min(worker_count(options), len(names or library.names()))
    with (
        RunFolder(options.out, "gallery", makes, overwrite=options.overwrite) as folder,
        local_workers(workers) if workers > 1 else nullcontext() as executor,
    ):
        exhibits = write_gallery(
            folder, names=names, at_rest=not options.as_drawn, progress=ProgressLine("gallery").show,
            executor=executor,
        )  # fmt: skip
    failed = [exhibit.pattern.name for exhibit in exhibits if not exhibit.good]
    good = len(exhibits) - len(failed)
    lines = [f"{folder / 'index.html'}: {len(exhibits)} patterns, {good} as they should be"]
    if failed:
        lines.append("look at " + ", ".join(failed))
    report(options, {"patterns": [e.pattern.name for e in exhibits], "failed": failed}, *lines)
    return 1 if failed else 0
