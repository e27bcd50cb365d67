"""Cells of several yarn materials, and yarns with two-phase stretch."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from yarnscale.cell import PeriodicCell
from yarnscale.cell.energy import CellEnergy
from yarnscale.drawing.curves import PeriodicCurve, pattern_from_curves
from yarnscale.drawing.knit import knit
from yarnscale.errors import InputError
from yarnscale.kinematics import ShellStrain
from yarnscale.yarn.material import ContactRule, StretchRule, YarnMaterial
from yarnscale.yarn.pattern import YarnPattern
from yarnscale.yarn.stiffness import PatternStiffness

RADIUS, SPACING = 1e-3, 4e-3
SOFT = YarnMaterial(5e5, 2e5, 0.01, 60.0, 120.0, name="soft")
STIFF = YarnMaterial(5e6, 1e6, 0.002, 300.0, 400.0, name="stiff")
TWO_PHASE = replace(SOFT, name="two-phase", stretch=StretchRule("two_phase", knee=0.05, stiff_modulus=4e6))
STATES = {"flat": ShellStrain(0.1, -0.1, 0.05), "bent": ShellStrain(0.1, 0.1, 0.0, 40.0, 10.0, 5.0)}


def straight(*kinds: int) -> YarnPattern:
    """Parallel yarns along x, ``SPACING`` apart, so far that they never touch."""
    count = 6
    curves = []
    for k in range(len(kinds)):
        points = np.zeros((count, 3))
        points[:, 0], points[:, 1] = RADIUS * np.arange(count), SPACING * k + 1e-4
        curves.append(PeriodicCurve(points, (1, 0)))
    period = np.array([count * RADIUS, SPACING * len(kinds)])
    return replace(pattern_from_curves(curves, period, RADIUS), yarn_material=np.array(kinds))


def plated() -> YarnPattern:
    """Two plated yarns in every course."""
    return knit(["k"], wale_spacing=10, course_spacing=6.5, yarns=["AB"], vertices_per_stitch=18)


def disturbed(energy: CellEnergy) -> np.ndarray:
    rng, n = np.random.default_rng(0), energy.count
    return energy.start() + np.concatenate([0.1 * rng.normal(size=3 * n), 0.3 * rng.normal(size=n)])


@pytest.mark.parametrize("state", STATES)
def test_equal_materials_are_one_material(state: str) -> None:
    one, two = (CellEnergy(plated(), m, STATES[state], symmetric=True) for m in (SOFT, (SOFT, SOFT)))
    x = disturbed(one)
    (value, gradient), (same, alike) = one.gradient(x), two.gradient(x)
    assert value == pytest.approx(same, rel=1e-12)
    np.testing.assert_allclose(gradient, alike, atol=1e-12 * np.abs(gradient).max())
    np.testing.assert_allclose(one.stress(x), two.stress(x), rtol=1e-12)


def test_materials_do_not_depend_on_their_numbers() -> None:
    pattern = plated()
    swapped = replace(pattern, yarn_material=1 - np.asarray(pattern.yarn_material))
    there = CellEnergy(pattern, (SOFT, STIFF), STATES["flat"])
    back = CellEnergy(swapped, (STIFF, SOFT), STATES["flat"])
    other = CellEnergy(pattern, (STIFF, SOFT), STATES["flat"])
    x = disturbed(there)
    assert there.value(x) == pytest.approx(back.value(x), rel=1e-12)
    assert abs(there.value(x) - other.value(x)) > 1e-3 * there.value(x)


def test_straight_yarns_add_up() -> None:
    """Tension Σ E A/p, bending Σ E I/p and mass Σ ρ A/p of a soft and two stiff yarns."""
    pattern, materials = straight(0, 1, 1), (SOFT, STIFF, STIFF)
    cell = PeriodicCell(pattern, (SOFT, STIFF)).with_options(tolerance=1e-8)
    width = SPACING * len(materials)
    tension = sum(m.stretch_stiffness(RADIUS) for m in materials) / width
    bending = sum(m.bending_stiffness(RADIUS) for m in materials) / width
    stretched = cell.relax(ShellStrain(0.02))
    assert stretched.converged
    assert stretched.energy_density == pytest.approx(0.5 * tension * 0.02**2, rel=1e-6)
    assert stretched.stress[0] == pytest.approx(tension * 0.02, rel=1e-6)
    bent = cell.relax(ShellStrain(II11=5.0))
    assert bent.energy_density == pytest.approx(0.5 * bending * 25.0, rel=2e-4)
    mass = sum(m.mass_per_length(RADIUS) for m in materials) / width
    assert cell.area_density == pytest.approx(mass, rel=1e-12)
    assert cell.material_name == "soft + stiff"
    all_soft = PeriodicCell(pattern, SOFT).relax(ShellStrain(0.02))
    assert all_soft.stress[0] == pytest.approx(0.02 * SOFT.stretch_stiffness(RADIUS) / SPACING, rel=1e-6)


def test_contact_of_two_materials_is_the_harmonic_mean() -> None:
    pattern = plated()
    found = PatternStiffness.of(pattern, (SOFT, STIFF))
    a, b = (int(np.flatnonzero(pattern.material_of_vertex == k)[0]) for k in (0, 1))
    first, second = np.array([a, a, b]), np.array([a, b, b])
    np.testing.assert_allclose(found.pair_stiffness(first, second), [60.0, 100.0, 300.0], rtol=1e-14)


@pytest.mark.parametrize("state", STATES)
@pytest.mark.parametrize("materials", [(SOFT, STIFF), (TWO_PHASE, STIFF)], ids=["linear", "two-phase"])
def test_derivatives_against_differences(state: str, materials: tuple[YarnMaterial, ...]) -> None:
    energy = CellEnergy(plated(), materials, STATES[state], symmetric=True)
    x = disturbed(energy)
    _, gradient, model = energy.quadratic(x)
    rng, step = np.random.default_rng(1), 1e-6
    exact = model.values(0.0)
    for d in rng.normal(size=(4, len(x))) / np.sqrt(len(x)):
        slope = (energy.value(x + step * d) - energy.value(x - step * d)) / (2 * step)
        assert slope == pytest.approx(gradient @ d, rel=1e-5, abs=1e-6 * np.abs(gradient).max())
        curve = (energy.gradient(x + step * d)[1] - energy.gradient(x - step * d)[1]) / (2 * step)
        product = model.pattern.multiply(exact, d)
        np.testing.assert_allclose(product, curve, atol=1e-4 * np.abs(exact).max())
    assert np.abs(gradient).max() > 1e-3


@pytest.mark.parametrize(
    ("stretch", "energy", "force"),
    [
        (-0.02, 0.5 * 8.0 * 4e-4, -0.16),
        (0.03, 0.5 * 9e-4, 0.03),
        (0.09, 0.5 * (8 * 16e-4 + 0.05 * 0.13), 0.37),
    ],
    ids=["pressed", "soft", "drawn"],
)
def test_a_straight_two_phase_yarn(stretch: float, energy: float, force: float) -> None:
    """EST22 eq. 5 with k_s2 = 8 k_s1 and ε̄ = 0.05, in units of k_s1."""
    unit = SOFT.stretch_stiffness(RADIUS) / SPACING
    state = PeriodicCell(straight(0), TWO_PHASE).with_options(tolerance=1e-8).relax(ShellStrain(stretch))
    assert state.converged
    assert state.energy_density == pytest.approx(energy * unit, rel=1e-6)
    assert state.stress[0] == pytest.approx(force * unit, rel=1e-6)


@pytest.mark.parametrize("partner", [STIFF, TWO_PHASE], ids=["stiff", "two-phase"])
def test_a_plated_knit_relaxes_and_its_stress_is_the_slope_of_its_energy(partner: YarnMaterial) -> None:
    cell = PeriodicCell(plated(), (SOFT, partner)).with_options(tolerance=1e-9)
    strain = np.array([0.12, 0.05, 0.1, 0, 0, 0])
    state = cell.relax(ShellStrain.from_vector(strain))
    assert state.outcome == "converged" and state.contacts > 0
    for k in range(3):
        step = 1e-4 * np.eye(6)[k]
        sides = [cell.relax(ShellStrain.from_vector(strain + s * step), start=state) for s in (1, -1)]
        assert all(side.converged for side in sides)
        slope = (sides[0].energy_density - sides[1].energy_density) / 2e-4
        assert state.stress[k] == pytest.approx(slope, rel=1e-4, abs=1e-5 * np.abs(state.stress[:3]).max())
    soft, stiff = (PeriodicCell(plated(), m).relax(state.strain).energy_density for m in (SOFT, STIFF))
    if partner is STIFF:
        assert soft < state.energy_density < stiff


@pytest.mark.parametrize(
    ("materials", "message"),
    [
        ((SOFT,), "yarns of pattern 'knit' are of 2 materials; expected 2 materials.*found 1"),
        ((SOFT, STIFF, STIFF), "of 2 materials; expected one or 2 materials; found 3"),
        ((SOFT, "wool"), "material 1 is no yarn material"),
        (
            (SOFT, replace(STIFF, contact=ContactRule(points=3))),
            "must count contact alike; number 1 does not",
        ),
    ],
)
def test_materials_that_do_not_suit_are_named(materials: tuple[YarnMaterial, ...], message: str) -> None:
    with pytest.raises(InputError, match=message):
        PeriodicCell(plated(), materials)
    PeriodicCell(plated(), SOFT)


def test_yarns_of_different_friction_stand_in_one_fabric() -> None:
    rubbing = replace(STIFF, contact=replace(STIFF.contact, friction=0.2))
    assert PeriodicCell(plated(), (SOFT, rubbing)).materials == (SOFT, rubbing)
