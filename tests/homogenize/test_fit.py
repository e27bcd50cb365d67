"""The fit: recovery of known energies, symmetry, curl, growth, a floor under false wells, reference data."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest

from yarnscale.errors import InputError
from yarnscale.homogenize.fit import FitOptions, fit_spline_material, strains_of, validate
from yarnscale.shell.materials.spline_patches import PLANES

REACH = np.array([0.6, 0.5, 0.6, 80.0, 80.0])
CURL = 0.3  # of the range: where the λ_x term is lowest


def energy(states: np.ndarray) -> np.ndarray:
    """A known energy of the form of eq. 31: unequal axes, curl, couplings of several shapes."""
    x = states / REACH
    axes = (
        2 * x[:, 0] ** 2 * np.exp(0.5 * x[:, 0])
        + 0.7 * x[:, 1] ** 2 * (1 + x[:, 1] ** 2)
        + 1.5 * x[:, 2] ** 2
    )
    bending = 0.02 * (x[:, 3] ** 2 - 2 * CURL * x[:, 3]) + 0.03 * (x[:, 4] ** 2 + 0.5 * x[:, 4])
    couplings = 0.8 * x[:, 0] * x[:, 2] + 0.1 * np.sin(x[:, 0]) * x[:, 1] ** 2
    couplings += 0.004 * x[:, 0] * x[:, 3] + 0.003 * np.tanh(x[:, 2]) * x[:, 4] * (1 + x[:, 4])
    return 0.05 + axes + bending + couplings


def stress(states: np.ndarray) -> np.ndarray:
    result = np.empty_like(states)
    for k in range(5):
        step = np.zeros(5)
        step[k] = 1e-5 * REACH[k]
        result[:, k] = (energy(states + step) - energy(states - step)) / (2 * step[k])
    return result


def axes_and_planes(count: int = 7, reach: np.ndarray = REACH) -> np.ndarray:
    line = np.linspace(-1, 1, count)
    states = [np.zeros((1, 5))]
    for k in range(5):
        axis = np.zeros((count, 5))
        axis[:, k] = line * reach[k]
        states.append(axis)
    for i, j in PLANES:
        plane = np.zeros((count**2, 5))
        plane[:, [i, j]] = np.array(list(product(line, line))) * reach[[i, j]]
        states.append(plane)
    return np.unique(np.concatenate(states).round(12), axis=0)


def unseen(count: int = 400) -> np.ndarray:
    return np.random.default_rng(1).uniform(-1, 1, (count, 5)) * REACH


SAMPLES = axes_and_planes()
SMOOTH = FitOptions(smoothing=1e-6)


@pytest.fixture(scope="module")
def fitted():
    return fit_spline_material(SAMPLES, energy(SAMPLES), stress(SAMPLES), density=0.2, options=SMOOTH)


def test_a_known_energy_is_recovered_from_few_samples(fitted):
    report = validate(fitted, unseen(), energy(unseen()), stress(unseen()))
    assert report.energy_median < 1e-4
    assert report.energy_95 < 3e-4
    assert np.all(report.stress_median < 1e-3)
    assert np.all(report.stress_95 < 5e-3)


def test_energies_alone_do_almost_as_well():
    material = fit_spline_material(SAMPLES, energy(SAMPLES), density=0.2, options=SMOOTH)
    report = validate(material, unseen(), energy(unseen()), stress(unseen()))
    assert report.energy_median < 2e-3
    assert report.energy_95 < 1e-2


def test_two_dimensional_terms_vanish_on_their_axes(fitted):
    for (i, j), term in fitted.planes.items():
        u, v = np.linspace(-1.5, 1.5, 31) * REACH[i], np.linspace(-1.5, 1.5, 31) * REACH[j]
        size = np.max(np.abs(term.values)) + 1e-12
        assert np.max(np.abs(term(u, 0.0))) < 1e-9 * size + 1e-15
        assert np.max(np.abs(term(0.0, v))) < 1e-9 * size + 1e-15
    assert all(abs(float(axis(0.0))) < 1e-15 for axis in fitted.axes)


def test_shear_is_symmetric_only_if_asked_for():
    skewed = energy(SAMPLES) + 0.05 * SAMPLES[:, 1] / REACH[1]
    states = strains_of(unseen())
    mirrored = states * [1, -1, 1, 1, 1, 1]
    even = fit_spline_material(SAMPLES, skewed, density=0.2)
    np.testing.assert_allclose(even.energy_density(states), even.energy_density(mirrored), rtol=1e-10)
    options = FitOptions(symmetric_shear=False)
    free = fit_spline_material(SAMPLES, skewed, density=0.2, options=options)
    expected = 0.1 * states[:, 1] / REACH[1]
    difference = free.energy_density(states) - free.energy_density(mirrored)
    np.testing.assert_allclose(difference, expected, atol=5e-3)


def test_half_of_the_shears_are_enough_for_a_symmetric_fit():
    states = SAMPLES[SAMPLES[:, 1] >= 0]
    half = fit_spline_material(states, energy(states), stress(states), density=0.2, options=SMOOTH)
    assert validate(half, unseen(), energy(unseen())).energy_95 < 1e-3
    assert half.range[1, 0] == -half.range[1, 1]


def test_the_minimum_of_a_curling_fabric_stays_off_center(fitted):
    curvature = np.linspace(-80, 80, 641)
    states = np.zeros((641, 5))
    states[:, 3] = curvature
    lowest = curvature[np.argmin(fitted.energy_density(strains_of(states)))]
    assert lowest == pytest.approx(CURL * 80, abs=0.5)


def test_one_dimensional_terms_fall_and_then_rise_even_through_noise():
    noise = np.random.default_rng(3).normal(size=len(SAMPLES)) * 0.03 * np.abs(energy(SAMPLES) - 0.05)
    material = fit_spline_material(SAMPLES, energy(SAMPLES) + noise, density=0.2)
    for axis, reach in zip(material.axes, REACH, strict=True):
        slope = np.sign(np.diff(axis(np.linspace(-2, 2, 500) * reach)).round(12))
        changes = np.diff(slope[slope != 0])
        assert np.count_nonzero(changes) <= 1
        assert np.all(changes >= 0)


def test_energy_grows_outside_the_samples_and_never_falls_below_them(fitted):
    rng = np.random.default_rng(4)
    wide = rng.uniform(-1.6, 1.6, (20_000, 5)) * REACH
    wide[:, 3:] *= 5
    # Eq. 32 adds the two bending families: doubly bent, the energy may lie as deep as both gain together.
    twice = fitted.energy_density(strains_of(wide))
    assert np.all(np.isfinite(twice))
    assert twice.min() > -0.05
    wide[np.arange(20_000), rng.integers(3, 5, 20_000)] = 0.0
    assert fitted.energy_density(strains_of(wide)).min() > energy(SAMPLES).min() - 1e-3
    for k in range(5):
        direction = np.zeros((3, 5))
        direction[:, k] = np.array([1.0, 1.3, 1.6]) * REACH[k]
        for sign in (-1, 1):
            assert np.all(np.diff(fitted.energy_density(strains_of(sign * direction))) > 0)


def three_way(states: np.ndarray) -> np.ndarray:
    """Like HYLC20's max(x², y², z²), of which pairwise terms give less than nothing where all three are large."""
    x = states / REACH
    squares = np.sort(x[:, :3] ** 2, axis=1)
    softer_pairs = 0.35 * np.sqrt(squares[:, 1] * squares[:, 2])
    return 0.01 + squares[:, 2] - softer_pairs + 0.05 * np.sum(x[:, 3:] ** 2, axis=1)


def test_false_wells_are_lifted():
    states = axes_and_planes(9)
    values = three_way(states)
    assert values.min() == 0.01
    sweep = strains_of(np.random.default_rng(5).uniform(-1.3, 1.3, (20_000, 5)) * REACH)
    free = fit_spline_material(states, values, density=0.2, options=FitOptions(floor=False))
    lifted = fit_spline_material(states, values, density=0.2)
    assert free.energy_density(sweep).min() < -0.3
    assert lifted.energy_density(sweep).min() > 0.01 - 5e-3
    record = lifted.provenance["fit"]["floor"]
    assert record["states_held"] > 0
    report = validate(lifted, states, values)
    assert report.energy_median < 0.01


def test_invalid_states_do_not_count():
    rng = np.random.default_rng(6)
    bad = rng.uniform(size=len(SAMPLES)) < 0.1
    bad[np.all(SAMPLES == 0, axis=1)] = False
    spoiled = np.where(bad, 1e6, energy(SAMPLES))
    spoiled[np.flatnonzero(bad)[0]] = np.nan
    gradients = stress(SAMPLES)
    gradients[::5, 2] = np.nan
    masked = fit_spline_material(SAMPLES, spoiled, gradients, density=0.2, valid=~bad, options=SMOOTH)
    weighted = fit_spline_material(
        SAMPLES, spoiled, gradients, density=0.2, weights=1.0 - bad, options=SMOOTH
    )
    for material in (masked, weighted):
        assert validate(material, unseen(), energy(unseen())).energy_95 < 2e-3


def test_strains_without_samples_have_no_terms():
    states = SAMPLES[np.all(SAMPLES[:, 1:] == 0, axis=1)]
    material = fit_spline_material(states, energy(states), stress(states), density=0.2)
    assert not material.planes
    values = material.energy_density([[0.1, 0, 0, 0, 0, 0], [0.1, 0.3, -0.2, 50, 20, 10]])
    assert values[0] == pytest.approx(values[1], rel=1e-12)


def test_states_of_more_strains_are_used_lightly():
    more = np.concatenate([SAMPLES, unseen(60)])
    material = fit_spline_material(more, energy(more), density=0.2)
    assert validate(material, unseen(), energy(unseen())).energy_95 < 2e-2


def test_what_was_done_is_in_the_provenance(fitted):
    record = fitted.provenance["fit"]
    assert record["states"] == len(SAMPLES)
    assert record["options"]["smoothing"] == 1e-6


@pytest.mark.parametrize(
    ("arguments", "word"),
    [
        ((SAMPLES[:, :4], energy(SAMPLES)), "strains"),
        ((SAMPLES, energy(SAMPLES)[1:]), "energies"),
        ((SAMPLES, energy(SAMPLES), SAMPLES[:, :3]), "stresses"),
        ((SAMPLES, energy(SAMPLES) * np.nan), "valid state"),
        (
            (SAMPLES[np.any(SAMPLES != 0, axis=1)], energy(SAMPLES)[np.any(SAMPLES != 0, axis=1)]),
            "undeformed",
        ),
    ],
)
def test_unusable_arrays_are_refused(arguments, word):
    with pytest.raises(InputError, match=word):
        fit_spline_material(*arguments, density=0.2)


def reference_samples(folder, name: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """In-plane states, energies, and which of them are near an equilibrium (rest always is)."""
    table = np.load(folder / "reference" / f"{name}.npz")
    values = sum(table[f"oracle_E{part}"] for part in "sbtc").ravel()
    grid = np.meshgrid(*(table[f"axes_{axis}"] for axis in ("sx", "sa", "sy")), indexing="ij")
    states = np.zeros((values.size, 5))
    states[:, :3] = np.stack([axis.ravel() for axis in grid], axis=1)
    usable = table["valid"].ravel() & (table["oracle_residual"].ravel() < 0.05)
    return states, values, usable | np.all(states == 0, axis=1)


@pytest.mark.parametrize("name", ["stockinette", "satin"])
def test_held_out_states_of_reference_planes(shared, name):
    states, values, usable = reference_samples(shared, name)
    acting = np.count_nonzero(states, axis=1)
    held = (acting == 2) & (np.random.default_rng(0).uniform(size=len(states)) < 0.2) & usable
    train = (acting <= 2) & ~held
    material = fit_spline_material(states[train], values[train], density=0.3, valid=usable[train])
    report = validate(material, states[held], values[held])
    three = validate(material, states[acting == 3], values[acting == 3], valid=usable[acting == 3])
    print(f"\n{name}: held out {report.energy_median:.1e}, 95 % {report.energy_95:.1e}")
    print(f"{name}: three strains {three.energy_median:.1e}, 95 % {three.energy_95:.1e}")
    assert report.energy_median < 2e-3
    assert report.energy_95 < 2.5e-2
    assert three.energy_median < 1e-2
