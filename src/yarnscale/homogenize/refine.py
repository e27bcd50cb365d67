"""Solve more states where the fit errs most, until a budget is spent or the error is small enough."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from yarnscale.cell.periodic import PeriodicCell
from yarnscale.checked import checked
from yarnscale.errors import InputError
from yarnscale.homogenize.adaptive import FEWEST_SCATTERED, CrossValidation, cross_validation, next_states
from yarnscale.homogenize.fit import FitOptions
from yarnscale.homogenize.sample import Progress, SampleSummary, sample
from yarnscale.homogenize.states import SampledStates
from yarnscale.homogenize.store import SampleStore

Array = NDArray[np.float64]

BATCH_SHARE = 0.15
"""States that are chosen at once, as a share of those that are there."""


@dataclass(frozen=True)
class Round:
    """Number of states that a fit was judged with, and its estimated errors (see ``CrossValidation``)."""

    states: int
    energy_95: float
    stress_95: float


@dataclass(frozen=True, eq=False)
class Refinement:
    """The store with the states that were added, the estimated errors on the way, and what the solves cost."""

    store: SampleStore
    rounds: tuple[Round, ...]
    summary: SampleSummary


@checked
def refine(
    cell: PeriodicCell,
    store: SampleStore,
    *,
    budget: int,
    target_error: float | None = None,
    options: FitOptions | None = None,
    workers: int = 2,
    dask: str | None = None,
    progress: Callable[[Progress], None] | None = None,
    judged: Callable[[Round], None] | None = None,
) -> Refinement:
    """Add states to a store of scattered ones, where the fit errs most, up to ``budget`` states in all.

    target_error: stop where the estimated 95th percentile of the error in energy, over the largest energy above rest,
    is below it. A batch is put into the store before it is solved, and follows from the states before it: an
    interrupted run goes on where it stopped, to the same end. judged: called before every batch. Raises InputError for
    the store of a grid, a budget or target that is not positive, or a store without states off the planes.
    """
    check_goal(budget, target_error)
    options = options or FitOptions(in_plane="full")
    summary, rounds = sample(cell, store, workers=workers, dask=dask, progress=progress), []
    bounds = np.stack([store.states.min(axis=0), store.states.max(axis=0)], axis=1)
    while (room := budget - store.count) > 0:
        states = SampledStates.of(store)
        found = _judged(states, cell, options, store)
        rounds.append(Round(len(states.strains), found.energy_95, found.stress_95))
        if judged is not None:
            judged(rounds[-1])
        if target_error is not None and found.energy_95 <= target_error:
            break
        count = min(room, max(8, round(BATCH_SHARE * store.count)))
        store = store.extended(next_states(found, bounds, count, known=store.states))
        spent = sample(cell, store, workers=workers, dask=dask, progress=progress)
        summary = replace(
            spent,
            seconds=summary.seconds + spent.seconds,
            peak_worker_megabytes=max(summary.peak_worker_megabytes, spent.peak_worker_megabytes),
        )
    return Refinement(store, tuple(rounds), summary)


def check_goal(budget: int, target_error: float | None) -> None:
    """InputError for a budget that is not positive, or a target that is no fraction."""
    if budget < 1:
        raise InputError("budget of solves", expected="at least 1", found=budget)
    if target_error is not None and not 0.0 < target_error < 1.0:
        raise InputError("target of the error", expected="between 0 and 1", found=target_error)


def _judged(
    states: SampledStates, cell: PeriodicCell, options: FitOptions, store: SampleStore
) -> CrossValidation:
    inside = np.count_nonzero(states.strains[states.converged], axis=1) > 2
    if np.count_nonzero(inside) < FEWEST_SCATTERED:
        raise InputError(
            "too few states inside the range to judge a fit", where=store.path,
            expected=f"at least {FEWEST_SCATTERED} converged ones", found=int(np.count_nonzero(inside)),
        )  # fmt: skip
    return cross_validation(states, density=cell.area_density, options=options)
