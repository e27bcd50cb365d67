"""The fit of three in-plane strains: it says what a sum over pairs cannot, and keeps what that one promises."""

from __future__ import annotations

import numpy as np
import pytest

from yarnscale.homogenize.fit import FitOptions, fit_spline_material, strains_of, validate
from yarnscale.homogenize.plan import StrainRange, axes_planes_and_inside, random_states

BOUNDS = StrainRange().bounds(0.001)
REACH = BOUNDS[:, 1]


def energy(states: np.ndarray) -> np.ndarray:
    """Three in-plane strains act together, also on bending; even in shear."""
    x = states / REACH
    flat = (
        2 * x[:, 0] ** 2 + x[:, 2] ** 2 + x[:, 1] ** 2 + 3 * (np.maximum(x[:, 0], 0) * x[:, 1] * x[:, 2]) ** 2
    )
    along = 0.05 * x[:, 3] ** 2 * (1 + x[:, 0] * x[:, 2] + 0.5 * x[:, 1] ** 2 * x[:, 0])
    along += 0.02 * x[:, 3] * x[:, 0] * x[:, 2]
    across = 0.04 * x[:, 4] ** 2 * (1 + 0.5 * x[:, 0] ** 2 * x[:, 2]) - 0.02 * x[:, 4] * x[:, 2]
    return 0.05 + flat + along + across


def stress(states: np.ndarray) -> np.ndarray:
    result = np.empty_like(states)
    for k in range(5):
        step = np.zeros(5)
        step[k] = 1e-5 * REACH[k]
        result[:, k] = (energy(states + step) - energy(states - step)) / (2 * step[k])
    return result


UNSEEN = random_states(BOUNDS, 200, seed=3)


def fit(in_plane: str, solves: int = 400, **options):
    states = axes_planes_and_inside(BOUNDS, solves)
    options = FitOptions(in_plane=in_plane, **options)  # type: ignore[arg-type]
    return fit_spline_material(states, energy(states), stress(states), density=0.2, options=options)


@pytest.fixture(scope="module")
def full():
    return fit("full", inside_knots=6)


def test_errors_meet_the_target_where_pairs_fail(full):
    report = validate(full, UNSEEN, energy(UNSEEN), stress(UNSEEN))
    assert report.energy_median < 0.005
    assert report.energy_95 < 0.02
    assert np.all(report.stress_median < 0.02)
    assert np.all(report.stress_95 < 0.10)
    pairs = validate(fit("pairwise", floor=False), UNSEEN, energy(UNSEEN), stress(UNSEEN))
    assert pairs.energy_95 > 3 * report.energy_95
    assert pairs.stress_95.max() > 2 * report.stress_95.max()


def test_nothing_is_added_on_axes_and_planes(full):
    pairs = type(full)(full.constant, full.axes, full.planes, full.density)
    states = UNSEEN.copy()
    states[:, 1] = 0.0
    states[:100, 2] = 0.0
    states[100:, 3:] = 0.0
    six = strains_of(states)
    np.testing.assert_allclose(full.energy_density(six), pairs.energy_density(six), rtol=1e-9)


def test_the_energy_is_even_in_shear_smooth_and_bounded_below(full):
    rng = np.random.default_rng(4)
    wide = rng.uniform(1.6 * BOUNDS[:, 0], 1.4 * BOUNDS[:, 1], (20_000, 5))
    wide[:, 3:] *= 4
    wide[np.arange(20_000), rng.integers(3, 5, 20_000)] = 0.0
    six = strains_of(wide)
    found = full.energy_density(six)
    np.testing.assert_allclose(full.energy_density(six * [1, -1, 1, 1, 1, 1]), found, rtol=1e-9)
    assert found.min() > energy(axes_planes_and_inside(BOUNDS, 400)).min() - 0.05
    for k, knots in enumerate(full.inside.knots):
        knots = knots[np.abs(knots) < 0.9]
        at = np.tile([0.3, 0.2, 0.3, 40.0, 10.0, -20.0], (len(knots), 1))
        at[:, k] = knots
        step = 1e-9 * np.eye(6)[k]
        jump = full.moduli(at + step) - full.moduli(at - step)
        assert np.max(np.abs(jump)) < 1e-5 * np.max(np.abs(full.moduli(at)))


@pytest.mark.parametrize("solves", [60, 200, 400])
def test_the_plan_keeps_to_its_budget_and_its_box(solves):
    states = axes_planes_and_inside(BOUNDS, solves)
    assert not states[0].any()
    assert abs(len(states) - solves) <= max(12, 0.05 * solves)
    assert np.all(states >= BOUNDS[:, 0] - 1e-12)
    assert np.all(states <= BOUNDS[:, 1] + 1e-12)
    assert len(np.unique(states.round(9), axis=0)) == len(states)
    bent = np.count_nonzero(states[:, 3:], axis=1)
    assert bent.max() == 1
    inside = np.all(states[:, :3] != 0, axis=1)
    assert 0.35 < np.mean(bent[inside]) < 0.65


def grid(*lines: list[float]) -> np.ndarray:
    return np.stack(np.meshgrid(*lines, indexing="ij"), axis=-1).reshape(-1, 5)


def test_flat_grids_have_no_bending_terms():
    line = [-0.1, 0.0, 0.2, 0.4, 0.6]
    states = grid(line, [-0.5, -0.2, 0.0, 0.2, 0.5], line, [0.0], [0.0])
    options = FitOptions(in_plane="full", floor=False)
    material = fit_spline_material(states, energy(states), stress(states), density=0.2, options=options)
    assert material.inside is not None
    assert not material.inside.nodal[1:].any()
    unseen = UNSEEN * [0.9, 0.9, 0.9, 0.0, 0.0]
    assert validate(material, unseen, energy(unseen)).energy_95 < 0.01


def test_without_states_of_three_strains_the_sum_over_pairs_stays():
    line = [-0.1, 0.0, 0.3, 0.6]
    states = grid(line, [0.0], line, [-80.0, 0.0, 80.0], [0.0])
    options = FitOptions(in_plane="full", floor=False)
    material = fit_spline_material(states, energy(states), stress(states), density=0.2, options=options)
    assert material.inside is None


def coupled(states: np.ndarray) -> np.ndarray:
    """``energy`` and a product of both curvatures that grows with stretch."""
    x = states / REACH
    return energy(states) - 0.08 * (0.3 + x[:, 2] + 0.5 * x[:, 0]) * x[:, 3] * x[:, 4] / (
        1 + 0.25 * (x[:, 3] ** 2 + x[:, 4] ** 2)
    )


def test_the_coupling_of_both_curvatures_follows_from_states_bent_about_one():
    states = axes_planes_and_inside(BOUNDS, 200)
    assert not np.any(states[:, 3] * states[:, 4])
    moments = stress(states)
    for k in (3, 4):
        step = 1e-5 * REACH[k] * np.eye(5)[k]
        moments[:, k] = (coupled(states + step) - coupled(states - step)) / (2 * step[k])
    options = FitOptions(in_plane="full", inside_knots=6)
    ours = fit_spline_material(states, coupled(states), moments, density=0.2, options=options)
    rng = np.random.default_rng(9)
    twice = rng.uniform(0.1, 0.8, (200, 5)) * REACH * np.where(rng.uniform(size=(200, 5)) < 0.5, -1, 1)
    twice[:, :3] = np.abs(twice[:, :3])
    gained = coupled(twice) - energy(twice)
    assert np.max(np.abs(gained)) > 0.02
    six = strains_of(twice)
    assert ours.inside is not None
    plain = type(ours)(
        ours.constant, ours.axes, ours.planes, ours.density, inside=ours.inside.without_coupling()
    )
    found = ours.energy_density(six) - plain.energy_density(six)
    np.testing.assert_allclose(found, gained, atol=0.05 * np.abs(gained).max())
