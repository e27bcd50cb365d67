"""Command ``library``: patterns in several yarns, each homogenized and tested, with a page of all."""

from __future__ import annotations

import argparse
import re
from contextlib import redirect_stdout
from io import StringIO
from itertools import product
from pathlib import Path

from yarnscale.cli.console import ProgressLine, print_notice, report
from yarnscale.cli.workers import worker_count
from yarnscale.cli.yarn_choice import same_yarns
from yarnscale.drawing import library as built_in
from yarnscale.errors import InputError
from yarnscale.files.cell_origin import CellOrigin
from yarnscale.files.material_library import MATERIAL, PATTERN, TESTS, tests
from yarnscale.files.material_toml import read_yarn_material
from yarnscale.files.run_folder import RunFolder, note_result
from yarnscale.show.canvas import require_renderer
from yarnscale.show.gallery import checked_names
from yarnscale.show.material_library import write_library

YARN = "wool"
LOADS = "0.1,0.5,1,2,5,10,20,35,50"
"""Of the tension tests [N/m]: those that the pages show and a few between them."""


def library(options: argparse.Namespace) -> int:
    """``homogenize`` and ``test`` for every pattern in every yarn that has no tests yet, then the page."""
    sources = checked_names(options.patterns or built_in.names())
    yarns = list(dict.fromkeys(options.material or [YARN]))
    require_renderer()
    wanted: dict[str, tuple[str, str]] = {}
    for source, yarn in product(sources, yarns):
        name = re.sub(r"[^\w.+-]+", "-", f"{Path(source).stem}-{read_yarn_material(yarn).name}")
        if name in wanted:
            raise InputError(f"two materials are called {name}", expected="patterns and yarns of different names")
        wanted[name] = source, yarn
        if options.resume and (options.out / name / MATERIAL).is_file():
            _check_yarn(options.out / name / MATERIAL, yarn)
    makes = ["index.html", *(f"{name}/" for name in wanted)]
    results = RunFolder(
        options.out, "library", makes, overwrite=options.overwrite, resume=options.resume, goes_on_from=["*/"],
    )  # fmt: skip
    failed, line = [], ProgressLine("library")
    with results as folder:
        for number, (name, (source, yarn)) in enumerate(wanted.items()):
            line.show(number, len(wanted), name)
            if not (folder / name / TESTS).is_file():
                good = _made(folder / name, source, yarn, options)
            else:
                good = not any(found.failed for found in tests(name, folder))
            if not good:
                failed.append(name)
        line.show(len(wanted), len(wanted))
        shown = write_library(folder)
    lines = [f"{folder / 'index.html'}: {len(shown)} materials"]
    if failed:
        lines.append("look at " + ", ".join(failed))
    report(options, {"materials": shown, "failed": failed}, *lines)
    return 1 if failed else 0


def _check_yarn(path: Path, yarn: str) -> None:
    """InputError where a material that is there is of another yarn of this name."""
    origin = CellOrigin.of_material(path)
    if origin is None or not same_yarns(origin.yarns, read_yarn_material(yarn)):
        raise InputError("cannot resume: another yarn", where=path, expected=yarn)


def _made(folder: Path, source: str, yarn: str, options: argparse.Namespace) -> bool:
    """Make one material; False where some state has no equilibrium. A pattern that cannot be one is told and passed."""
    solves = [] if options.solves is None else ["--solves", str(options.solves)]
    workers = ["--workers", str(worker_count(options)), *([] if options.dask is None else ["--dask", options.dask])]
    good = True
    try:
        if not (folder / MATERIAL).is_file():
            homogenized = ["homogenize", source, "--material", yarn, "--out", str(folder), *solves, *workers]
            good = _run(*homogenized, *(["--resume"] if folder.is_dir() else []))
        if (folder / MATERIAL).is_file():
            against = ["--against", str(folder / MATERIAL), "--out", str((folder / TESTS).parent)]
            good = _run("test", str(folder / PATTERN), *against, "--loads", LOADS, "--overwrite") and good
            note_result(folder / "tests", folder)
            note_result(folder / "yarns.png", folder)
    except InputError as error:
        print_notice(str(error))
        return False
    return good


def _run(*arguments: str) -> bool:
    """Run another command without what it prints; whether it succeeded."""
    from yarnscale.cli.arguments import parser

    options = parser().parse_args(arguments)
    with redirect_stdout(StringIO()):
        return options.run(options) == 0
