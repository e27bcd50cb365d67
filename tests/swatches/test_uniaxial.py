"""Uniform uniaxial stretch (EST22 eq. 3) against linear theory, the minimum itself and finite differences."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from yarnscale.shell.materials.orthotropic import OrthotropicMaterial
from yarnscale.swatches.measurements import Direction
from yarnscale.swatches.uniaxial import biaxial_sensitivity, biaxial_stress, uniaxial, uniaxial_sensitivity

FABRIC = OrthotropicMaterial(60.0, 20.0, 100.0, 25.0, area=10.0, log_area=5.0)


def test_small_stretch_is_orthotropic_hooke():
    area = 2 * (10.0 + 5.0)  # (J − 1)² and ln² J are both (E11 + E22)² at first
    kxx, kxy, kyy = 60.0 + area, 20.0 + area, 100.0 + area
    stress, contraction = uniaxial(FABRIC, 0.0, np.array([1e-5]))
    assert stress[0] / 1e-5 == pytest.approx(kxx - kxy**2 / kyy, rel=1e-3)
    assert contraction[0] / 1e-5 == pytest.approx(kxy / kyy, rel=1e-3)
    stress, contraction = uniaxial(FABRIC, np.pi / 2, np.array([1e-5]))
    assert stress[0] / 1e-5 == pytest.approx(kyy - kxy**2 / kxx, rel=1e-3)


@pytest.mark.parametrize("direction", Direction)
def test_contraction_is_the_minimum_and_stress_the_slope(direction):
    stretch = np.linspace(0.02, 1.5, 9)
    stress, contraction = uniaxial(FABRIC, direction.angle, stretch)
    u, v = (
        np.array([np.cos(direction.angle), np.sin(direction.angle)]),
        np.array([-np.sin(direction.angle), np.cos(direction.angle)]),
    )

    def energy(s: float, c: float) -> float:
        deformation = (1 + s) * np.outer(u, u) + (1 - c) * np.outer(v, v)
        first = deformation.T @ deformation
        a, b = np.sqrt(first[0, 0]), np.sqrt(first[1, 1])
        return float(FABRIC.energy_density([a - 1, first[0, 1] / (a * b), b - 1, 0, 0, 0]))

    for s, c, sigma in zip(stretch, contraction, stress, strict=True):
        least = energy(s, c)
        assert all(energy(s, other) > least for other in np.linspace(-0.5, 0.95, 59) if abs(other - c) > 1e-3)
        assert (energy(s + 1e-5, c) - energy(s - 1e-5, c)) / 2e-5 == pytest.approx(sigma, rel=1e-6)


@pytest.mark.parametrize("direction", Direction)
def test_sensitivities_are_finite_differences(direction):
    stretch, names = np.array([0.05, 0.3]), ("stretch_weft", "stretch_coupling", "shear", "area", "log_area")
    _, _, by_stress, by_contraction = uniaxial_sensitivity(FABRIC, direction.angle, stretch, names)
    for k, name in enumerate(names):
        step = 1e-4 * getattr(FABRIC, name)
        above = uniaxial(replace(FABRIC, **{name: getattr(FABRIC, name) + step}), direction.angle, stretch)
        below = uniaxial(replace(FABRIC, **{name: getattr(FABRIC, name) - step}), direction.angle, stretch)
        np.testing.assert_allclose(by_stress[:, k], (above[0] - below[0]) / (2 * step), rtol=1e-5, atol=1e-9)
        np.testing.assert_allclose(by_contraction[:, k], (above[1] - below[1]) / (2 * step), rtol=1e-5, atol=1e-9)


def test_biaxial_stress_is_the_slope_and_its_sensitivities_are_finite_differences():
    stretch, names = (
        np.array([[0.05, 0.3], [0.2, -0.05]]),
        ("stretch_weft", "stretch_coupling", "area", "log_area"),
    )
    along = uniaxial(FABRIC, 0.0, np.array([0.2]))
    alone = biaxial_stress(FABRIC, np.array([[0.2, -float(along[1][0])]]))
    np.testing.assert_allclose(alone, [[along[0][0], 0.0]], atol=1e-9)
    slopes = biaxial_sensitivity(FABRIC, stretch, names)
    for k, name in enumerate(names):
        step = 1e-4 * getattr(FABRIC, name)
        above, below = (
            biaxial_stress(replace(FABRIC, **{name: getattr(FABRIC, name) + s}), stretch) for s in (step, -step)
        )
        np.testing.assert_allclose(slopes[..., k], (above - below) / (2 * step), rtol=1e-6, atol=1e-9)
