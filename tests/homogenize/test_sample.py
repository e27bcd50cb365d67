"""Sampling runs on this machine: what they store, in which order, and what they refuse to resume."""

from __future__ import annotations

import sys
from concurrent.futures import Executor, Future
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import xarray

from yarnscale.cell import PeriodicCell
from yarnscale.drawing import library
from yarnscale.errors import InputError
from yarnscale.homogenize import sample as module
from yarnscale.homogenize.executors import dask_workers
from yarnscale.homogenize.plan import StrainGrid, scattered_axes
from yarnscale.homogenize.sample import check_resumable, create_store, sample
from yarnscale.homogenize.store import SampleStore
from yarnscale.homogenize.worker import CODE_OF, solve
from yarnscale.kinematics import ShellStrain
from yarnscale.yarn.material import PRESETS

GRID = StrainGrid(s_x=(-0.05, 0.0, 0.1), lambda_x=(0.0, 20.0), lambda_y=(0.0, -20.0))


@pytest.fixture(scope="module")
def cell() -> PeriodicCell:
    return PeriodicCell(library.build("plain"), PRESETS["hylc2020-stockinette"])


class Inline(Executor):
    """Solves at once in this process; loses its workers at the calls listed."""

    def __init__(self, losses: dict[str, object]) -> None:
        self.losses = losses

    def submit(self, fn, /, *args, **kwargs):  # type: ignore[no-untyped-def]
        self.losses["calls"] = call = int(self.losses.get("calls", 0)) + 1  # type: ignore[call-overload]
        if call in self.losses.get("at_submit", ()):  # type: ignore[operator]
            raise BrokenProcessPool("gone")
        future: Future = Future()
        deadly = self.losses.get("deadly")
        if call in self.losses.get("in_solve", ()) or (deadly is not None and args[1][0] == deadly):  # type: ignore[operator]
            future.set_exception(BrokenProcessPool("gone"))
        else:
            future.set_result(fn(*args, **kwargs))
        return future


@pytest.fixture
def inline(monkeypatch: pytest.MonkeyPatch) -> dict[str, object]:
    losses: dict[str, object] = {}

    @contextmanager
    def workers(count: int):  # type: ignore[no-untyped-def]
        yield Inline(losses)

    monkeypatch.setattr(module, "local_workers", workers)
    return losses


def test_a_grid_is_sampled_as_single_solves_are(cell: PeriodicCell, tmp_path: Path, inline: object) -> None:
    seen = []
    store = create_store(tmp_path / "store", cell, GRID.axes, scattered=False, positions=True)
    summary = sample(cell, store, progress=seen.append)
    assert (summary.states, summary.converged) == (9, 9)
    assert summary.peak_worker_megabytes > 10
    assert [p.done for p in seen] == sorted(p.done for p in seen)
    assert (seen[-1].done, seen[-1].total, seen[-1].converged) == (9, 9, 9)
    data = xarray.open_zarr(tmp_path / "store").load()
    bent = data.sel(s_x=0.1, s_a=0.0, s_y=0.0, lambda_x=20.0, lambda_y=0.0)
    alone = cell.relax(ShellStrain(s_x=0.1, II11=20.0))
    assert float(bent.energy_density) == pytest.approx(alone.energy_density, rel=1e-6)
    assert np.allclose(bent.stress, alone.stress, rtol=1e-3, atol=1e-4 * np.abs(alone.stress).max())
    assert np.allclose(bent.positions, alone.positions, atol=1e-2 * cell.pattern.radius)
    twice = data.sel(s_x=0.1, s_a=0.0, s_y=0.0, lambda_x=20.0, lambda_y=-20.0)
    assert int(twice.status) == CODE_OF["excluded"]
    assert np.isnan(twice.energy_density)
    provenance = data.attrs["provenance"]
    assert provenance["pattern_hash"] == cell.pattern.content_hash()
    assert provenance["material"]["young_modulus"] == cell.material.young_modulus
    assert "casadi" in provenance["versions"]


def test_a_finished_store_is_not_solved_again(cell: PeriodicCell, tmp_path: Path, inline: dict) -> None:
    store = create_store(tmp_path / "store", cell, StrainGrid(s_x=(0.0, 0.1)).axes, scattered=False)
    sample(cell, store)
    calls = inline["calls"]
    summary = sample(cell, SampleStore(tmp_path / "store"))
    assert (summary.states, summary.converged) == (2, 2)
    assert inline["calls"] == calls


@pytest.mark.parametrize(
    "losses", [{"at_submit": (1, 4)}, {"in_solve": (1, 3, 4)}, {"at_submit": (2,), "in_solve": (3,)}]
)
def test_lost_workers_change_nothing(
    cell: PeriodicCell, tmp_path: Path, inline: dict, losses: dict[str, object]
) -> None:
    quiet = create_store(tmp_path / "quiet", cell, GRID.axes, scattered=False)
    sample(cell, quiet)
    inline.clear()
    inline.update(losses)
    store = create_store(tmp_path / "store", cell, GRID.axes, scattered=False)
    assert sample(cell, store).converged == 9
    for index in range(store.count):
        assert np.array_equal(store.read(index, "energy_density"), quiet.read(index, "energy_density"), equal_nan=True)


def test_a_state_that_kills_its_workers_stays_pending(cell: PeriodicCell, tmp_path: Path, inline: dict) -> None:
    inline["deadly"] = 0.05
    axes = StrainGrid(s_x=(0.0, 0.05, 0.1, 0.15)).axes
    store = create_store(tmp_path / "store", cell, axes, scattered=False)
    summary = sample(cell, store)
    assert (summary.states, summary.converged) == (4, 3)
    assert store.status().tolist() == [1, 0, 1, 1]
    del inline["deadly"]
    assert sample(cell, store).converged == 4


def test_a_machine_that_kills_every_worker_ends_the_run(cell: PeriodicCell, tmp_path: Path, inline: dict) -> None:
    inline["in_solve"] = range(1000)
    store = create_store(tmp_path / "store", cell, GRID.axes, scattered=False)
    with pytest.raises(ChildProcessError, match="all workers died"):
        sample(cell, store)


def test_processes_of_this_machine_do_the_same(cell: PeriodicCell, tmp_path: Path) -> None:
    axes = StrainGrid(s_x=(0.0, 0.1, 0.2)).axes
    store = create_store(tmp_path / "store", cell, axes, scattered=False)
    record, _ = solve(cell, store.states[0], None)  # compiles what is missing: that would cost the worker memory
    summary = sample(cell, store, workers=1)
    assert summary.converged == 3
    assert 50 < summary.peak_worker_megabytes < 300
    assert float(store.read(0, "energy_density")) == pytest.approx(record["energy_density"], abs=1e-9)


def test_no_workers_are_refused(cell: PeriodicCell, tmp_path: Path) -> None:
    store = create_store(tmp_path / "store", cell, GRID.axes, scattered=False)
    with pytest.raises(InputError, match="workers; expected at least 1"):
        sample(cell, store, workers=0)


def test_only_the_same_run_resumes(cell: PeriodicCell, tmp_path: Path) -> None:
    store = create_store(tmp_path / "store", cell, GRID.axes, scattered=False)
    opened = SampleStore(tmp_path / "store")
    check_resumable(opened, cell, GRID.axes)
    softer = replace(cell, material=replace(cell.material, young_modulus=1.0))
    other = replace(cell, pattern=library.build("twill-2x1"))
    for wrong, message in (
        (softer, "another material"),
        (other, "another pattern hash"),
        (replace(cell, sliding=True), "another sliding"),
        (cell.with_options(tolerance=1e-3), "another tolerance"),
        (cell.with_options(starts=2), "another number of starts"),
        (cell.with_options(seed=1), "another seed"),
    ):
        with pytest.raises(InputError, match=f"cannot resume: {message}") as caught:
            check_resumable(store, wrong, GRID.axes)
        assert str(store.path) in str(caught.value)
    with pytest.raises(InputError, match="cannot resume: another number of tiles"):
        check_resumable(store, cell, GRID.axes, tiles=(2, 1))
    with pytest.raises(InputError, match="cannot resume: other states"):
        check_resumable(store, cell, StrainGrid(s_x=(0.0,)).axes)
    moved = GRID.axes | {"s_x": np.array([-0.05, 0.0, 0.11])}
    with pytest.raises(InputError, match="cannot resume: other states"):
        check_resumable(store, cell, moved)
    with pytest.raises(InputError, match="no positions"):
        check_resumable(store, cell, GRID.axes, positions=True)
    with pytest.raises(InputError, match="no moduli"):
        check_resumable(store, cell, GRID.axes, moduli=True)


def test_scattered_states_resume_too(cell: PeriodicCell, tmp_path: Path) -> None:
    axes = scattered_axes(np.random.default_rng(1).uniform(-0.1, 0.1, (3, 5)))
    store = create_store(tmp_path / "store", cell, axes, scattered=True)
    check_resumable(store, cell, axes)


def test_without_dask_the_extra_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    with (
        pytest.raises(InputError, match="Dask is not installed; expected the extra 'dask'"),
        dask_workers("a:1"),
    ):
        pass
