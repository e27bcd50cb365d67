"""The fit of a compact energy: derivatives by its numbers, recovery of a known energy, symmetry, errors."""

from __future__ import annotations

import warnings

import numpy as np
import pytest

from yarnscale.errors import InputError
from yarnscale.homogenize import compact_problem
from yarnscale.homogenize.compact_fit import (
    CompactOptions,
    StressErrors,
    fit_compact_material,
)
from yarnscale.homogenize.compact_problem import STAGES, Problem, Samples
from yarnscale.homogenize.spring_jacobian import Directional, sizes_of, springs_of, unknowns_of
from yarnscale.kinematics import strain_units
from yarnscale.shell.materials.compact import MIRROR, CompactMaterial, SpringNetwork

FEW = CompactOptions(steps=2, springs=5)
RADIUS = 1e-3
SCALE = strain_units(RADIUS)


def known(*, skewed: bool = False) -> CompactMaterial:
    """A fabric that is soft at rest and a thousand times stiffer where pulled along a valley."""
    directions = np.array(
        [[3.0, 0, 1.2, 0, 0, 0], [0.8, 0, 3.0, 0, 0, 0], [-1.0, 0, -1.0, 0, 0, 0],
         [0, 2.0, 0, 0, 0.5, 0], [0, -2.0, 0, 0, -0.5, 0], [0.5, 0, 0, 1.5, 0, 0.5], [0, 0, 0.5, -1.0, 0, 1.5]]
    )  # fmt: skip
    thresholds = np.array([-2.5, -2.0, -1.0, -0.5, -0.5, -0.3, -0.4])
    if skewed:
        directions[2, 1], thresholds[2] = 1.0, 1.0
    none = np.zeros((0, 6)), np.zeros(0)
    springs = SpringNetwork(
        *none, directions, np.zeros((7, 0)), thresholds,
        np.array([5.0, 8.0, 0.3, 0.2, 0.2, 0.01, 0.02]), np.full(6, 0.005), *none, np.zeros(0),
    )  # fmt: skip
    return CompactMaterial(0.03, SCALE, springs, density=0.2, mirrored=not skewed)


def states(count: int, seed: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    x = rng.normal(size=(count, 6))
    x *= (np.geomspace(0.03, 1.0, count) / np.linalg.norm(x, axis=1))[:, None]
    x[0] = 0.0
    return np.clip(x * SCALE, [-0.8, -0.9, -0.8, -400, -400, -400], None)


SHORT = {"rounds": 3, "iterations": 4}
"""Options of a fit that need not find the energy again."""


def fitted(material: CompactMaterial, **options: int) -> CompactMaterial:
    z = states(200, 0)
    settings = {"steps": 2, "springs": 14, "rounds": 15, "iterations": 20, "starts": 1} | options
    return fit_compact_material(
        z, material.energy_density(z), material.stress(z), material.moduli(z), density=0.2, radius=RADIUS,
        options=CompactOptions(**settings),
    )  # fmt: skip


def test_a_fabric_without_any_stress_has_no_springs():
    """Least squares may leave no spring in a round; the next one draws all of them at random."""
    z, options = states(60, 0), CompactOptions(steps=1, springs=4, rounds=3, iterations=2)
    none = np.zeros(60), np.zeros((60, 6)), np.zeros((60, 6, 6))
    found = fit_compact_material(z, *none, density=0.2, radius=RADIUS, options=options)
    assert np.abs(found.stress(z) * SCALE).max() < 1e-4


@pytest.fixture(scope="module")
def found() -> CompactMaterial:
    return fitted(known())


def test_derivatives_by_the_numbers_are_those_of_differences():
    rng = np.random.default_rng(0)
    unknowns = 0.7 * rng.normal(size=sum(sizes_of(3, 4)))
    directions = np.linalg.qr(rng.normal(size=(5, 6, 6)))[0].transpose(1, 2, 0)
    place = Directional(0.5 * rng.normal(size=(6, 5)), directions, mirrored=True)
    springs, adjoint = springs_of(unknowns, 3, 4)[0], rng.normal(size=(13, 5))
    exact = place.jacobian(springs)
    np.testing.assert_allclose(place.pulled_back(springs, adjoint), np.einsum("nou,on->u", exact, adjoint), rtol=1e-9)
    for k, step in enumerate(1e-6 * np.eye(len(unknowns))):
        up, down = (place.values(*springs_of(unknowns + s * step, 3, 4)) for s in (1, -1))
        np.testing.assert_allclose(exact[:, :, k].T, (up - down) / 2e-6, atol=2e-7)
    np.testing.assert_allclose(unknowns_of(*springs_of(unknowns, 3, 4)), unknowns, atol=1e-12)


def test_outputs_are_those_of_the_material():
    material, z = known(), states(20, 3)
    along = np.repeat(np.eye(6)[:, :, None], 20, axis=2)
    values = Directional((z / SCALE).T, along, mirrored=True).values(material.springs, material.constant)
    np.testing.assert_allclose(values[0], material.energy_density(z), rtol=1e-12)
    np.testing.assert_allclose(values[1:7].T, material.stress(z) * SCALE, rtol=1e-10, atol=1e-12)
    diagonal = np.einsum("nii->ni", material.moduli(z)) * SCALE**2
    np.testing.assert_allclose(values[7:].T, diagonal, rtol=1e-9, atol=1e-10)


def test_a_known_energy_is_recovered_relative_to_each_states_size(found):
    material, z = known(), states(300, 5)
    errors = StressErrors.of(found.stress(z), material.stress(z), SCALE)
    assert errors.median < 0.05
    assert errors.high < 0.3
    least = [np.linalg.eigvalsh(m.moduli(np.zeros(6)) * SCALE[:, None] * SCALE)[0] for m in (found, material)]
    assert least[0] == pytest.approx(least[1], rel=0.2)
    assert found.provenance["fit"]["errors"]["states"] == 200
    assert found.outside(np.zeros(6)) == 0.0
    assert found.outside(np.array([3.0, 0, 0, 0, 0, 0])) > 1.0


def test_it_is_stiffer_outside_than_at_the_border(found):
    for k, sign in ((0, 1), (2, 1), (3, 1), (5, -1)):
        line = np.zeros((3, 6))
        line[:, k] = sign * np.array([1.5, 3.0, 4.5]) * SCALE[k]
        modulus = found.moduli(line)[:, k, k]
        assert np.all(np.diff(modulus) > 0)


def test_mirror_images_count_only_where_the_fabric_is_one(found):
    assert found.mirrored
    skewed = fitted(known(skewed=True), **SHORT)
    assert not skewed.mirrored
    z = states(50, 8)
    assert not np.allclose(skewed.energy_density(z * MIRROR), skewed.energy_density(z), rtol=1e-3)


def test_the_same_samples_and_seed_give_the_same_material():
    first, second = (fitted(known(), **SHORT).energy_density(states(20, 9)) for _ in range(2))
    np.testing.assert_allclose(first, second, rtol=1e-6)


def test_sums_do_not_depend_on_threads_and_steps_that_are_too_long_are_silent(monkeypatch):
    material, z, rng = known(), states(40, 2), np.random.default_rng(3)
    arrays = material.energy_density(z), material.stress(z), material.moduli(z)
    problem = Problem(Samples.of(z / SCALE, arrays[0], arrays[1] * SCALE, arrays[2], None, SCALE), True, FEW)
    unknowns = rng.normal(size=sum(sizes_of(FEW.steps, FEW.springs)))
    weights, sums = problem.weights(0.1), []
    for threads in (1, 2, 3):
        monkeypatch.setattr(compact_problem, "available_threads", lambda threads=threads: threads)
        residuals = problem._residuals(unknowns, weights)
        sums.append([f(unknowns, weights, residuals) for f in (problem._slope, problem._normal)])
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            assert problem._loss(problem._residuals(800.0 * unknowns, weights)) == np.inf
    for other in sums[1:]:
        for one, same in zip(sums[0], other, strict=True):
            np.testing.assert_array_equal(one, same)


def test_a_fabric_that_shears_as_it_bends_is_not_its_mirror_image():
    """As a twill; the stress of its states in tension does not show it."""
    material, z = known(), states(200, 0)
    z[1::2, [1, 4]] *= 1e-3
    moduli = material.moduli(z)
    share = 0.12 * np.sqrt(np.abs(moduli[:, 1, 1] * moduli[:, 3, 3]))
    moduli[:, 1, 3] += share
    moduli[:, 3, 1] += share
    few = CompactOptions(steps=1, springs=5, rounds=2, iterations=0)
    args = material.energy_density(z), material.stress(z)
    assert fit_compact_material(z, *args, material.moduli(z), density=0.2, radius=RADIUS, options=few).mirrored
    assert not fit_compact_material(z, *args, moduli, density=0.2, radius=RADIUS, options=few).mirrored


def test_a_buckled_state_of_rest_does_not_make_a_fabric_skewed():
    material, z = known(), states(200, 0)
    moduli = material.moduli(z)
    moduli[0, 0, 1] = moduli[0, 1, 0] = 0.5 * np.sqrt(moduli[0, 0, 0] * moduli[0, 1, 1])
    few = CompactOptions(steps=1, springs=5, rounds=2, iterations=0)
    found = fit_compact_material(
        z, material.energy_density(z), material.stress(z), moduli, density=0.2, radius=RADIUS, options=few
    )
    assert found.mirrored


@pytest.mark.parametrize(
    "option",
    [{"springs": 0}, {"steps": -1}, {"rounds": 1.5}, {"tolerance": 0.0}, {"modulus_weight": float("nan")}],
)
def test_options_out_of_range_are_refused(option):
    with pytest.raises(InputError, match=next(iter(option))):
        CompactOptions(**option)


@pytest.mark.parametrize(
    ("arguments", "word"),
    [
        ((np.zeros((40, 5)), np.zeros(40), np.zeros((40, 6))), "strains"),
        ((np.zeros((40, 6)), np.zeros(39), np.zeros((40, 6))), "energies"),
        ((np.zeros((9, 6)), np.zeros(9), np.zeros((9, 6))), "at least 10"),
        ((np.zeros((40, 6)), np.zeros(40), np.full((40, 6), np.nan)), "at least 10"),
    ],
)
def test_unusable_arrays_are_refused(arguments, word):
    with pytest.raises(InputError, match=word):
        fit_compact_material(*arguments, density=0.2, radius=RADIUS)


def test_a_stage_that_ends_in_failed_steps_leaves_the_next_ones_theirs(monkeypatch):
    """Each stage starts with little damping; the record of the fit says how many steps each took."""
    descend, seen = Problem._descend, []

    def failing_first(self, unknowns, weights, damping, steps):
        seen.append((float(weights[0, 0]), damping))
        if weights[0, 0] == seen[0][0]:
            return unknowns, 0, 0.0
        return descend(self, unknowns, weights, damping, steps)

    monkeypatch.setattr(Problem, "_descend", failing_first)
    found = fitted(known(), rounds=SHORT["rounds"])
    done = found.provenance["fit"]["iterations"]
    assert len(done) == len(STAGES) and done[0] == 0 and done[-1] > 0
    first = {weight: damping for weight, damping in reversed(seen)}
    assert max(damping for weight, damping in seen if weight == seen[0][0]) > 1e-2
    assert all(damping <= 1e-2 for damping in first.values())
