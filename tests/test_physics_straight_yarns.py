"""Straight parallel yarns have closed forms: EA/p in stretch, EI/p in bending, GJ/p in twist, nothing across."""

from __future__ import annotations

import numpy as np
import pytest

from yarnscale.cell import PeriodicCell
from yarnscale.drawing.curves import PeriodicCurve, pattern_from_curves
from yarnscale.kinematics import ShellStrain
from yarnscale.yarn.material import YarnMaterial
from yarnscale.yarn.pattern import YarnPattern

RADIUS = 1e-3
SPACING = 4e-3
YARN = YarnMaterial(5e6, 2e6, 0.7, 60.0, 1000.0)
TENSION = YARN.stretch_stiffness(RADIUS) / SPACING
BENDING = YARN.bending_stiffness(RADIUS) / SPACING
TWISTING = YARN.twist_stiffness(RADIUS) / SPACING


def parallel_yarns(
    axis: int, *, vertices: int = 8, yarns: int = 1, height: float = 0.0, edge: float = RADIUS
) -> YarnPattern:
    """Yarns along x (axis 0) or y (axis 1), ``SPACING`` apart, so far that they never touch."""
    period = np.array([SPACING * yarns] * 2)
    period[axis] = vertices * edge
    curves = []
    for k in range(yarns):
        points = np.zeros((vertices, 3))
        points[:, axis] = edge * np.arange(vertices) + 3e-4
        points[:, 1 - axis] = SPACING * k + 1e-4
        points[:, 2] = height
        curves.append(PeriodicCurve(points, (1, 0) if axis == 0 else (0, 1)))
    return pattern_from_curves(curves, period, RADIUS)


def cell(axis: int, **options) -> PeriodicCell:  # type: ignore[no-untyped-def]
    return PeriodicCell(parallel_yarns(axis, **options), YARN).with_options(tolerance=1e-7)


def strain(axis: int, along: float = 0.0, across: float = 0.0, **other: float) -> ShellStrain:
    first, second = ("s_x", "s_y") if axis == 0 else ("s_y", "s_x")
    return ShellStrain(**{first: along, second: across}, **other)


AXES = pytest.mark.parametrize("axis", [0, 1], ids=["along x", "along y"])


@AXES
@pytest.mark.parametrize("stretch", [-0.02, 1e-4, 0.01, 0.3])
def test_stretch_along_the_yarns(axis: int, stretch: float) -> None:
    state = cell(axis).relax(strain(axis, stretch))
    assert state.converged and state.contacts == 0
    assert state.energy_density == pytest.approx(0.5 * TENSION * stretch**2, rel=1e-6)
    expected = np.zeros(6)
    expected[2 * axis] = TENSION * stretch
    np.testing.assert_allclose(state.stress, expected, rtol=1e-6, atol=1e-6 * TENSION * abs(stretch))


@AXES
def test_stretch_across_and_shear_cost_nothing(axis: int) -> None:
    state = cell(axis, yarns=2).relax(strain(axis, 0.0, 0.2, s_a=0.3))
    assert state.converged
    assert abs(state.energy_density) < 1e-9 * TENSION


@AXES
@pytest.mark.parametrize("curvature", [-5.0, 0.5, 10.0])
def test_bending_along_the_yarns(axis: int, curvature: float) -> None:
    """EI/p; the polygon's chords differ from the arc by (κ l)²/24."""
    component = "II11" if axis == 0 else "II22"
    state = cell(axis).relax(ShellStrain(**{component: curvature}))
    assert state.converged
    assert state.energy_density == pytest.approx(0.5 * BENDING * curvature**2, rel=1e-3)
    expected = np.zeros(6)
    expected[3 if axis == 0 else 5] = BENDING * curvature
    np.testing.assert_allclose(state.stress[3:], expected[3:], rtol=1e-3, atol=1e-3 * BENDING * abs(curvature))


@AXES
def test_bending_across_the_yarns_costs_nothing(axis: int) -> None:
    component = "II22" if axis == 0 else "II11"
    state = cell(axis, yarns=2).relax(ShellStrain(**{component: 20.0}))
    assert state.converged
    assert abs(state.energy_density) < 1e-6 * 0.5 * BENDING * 20.0**2


@AXES
def test_bending_converges_with_the_square_of_the_edge_length(axis: int) -> None:
    """|κb| = 2 tan(κl/2): second order in the edge length."""
    component, errors = "II11" if axis == 0 else "II22", []
    for curvature in (50.0, 100.0, 200.0):  # at fixed edges the same as longer edges
        state = cell(axis, vertices=6).relax(ShellStrain(**{component: curvature}))
        errors.append(abs(state.energy_density / (0.5 * BENDING * curvature**2) - 1))
    rates = np.log2(np.array(errors[1:]) / errors[:-1])
    np.testing.assert_allclose(rates, 2.0, atol=0.15)


@AXES
def test_moduli(axis: int) -> None:
    """EA/p, EI/p and GJ/p: turning the surface about a yarn, II12, twists that yarn."""
    straight = cell(axis)
    moduli = straight.moduli(straight.relax())
    expected = np.zeros((6, 6))
    expected[2 * axis, 2 * axis] = TENSION
    expected[3 + 2 * axis, 3 + 2 * axis] = BENDING
    expected[4, 4] = TWISTING
    np.testing.assert_allclose(moduli[:3, :3], expected[:3, :3], atol=1e-3 * TENSION)
    np.testing.assert_allclose(moduli[3:, 3:], expected[3:, 3:], atol=1e-3 * BENDING)
    np.testing.assert_allclose(moduli[:3, 3:], 0, atol=1e-6 * np.sqrt(TENSION * BENDING))


def test_yarns_out_of_the_midsurface_stretch_when_it_bends() -> None:
    """At height h a yarn is strained by −κ h: EA h²/p more, or a relaxed state that moves back to the middle."""
    height, curvature = 0.5e-3, 2.0
    # Vertices lie on the surface, the curve of the yarn l²/12 of the curvature below: short edges.
    raised = parallel_yarns(0, height=height, vertices=16, edge=0.5 * RADIUS)
    state = PeriodicCell(raised, YARN).with_options(tolerance=1e-7).relax(ShellStrain(II11=curvature))
    # Fluctuations have zero mean, so the yarn cannot leave its height.
    expected = 0.5 * TENSION * (curvature * height) ** 2 + 0.5 * BENDING * curvature**2
    assert state.energy_density == pytest.approx(expected, rel=2e-3)
    assert state.stress[0] == pytest.approx(-TENSION * curvature * height, rel=2e-3)


def test_density() -> None:
    assert cell(0).area_density == pytest.approx(1000.0 * np.pi * RADIUS**2 / SPACING)
