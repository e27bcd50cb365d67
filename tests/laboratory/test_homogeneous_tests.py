"""Virtual tests of homogeneous fabric against closed forms."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import pytest

import yarnscale as ys
from yarnscale.homogeneous.fabrics import MaterialFabric, Response
from yarnscale.laboratory import homogeneous_tests as tests


@dataclass(frozen=True, eq=False)
class Quadratic:
    """Ψ = ½ (z − rest)ᵀ C (z − rest): everything has a closed form."""

    matrix: np.ndarray
    rest: np.ndarray

    @property
    def strain_scale(self) -> np.ndarray:
        return np.array([0.5] * 3 + [100.0] * 3)

    def response(self, strain, start=None):
        gap = strain - self.rest
        return Response(np.array(strain), 0.5 * gap @ self.matrix @ gap, self.matrix @ gap)

    def moduli(self, response):
        return self.matrix


def curling() -> Quadratic:
    random = np.random.default_rng(3)
    scale = np.array([0.5] * 3 + [100.0] * 3)
    root = random.normal(size=(6, 6)) * 0.3 + np.eye(6)
    return Quadratic((root @ root.T) / np.outer(scale, scale), np.array([0.02, 0.0, -0.01, 40.0, 0.0, -60.0]))


def orthotropic(**changes: float) -> MaterialFabric:
    constants = {"stretch_weft": 100.0, "stretch_coupling": 20.0, "stretch_warp": 60.0, "shear": 15.0}
    bends = {"bend_weft": 1e-5, "bend_bias": 1.2e-5, "bend_warp": 0.8e-5}
    return MaterialFabric(ys.OrthotropicMaterial(**(constants | bends | changes)))


@pytest.mark.parametrize(("direction", "modulus"), [(0.0, 100 - 20**2 / 60), (90.0, 60 - 20**2 / 100)])
def test_small_loads_stretch_by_the_modulus(direction, modulus):
    point = tests.tension(orthotropic(), direction, [0.02])[0]
    assert point.status == "converged"
    assert point.stretch == pytest.approx(0.02 / modulus, rel=2e-3)


def test_contraction_is_the_ratio_of_stiffnesses_at_small_loads():
    point = tests.tension(orthotropic(), 0.0, [0.05])[0]
    assert point.contraction / point.stretch == pytest.approx(20 / 60, rel=5e-3)


def test_isotropic_fabric_is_the_same_in_every_direction():
    isotropic = {"stretch_weft": 80.0, "stretch_warp": 80.0, "stretch_coupling": 24.0, "shear": 28.0}
    fabric = orthotropic(**isotropic)
    loads = (0.5, 5.0, 40.0)
    course = tests.tension(fabric, 0.0, loads)
    for direction in (30.0, 45.0, 90.0, 171.0):
        for a, b in zip(course, tests.tension(fabric, direction, loads), strict=True):
            assert a.status == b.status == "converged"
            # The loads are met to a thousandth.
            assert b.stretch == pytest.approx(a.stretch, rel=3e-3)
            assert b.contraction == pytest.approx(a.contraction, rel=3e-3)


def test_work_of_the_load_is_the_energy():
    loads = np.geomspace(0.01, 50, 60)
    points = tests.tension(orthotropic(), 30.0, loads)
    stretch = np.array([0.0, *(p.stretch for p in points)])
    work = np.trapezoid([0.0, *loads], stretch)
    assert points[-1].energy == pytest.approx(work, rel=5e-3)


def test_equal_loads_stretch_less_than_one_alone():
    both = tests.biaxial(orthotropic(), (1.0, 1.0), [5.0])[0]
    alone = tests.tension(orthotropic(), 0.0, [5.0])[0]
    assert both.status == "converged"
    assert 0 < both.stretch_course < alone.stretch


def test_shear_force_is_the_shear_modulus():
    point = tests.shear(orthotropic(), [0.5])[0]
    # ψ = ½ k_ss (2 E12)², and 2 E12 = s_a = sin γ to first order.
    assert point.force == pytest.approx(15.0 * math.radians(0.5), rel=2e-3)


def test_tension_stiffens_shear():
    slack, taut = (tests.shear(orthotropic(), [5.0], load=load)[0].force for load in (0.0, tests.SHEAR_TENSION))
    assert taut > slack
    assert pytest.approx(9.80665) == tests.SHEAR_TENSION  # 10 gf/cm


@pytest.mark.parametrize(("direction", "stiffness"), [(0.0, 1e-5), (45.0, 1.2e-5), (90.0, 0.8e-5)])
def test_moment_of_a_cylinder(direction, stiffness):
    points = tests.bending(orthotropic(), direction, [-60.0, -5.0, 0.0, 20.0])
    assert [p.curvature for p in points] == [-60.0, -5.0, 0.0, 20.0]
    for p in points:
        assert p.moment == pytest.approx(2 * stiffness * p.curvature, abs=1e-9)


def test_rolls_of_a_quadratic_energy():
    fabric = curling()
    for direction, component in ((0.0, 3), (90.0, 5)):
        free = [0, 1, 2, component]
        load = fabric.matrix @ fabric.rest
        expected = np.linalg.solve(fabric.matrix[np.ix_(free, free)], load[free])[3]
        roll = tests.natural_curvature(fabric, direction)
        assert roll.status == "converged"
        assert roll.curvature == pytest.approx(expected, rel=1e-3)
        assert roll.saved > 0
        assert roll.side == ("face" if expected > 0 else "back")


def test_a_load_that_is_not_met_gives_no_number():
    fabric = curling()
    soft = Quadratic(np.diag([1e-6] * 6), fabric.rest)
    point = tests.tension(soft, 0.0, [50.0])[0]
    assert point.status != "converged"
    assert math.isnan(point.stretch)


@pytest.mark.parametrize("loads", [[], [0.0], [1.0, 0.5], [1.0, math.nan], [-1.0]])
def test_loads_that_make_no_test_are_refused(loads):
    with pytest.raises(ys.InputError, match="loads"):
        tests.tension(orthotropic(), 0.0, loads)


def test_directions_and_ratios_that_are_no_numbers_are_refused():
    with pytest.raises(ys.InputError, match="direction"):
        tests.tension(orthotropic(), math.nan, [1.0])
    with pytest.raises(ys.InputError, match="ratio"):
        tests.biaxial(orthotropic(), (0.0, 0.0), [1.0])
