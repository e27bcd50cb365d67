"""The whole command line; imports nothing heavy, so that ``--help`` answers at once."""

from __future__ import annotations

import argparse
import os
import shutil
import sys
import textwrap
from collections.abc import Callable, Sequence
from importlib import import_module
from itertools import takewhile
from pathlib import Path
from typing import Any, NoReturn

from yarnscale.cli.cloth_options import add_cloth_commands
from yarnscale.cli.estimate_options import add_estimate_options
from yarnscale.cli.fabric_options import add_fabric_options
from yarnscale.cli.material_options import add_material_commands
from yarnscale.cli.page_options import add_register_options, add_view_options
from yarnscale.cli.shared_options import GROUPS, SHARED, Add
from yarnscale.cli.yarn_options import add_yarn_commands
from yarnscale.errors import misspelt
from yarnscale.version import __version__

_COMPLETING = "_ARGCOMPLETE" in os.environ
"""Whether a shell asks how a command line goes on."""
_ORDER = {title: place for place, title in enumerate(GROUPS)}
_GROUP_OF = {f"--{name}": title for title, names in GROUPS.items() for name in names}


class Parser(argparse.ArgumentParser):
    """Says what is wrong in one line, with the name that is likely meant; without any argument it prints its help."""

    def error(self, message: str) -> NoReturn:
        self.exit(2, f"{self.prog}: error: {message} (see {self.prog} --help)\n")

    def _add_action(self, action: argparse.Action) -> argparse.Action:
        """Options of the groups in ``GROUPS`` appear there in the help."""
        title = _GROUP_OF.get(next(iter(action.option_strings), ""))
        if title is None:
            return super()._add_action(action)
        there = (group for group in self._action_groups if group.title == title)
        group = next(there, None) or self.add_argument_group(title)
        self._action_groups.sort(key=lambda group: _ORDER.get(group.title or "", -1))
        return group._add_action(action)

    def parse_known_args(self, args: Sequence[str] | None = None, namespace: Any = None) -> Any:
        if _COMPLETING:
            return super().parse_known_args(args, namespace)
        if not args and any(action.required for action in self._actions):
            self.print_help(sys.stderr)
            self.exit(2)
        # A misspelt option before one that is missing, which it likely stands for.
        for word in () if self._subparsers else takewhile(lambda word: word != "--", args or ()):
            if word.startswith("--") and not self._begins_option(word.partition("=")[0]):
                self._unknown(word)
        found, unknown = super().parse_known_args(args, namespace)
        if unknown:
            self._unknown(unknown[0])
        return found, unknown

    def _begins_option(self, word: str) -> bool:
        return any(option.startswith(word) for option in self._option_string_actions)

    def _unknown(self, word: str) -> NoReturn:
        self.error(f"unknown argument {misspelt(word.partition('=')[0], self._option_string_actions)}")

    def _check_value(self, action: argparse.Action, value: Any) -> None:
        if action.choices is not None and value not in action.choices:
            choices = [str(choice) for choice in action.choices]
            what = f"expected {', '.join(choices)}; found {misspelt(value, choices)}"
            raise argparse.ArgumentError(action, what)


def _deferred(module: str, function: str) -> Callable[[argparse.Namespace], int]:
    def run(options: argparse.Namespace) -> int:
        return getattr(import_module(f"yarnscale.cli.{module}"), function)(options)

    return run


def parser() -> Parser:
    """The whole command line."""
    top = Parser(
        prog="yarnscale", usage="yarnscale [-h] [--version] COMMAND …",
        description="Knitted and woven cloth across scales.", formatter_class=argparse.RawDescriptionHelpFormatter,
    )  # fmt: skip
    top.add_argument("--version", action="version", version=f"yarnscale {__version__}")
    commands = top.add_subparsers(
        dest="command", required=True, metavar="COMMAND", help=argparse.SUPPRESS, prog=top.prog
    )
    width, lines = shutil.get_terminal_size().columns - 2, list[str]()

    def add(name: str, module: str, about: str, *shared: str) -> argparse.ArgumentParser:
        command = commands.add_parser(name, description=about)
        command.set_defaults(run=_deferred(module, name), default=command.get_default)
        for option in shared:
            command.add_argument(option, **SHARED[option])
        lines.append(textwrap.fill(f"  {name:<11} {about}", width, subsequent_indent=" " * 14))
        return command

    for title, add_commands in _COMMANDS.items():
        lines += ["", f"{title}:"]
        add_commands(add)
    top.epilog = "\n".join(lines).strip()
    if _COMPLETING:
        from yarnscale.cli.completion import complete

        complete(top, commands.choices)
    return top


def _add_first_commands(add: Add) -> None:
    guide = add("help", "guide", "Print a page of the guide: formats, conventions, theory.")
    guide.add_argument("topic", nargs="?", metavar="TOPIC", help="name of a page (without: their list)")
    option = add(
        "samples", "guide", "Write small inputs to try: curves, charts, scenes, a mesh, materials."
    ).add_argument
    option("--out", type=Path, required=True, metavar="DIR", help="folder for them")
    option("--overwrite", action="store_true", help="replace files of the same names")
    about = "Run the whole first job on a built-in pattern, with pictures and a page."
    demo = add("demo", "demo", about, "--overwrite", "--json")
    demo.add_argument("--out", type=Path, default=Path("demo"), metavar="DIR", help="folder for the page (demo)")


_COMMANDS: dict[str, Callable[[Add], None]] = {
    "first steps": _add_first_commands,
    "patterns and cells of yarns": add_yarn_commands,
    "shell materials": add_material_commands,
    "cloth as a shell": add_cloth_commands,
    "finite fabrics of yarns": add_fabric_options,
    "measured swatches": add_estimate_options,
    "photographs": add_register_options,
    "looking": add_view_options,
}
"""Commands by the heading of their group in the help."""
