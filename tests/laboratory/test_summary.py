"""Numbers of KES, FAST and ASTM D1388, and the shadow of a drape, against what they are by definition."""

from __future__ import annotations

import math

import numpy as np
import pytest

from yarnscale.laboratory import drape
from yarnscale.laboratory.cantilever import bending_length
from yarnscale.laboratory.homogeneous_tests import BendingPoint, ShearPoint, TensionPoint
from yarnscale.laboratory.summary import bending_summary, shear_summary, tensile_summary


def pull(load: float, stretch: float, status: str = "converged") -> TensionPoint:
    return TensionPoint(0.0, load, stretch, 0.0, 0.0, status)


def test_a_linear_fabric_has_linearity_one():
    points = [pull(load, load / 500.0) for load in (1.0, 4.903325, 10.0, 20.0, 100.0)]
    summary = tensile_summary(points)
    assert pytest.approx(1.0) == summary.LT
    assert pytest.approx(0.5 * 100 * 0.2) == summary.WT
    assert pytest.approx(100 * 4.903325 / 500) == summary.E5
    assert pytest.approx(100 * 98.0665 / 500) == summary.E100
    assert summary.RT is None


def test_extensions_beyond_the_loads_are_not_known():
    summary = tensile_summary([pull(1.0, 0.01), pull(10.0, 0.1), pull(50.0, math.nan, "stalled")])
    assert summary.largest_load == 10.0
    assert summary.E20 is None
    assert pytest.approx(100 * (0.01 + 0.09 * 3.903325 / 9)) == summary.E5


@pytest.mark.parametrize("stiffness", [1e-6, 2e-5])
def test_bending_length_is_the_cube_root_of_rigidity_over_weight(stiffness):
    kappa = np.linspace(-100, 100, 5)
    length = bending_length(kappa, stiffness * kappa, 0.15)
    assert length == pytest.approx((stiffness / (0.15 * 9.81)) ** (1 / 3), rel=0.01)


def test_a_strip_that_curls_has_no_bending_length():
    kappa = np.linspace(-100, 100, 9)
    assert bending_length(kappa, 1e-6 * (kappa**3 / 3000 - kappa), 0.15) is None


def test_rigidity_is_the_mean_of_both_sides():
    points = [
        BendingPoint(0.0, k, (2e-6 if k > 0 else 1e-6) * k, "converged") for k in (-150.0, -50.0, 0.0, 50.0, 150.0)
    ]
    summary = bending_summary(points, 0.2)
    assert pytest.approx(1.5e-6) == summary.B


def test_shear_numbers():
    points = [ShearPoint(angle, 9.80665, 0.3 * angle, 0.0, 0.0, "converged") for angle in (0.5, 1.0, 2.5)]
    bias = [pull(1.0, 0.02), pull(10.0, 0.2)]
    summary = shear_summary(points, bias)
    assert pytest.approx(0.3) == summary.G
    assert summary.fast_G == pytest.approx(123 / (100 * 0.02 * 4.903325))
    assert summary.hysteresis is None
    # Cycles measure one side, then the other.
    both = points + [ShearPoint(-p.angle, p.tension, -p.force, 0.0, 0.0, "converged") for p in points]
    assert pytest.approx(0.3) == shear_summary(both, bias).G


@pytest.mark.parametrize("waves", [4, 7])
def test_folds_are_counted(waves):
    angle = np.radians(np.arange(360) + 0.5)
    noise = 2e-4 * np.random.default_rng(1).normal(size=360)
    assert drape.folds(0.12 + 0.01 * np.cos(waves * angle) + noise) == waves
    assert drape.folds(0.12 + noise) == 0


def test_drape_coefficient_is_zero_at_the_disc_and_one_where_nothing_falls():
    assert drape.drape_coefficient(np.full(360, drape.SPECIMEN)) == pytest.approx(1.0)
    assert drape.drape_coefficient(np.full(360, drape.DISC)) == pytest.approx(0.0)


def test_outline_of_a_flat_specimen_is_its_rim():
    scene = drape.cusick(_soft(), spacing=0.03)
    shadow = drape.outline(scene.start.positions, scene.cloth.mesh.edges)
    assert shadow.max() == pytest.approx(drape.SPECIMEN, rel=1e-6)
    # Five edges a sector: the polygon is inside the circle by 1 − cos(π/30).
    assert shadow.min() > drape.SPECIMEN * 0.99


def _soft():
    import yarnscale as ys

    return ys.OrthotropicMaterial(100.0, 20.0, 60.0, 15.0, bend_weft=1e-6, bend_bias=1e-6, bend_warp=1e-6)


def test_stiff_cloth_drapes_less_than_limp_cloth():
    import yarnscale as ys

    found = []
    for bend in (3e-4, 4e-6):
        material = ys.OrthotropicMaterial(
            100.0, 20.0, 100.0, 30.0, bend_weft=bend, bend_bias=bend, bend_warp=bend, density=0.15
        )
        found.append(drape.drape_test(material, spacing=0.02))
    stiff, limp = found
    assert stiff.result.converged and limp.result.converged
    assert stiff.coefficient > 0.9
    assert limp.coefficient < 0.6
