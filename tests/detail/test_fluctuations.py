"""The table of sampled fluctuations: what is exact, what stands in for what is missing, what it refuses."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from yarnscale.cell import PeriodicCell
from yarnscale.detail.fluctuations import FluctuationTable, ScatteredFluctuations, bracket, detail_grid, fluctuation
from yarnscale.errors import InputError
from yarnscale.homogenize.plan import StrainGrid, scattered_axes
from yarnscale.homogenize.rays import ray_to
from yarnscale.homogenize.sample import create_ray_store, create_store
from yarnscale.homogenize.store import SampleStore
from yarnscale.homogenize.worker import CODE_OF, solve


def at(table: FluctuationTable, states: np.ndarray, vertices: np.ndarray) -> np.ndarray:
    """û of vertices (k,) at states (k, 5), as yarns on a cloth get it."""
    found = np.empty((len(vertices), 3))
    for state, vertex, out in zip(np.array(states), vertices, found, strict=True):
        fluctuation(table.values, table.axes, state, vertex, out)
    return found


def test_sampled_states_are_exact(table: FluctuationTable, store: SampleStore) -> None:
    vertices = np.arange(len(table.pattern.vertices))
    for number in np.flatnonzero(store.status() == CODE_OF["converged"]):
        states = np.broadcast_to(store.states[number], (len(vertices), 5))
        found = at(table, states, vertices)
        np.testing.assert_allclose(found, store.read(number, "fluctuation"), atol=1e-15)
    assert table.replaced == 0


def test_between_samples_it_is_linear_and_outside_it_stays(table: FluctuationTable) -> None:
    vertices = np.zeros(3, np.int64)
    low, high = np.array([0.05, 0.0, 0.1, 0.0, 0.0]), np.array([0.2, 0.0, 0.1, 0.0, 0.0])
    found = at(table, np.stack([low, high, 0.25 * low + 0.75 * high]), vertices)
    np.testing.assert_allclose(found[2], 0.25 * found[0] + 0.75 * found[1], atol=1e-15)
    outside = at(table, np.array([[-0.9, 0.9, 5.0, 1e4, -1e4], [0.05, 0.15, 0.25, 40.0, -40.0]]), vertices[:2])
    np.testing.assert_array_equal(outside[0], outside[1])


def test_bending_about_both_axes_adds_up(table: FluctuationTable) -> None:
    flat = np.array([0.2, 0.0, 0.25, 0.0, 0.0])
    along_x, along_y = np.array([0.2, 0.0, 0.25, 40.0, 0.0]), np.array([0.2, 0.0, 0.25, 0.0, -40.0])
    found = at(table, np.stack([flat, along_x, along_y, along_x + along_y - flat]), np.full(4, 3))
    np.testing.assert_allclose(found[3], found[1] + found[2] - found[0], atol=1e-15)


def test_the_nearest_state_stands_in_for_one_that_failed(
    store: SampleStore, cell: PeriodicCell, tmp_path: Path
) -> None:
    shutil.copytree(store.path, tmp_path / "copy")
    copy = SampleStore(tmp_path / "copy")
    flat = np.flatnonzero((copy.states == [0.2, 0.15, 0.25, 0.0, 0.0]).all(axis=1))[0]
    bent = np.flatnonzero((copy.states == [0.05, 0.0, 0.1, 40.0, 0.0]).all(axis=1))[0]
    for number in (flat, bent):
        result, _ = solve(cell, copy.states[number], None)
        lost = np.full_like(copy.read(number, "fluctuation"), np.nan)
        copy.write(number, {**result, "fluctuation": lost, "status": CODE_OF["passages"]})
    table = FluctuationTable.from_store(copy, cell.pattern)
    # The failed flat state takes its two bent ones with it: they count from it.
    assert table.replaced == 4 and np.isfinite(table.values).all()
    vertices = np.arange(3)
    found = at(table, np.broadcast_to(copy.states[flat], (3, 5)), vertices)
    neighbours = np.flatnonzero((np.abs(copy.states - copy.states[flat]) > 0).sum(axis=1) == 1)
    flats = [n for n in neighbours if (copy.states[n, 3:] == 0).all()]
    assert any(np.allclose(found, copy.read(n, "fluctuation")[:3], atol=1e-15) for n in flats)


def test_what_makes_no_table_is_refused(store: SampleStore, cell: PeriodicCell, tmp_path: Path) -> None:
    other = replace(cell.pattern, radius=1.01 * cell.pattern.radius)
    with pytest.raises(InputError, match="samples of another pattern"):
        FluctuationTable.from_store(store, other)
    states = scattered_axes(np.zeros((2, 5)))
    scattered = create_store(tmp_path / "scattered", cell, states, scattered=True)
    with pytest.raises(InputError, match="a converged state"):
        FluctuationTable.from_store(scattered, cell.pattern)
    bent = create_store(tmp_path / "bent", cell, StrainGrid(lambda_x=(10.0,)).axes, scattered=False)
    with pytest.raises(InputError, match="flat states"):
        FluctuationTable.from_store(bent, cell.pattern)
    empty = create_store(tmp_path / "empty", cell, StrainGrid().axes, scattered=False)
    with pytest.raises(InputError, match="a converged flat state"):
        FluctuationTable.from_store(empty, cell.pattern)


@pytest.mark.parametrize("kind", ["strains", "rays"])
def test_scattered_states_are_interpolated_between(cell: PeriodicCell, tmp_path: Path, kind: str) -> None:
    """û that is linear in all strains comes back exactly, also from states that bend twice and twist."""
    rng, count = np.random.default_rng(5), len(cell.pattern.edges)
    radius = cell.pattern.radius
    slope = radius * rng.normal(size=(count, 3, 6)) * ([1.0] * 3 + [radius] * 3)
    if kind == "strains":
        strains = rng.uniform(-0.1, 0.4, (40, 5)) * [1, 1, 1, 100, 100]
        store = create_store(tmp_path / kind, cell, scattered_axes(strains), scattered=True)
        strains = np.insert(strains, 4, 0.0, axis=1)
    else:
        strains = rng.uniform(-0.1, 0.4, (40, 6)) * [1, 1, 1, 100, 100, 100]
        store = create_ray_store(tmp_path / kind, cell, [ray_to(strain, parts=1) for strain in strains])
    numbers = np.arange(store.count).reshape(len(strains), -1)[:, 0]
    names = ("energy_density", "iterations", "seconds", "residual", "min_distance_over_diameter")
    for number, strain in zip(numbers.tolist(), strains, strict=True):
        found = {"fluctuation": slope @ strain, "twist": np.zeros(count), "strain": strain}
        rest = {"stress": np.zeros(6), "moduli": np.eye(6), "status": CODE_OF["converged"]}
        store.write(number, dict.fromkeys(names, 0.0) | found | rest)
    table = FluctuationTable.from_store(store, cell.pattern)
    state = np.array([0.05, 0.1, 0.2, 10.0, 0.0])
    found = at(table, np.repeat(state[None], count, axis=0), np.arange(count))
    np.testing.assert_allclose(found, slope @ np.insert(state, 4, 0.0), atol=1e-4 * radius)
    # Out of range the ends of the range stand in.
    far = at(table, np.full((1, 5), [9.0, 0.0, 0.0, 0.0, 0.0]), np.zeros(1, np.int64))
    end = at(table, np.array([[strains[:, 0].max(), 0.0, 0.0, 0.0, 0.0]]), np.zeros(1, np.int64))
    np.testing.assert_array_equal(far, end)
    stored = ScatteredFluctuations.of(store, radius)
    assert stored.error_on(store).shape == (0, count)  # its own states say nothing
    fewer = replace(stored, states=np.delete(stored.states, 20, 0), values=np.delete(stored.values, 20, 0))
    errors = fewer.error_on(store)
    assert len(errors) <= 1 and errors.max(initial=0.0) < 1e-9 * radius


def test_the_default_grid_scales_with_the_yarn(cell: PeriodicCell) -> None:
    grid = detail_grid(cell)
    assert 0.0 in grid.s_x and 0.0 in grid.s_a and 0.0 in grid.lambda_x
    assert max(grid.lambda_y) * cell.pattern.radius == pytest.approx(0.08)


def test_no_number_lies_in_an_interval_of_the_axis() -> None:
    place, share = bracket(np.array([0.0, 1.0, 3.0]), np.nan)
    assert 0 <= place <= 1 and np.isnan(share)
