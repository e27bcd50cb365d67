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
from yarnscale.cli.shared_options import Option, Share, add_json, add_overwrite
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

    def command_of(name: str, module: str, about: str, *shared: Share) -> argparse.ArgumentParser:
        command = commands.add_parser(name, help=about, description=about)
        command.set_defaults(run=_deferred(module, name))
        for options in shared:
            options(command)
        return command

    def add(name: str, module: str, about: str, *shared: Share) -> Option:
        return command_of(name, module, about, *shared).add_argument

    add_yarn_commands(add)
    add_material_commands(add)
    add_cloth_commands(add)
    about = "Simulate a finite fabric, yarn by yarn or in a bounding volume."
    add_fabric_options(command_of("fabric", "fabric", about))
    add_estimate_options(add)
    option = add("samples", "guide", "Write small inputs to try: curves, charts, scenes, a mesh, materials.")
    option("--out", type=Path, required=True, metavar="DIR", help="folder for them")
    option("--overwrite", action="store_true", help="replace files of the same names")
    option = add("help", "guide", "Print a page of the guide: formats, conventions, theory.")
    option("topic", nargs="?", metavar="TOPIC", help="name of a page (without: their list)")
    about = "Run the whole first job on a built-in pattern, with pictures and a page."
    option = add("demo", "demo", about, add_overwrite, add_json)
    option("--out", type=Path, default=Path("demo"), metavar="DIR", help="folder for the page (demo)")
    return top
