"""Sampling runs that are killed: nothing that was finished is lost, and the end is that of a quiet run.

Runs are forked from a process that has everything loaded, so that most of a run's life is work. They are the command
itself, with processes of its own as workers; only the way those are started differs (fork instead of spawn).
"""

from __future__ import annotations

import contextlib
import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

import yarnscale
from yarnscale.homogenize.store import SampleStore

pytestmark = pytest.mark.skipif(not hasattr(os, "fork"), reason="needs processes that fork")

KILLS = 20
ENVIRONMENT = os.environ | {
    "OPENBLAS_NUM_THREADS": "1",
    "PYTHONPATH": str(Path(yarnscale.__file__).parents[1]),
}
GRID = """
s_x = [-0.05, 0, 0.05, 0.1, 0.15, 0.2, 0.25]
s_a = [-0.1, 0.1]
s_y = [-0.05, 0, 0.1, 0.2]
"""
STATES = 56

FORKING = """
import json, multiprocessing, os, sys, traceback
import yarnscale.cli, yarnscale.cli.samples, yarnscale.homogenize.executors as executors
executors.get_context = lambda method: multiprocessing.get_context("fork")
from yarnscale.cell import PeriodicCell
from yarnscale.kinematics import ShellStrain
from yarnscale.drawing import library
from yarnscale.yarn.material import PRESETS
PeriodicCell(library.build("plain"), PRESETS["hylc2020-stockinette"]).relax(ShellStrain(s_x=0.01))
print("ready", flush=True)
for line in sys.stdin:
    child = os.fork()
    if child == 0:
        os.setsid()
        sys.stdout = open(os.devnull, "w")
        sys.stderr = open(json.loads(line)[0], "w")
        code = 70
        try:
            code = yarnscale.cli.main(json.loads(line)[1])
        except BaseException:
            traceback.print_exc()
        finally:
            sys.stderr.flush()
            os._exit(code)
    print(child, flush=True)
    print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]), flush=True)
"""

PROGRESS = ("sampling plain:", "settling plain", "yarn of plain")
"""Beginnings of lines that tell how far a run is and of what yarn it is."""


@pytest.fixture(scope="module", autouse=True)
def _interruptible() -> Iterator[None]:
    """Commands started here obey Ctrl-C even where the tests run in the background, which ignores it."""
    kept = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, kept)


class Runner:
    """Starts runs of the command in groups of their own, one at a time."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.process = subprocess.Popen(
            [sys.executable, "-c", FORKING],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            env=ENVIRONMENT,
        )
        assert self.answer() == "ready"

    def answer(self) -> str:
        assert self.process.stdout is not None
        return self.process.stdout.readline().strip()

    def start(self, *arguments: str) -> int:
        """Start a run; its process id, which is that of its group."""
        assert self.process.stdin is not None
        self.process.stdin.write(json.dumps([str(self.folder / "stderr.txt"), arguments]) + "\n")
        self.process.stdin.flush()
        return int(self.answer())

    def end(self) -> int:
        """Wait for the run; its exit status, negative where a signal ended it."""
        return int(self.answer())

    def run(self, *arguments: str) -> int:
        self.start(*arguments)
        return self.end()


@pytest.fixture(scope="module")
def runner(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Runner]:
    started = Runner(tmp_path_factory.mktemp("runs"))
    yield started
    assert started.process.stdin is not None
    started.process.stdin.close()
    started.process.wait(timeout=30)


@pytest.fixture(scope="module")
def grid(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("grid") / "grid.toml"
    path.write_text(GRID)
    return path


@pytest.fixture(scope="module")
def quiet(runner: Runner, grid: Path) -> SampleStore:
    """The store of a run that nobody disturbed."""
    path = runner.folder / "quiet"
    assert runner.run(*command(grid, path)) == 0
    return SampleStore(path)


def command(grid: Path, store: Path, *more: str) -> list[str]:
    return ["sample", "plain", "--grid", str(grid), "--out", str(store), "--workers", "2", *more]


def finished(store: SampleStore) -> dict[int, list[bytes]]:
    """Contents of all finished states."""
    names = ("status", "energy_density", "stress", "fluctuation", "twist", "iterations", "seconds")
    return {int(i): [store.read(int(i), name).tobytes() for name in names] for i in np.flatnonzero(store.status())}


def wait_for(store: Path, count: int) -> None:
    """Until a store has that many finished states."""
    began = time.monotonic()
    while time.monotonic() - began < 60:
        with contextlib.suppress(OSError, ValueError):
            if np.count_nonzero(SampleStore(store).status()) >= count:
                return
        time.sleep(0.002)
    raise AssertionError(f"fewer than {count} states after a minute")


def same_outcome(store: SampleStore, other: SampleStore) -> None:
    for name, tolerance in (("energy_density", 1e-9), ("stress", 1e-6)):
        for index in range(store.count):
            assert np.allclose(store.read(index, name), other.read(index, name), rtol=tolerance, atol=tolerance)


def group_goes(group: int) -> bool:
    """Whether all processes of a group end soon."""
    began = time.monotonic()
    while time.monotonic() - began < 10:
        try:
            os.killpg(group, 0)
        except ProcessLookupError:
            return True
        time.sleep(0.02)
    return False


@pytest.mark.slow
def test_twenty_kills_lose_no_finished_state(runner: Runner, grid: Path, quiet: SampleStore) -> None:
    rng = np.random.default_rng(20)
    kills, stores, at_kills = 0, 0, []
    while kills < KILLS:
        path = runner.folder / f"killed{stores}"
        stores += 1
        kept: dict[int, list[bytes]] = {}
        status = -signal.SIGKILL
        while status != 0:
            group = runner.start(*command(grid, path, "--resume"))
            if kills < KILLS:
                wait_for(path, min(len(kept) + int(rng.integers(0, 5)), STATES))
                time.sleep(rng.uniform(0.0, 0.1))
                with contextlib.suppress(ProcessLookupError):
                    os.killpg(group, signal.SIGKILL)
            status = runner.end()
            assert status in (0, -signal.SIGKILL)
            now = finished(SampleStore(path))
            assert {index: now[index] for index in kept} == kept
            kept = now
            if status != 0:
                kills += 1
                at_kills.append(len(kept))
        assert len(kept) == STATES
        same_outcome(SampleStore(path), quiet)
        assert not list(path.rglob("*.building"))
    assert len(set(at_kills)) > 5


def workers_of(process: int) -> list[int]:
    return [int(p) for p in Path(f"/proc/{process}/task/{process}/children").read_text().split()]


needs_proc = pytest.mark.skipif(not Path("/proc/self/task").exists(), reason="needs /proc to find workers")


@needs_proc
def test_a_run_outlives_workers_that_die(runner: Runner, grid: Path, quiet: SampleStore) -> None:
    path = runner.folder / "orphaned"
    process = runner.start(*command(grid, path))
    for count in (3, 20):
        wait_for(path, count)
        kept = finished(SampleStore(path))
        os.kill(workers_of(process)[0], signal.SIGKILL)
    assert runner.end() == 0
    end = SampleStore(path)
    now = finished(end)
    assert {index: now[index] for index in kept} == kept
    same_outcome(end, quiet)


@needs_proc
def test_workers_end_with_the_run_that_started_them(runner: Runner, grid: Path, quiet: SampleStore) -> None:
    path = runner.folder / "beheaded"
    process = runner.start(*command(grid, path))
    wait_for(path, 3)
    os.kill(process, signal.SIGKILL)
    assert runner.end() == -signal.SIGKILL
    assert group_goes(process)


def test_ctrl_c_keeps_what_is_finished(runner: Runner, grid: Path, quiet: SampleStore) -> None:
    path = runner.folder / "interrupted"
    group = runner.start(*command(grid, path))
    wait_for(path, 5)
    kept = finished(SampleStore(path))
    os.killpg(group, signal.SIGINT)
    assert runner.end() == 130
    assert group_goes(group)
    lines = (runner.folder / "stderr.txt").read_text().splitlines()
    assert [line for line in lines if not line.startswith(PROGRESS)] == [
        "yarnscale: interrupted; what was finished is kept"
    ]
    assert runner.run(*command(grid, path, "--resume")) == 0
    now = finished(SampleStore(path))
    assert {index: now[index] for index in kept} == kept
    same_outcome(SampleStore(path), quiet)


def test_a_spawned_run_is_silent_on_ctrl_c_and_resumes(grid: Path, tmp_path: Path, quiet: SampleStore) -> None:
    line = [sys.executable, "-m", "yarnscale", *command(grid, tmp_path / "store", "--workers", "1")]
    with subprocess.Popen(line, stderr=subprocess.PIPE, text=True, start_new_session=True, env=ENVIRONMENT) as run:
        wait_for(tmp_path / "store", 2)
        os.killpg(run.pid, signal.SIGINT)
        _, errors = run.communicate(timeout=30)
    assert run.returncode == 130
    said = [text for text in errors.splitlines() if not text.startswith(PROGRESS)]
    assert said == ["yarnscale: interrupted; what was finished is kept"]
    kept = finished(SampleStore(tmp_path / "store"))
    again = subprocess.run([*line, "--resume", "--json"], capture_output=True, text=True, check=False, env=ENVIRONMENT)
    assert again.returncode == 0
    assert json.loads(again.stdout)["converged"] == STATES
    now = finished(SampleStore(tmp_path / "store"))
    assert {index: now[index] for index in kept} == kept
    same_outcome(SampleStore(tmp_path / "store"), quiet)
