"""Adaptive sampling: where fits disagree, what their errors are estimated to be, and runs that stop half-way."""

from __future__ import annotations

import shutil
from concurrent.futures import Executor, Future
from contextlib import nullcontext
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from yarnscale.cell import PeriodicCell
from yarnscale.errors import InputError
from yarnscale.homogenize.adaptive import CrossValidation, cross_validation, next_states
from yarnscale.homogenize.fit import FitOptions, fit_spline_material, validate
from yarnscale.homogenize.plan import (
    StrainGrid,
    StrainRange,
    axes_planes_and_inside,
    random_states,
    scattered,
    scattered_axes,
)
from yarnscale.homogenize.refine import refine
from yarnscale.homogenize.sample import create_store
from yarnscale.homogenize.states import SampledStates
from yarnscale.homogenize.store import SampleStore
from yarnscale.yarn import library
from yarnscale.yarn.material import PRESETS

BOUNDS = StrainRange().bounds(0.001)
REACH = BOUNDS[:, 1]
OPTIONS = FitOptions(in_plane="full", inside_knots=5, plane_knots=7)
COARSE = FitOptions(in_plane="full", inside_knots=3, plane_knots=3, axis_knots=5)


def energy(states: np.ndarray) -> np.ndarray:
    """Smooth but for a ridge at large s_x; bends a little."""
    x = states / REACH
    ridge = 0.6 * np.exp(-(((x[:, 0] - 0.8) / 0.1) ** 2)) * x[:, 1] ** 2 * x[:, 2]
    return 2 * x[:, 0] ** 2 + x[:, 1] ** 2 + x[:, 2] ** 2 + 0.05 * x[:, 3] ** 2 + 0.05 * x[:, 4] ** 2 + ridge


def sampled(states: np.ndarray) -> SampledStates:
    slopes = []
    for k in range(5):
        step = np.eye(5)[k] * 1e-5 * REACH[k]
        slopes.append((energy(states + step) - energy(states - step)) / (2e-5 * REACH[k]))
    unknown = np.full((len(states), 6, 6), np.nan)
    return SampledStates(
        states, energy(states), np.stack(slopes, axis=1), np.ones(len(states), bool), unknown
    )


@pytest.fixture(scope="module")
def judged() -> CrossValidation:
    return cross_validation(sampled(axes_planes_and_inside(BOUNDS, 150)), density=0.2, options=OPTIONS)


def test_the_estimated_error_is_about_that_on_unseen_states(judged: CrossValidation) -> None:
    data = sampled(axes_planes_and_inside(BOUNDS, 150))
    material = fit_spline_material(data.strains, data.energies, data.stresses, density=0.2, options=OPTIONS)
    unseen = sampled(random_states(BOUNDS, 300, seed=8))
    report = validate(material, unseen.strains, unseen.energies)
    assert 0.5 * report.energy_95 < judged.energy_95 < 4 * report.energy_95


def test_fits_disagree_where_the_energy_is_hard(judged: CrossValidation) -> None:
    places = random_states(BOUNDS, 500, seed=9)
    spread = judged.disagreement(places)
    ridge = np.abs(places[:, 0] / REACH[0] - 0.8) < 0.2
    assert spread[ridge].mean() > 2 * spread[~ridge].mean()


@dataclass(frozen=True)
class OneSided:
    """Fits that disagree where s_x > 0.4 alone."""

    def disagreement(self, states: np.ndarray) -> np.ndarray:
        return (states[:, 0] > 0.4).astype(float)


def test_states_are_chosen_where_fits_disagree_and_never_twice() -> None:
    known = axes_planes_and_inside(BOUNDS, 80)
    for _ in range(3):
        more = next_states(OneSided(), BOUNDS, 40, known=known)  # type: ignore[arg-type]
        assert np.array_equal(more, next_states(OneSided(), BOUNDS, 40, known=known))  # type: ignore[arg-type]
        assert np.all(more[:, 0] > 0.4)
        assert np.all((more >= BOUNDS[:, 0]) & (more <= BOUNDS[:, 1]))
        known = np.concatenate([known, more])
    assert len(np.unique(known.round(9), axis=0)) == len(known)


def test_the_scattered_sequence_goes_on_where_it_was_left() -> None:
    whole = scattered(BOUNDS, 40)
    assert np.array_equal(np.concatenate([scattered(BOUNDS, 13), scattered(BOUNDS, 27, skip=13)]), whole)


@pytest.fixture(scope="module")
def cell() -> PeriodicCell:
    return PeriodicCell(library.build("plain"), PRESETS["hylc2020-basket"])


def planned(path: Path, cell: PeriodicCell) -> SampleStore:
    box = StrainRange((-0.02, 0.1), 0.1, 0.01).bounds(cell.pattern.radius)
    return create_store(path, cell, scattered_axes(axes_planes_and_inside(box, 60)), scattered=True)


class Here(Executor):
    """Solves at once, in this process."""

    def submit(self, fn, /, *args, **kwargs):  # type: ignore[no-untyped-def]
        future: Future = Future()
        future.set_result(fn(*args, **kwargs))
        return future


def test_an_interrupted_run_comes_to_the_same_end(
    cell: PeriodicCell, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("yarnscale.homogenize.sample.local_workers", lambda count: nullcontext(Here()))
    rounds = []
    quiet = refine(cell, planned(tmp_path / "quiet", cell), budget=80, workers=1, options=COARSE)
    assert quiet.store.count == 80
    assert quiet.store.status().all()
    assert [entry.states for entry in quiet.rounds] == sorted({entry.states for entry in quiet.rounds})

    store = planned(tmp_path / "store", cell)
    first = store.count

    def stop(progress) -> None:  # type: ignore[no-untyped-def]
        if progress.total > first and progress.done > first + 3:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        refine(cell, store, budget=80, workers=1, options=COARSE, progress=stop)
    store = SampleStore(tmp_path / "store")
    assert first < store.count < 80
    again = refine(cell, store, budget=80, workers=1, options=COARSE, judged=rounds.append)
    np.testing.assert_array_equal(again.store.states, quiet.store.states)
    for index in range(80):
        one, two = (float(s.read(index, "energy_density")) for s in (again.store, quiet.store))
        assert one == pytest.approx(two, rel=1e-9)
    assert tuple(rounds) == again.rounds
    enough = refine(cell, again.store, budget=200, target_error=0.5, workers=1, options=COARSE)
    assert enough.store.count == 80


def test_a_store_grows_whole_or_not_at_all(cell: PeriodicCell, tmp_path: Path) -> None:
    store = planned(tmp_path / "store", cell)
    record = {
        "energy_density": 1.5,
        "stress": np.arange(6.0),
        "moduli": np.eye(6),
        "iterations": 3,
        "seconds": 0.1,
        "residual": 0.0,
    }
    record |= {"min_distance_over_diameter": 1.0, "status": 1}
    vertices = len(cell.pattern.edges)
    record |= {"fluctuation": np.full((vertices, 3), 0.25), "twist": np.zeros(vertices)}
    store.write(4, record)
    more = np.array([[0.05, 0.0, 0.01, 0.0, 0.0]])
    larger = store.extended(more)
    np.testing.assert_array_equal(larger.states, np.concatenate([store.states, more]))
    assert np.flatnonzero(larger.status()).tolist() == [4]
    np.testing.assert_array_equal(larger.read(4, "fluctuation"), record["fluctuation"])
    assert float(larger.dataset()["energy_density"][4]) == 1.5
    assert [path.name for path in tmp_path.iterdir()] == ["store"]
    # Killed after the old store was moved away, and after the new one had come.
    (tmp_path / "store").rename(tmp_path / ".store.before")
    SampleStore.recover(tmp_path / "store")
    assert SampleStore(tmp_path / "store").count == larger.count
    shutil.copytree(tmp_path / "store", tmp_path / ".store.before")
    SampleStore.recover(tmp_path / "store")
    assert [path.name for path in tmp_path.iterdir()] == ["store"]


def test_impossible_goals_are_refused(cell: PeriodicCell, tmp_path: Path) -> None:
    store = planned(tmp_path / "store", cell)
    for goal in ({"budget": 0}, {"budget": 90, "target_error": 1.5}):
        with pytest.raises(InputError, match=r"budget of solves|target of the error"):
            refine(cell, store, **goal)  # type: ignore[arg-type]
    grid = create_store(tmp_path / "grid", cell, StrainGrid().axes, scattered=False)
    with pytest.raises(InputError, match="states cannot be added"):
        grid.extended(np.zeros((1, 5)))
