"""The material that stiffens: closed forms of a strip, contraction of each direction by itself, finite energies."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from yarnscale.errors import InputError
from yarnscale.shell.materials.stiffening import StiffeningMaterial
from yarnscale.swatches.uniaxial import uniaxial

FABRIC = StiffeningMaterial(
    5.0, 30.0, 10.0, 20.0, 4.0, 9.0, 3.0, 1.0, 60.0, 20.0, coupling=40.0, shear=10.0, shear_rate=1.0, bend_weft=2e-6,
    bend_bias=1e-6, bend_warp=1e-6,
)  # fmt: skip


def test_a_strip_stiffens_and_contracts_by_the_numbers_of_its_direction():
    stretch = np.array([0.2, 0.5, 0.8])
    stress, contraction = uniaxial(FABRIC, 0.0, stretch)
    reach, left = (1 - np.exp(-3.0 * stretch)) / 3.0, 20.0 / (40.0 + 20.0)
    # Within the smoothing of the passage from tension to compression, which is 0.005 wide.
    np.testing.assert_allclose(contraction, (1 - left) * reach, rtol=0.02)
    along = 5.0 * stretch + 10.0 / 4.0 * np.expm1(4.0 * stretch) + 40.0 * left * reach * np.exp(-3.0 * stretch)
    np.testing.assert_allclose(stress, along, rtol=0.02)
    # Other numbers of the warp change nothing.
    other = replace(FABRIC, stretch_warp=90.0, rate_warp=2.0, saturation_warp=-1.0, compression_weft=500.0)
    np.testing.assert_allclose(uniaxial(other, 0.0, stretch), (stress, contraction), rtol=0.02)


def test_stress_and_moduli_are_derivatives_and_rest_is_free():
    assert float(FABRIC.energy_density(np.zeros(6))) == pytest.approx(0.0, abs=1e-15)
    np.testing.assert_allclose(FABRIC.stress(np.zeros(6)), 0.0, atol=1e-12)
    strain, step = np.array([0.2, -0.3, -0.1, 20.0, -10.0, 40.0]), np.array([1e-6] * 3 + [1e-3] * 3)
    pairs = strain + np.concatenate([np.diag(step), -np.diag(step)])
    energy, stress = FABRIC.energy_density(pairs), FABRIC.stress(pairs)
    np.testing.assert_allclose(FABRIC.stress(strain), (energy[:6] - energy[6:]) / (2 * step), rtol=1e-6, atol=1e-9)
    slopes = (stress[:6] - stress[6:]) / (2 * step[:, None])
    np.testing.assert_allclose(FABRIC.moduli(strain), slopes, rtol=1e-5, atol=1e-5 * np.abs(slopes).max())


def test_energies_stay_finite_far_away_and_impossible_constants_are_refused():
    assert np.isfinite(FABRIC.energy_density([[1e3, 0.9, 1e3, 0, 0, 0], [-0.999, 0.0, -0.999, 0, 0, 0]])).all()
    for change in ({"rate_weft": 0.0}, {"saturation_warp": 0.0}, {"coupling": -1.0}, {"bend_weft": 1e-4}):
        with pytest.raises(InputError, match=next(iter(change)).split("_")[0]):
            replace(FABRIC, **change)
