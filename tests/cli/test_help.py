"""Help answers at once, for every command, without loading what only work needs."""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

import yarnscale
from yarnscale.cli.arguments import parser

COMMANDS = sorted(next(a for a in parser()._actions if isinstance(a, argparse._SubParsersAction)).choices)
HEAVY = (
    "numpy",
    "scipy",
    "casadi",
    "llvmlite",
    "numba",
    "xarray",
    "zarr",
    "pyvista",
    "matplotlib",
    "distributed",
    "pxr",
    "av",
)


def test_the_commands_that_other_programs_rely_on_are_there() -> None:
    expected = [
        "patterns",
        "pattern",
        "relax",
        "homogenize",
        "evaluate",
        "stretch",
        "drape",
        "simulate",
        "sample",
        "fit",
    ]
    assert set(expected) <= set(COMMANDS)


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_has_help(run, command: str) -> None:
    outcome = run(command, "--help")
    assert outcome.status == 0
    assert outcome.out.startswith(f"usage: yarnscale {command}")
    assert outcome.err == ""


def test_help_loads_nothing_heavy() -> None:
    code = f"""
import json, sys
from yarnscale.cli import main
try:
    main(["relax", "--help"])
except SystemExit:
    pass
print(json.dumps([name for name in {HEAVY!r} if name in sys.modules]))
"""
    environment = os.environ | {"PYTHONPATH": str(Path(yarnscale.__file__).parents[1])}
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, env=environment
    )
    assert json.loads(done.stdout.splitlines()[-1]) == []


@pytest.mark.parametrize("arguments", [[], ["nonsense"], ["relax"], ["relax", "plain", "--nonsense"]])
def test_wrong_usage_is_one_line(refused, arguments: list[str]) -> None:
    assert "--help" in refused(*arguments)


def test_the_version_is_told(run) -> None:
    assert run("--version").out.startswith("yarnscale ")
