"""Help answers at once, for every command, without loading what only work needs."""

from __future__ import annotations

import argparse
import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

import yarnscale
from yarnscale.cli.arguments import parser
from yarnscale.shell.scenes.ready import READY

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


def test_ready_scenes_are_all_named(run) -> None:
    words = re.split(r"[\s,]+", run("simulate", "--help").out)
    assert set(READY) <= set(words)


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
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, env=environment)
    assert json.loads(done.stdout.splitlines()[-1]) == []


@pytest.mark.parametrize("arguments", [["nonsense"], ["relax", "--json"], ["relax", "plain", "--nonsense"]])
def test_wrong_usage_is_one_line(refused, arguments: list[str]) -> None:
    assert "--help" in refused(*arguments)


def test_the_version_is_told(run) -> None:
    assert run("--version").out.startswith("yarnscale ")


def completed(line: str, tmp_path: Path) -> set[str]:
    """What a shell is offered at the end of a line."""
    asked = {"_ARGCOMPLETE": "1", "COMP_LINE": line, "COMP_POINT": str(len(line)), "_ARGCOMPLETE_IFS": "\n"}
    found = tmp_path / "offered"
    environment = os.environ | asked | {
        "_ARGCOMPLETE_STDOUT_FILENAME": str(found), "PYTHONPATH": str(Path(yarnscale.__file__).parents[1]),
    }  # fmt: skip
    subprocess.run([sys.executable, "-m", "yarnscale"], env=environment, cwd=tmp_path, check=True, timeout=60)
    return {name.strip() for name in found.read_text().split("\n")}


def test_shells_complete_commands_options_choices_names_and_files(tmp_path: Path) -> None:
    (tmp_path / "stone.chart").touch()
    assert {"homogenize"} == completed("yarnscale homo", tmp_path)
    assert {"--strain", "--starts"} <= completed("yarnscale relax plain --st", tmp_path)
    assert {"course", "wale"} == completed("yarnscale stretch m.json --direction ", tmp_path)
    assert {"stockinette", "stone.chart"} <= completed("yarnscale relax sto", tmp_path)
    assert {"stockinette-small", "stockinette-wool"} <= completed("yarnscale view stockinette-", tmp_path)
    assert {"wool"} == completed("yarnscale relax plain --material wo", tmp_path)


def test_misspelt_names_are_told_the_likely_one(refused) -> None:
    for arguments, meant in (
        (["rleax"], "relax"),
        (["relax", "plain", "--straim", "0,0,0,0,0"], "--strain"),
        (["pattern", "plain", "--outt", "x"], "--out"),
        (["relax", "stokinette"], "stockinette"),
        (["relax", "plain", "--material", "woll"], "wool"),
        (["stretch", "m.json", "--out", "x", "--direction", "curse"], "course"),
        (["simulate", "sweeter", "--out", "x"], "sweater"),
        (["help", "estimat"], "estimate"),
    ):
        assert f"did you mean {meant}?" in refused(*arguments)
    assert "did you mean" not in refused("relax", "xyz")


def test_without_arguments_comes_help_and_commands_stand_in_groups(run) -> None:
    outcome = run()
    assert outcome.status == 2 and "shell materials:\n  homogenize" in outcome.err
    outcome = run("relax")
    assert outcome.status == 2 and "positional arguments:\n  PATTERN" in outcome.err
    titles = [line[:-1] for line in outcome.err.splitlines() if line.endswith(":") and line[0] != " "]
    assert re.search(r"options:\n  -h, --help .*\n\nyarn:", run("fabric").err)
    assert titles.index("yarn") < titles.index("loads and states") < titles.index("results")
