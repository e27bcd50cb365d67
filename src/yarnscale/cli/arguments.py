"""The whole command line; imports nothing heavy, so that ``--help`` answers at once."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import NoReturn

from yarnscale import __version__
from yarnscale.cli.cloth_options import add_cloth_commands
from yarnscale.cli.estimate_options import add_estimate_options
from yarnscale.cli.fabric_options import add_fabric_options
from yarnscale.cli.material_options import add_material_commands
from yarnscale.cli.shared_options import add_json, add_overwrite
from yarnscale.cli.yarn_options import add_yarn_commands


class _Parser(argparse.ArgumentParser):
    """Says what is wrong in one line; the usage is a ``--help`` away."""

    def error(self, message: str) -> NoReturn:
        self.exit(2, f"{self.prog}: error: {message} (see {self.prog} --help)\n")


def _deferred(module: str, function: str) -> Callable[[argparse.Namespace], int]:
    def run(options: argparse.Namespace) -> int:
        return getattr(import_module(f"yarnscale.cli.{module}"), function)(options)

    return run


def parser() -> argparse.ArgumentParser:
    """The whole command line."""
    top = _Parser(prog="yarnscale", description="Knitted and woven cloth across scales.")
    top.add_argument("--version", action="version", version=f"yarnscale {__version__}")
    commands = top.add_subparsers(title="commands", dest="command", required=True, metavar="COMMAND")

    def add(name: str, module: str, about: str) -> argparse.ArgumentParser:
        command = commands.add_parser(name, help=about, description=about)
        command.set_defaults(run=_deferred(module, name))
        return command

    add_yarn_commands(add)
    add_material_commands(add)
    add_cloth_commands(add)
    add_fabric_options(
        add("fabric", "fabric", "Simulate a finite fabric, yarn by yarn or in a bounding volume.")
    )
    add_estimate_options(add("estimate", "estimate", "Estimate the yarn of a fabric from measured swatches."))
    samples = add("samples", "guide", "Write small inputs to try: curves, charts, scenes, a mesh, materials.")
    samples.add_argument("--out", type=Path, required=True, metavar="DIR", help="folder for them")
    samples.add_argument("--overwrite", action="store_true", help="replace files of the same names")
    help = add("help", "guide", "Print a page of the guide: formats, conventions, theory.")
    help.add_argument("topic", nargs="?", metavar="TOPIC", help="name of a page (without: their list)")
    demo = add("demo", "demo", "Run the whole first job on a built-in pattern, with pictures and a page.")
    demo.add_argument(
        "--out", type=Path, default=Path("demo"), metavar="DIR", help="folder for the page (demo)"
    )
    add_overwrite(demo)
    add_json(demo)
    return top
