"""How tests run the command line: in this process, or as a program of its own."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import pytest

import yarnscale
from yarnscale.cli import main


@dataclass(frozen=True)
class Outcome:
    status: int
    out: str
    err: str


Run = Callable[..., Outcome]


@pytest.fixture
def run(capsys: pytest.CaptureFixture[str]) -> Run:
    """Run a command in this process."""

    def call(*arguments: object) -> Outcome:
        capsys.readouterr()
        try:
            status = main([str(a) for a in arguments])
        except SystemExit as end:
            status = int(end.code or 0)
        said = capsys.readouterr()
        return Outcome(status, said.out, said.err)

    return call


@pytest.fixture
def refused(run: Run) -> Callable[..., str]:
    """Run a command that must refuse its input: status 2 and one line, which is returned."""

    def call(*arguments: object) -> str:
        outcome = run(*arguments)
        assert outcome.status == 2, outcome
        assert outcome.out == ""
        assert outcome.err.endswith("\n") and outcome.err.count("\n") == 1, outcome.err
        assert "error: " in outcome.err and "Traceback" not in outcome.err
        assert len(outcome.err) < 1200
        return outcome.err

    return call


@pytest.fixture
def program() -> Run:
    """Run a command as a program."""

    def call(*arguments: object) -> Outcome:
        environment = os.environ | {"PYTHONPATH": str(Path(yarnscale.__file__).parents[1])}
        done = subprocess.run(
            [sys.executable, "-m", "yarnscale", *map(str, arguments)],
            capture_output=True, text=True, check=False, timeout=300, env=environment,
        )  # fmt: skip
        return Outcome(done.returncode, done.stdout, done.stderr)

    return call
