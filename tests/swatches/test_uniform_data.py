"""Uniform data: weights and errors as EST22 §7.3.1 defines them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from yarnscale.errors import InputError
from yarnscale.shell.materials.orthotropic import JERSEY
from yarnscale.swatches.cloth_check import ClothCheck, without_own_clamps
from yarnscale.swatches.measurements import Direction
from yarnscale.swatches.swatch import StretchResponse
from yarnscale.swatches.uniaxial import uniaxial
from yarnscale.swatches.uniform_data import UniformCurve, UniformData

STRETCH = np.linspace(0.1, 1.0, 10)
SOFT = UniformCurve(Direction.WEFT, STRETCH, 0.3 * STRETCH, 20 * STRETCH * (1 + STRETCH), 0.5)
STIFF = UniformCurve(Direction.WARP, STRETCH, 0.2 * STRETCH, 40 * STRETCH * (1 + STRETCH), 0.3, False)
DATA = UniformData("fabric", (SOFT, STIFF))


def test_weights_are_one_in_comfort_and_fall_beyond():
    np.testing.assert_allclose(SOFT.second_stress, 20 * STRETCH)
    np.testing.assert_allclose(SOFT.stress_decay, np.minimum(1.0, 0.5 / STRETCH))
    np.testing.assert_allclose(SOFT.contraction_decay, np.minimum(1.0, 0.5 / STRETCH))
    assert not STIFF.contraction_decay.any()  # not measured


def test_errors_are_over_the_largest_target_in_comfort():
    assert DATA.stress_scale == pytest.approx(12.0)  # 40 · 0.3 against 20 · 0.5
    assert DATA.contraction_scale == pytest.approx(0.15)
    errors = DATA.errors(
        [SOFT.stress + 1.2 * (1 + STRETCH), STIFF.stress], [SOFT.contraction + 0.015, STIFF.contraction + 9.0]
    )
    assert errors.full == pytest.approx(0.1 / 2)
    assert errors.comfort == pytest.approx(0.1 * 5 / 8)
    assert errors.compression == pytest.approx(0.1)


def test_contractions_that_were_not_measured_are_no_scale():
    wide = replace(STIFF, contraction=9.0 * STRETCH)
    assert UniformData("fabric", (SOFT, wide)).contraction_scale == DATA.contraction_scale
    constant = replace(SOFT, contraction=0.0 * STRETCH)
    errors = UniformData("fabric", (constant,)).errors([SOFT.stress], [0.01 + constant.contraction])
    assert errors.compression == pytest.approx(10.0)


def test_directions_can_be_held_out():
    assert DATA.only(Direction.WARP).curves == (STIFF,)
    with pytest.raises(InputError, match="directions"):
        DATA.only(Direction.BIAS)


def test_clamps_are_taken_out_as_the_cloth_feels_them():
    """Clamps make force larger by 30 and 10 %, contraction smaller by a tenth and by half; one state is lost."""
    width, responses = 0.05, []
    converged = STRETCH[4] != STRETCH
    for curve, force, across in ((SOFT, 1.3, 0.9), (STIFF, 1.1, 0.5)):
        stress, contraction = uniaxial(JERSEY, curve.direction.angle, STRETCH)
        force = np.where(converged, force * width * stress, 77.0)
        responses.append(StretchResponse(width, STRETCH, force, across * contraction, converged, np.zeros((10, 1, 3))))
    free = replace(STIFF, contraction_measured=True)
    measured = UniformData("", (SOFT, free))
    found = without_own_clamps(ClothCheck(JERSEY, measured, tuple(responses)), measured).curves
    np.testing.assert_allclose(found[0].stress, SOFT.stress / 1.3)
    np.testing.assert_allclose(found[1].stress, STIFF.stress / 1.1)
    np.testing.assert_allclose(found[0].contraction, SOFT.contraction / 0.9)
    np.testing.assert_allclose(found[1].contraction, STIFF.contraction)
    assert (found[0].contraction_weight, found[1].contraction_weight) == (1.0, 0.1)
    np.testing.assert_allclose(found[1].contraction_decay, 0.1 * free.contraction_decay)
