"""Relax a cell under many states, over processes, with every finished state stored at once."""

from __future__ import annotations

import json
import platform
import signal
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, CancelledError, Executor, Future, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import ExitStack, contextmanager
from dataclasses import asdict, dataclass, replace
from importlib.metadata import version
from pathlib import Path

import numpy as np

from yarnscale.arrays import Array
from yarnscale.cell.periodic import PeriodicCell
from yarnscale.checked import checked
from yarnscale.errors import InputError
from yarnscale.homogenize.executors import DaskExecutor, dask_workers, is_loss, local_workers
from yarnscale.homogenize.rays import ITERATES, TESTED, VISITED, Ray
from yarnscale.homogenize.store import RAY_DIMS, SampleStore, states_of
from yarnscale.homogenize.units import GridUnits, RayUnits, Units
from yarnscale.yarn.material import YarnMaterial

ATTEMPTS = 3
"""How often a state whose worker died is tried before it is left pending."""
LOSSES = 6
"""How often all workers may be lost in a row, with nothing finished in between, before the run ends."""
WATCH = 2.0
"""How long a run waits for a result before it looks whether a cluster is still there [s]."""


@dataclass(frozen=True)
class SamplingProgress:
    """How far a run is: states done of all, the seconds since its start and the ones left (nan until known)."""

    done: int
    total: int
    converged: int
    seconds: float
    seconds_left: float


@dataclass(frozen=True)
class SampleSummary:
    """What a run did: states in the store, converged ones, wall seconds, workers, largest worker memory [MB].

    pending: states or levels of load left since their workers died. ended: rays of loads that ended early, where the
    fabric buckles, unravels or rolls up; of strains none.
    """

    states: int
    converged: int
    seconds: float
    workers: int
    peak_worker_megabytes: float
    pending: int = 0
    ended: int = 0

    def joined(self, later: SampleSummary, *, same_store: bool = False) -> SampleSummary:
        """Both runs; on the same store, what the later one counts includes the earlier one."""
        counts = () if same_store else ("states", "converged", "pending", "ended")
        return replace(
            later, seconds=self.seconds + later.seconds,
            peak_worker_megabytes=max(self.peak_worker_megabytes, later.peak_worker_megabytes),
            **{name: getattr(self, name) + getattr(later, name) for name in counts},
        )  # fmt: skip


def provenance(cell: PeriodicCell, tiles: tuple[int, int] = (1, 1)) -> dict[str, object]:
    """Versions, pattern and material behind a run, to be stored with it; ``tiles`` of the pattern make the cell."""
    packages = ("yarnscale", "numpy", "scipy", "casadi", "llvmlite", "numba")
    return {
        "pattern": cell.pattern.name,
        "pattern_hash": cell.pattern.content_hash(),
        "radius": cell.pattern.radius,
        "period": cell.pattern.period.tolist(),
        "area_density": cell.area_density,
        "thickness": float(np.ptp(cell.pattern.vertices[:, 2])) + 2.0 * cell.pattern.radius,
        "material": _plain_material(cell),
        "sliding": "free" if cell.sliding else "fixed",
        "tolerance": cell.options.tolerance,
        "tiles": list(tiles),
        "starts": cell.options.starts,
        "seed": cell.options.seed,
        "versions": {name: version(name) for name in packages} | {"python": platform.python_version()},
    }


def _plain_material(cell: PeriodicCell) -> object:
    """The fields of the material, or a list of them where yarns have each its own; samples have no friction."""
    entries = [asdict(material) for material in cell.materials]
    for entry in entries:
        del entry["contact"]["friction"]
    return entries[0] if isinstance(cell.material, YarnMaterial) else entries


@checked
def create_store(
    path: Path,
    cell: PeriodicCell,
    axes: Mapping[str, Array],
    *,
    scattered: bool,
    positions: bool = False,
    moduli: bool = False,
    tiles: tuple[int, int] = (1, 1),
) -> SampleStore:
    """A new store for this cell; its states that bend about both axes are marked ``excluded``.

    moduli: keep those of every equilibrium too, which takes about as long as finding it. tiles: how many tiles of a
    smaller pattern the cell has; only noted in the store.
    """
    return SampleStore.create(
        Path(path),
        axes,
        scattered=scattered,
        vertices=len(cell.pattern.edges),
        positions=positions,
        moduli=moduli,
        provenance=provenance(cell, tiles),
    )


def create_ray_store(path: Path, cell: PeriodicCell, rays: Sequence[Ray]) -> SampleStore:
    """A new store for states of this cell that are found along rays of loads."""
    return SampleStore.create_rays(
        path, [ray.plain() for ray in rays], iterates=ITERATES, vertices=len(cell.pattern.edges),
        provenance=provenance(cell),
    )  # fmt: skip


_COMPARED = {
    "tiles": "number of tiles",
    "pattern_hash": "pattern hash",
    "material": "material",
    "sliding": "sliding",
    "tolerance": "tolerance",
    "starts": "number of starts",
    "seed": "seed",
}
"""Provenance that must agree to resume -> its name in messages."""


def check_resumable(
    store: SampleStore,
    cell: PeriodicCell,
    axes: Mapping[str, Array],
    *,
    positions: bool = False,
    moduli: bool = False,
    tiles: tuple[int, int] = (1, 1),
) -> None:
    """InputError unless the store was made for this cell and these states, with the same contents of every state.

    positions, moduli: whether they are kept.
    """
    _check_cell(store, cell, tiles)
    fresh, held = states_of(store.dims, axes), store.states
    if fresh.shape != held.shape or not np.allclose(fresh, held, atol=1e-12):
        raise InputError("cannot resume: other states", where=store.path, expected="the states of the store")
    for name, asked, there in (
        ("positions", positions, store.has_positions),
        ("moduli", moduli, store.has_moduli),
    ):
        if asked and not there:
            raise InputError(f"cannot resume: the store has no {name}", where=store.path, expected=f"no --{name}")


def resumed_ray_store(store: SampleStore, cell: PeriodicCell, rays: Sequence[Ray]) -> SampleStore:
    """The store, with those of ``rays`` that it lacks.

    InputError unless it was made for this cell and one of both plans begins with the other, but for further states.
    """
    _check_cell(store, cell, (1, 1))
    if store.dims != RAY_DIMS:
        raise InputError(
            "cannot resume: a store without loads", where=store.path, expected="a new folder", found="strains"
        )
    planned = json.loads(json.dumps([ray.plain() for ray in rays]))
    held = [ray for ray in store.rays if ray["kind"] not in (VISITED, TESTED)]
    if any(one != other for one, other in zip(held, planned, strict=False)):
        raise InputError("cannot resume: other loads", where=store.path, expected="the loads of the store")
    return store if len(held) >= len(planned) else store.extended(planned[len(held) :])


def _check_cell(store: SampleStore, cell: PeriodicCell, tiles: tuple[int, int]) -> None:
    stored, now = store.attributes["provenance"], provenance(cell, tiles)
    for field, name in _COMPARED.items():
        if stored.get(field) != _plain(now[field]):
            raise InputError(
                f"cannot resume: another {name}", where=store.path,
                expected=stored.get(field), found=now[field],
            )  # fmt: skip


def _plain(value: object) -> object:
    if isinstance(value, dict):
        return {key: _plain(entry) for key, entry in value.items()}
    return list(value) if isinstance(value, tuple) else value


@contextmanager
def _interrupts_held() -> Iterator[None]:
    """Block Ctrl-C: processes started within get none either, until they enable it (``prepare``)."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _has_result(future: Future) -> bool:
    """Whether a finished solve gave a result; False where its worker was lost, any other failure is raised."""
    error = CancelledError() if future.cancelled() else future.exception()
    if error is not None and not is_loss(error):
        raise error
    return error is None


class _Run:
    """Hands units of work to workers as soon as their start is there."""

    def __init__(self, work: Units, cell: PeriodicCell, report: Callable[[SamplingProgress], None] | None) -> None:
        self.work, self.cell, self.report = work, cell, report
        self.began = time.perf_counter()
        self.total, self.pending = work.total, work.pending()
        self.finished_before = self.total - len(self.pending)
        self.running: dict[Future, int] = {}
        self.attempts: dict[int, int] = {}
        self.losses = 0
        self.peak = 0.0

    def submit(self, executor: Executor, room: int) -> bool:
        """Submit ready states until ``room`` are running; False where the workers are lost."""
        while len(self.running) < room:
            index = next((i for i in self.pending if self.work.ready(i)), None)
            if index is None:
                return True
            if self.work.settled(index):
                self.pending.remove(index)
                continue
            # A state whose worker died runs alone: if it kills the next one too, it takes no other state with it.
            if self.running and (index in self.attempts or self.attempts.keys() & self.running.values()):
                return True
            task, arguments = self.work.task(index)
            try:
                with _interrupts_held():
                    future = executor.submit(task, self.cell, *arguments)
            except BrokenProcessPool:
                self._lost()
                return False
            self.pending.remove(index)
            self.running[future] = index
        return True

    def collect(self, executor: Executor) -> bool:
        """Store what is finished; False where workers died and their states went back to the queue."""
        finished, _ = wait(self.running, timeout=WATCH, return_when=FIRST_COMPLETED)
        if isinstance(executor, DaskExecutor) and not any(_has_result(future) for future in finished):
            executor.look()
        lost = False
        for future in finished:
            if not _has_result(future):
                lost = True
                continue
            result, megabytes = future.result()
            index = self.running.pop(future)
            self.peak = max(self.peak, megabytes)
            self.work.keep(index, result)
            self.losses = 0
        if lost:
            self._lost()
        self._report()
        return not lost

    def _lost(self) -> None:
        """Put running states back into the queue; those that were tried too often stay pending."""
        self.losses += 1
        if self.losses >= LOSSES:
            raise ChildProcessError(f"all workers died {LOSSES} times in a row; what was finished is kept")
        for index in self.running.values():
            self.attempts[index] = self.attempts.get(index, 0) + 1
            if self.attempts[index] < ATTEMPTS:
                self.pending.insert(0, index)
            else:
                self.work.give_up(index)
        self.running.clear()

    def _report(self) -> None:
        if self.report is None:
            return
        done = self.total - len(self.pending) - len(self.running)
        seconds = time.perf_counter() - self.began
        fresh = done - self.finished_before
        left = seconds / fresh * (self.total - done) if fresh else float("nan")
        self.report(SamplingProgress(done, self.total, self.work.converged, seconds, left))


@contextmanager
def _workers(count: int, dask: str | None, *, again: bool) -> Iterator[Executor]:
    """Processes here or on a cluster; ChildProcessError where a cluster that was there is not found ``again``."""
    with ExitStack() as stack:
        try:
            executor = stack.enter_context(local_workers(count) if dask is None else dask_workers(dask))
        except InputError:
            if not again:
                raise
            raise ChildProcessError(f"the Dask cluster at {dask} is gone; what was finished is kept") from None
        yield executor


@checked
def sample(
    cell: PeriodicCell,
    store: SampleStore,
    *,
    workers: int = 2,
    dask: str | None = None,
    progress: Callable[[SamplingProgress], None] | None = None,
) -> SampleSummary:
    """Relax ``cell`` under every state of ``store`` that is not done yet.

    Starts are chosen by state alone, so the results do not depend on the number of workers or on interruptions.
    """
    store.discard_unfinished()
    work = RayUnits(store) if store.dims == RAY_DIMS else GridUnits(store)
    seconds, workers, peak = work_off(work, cell, workers=workers, dask=dask, progress=progress)
    return SampleSummary(work.solved, work.converged, seconds, workers, peak, len(work.pending()), work.ended)


def work_off(
    work: Units,
    cell: PeriodicCell,
    *,
    workers: int = 2,
    dask: str | None = None,
    progress: Callable[[SamplingProgress], None] | None = None,
) -> tuple[float, int, float]:
    """Have workers do all units that are left: wall seconds, number of workers, largest worker memory [MB].

    Units whose workers died are tried again, a few times. Raises InputError without workers, ChildProcessError where
    all are lost again and again.
    """
    if workers < 1:
        raise InputError("workers", expected="at least 1", found=workers)
    run = _Run(work, cell, progress)
    if run.pending and dask is None:
        # Once here, not at the same time in every worker, whose memory compiling would more than double.
        cell.warm_up()
    room = workers if dask is None else 64
    while run.pending or run.running:
        with _workers(workers, dask, again=run.losses > 0) as executor:
            if isinstance(executor, DaskExecutor):
                workers = max(executor.workers, 1)
            whole = run.submit(executor, room + 1)
            while whole and run.running:
                whole = run.collect(executor) and run.submit(executor, room + 1)
    return time.perf_counter() - run.began, workers, run.peak
