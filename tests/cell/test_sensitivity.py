"""Sensitivities against differences of cells that are relaxed again with changed parameters."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from yarnscale.cell import Equilibrium, PeriodicCell
from yarnscale.cell.parameters import PARAMETERS
from yarnscale.cell.sensitivity import Sensitivities
from yarnscale.drawing import library
from yarnscale.kinematics import ShellStrain
from yarnscale.yarn.material import YarnMaterial

MATERIAL = YarnMaterial.preset("hylc2020-stockinette")
CASES = {
    "flat": (False, ShellStrain(0.15, 0.1, 0.05)),
    "bent": (False, ShellStrain(0.1, 0.05, 0.0, 40.0)),
    "sliding": (True, ShellStrain(0.2, 0.0, 0.1)),
}


@pytest.fixture(scope="module", params=CASES)
def solved(request: pytest.FixtureRequest) -> tuple[PeriodicCell, Equilibrium, Sensitivities]:
    sliding, strain = CASES[request.param]
    pattern = library.build("stockinette")
    rng, n = np.random.default_rng(1), len(pattern.edges)
    curved = {"rest_curvature": rng.normal(0, 0.1, (n, 2)), "rest_twist": rng.normal(0.1, 0.1, n)}
    cell = PeriodicCell(replace(pattern, **curved), MATERIAL, sliding).with_options(tolerance=1e-12)
    state = cell.relax(strain)
    return cell, state, cell.sensitivities(state)


def _differences(
    changed: tuple[PeriodicCell, PeriodicCell], state: Equilibrium, step: float
) -> tuple[float, np.ndarray]:
    ahead, behind = (cell.relax(state.strain, start=state) for cell in changed)
    energy = (ahead.energy_density - behind.energy_density) / (2 * step)
    return energy, (ahead.stress - behind.stress) / (2 * step)


@pytest.mark.parametrize("name", PARAMETERS)
def test_material_parameters(solved: tuple[PeriodicCell, Equilibrium, Sensitivities], name: str) -> None:
    cell, state, found = solved
    value = getattr(cell.material, name)
    step = 1e-3 * value
    changed = tuple(replace(cell, material=replace(MATERIAL, **{name: value + s * step})) for s in (1, -1))
    energy, stress = _differences((changed[0], changed[1]), state, step)
    assert found.energy[name] == pytest.approx(energy, rel=1e-4)
    units = np.array([1.0] * 3 + [cell.pattern.radius] * 3)
    np.testing.assert_allclose(found.stress[name] / units, stress / units, atol=1e-4 * np.abs(stress / units).max())


def test_rest_lengths(solved: tuple[PeriodicCell, Equilibrium, Sensitivities]) -> None:
    cell, state, found = solved
    rng = np.random.default_rng(0)
    step = 1e-5 * float(cell.pattern.rest_length.mean())
    units = np.array([1.0] * 3 + [cell.pattern.radius] * 3)
    n = len(cell.pattern.edges)
    directions = [np.eye(n)[n // 3], rng.uniform(-1, 1, n), np.ones(n)]
    for direction in directions:
        changed = tuple(
            replace(
                cell,
                pattern=replace(cell.pattern, rest_length=cell.pattern.rest_length + s * step * direction),
            )
            for s in (1, -1)
        )
        energy, stress = _differences((changed[0], changed[1]), state, step)
        scale = float(np.abs(found.energy_by_rest_length).max())
        assert found.energy_by_rest_length @ direction == pytest.approx(energy, rel=1e-4, abs=1e-4 * scale)
        ours = found.stress_by_rest_length @ direction
        np.testing.assert_allclose(ours / units, stress / units, atol=1e-4 * np.abs(stress / units).max())


def test_scaling_all_stiffnesses_scales_energy_and_stress(
    solved: tuple[PeriodicCell, Equilibrium, Sensitivities],
) -> None:
    """Ψ is homogeneous of degree one in (E, G, k_contact) together."""
    cell, state, found = solved
    names = ("young_modulus", "shear_modulus", "contact_stiffness")
    total = sum(getattr(cell.material, name) * found.energy[name] for name in names)
    assert total == pytest.approx(state.energy_density, rel=1e-6)
    stress = sum(getattr(cell.material, name) * found.stress[name] for name in names)
    np.testing.assert_allclose(stress, state.stress, rtol=1e-5, atol=1e-6 * np.abs(state.stress[:3]).max())
