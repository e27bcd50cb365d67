"""Sampling on a Dask cluster: a scheduler and two workers on this machine, one of them killed in mid-run."""

from __future__ import annotations

import json
import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from threading import Thread
from typing import Any

import numpy as np
import pytest

import yarnscale
from yarnscale.cell import PeriodicCell
from yarnscale.cli import main
from yarnscale.drawing import library
from yarnscale.errors import InputError
from yarnscale.homogeneous.loads import FLAT, Loads
from yarnscale.homogenize import executors
from yarnscale.homogenize.executors import kept_workers, reach_workers
from yarnscale.homogenize.plan import StrainGrid
from yarnscale.homogenize.rays import Ray, strains_held
from yarnscale.homogenize.sample import create_ray_store, create_store, sample
from yarnscale.homogenize.states import FabricStates
from yarnscale.homogenize.store import SampleStore
from yarnscale.kinematics import ShellStrain
from yarnscale.yarn.material import PRESETS

distributed = pytest.importorskip("distributed", reason="the extra 'dask' is not installed")
pytestmark = pytest.mark.slow

GRID = StrainGrid(s_x=(-0.05, 0.0, 0.05, 0.1, 0.2), s_a=(-0.1, 0.1), s_y=(-0.05, 0.0, 0.1, 0.2))
STATES = 40
ENVIRONMENT = os.environ | {
    "OPENBLAS_NUM_THREADS": "1",
    "PYTHONPATH": str(Path(yarnscale.__file__).parents[1]),
}


def local_cluster(workers: int):  # type: ignore[no-untyped-def]
    return distributed.LocalCluster(
        n_workers=workers,
        threads_per_worker=1,
        processes=True,
        host="127.0.0.1",
        scheduler_port=0,
        dashboard_address=":0",
        silence_logs="CRITICAL",
    )


@pytest.fixture(scope="module")
def local() -> Iterator[Any]:
    """A scheduler with two workers for all tests of this file: each worker takes seconds of a processor to start."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PYTHONPATH", ENVIRONMENT["PYTHONPATH"])
        with local_cluster(2) as started:
            yield started


@pytest.fixture(scope="module")
def cluster(local) -> tuple[str, list[int]]:  # type: ignore[no-untyped-def]
    """Its address, and the processes of its two workers; the nannies start no others in time."""
    with distributed.Client(local.scheduler_address) as client:
        return local.scheduler_address, sorted(client.run(os.getpid).values())


@pytest.fixture(scope="module", autouse=True)
def process_kept() -> Iterator[None]:
    """One process for all runs without Dask."""
    with kept_workers():
        yield


@pytest.fixture(scope="module")
def cell() -> PeriodicCell:
    made = PeriodicCell(library.build("plain"), PRESETS["hylc2020-stockinette"])
    made.relax(ShellStrain(s_x=0.01))  # compiles what is missing: that would cost the workers memory
    return made


def write_grid(path: Path) -> Path:
    path.write_text("\n".join(f"{name} = {values.tolist()}" for name, values in GRID.axes.items()))
    return path


def test_loads_are_sampled_as_on_this_machine(
    cluster: tuple[str, list[int]], cell: PeriodicCell, tmp_path: Path
) -> None:
    rays = [
        Ray("rest", ((Loads(), strains_held(np.zeros(6))),)),
        Ray("tension", tuple((Loads.tension(0.5, load), FLAT) for load in (0.1, 0.4))),
    ]
    far = create_ray_store(tmp_path / "far", cell, rays)
    near = create_ray_store(tmp_path / "near", cell, rays)
    assert sample(cell, far, dask=cluster[0]).converged == sample(cell, near, workers=1).converged > 2
    for name in ("strains", "energies", "stresses", "moduli"):
        assert np.array_equal(getattr(FabricStates.of(far), name), getattr(FabricStates.of(near), name))


def test_a_killed_worker_loses_nothing(cluster: tuple[str, list[int]], cell: PeriodicCell, tmp_path: Path) -> None:
    address, processes = cluster
    quiet = create_store(tmp_path / "quiet", cell, GRID.axes, scattered=False)
    summary = sample(cell, quiet, dask=address)
    assert (summary.states, summary.converged) == (STATES, STATES)
    assert 50 < summary.peak_worker_megabytes < 300
    store = create_store(tmp_path / "store", cell, GRID.axes, scattered=False)
    kept: dict[int, bytes] = {}

    def disturb(progress) -> None:
        if progress.done >= 5 and not kept:
            done = np.flatnonzero(store.status())
            kept.update({int(i): store.read(int(i), "fluctuation").tobytes() for i in done})
            os.kill(processes[0], signal.SIGKILL)

    assert sample(cell, store, dask=address, progress=disturb).converged == STATES
    assert len(kept) >= 5
    assert {index: store.read(index, "fluctuation").tobytes() for index in kept} == kept
    for index in range(STATES):
        assert abs(store.read(index, "energy_density") - quiet.read(index, "energy_density")) < 1e-9


def test_the_command_samples_on_a_cluster(
    cluster: tuple[str, list[int]], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "store"
    options = ["--grid", str(write_grid(tmp_path / "grid.toml")), "--out", str(out), "--dask", cluster[0], "--json"]
    assert main(["sample", "plain", *options]) == 0
    found = json.loads(capsys.readouterr().out)
    run_of = {"states", "converged", "seconds", "workers", "peak_worker_megabytes"}
    assert set(found) == run_of | {"material", "material_from"}
    assert found["workers"] == 2
    assert (SampleStore(out).status() == 1).all()


def test_a_wrong_address_is_told_and_writes_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(executors, "CONNECT", 1.0)
    grid = write_grid(tmp_path / "grid.toml")
    options = ["--grid", str(grid), "--out", str(tmp_path / "store"), "--dask", "127.0.0.1:9"]
    assert main(["sample", "plain", *options]) == 2
    said = capfd.readouterr().err
    assert said.startswith("yarnscale: error: 127.0.0.1:9: no Dask scheduler; expected host:port")
    assert said.count("\n") == 1
    assert [path.name for path in tmp_path.iterdir()] == ["grid.toml"]


def test_a_cluster_without_workers_is_told_and_given_up(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(executors, "PATIENCE", 0.3)
    said: list[str] = []
    with (
        local_cluster(0) as empty,
        pytest.raises(InputError, match="no workers at the Dask scheduler") as caught,
    ):
        reach_workers(empty.scheduler_address, on_notice=said.append)
    assert "one within 0.3 s" in str(caught.value)
    assert len(said) == 1 and "no workers yet; waiting 0.3 s" in said[0]


def test_workers_that_all_leave_end_the_run(local, cell: PeriodicCell, tmp_path: Path, monkeypatch) -> None:  # type: ignore[no-untyped-def]
    """The last test on the cluster: it has no workers afterwards."""
    monkeypatch.setattr(executors, "PATIENCE", 1.0)
    store = create_store(tmp_path / "store", cell, GRID.axes, scattered=False)

    def leave(progress) -> None:  # type: ignore[no-untyped-def]
        if progress.done:
            local.scale(0)

    with pytest.raises(ChildProcessError, match=r"no Dask worker for 1 s|is gone"):
        sample(cell, store, dask=local.scheduler_address, progress=leave)
    done = int((store.status() == 1).sum())
    assert 0 < done < STATES
    assert sample(cell, store, workers=1).converged == STATES


def test_a_scheduler_that_dies_ends_the_run_in_a_line(
    cell: PeriodicCell, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        address = f"127.0.0.1:{free.getsockname()[1]}"
    start = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL, "env": ENVIRONMENT}
    parts = ["-m", "distributed.cli.dask_scheduler", "--host", "127.0.0.1", "--port", address.split(":")[1]]
    scheduler = subprocess.Popen([sys.executable, *parts, "--no-dashboard"], **start)
    parts = ["-m", "distributed.cli.dask_worker", address, "--nthreads", "1", "--no-dashboard", "--no-nanny"]
    worker = subprocess.Popen([sys.executable, *parts], **start)
    store = tmp_path / "store"

    def kill_in_mid_run() -> None:
        end = time.monotonic() + 60
        while len(list(store.glob("status/c/*/*/*/*/*"))) < 2 and time.monotonic() < end:
            time.sleep(0.02)
        scheduler.kill()

    watching = Thread(target=kill_in_mid_run)
    try:
        monkeypatch.setattr(executors, "CONNECT", 30.0)  # until the scheduler is up
        reach_workers(address)
        monkeypatch.setattr(executors, "CONNECT", 2.0)
        capfd.readouterr()
        watching.start()
        grid = write_grid(tmp_path / "grid.toml")
        code = main(["sample", "rib-2x2", "--grid", str(grid), "--out", str(store), "--dask", address])
        watching.join()
    finally:
        for process in (worker, scheduler):
            process.kill()
            process.wait()
    said = capfd.readouterr().err
    assert code == 1, said
    assert "Traceback" not in said
    progress = ("sampling rib-2x2: ", "settling rib-2x2", "yarn of rib-2x2")
    told = [line for line in said.splitlines() if not line.startswith(progress)]
    assert told == [f"yarnscale: error: the Dask cluster at {address} is gone; what was finished is kept"]
    assert 2 <= int((SampleStore(store).status() == 1).sum()) < STATES
