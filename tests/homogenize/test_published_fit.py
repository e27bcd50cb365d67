"""The published form: recovery of known energies, symmetry, curl, straight continuation, reference data."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest

from yarnscale.errors import InputError
from yarnscale.homogenize.published_fit import PublishedOptions, fit_spline_material, strains_of
from yarnscale.shell.materials.spline_patches import PLANES

REACH = np.array([0.6, 0.5, 0.6, 80.0, 80.0])
CURL = 0.3  # of the range: where the λ_x term is lowest


def energy(states: np.ndarray) -> np.ndarray:
    """A known energy of the form of eq. 31: unequal axes, curl, couplings of several shapes."""
    x = states / REACH
    axes = 2 * x[:, 0] ** 2 * np.exp(0.5 * x[:, 0]) + 0.7 * x[:, 1] ** 2 * (1 + x[:, 1] ** 2) + 1.5 * x[:, 2] ** 2
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


def energy_errors(material, states: np.ndarray, values: np.ndarray, valid=slice(None)) -> tuple[float, float]:
    """Median and 95th percentile of the error of the energy over the largest energy above rest."""
    error = np.abs(material.energy_density(strains_of(states)) - values)[valid]
    rest = float(material.energy_density(np.zeros(6)))
    error /= np.abs(values[valid] - rest).max()
    return float(np.median(error)), float(np.percentile(error, 95))


SAMPLES = axes_and_planes()


@pytest.fixture(scope="module")
def fitted():
    return fit_spline_material(SAMPLES, energy(SAMPLES), stress(SAMPLES), density=0.2)


def test_a_known_energy_is_recovered_from_few_samples(fitted):
    median, high = energy_errors(fitted, unseen(), energy(unseen()))
    assert median < 1e-4
    assert high < 3e-4
    found, expected = fitted.stress(strains_of(unseen()))[:, [0, 1, 2, 3, 5]], stress(unseen())
    assert np.all(np.percentile(np.abs(found - expected), 95, axis=0) < 5e-3 * np.abs(expected).max(axis=0))


def test_energies_alone_do_almost_as_well():
    material = fit_spline_material(SAMPLES, energy(SAMPLES), density=0.2)
    median, high = energy_errors(material, unseen(), energy(unseen()))
    assert median < 2e-3
    assert high < 1e-2


def test_without_pairs_the_axes_are_the_same_and_nothing_else_is_there(fitted):
    alone = fit_spline_material(
        SAMPLES,
        energy(SAMPLES),
        stress(SAMPLES),
        density=0.2,
        options=PublishedOptions(pairs=False),
    )
    assert not alone.planes
    on_axes = np.diag(REACH) * 0.7
    np.testing.assert_allclose(
        alone.energy_density(strains_of(on_axes)), fitted.energy_density(strains_of(on_axes)), rtol=1e-9
    )


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
    options = PublishedOptions(symmetric_shear=False)
    free = fit_spline_material(SAMPLES, skewed, density=0.2, options=options)
    expected = 0.1 * states[:, 1] / REACH[1]
    difference = free.energy_density(states) - free.energy_density(mirrored)
    np.testing.assert_allclose(difference, expected, atol=5e-3)


def test_half_of_the_shears_are_enough_for_a_symmetric_fit():
    states = SAMPLES[SAMPLES[:, 1] >= 0]
    half = fit_spline_material(states, energy(states), stress(states), density=0.2)
    assert energy_errors(half, unseen(), energy(unseen()))[1] < 1e-3
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


def test_terms_go_on_along_straight_lines(fitted):
    for k in range(3, 5):
        direction = np.zeros((3, 5))
        direction[:, k] = np.array([1.5, 2.0, 2.5]) * REACH[k]
        first, second = np.diff(fitted.energy_density(strains_of(direction)))
        assert first == pytest.approx(second, rel=1e-9)
        assert first > 0


def test_states_without_energy_or_slope_do_not_count():
    rng = np.random.default_rng(6)
    bad = rng.uniform(size=len(SAMPLES)) < 0.1
    bad[np.all(SAMPLES == 0, axis=1)] = False
    # The ends stay, since beyond the samples the published form goes on straight and this energy does not.
    bad[(np.abs(SAMPLES) > 0.999 * REACH).any(axis=1)] = False
    gradients = stress(SAMPLES)
    gradients[::5, 2] = np.nan
    material = fit_spline_material(SAMPLES, np.where(bad, np.nan, energy(SAMPLES)), gradients, density=0.2)
    assert energy_errors(material, unseen(), energy(unseen()))[1] < 2e-3


def test_strains_without_samples_have_no_terms():
    states = SAMPLES[np.all(SAMPLES[:, 1:] == 0, axis=1)]
    material = fit_spline_material(states, energy(states), stress(states), density=0.2)
    assert not material.planes
    values = material.energy_density([[0.1, 0, 0, 0, 0, 0], [0.1, 0.3, -0.2, 50, 20, 10]])
    assert values[0] == pytest.approx(values[1], rel=1e-12)


def test_plane_terms_do_not_fall_outward_but_for_the_contraction_across_a_pull(fitted):
    """With noise that makes wells, all sums of terms on a plane are lowest in one place (Fig. 11)."""
    noise = np.random.default_rng(4).normal(size=len(SAMPLES)) * 0.05 * np.abs(energy(SAMPLES) - 0.05)
    noisy = energy(SAMPLES) + noise
    material = fit_spline_material(SAMPLES, noisy, density=0.2, options=PublishedOptions(smoothing=0.3))
    for (i, j), term in material.planes.items():
        total = term.values + material.axes[i](term.knots_u)[:, None] + material.axes[j](term.knots_v)
        inner = total[1:-1, 1:-1]
        around = [total[1 + a : -1 + a or None, 1 + b : -1 + b or None] for a, b in product((-1, 0, 1), repeat=2)]
        off_axes = (term.knots_u[1:-1, None] != 0) & (term.knots_v[1:-1] != 0)
        wells = (inner < np.min([a for k, a in enumerate(around) if k != 4], axis=0) - 1e-12) & off_axes
        assert (i, j) == (0, 2) or np.count_nonzero(wells) <= 1


def test_more_smoothing_evens_out_noise():
    states = np.zeros((121, 5))
    states[:, 0] = np.linspace(-1, 1, 121) * REACH[0]
    noisy = energy(states) + np.random.default_rng(5).normal(size=121) * 0.1
    weak, strong = (
        fit_spline_material(states, noisy, density=0.2, options=PublishedOptions(smoothing=width))
        for width in (0.25, 8.0)
    )
    errors = [np.std(m.energy_density(strains_of(states)) - energy(states)) for m in (weak, strong)]
    assert errors[1] < 0.6 * errors[0]


def test_what_was_done_is_in_the_provenance(fitted):
    record = fitted.provenance["fit"]
    assert record["states"] == len(SAMPLES)
    assert record["options"]["smoothing"] == PublishedOptions().smoothing


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
    train = (acting <= 2) & ~held & usable
    material = fit_spline_material(states[train], values[train], density=0.3)
    median, high = energy_errors(material, states[held], values[held])
    three = energy_errors(material, states[acting == 3], values[acting == 3], usable[acting == 3])
    assert median < 2e-3
    assert high < 2.5e-2
    assert three[0] < 1e-2
