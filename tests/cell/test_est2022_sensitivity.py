"""Sensitivities of the model of EST22 §6 and of several materials, against cells relaxed again."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from yarnscale.cell import Equilibrium, PeriodicCell
from yarnscale.cell.sensitivity import Sensitivities
from yarnscale.drawing import library
from yarnscale.drawing.knit import knit
from yarnscale.kinematics import ShellStrain
from yarnscale.yarn.material import ContactRule, StretchRule, YarnMaterial

RADIUS = 1e-3
BARRIER = ContactRule(kernel="est2022", weights="simpson", outer_radius_ratio=1.1)
KNEE = StretchRule("two_phase", knee=0.02, stiff_modulus=4e6)
YARN = YarnMaterial(5e5, 2e5, 0.01, 20.0, 120.0, contact=BARRIER, stretch=KNEE)

Change = Callable[[float], YarnMaterial]
"""A material whose one parameter is scaled."""
CHANGES: dict[str, tuple[float, Change]] = {
    "stretch_stiffness": (
        YARN.stretch_stiffness(RADIUS),
        lambda f: YARN.with_stiffnesses(RADIUS, stretch=f * YARN.stretch_stiffness(RADIUS)),
    ),
    "stretch.knee": (KNEE.knee, lambda f: replace(YARN, stretch=replace(KNEE, knee=f * KNEE.knee))),
    "bending_stiffness": (
        YARN.bending_stiffness(RADIUS),
        lambda f: YARN.with_stiffnesses(RADIUS, bending=f * YARN.bending_stiffness(RADIUS)),
    ),
    "contact.outer_radius_ratio": (
        BARRIER.outer_radius_ratio,
        lambda f: replace(YARN, contact=replace(BARRIER, outer_radius_ratio=1.1 * f)),
    ),
    "contact_stiffness": (20.0, lambda f: replace(YARN, contact_stiffness=20.0 * f)),
    "stretch.stiff_modulus": (4e6, lambda f: replace(YARN, stretch=replace(KNEE, stiff_modulus=4e6 * f))),
    "twist_stiffness": (
        YARN.twist_stiffness(RADIUS),
        lambda f: YARN.with_stiffnesses(RADIUS, twist=f * YARN.twist_stiffness(RADIUS)),
    ),
    "young_modulus": (5e5, lambda f: replace(YARN, young_modulus=5e5 * f)),
}
"""The five parameters of EST22 §6 first."""

Solved = tuple[PeriodicCell, Equilibrium, Sensitivities]


@pytest.fixture(scope="module", params=[ShellStrain(0.3, 0.05, 0.35), ShellStrain(0.25, 0.0, 0.2, 30.0)])
def solved(request: pytest.FixtureRequest) -> Solved:
    pattern = library.build("stockinette")
    rng, n = np.random.default_rng(1), len(pattern.edges)
    curved = {"rest_curvature": rng.normal(0, 0.1, (n, 2)), "rest_twist": rng.normal(0.1, 0.1, n)}
    cell = PeriodicCell(replace(pattern, **curved), YARN).with_options(tolerance=1e-12)
    state = cell.relax(request.param)
    assert state.converged
    return cell, state, cell.sensitivities(state)


@pytest.mark.parametrize("name", CHANGES)
def test_every_parameter(solved: Solved, name: str) -> None:
    cell, state, found = solved
    value, changed = CHANGES[name]
    step = 1e-3 if name == "twist_stiffness" else 1e-4  # little depends on twist
    sides = [replace(cell, material=changed(1 + s * step)).relax(state.strain, start=state) for s in (1, -1)]
    assert all(side.converged for side in sides)
    energy = (sides[0].energy_density - sides[1].energy_density) / (2 * step * value)
    stress = (sides[0].stress - sides[1].stress) / (2 * step * value)
    units = np.array([1.0] * 3 + [RADIUS] * 3)
    assert abs(energy) > 0
    assert found.energy[name] == pytest.approx(energy, rel=1e-4)
    np.testing.assert_allclose(found.stress[name] / units, stress / units, atol=1e-4 * np.abs(stress / units).max())


def test_each_of_two_materials() -> None:
    other = replace(YARN, young_modulus=2e6, contact_stiffness=60.0, stretch=StretchRule())
    pattern = knit(["k"], wale_spacing=10, course_spacing=6.5, yarns=["AB"], vertices_per_stitch=18)
    cell = PeriodicCell(pattern, (YARN, other)).with_options(tolerance=1e-12)
    state = cell.relax(ShellStrain(0.2, 0.0, 0.2))
    found = cell.sensitivities(state)
    step = 1e-3
    for k, name in (
        (0, "young_modulus"),
        (1, "young_modulus"),
        (0, "contact_stiffness"),
        (1, "contact_stiffness"),
    ):
        sides = []
        for sign in (1, -1):
            materials = [YARN, other]
            value = getattr(materials[k], name)
            materials[k] = replace(materials[k], **{name: value * (1 + sign * step)})
            sides.append(replace(cell, material=tuple(materials)).relax(state.strain, start=state))
        energy = (sides[0].energy_density - sides[1].energy_density) / (2 * step * value)
        stress = (sides[0].stress - sides[1].stress) / (2 * step * value)
        assert found.energy_of[k][name] == pytest.approx(energy, rel=1e-4)
        np.testing.assert_allclose(found.stress_of[k][name][:3], stress[:3], atol=1e-4 * np.abs(stress[:3]).max())
    total = sum(entry["young_modulus"] for entry in found.energy_of)
    assert found.energy["young_modulus"] == pytest.approx(total, rel=1e-12)
    assert "stretch.knee" in found.energy_of[0] and "stretch.knee" not in found.energy_of[1]
