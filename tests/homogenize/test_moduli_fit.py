"""Moduli of samples in the fit: what a fit says of them, twisting included, and what they are worth between samples."""

from __future__ import annotations

import numpy as np
import pytest

from yarnscale.cell import PeriodicCell
from yarnscale.errors import InputError
from yarnscale.homogenize.fit import FitOptions, fit_spline_material, strains_of
from yarnscale.homogenize.moduli_fit import by_twist, whitening
from yarnscale.homogenize.plan import StrainRange, axes_planes_and_inside, scattered_axes
from yarnscale.homogenize.sample import create_store, sample
from yarnscale.homogenize.states import SampledStates
from yarnscale.yarn.library import STRUCTURES
from yarnscale.yarn.material import YarnMaterial

BOUNDS = StrainRange().bounds(0.001)
SCALES = np.array([1e-4, 1e-4, 1e-4, 1e-2, 1e-2, 1e-2])


def moduli_of(gradient, states: np.ndarray) -> np.ndarray:
    """Central differences of a gradient (n, 6) -> (n, 6) at states (n, 6)."""
    found = np.empty((len(states), 6, 6))
    for k, step in enumerate(SCALES):
        away = step * np.eye(6)[k]
        found[:, :, k] = (gradient(states + away) - gradient(states - away)) / (2 * step)
    return found


def tense(z: np.ndarray) -> np.ndarray:
    """Gradient of an energy like a knit's: stiff along s_x + s_y once it is taut, soft across; it bends and twists."""
    taut = z[:, 0] + z[:, 2]
    force = 30 * (taut + np.sqrt(taut**2 + 0.1**2))
    force0 = 30 * 0.1
    result = np.stack([force - force0 + z[:, 0], 2 * z[:, 1], force - force0 + z[:, 2]], axis=1)
    bend, twist, across = 1e-4, 7e-5, -3e-5
    moments = [
        bend * z[:, 3] + across * z[:, 5],
        2 * twist * z[:, 4],
        bend * z[:, 5] + across * z[:, 3],
    ]
    return np.concatenate([result, np.stack(moments, axis=1)], axis=1)


def energy(z: np.ndarray) -> np.ndarray:
    """∫ of ``tense`` along a straight line from rest, by Gauss's rule."""
    places, shares = np.polynomial.legendre.leggauss(24)
    total = sum(w * np.sum(tense(0.5 * (p + 1) * z) * z, axis=1) for p, w in zip(places, shares, strict=True))
    return np.asarray(0.01 + 0.5 * total)


def fitted(*, moduli: bool):
    states = axes_planes_and_inside(BOUNDS, 150)
    six = strains_of(states)
    return fit_spline_material(
        states,
        energy(six),
        tense(six)[:, [0, 1, 2, 3, 5]],
        density=0.2,
        moduli=moduli_of(tense, six) if moduli else None,
        options=FitOptions(in_plane="full", inside_knots=6, floor=False),
    )


@pytest.fixture(scope="module")
def with_moduli():
    return fitted(moduli=True)


def test_the_modulus_at_rest_is_that_of_the_samples(with_moduli):
    seen = moduli_of(tense, np.zeros((1, 6)))[0]
    found = moduli_of(with_moduli.stress, np.zeros((1, 6)))[0]
    size = np.sqrt(np.outer(np.diag(seen), np.diag(seen)))
    assert np.abs((found - seen) / size).max() < 0.1
    assert np.linalg.eigvalsh(found / size).min() > 0


def test_moduli_keep_the_soft_direction_of_a_taut_fabric_positive(with_moduli):
    """Its modulus is a hundredth of the stiff one's: energies and stresses alone leave its sign open."""
    rng = np.random.default_rng(2)
    states = rng.uniform(0.7 * BOUNDS[:, 0], 0.7 * BOUNDS[:, 1], (200, 5))
    states[:, [0, 2]] = np.abs(states[:, [0, 2]])
    states[np.arange(200), 3 + np.arange(200) % 2] = 0.0
    lowest = []
    for material in (with_moduli, fitted(moduli=False)):
        moduli = moduli_of(material.stress, strains_of(states))
        lowest.append(np.percentile(np.linalg.eigvalsh(moduli[:, :3, :3])[:, 0], 5))
    assert lowest[0] > -0.25
    assert lowest[1] < -0.5


def test_twisting_is_the_second_derivative_of_a_matrix_function():
    def function(x: np.ndarray, order: int) -> np.ndarray:
        return np.exp(x) if order else np.exp(x) - 1.0

    states = np.zeros((4, 5))
    states[:, 3:] = [[0.7, -0.4], [0.0, 0.6], [0.5, 0.0], [0.3, 0.3]]
    for family in range(2):
        found = by_twist(states, family, lambda z, order, f=family: function(z[:, 3 + f], order))
        for z, value in zip(states, found, strict=True):
            entries = []
            for b in (-1e-4, 0.0, 1e-4):
                values, vectors = np.linalg.eigh([[z[3], b], [b, z[4]]])
                entries.append((vectors * np.expm1(values)) @ vectors.T)
            second = (entries[0] - 2 * entries[1] + entries[2])[family, family] / 1e-8
            assert value == pytest.approx(second, rel=1e-5)


def test_whitening_turns_moduli_into_signs():
    rng = np.random.default_rng(3)
    root = rng.normal(size=(5, 6, 6))
    moduli = root @ root.transpose(0, 2, 1)
    white = whitening(moduli, [0, 1, 2])
    turned = white @ moduli[:, :3, :3] @ white.transpose(0, 2, 1)
    values = np.linalg.eigvalsh(turned)
    assert np.all((values > 0) & (values < 1.0 + 1e-9))
    assert np.median(values) > 0.9


def test_a_store_keeps_moduli_and_they_are_derivatives_of_stress(tmp_path):
    structure = STRUCTURES["plain"]
    cell = PeriodicCell(structure.build(), YarnMaterial.preset(structure.material))
    step = 2e-4
    states = np.zeros((3, 5))
    states[1:, 0] = [step, -step]
    store = create_store(tmp_path / "store", cell, scattered_axes(states), scattered=True, moduli=True)
    sample(cell, store, workers=1)
    found = SampledStates.of(store)
    assert found.converged.all()
    slope = (found.stresses[1] - found.stresses[2]) / (2 * step)
    np.testing.assert_allclose(found.moduli[0][0, [0, 1, 2]], slope[:3], rtol=0.02, atol=0.02 * abs(slope[0]))


def test_moduli_of_another_shape_are_refused():
    states = axes_planes_and_inside(BOUNDS, 40)
    six = strains_of(states)
    with pytest.raises(InputError, match="moduli"):
        fit_spline_material(states, energy(six), density=0.2, moduli=np.zeros((len(states), 5, 5)))
