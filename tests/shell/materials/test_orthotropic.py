"""The orthotropic material: EST22 eq. 1 in numbers, bending by direction, derivatives."""

from __future__ import annotations

import numpy as np
import pytest

from yarnscale.errors import InputError
from yarnscale.shell.materials.orthotropic import OrthotropicMaterial

FABRIC = OrthotropicMaterial(
    40.0, 9.0, 25.0, 6.0, 1.5, 0.3, bend_weft=4e-6, bend_bias=3e-6, bend_warp=2e-6, density=0.18
)


def curved(curvature: float, angle: float) -> np.ndarray:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([0, 0, 0, *(curvature * np.array([c * c, c * s, s * s]))])


def test_membrane_energy_is_equation_1():
    deformation = np.array([[1.2, 0.15], [-0.05, 0.9]])
    first = deformation.T @ deformation
    a, b = np.sqrt(first[0, 0]), np.sqrt(first[1, 1])
    strain = [a - 1, first[0, 1] / (a * b), b - 1, 0.0, 0.0, 0.0]
    e = 0.5 * (first - np.eye(2))
    epsilon = np.array([e[0, 0], e[1, 1], 2 * e[0, 1]])
    stiffness = np.array([[40.0, 9.0, 0], [9.0, 25.0, 0], [0, 0, 6.0]])
    area = np.linalg.det(deformation)
    expected = 0.5 * epsilon @ stiffness @ epsilon + 1.5 * (area - 1) ** 2 + 0.3 * np.log(area) ** 2
    assert float(FABRIC.energy_density(strain)) == pytest.approx(expected, rel=1e-12)


def test_rest_is_free_of_energy_and_stress():
    assert float(FABRIC.energy_density(np.zeros(6))) == 0
    np.testing.assert_allclose(FABRIC.stress(np.zeros(6)), 0, atol=1e-14)


@pytest.mark.parametrize(("angle", "stiffness"), [(0, 4e-6), (45, 3e-6), (90, 2e-6), (135, 3e-6)])
def test_cylinders_feel_the_stiffness_of_their_direction(angle, stiffness):
    energy = FABRIC.energy_density(curved(50.0, np.radians(angle)))
    assert float(energy) == pytest.approx(stiffness * 2500, rel=1e-12)


def test_equal_stiffnesses_are_isotropic():
    fabric = OrthotropicMaterial(1.0, 0.0, 1.0, 1.0, bend_weft=2e-6, bend_bias=2e-6, bend_warp=2e-6)
    energies = fabric.energy_density([curved(30.0, angle) for angle in np.linspace(0, np.pi, 19)])
    np.testing.assert_allclose(energies, 2e-6 * 900, rtol=1e-12)


@pytest.mark.parametrize("bias", [0.75e-6, 1e-6, 2.5e-6, 9e-6])
def test_bending_is_never_negative(bias):
    fabric = OrthotropicMaterial(1.0, 0.0, 1.0, 1.0, bend_weft=4e-6, bend_bias=bias, bend_warp=1e-6)
    curvatures = np.random.default_rng(0).normal(size=(500, 3)) * 100
    strains = np.hstack([np.zeros((500, 3)), curvatures])
    assert np.all(fabric.energy_density(strains) >= -1e-15)


def test_stress_and_moduli_are_derivatives():
    strain, step = np.array([0.2, -0.3, 0.1, 20.0, -10.0, 40.0]), np.array([1e-5] * 3 + [1e-3] * 3)
    pairs = strain + np.concatenate([np.diag(step), -np.diag(step)])
    energy, stress = FABRIC.energy_density(pairs), FABRIC.stress(pairs)
    np.testing.assert_allclose(FABRIC.stress(strain), (energy[:6] - energy[6:]) / (2 * step), rtol=1e-6)
    moduli = (stress[:6] - stress[6:]) / (2 * step[:, None])
    np.testing.assert_allclose(FABRIC.moduli(strain), moduli, rtol=1e-6, atol=1e-10)


@pytest.mark.parametrize(
    ("change", "word"),
    [
        ({"stretch_weft": -1.0}, "stretch_weft"),
        ({"shear": float("nan")}, "shear"),
        ({"stretch_coupling": 40.0}, "stretch_coupling"),
        ({"bend_bias": 0.0, "bend_weft": 1e-6}, "bend_bias"),
        ({"density": 0.0}, "density"),
    ],
)
def test_constants_that_make_no_material_are_refused(change, word):
    constants = {"stretch_weft": 40.0, "stretch_coupling": 9.0, "stretch_warp": 25.0, "shear": 6.0} | change
    with pytest.raises(InputError, match=word):
        OrthotropicMaterial(**constants)
