"""Stress and moduli of relaxed cells against differences of re-solved equilibria."""

from __future__ import annotations

import numpy as np
import pytest

from yarnscale.cell import PeriodicCell
from yarnscale.cell.energy import CellEnergy
from yarnscale.drawing import library
from yarnscale.kinematics import COMPONENTS, ShellStrain
from yarnscale.numerics.linear_solver import linear_solver
from yarnscale.numerics.newton import NewtonOptions, Solution, minimise
from yarnscale.yarn.material import YarnMaterial

MATERIAL = YarnMaterial.preset("hylc2020-stockinette")
CASES = {
    "knit, flat": ("stockinette", ShellStrain(0.2, 0.1, 0.05)),
    "weave, flat": ("twill-2x1", ShellStrain(0.1, -0.08, 0.04)),
    "knit, bent": ("stockinette", ShellStrain(0.15, 0.1, 0.05, 30.0)),
    "weave, bent askew": ("twill-2x1", ShellStrain(0.05, 0.0, 0.05, 20.0, 10.0, 5.0)),
}


def solve(base: CellEnergy, vector: np.ndarray, start: np.ndarray | None) -> tuple[CellEnergy, Solution]:
    energy = CellEnergy(base.pattern, base.material, ShellStrain.from_vector(vector), symmetric=True)
    solution = minimise(
        energy,
        energy.start() if start is None else start,
        NewtonOptions(tolerance=1e-11),
        bound=energy.bound,
        linear=linear_solver(energy.constraints),
    )
    assert solution.converged
    return energy, solution


@pytest.mark.parametrize("case", CASES)
def test_stress_is_the_derivative_of_equilibrium_energies(case: str) -> None:
    """Six components, fourth-order central differences, relative 1e-5."""
    name, strain = CASES[case]
    pattern = library.build(name)
    base = CellEnergy(pattern, MATERIAL, strain, symmetric=True)
    energy, solution = solve(base, strain.vector, None)
    stress = energy.stress(solution.x)
    unit = energy.unit / pattern.area
    for k, component in enumerate(COMPONENTS):
        step = np.eye(6)[k] * (2e-4 if k < 3 else 0.05)
        value = {m: solve(base, strain.vector + m * step, solution.x)[1].value * unit for m in (-2, -1, 1, 2)}
        expected = (8 * (value[1] - value[-1]) - (value[2] - value[-2])) / (12 * step[k])
        assert abs(expected) > 1e-7, f"{component} says nothing"
        assert stress[k] == pytest.approx(expected, rel=1e-5), component


@pytest.mark.parametrize("name", ["stockinette", "twill-2x1"])
def test_moduli_are_the_derivative_of_stress(name: str) -> None:
    cell = PeriodicCell(library.build(name), MATERIAL).with_options(tolerance=1e-10)
    strain = ShellStrain(0.15, 0.06, 0.05)
    state = cell.relax(strain)
    moduli = cell.moduli(state)
    np.testing.assert_allclose(moduli, moduli.T, atol=1e-9 * np.abs(moduli).max())
    differences = np.empty((6, 6))
    for k in range(6):
        step = np.eye(6)[k] * (2e-5 if k < 3 else 0.004)
        sides = []
        for sign in (1, -1):
            energy = CellEnergy(cell.pattern, MATERIAL, ShellStrain(), symmetric=True)
            start = energy.start(state.fluctuation / cell.pattern.radius, state.twist)
            moved, solution = solve(energy, strain.vector + sign * step, start)
            sides.append(moved.stress(solution.x))
        differences[k] = (sides[0] - sides[1]) / (2 * step[k])
    # A length scale balances the units: components weigh as much as their own stiffness.
    scale = np.sqrt(np.abs(np.diag(moduli)))
    np.testing.assert_allclose(moduli / scale[:, None] / scale, differences / scale[:, None] / scale, atol=1e-4)


def test_stress_without_load_is_the_prestress_of_the_rest_shape() -> None:
    """The rest state is not free of stress, but its stress is that of its energy: half a step both ways agree."""
    cell = PeriodicCell(library.build("plain"), MATERIAL).with_options(tolerance=1e-9)
    state = cell.relax()
    ahead, behind = (cell.relax(ShellStrain(s), start=state).energy_density for s in (3e-5, -3e-5))
    assert state.stress[0] == pytest.approx((ahead - behind) / 6e-5, rel=1e-4)
