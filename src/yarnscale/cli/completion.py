"""What a shell completes beside options and their choices: names of patterns, materials, scenes and pages; files."""

from __future__ import annotations

import argparse
import tomllib
from collections.abc import Iterable, Mapping
from importlib.resources import files

import argcomplete
from argcomplete.completers import FilesCompleter


def complete(parser: argparse.ArgumentParser, commands: Mapping[str, argparse.ArgumentParser]) -> None:
    """Answer a shell that asks how a command line goes on, and end the process; else do nothing."""
    for command in commands.values():
        for action in command._actions:
            action.completer = _completer(action)  # type: ignore[attr-defined]
    argcomplete.autocomplete(parser)


def _completer(action: argparse.Action) -> argcomplete.completers.BaseCompleter | None:
    if action.choices is not None:
        return None

    class Names(FilesCompleter):
        def __call__(self, prefix: str, **options: object) -> list[str]:
            return [*_names(action), *super().__call__(prefix, **options)]

    return Names()


def _names(action: argparse.Action) -> Iterable[str]:
    kind = action.metavar or action.dest
    if kind in ("PATTERN", "THING", "SUBJECT", "OTHER", "KNIT.chart"):
        # Not by yarnscale.drawing, which would load numba.
        yield from tomllib.loads((files("yarnscale") / "drawing" / "patterns.toml").read_text(encoding="utf-8"))
    if kind in ("SHELL", "THING", "SUBJECT", "OTHER"):
        from yarnscale.files import material_library

        yield from material_library.names()
    if kind == "YARN":
        from yarnscale.yarn.material import PRESETS

        yield from PRESETS
    if kind == "SCENE":
        from yarnscale.shell.scenes.ready import READY

        yield from READY
    if kind == "TOPIC":
        from yarnscale.cli.guide import pages

        yield from pages()
