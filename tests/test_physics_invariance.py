"""What describes the same fabric has the same energy density: rigid motion, period shift, stored copies, supercells."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from yarnscale.cell import Equilibrium, PeriodicCell
from yarnscale.cell.rest import settled
from yarnscale.drawing import library
from yarnscale.kinematics import ShellStrain
from yarnscale.yarn.material import YarnMaterial
from yarnscale.yarn.pattern import YarnPattern

MATERIAL = YarnMaterial.preset("hylc2020-stockinette")
REST = ShellStrain()
TENSION = ShellStrain(0.1, 0.05, 0.06)
BENT = ShellStrain(0.05, 0.0, 0.05, 25.0)
STATES = pytest.mark.parametrize("strain", [REST, TENSION, BENT], ids=["rest", "mild tension", "bent"])
TURNS = {
    "half a turn about z": np.diag([-1.0, -1.0, 1.0]),
    "a quarter turn about z": np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]),
    "turned over about x": np.diag([1.0, -1.0, -1.0]),
    "turned over about y": np.diag([-1.0, 1.0, -1.0]),
}


@cache
def fabric(name: str) -> YarnPattern:
    """A built-in pattern at rest. As drawn, stockinette has yarns to spare: it buckles to one of several images."""
    return settled(library.build(name), MATERIAL).pattern


def relaxed(pattern: YarnPattern, strain: ShellStrain) -> Equilibrium:
    state = PeriodicCell(pattern, MATERIAL).with_options(tolerance=1e-8).relax(strain)
    assert state.converged
    return state


def turned(pattern: YarnPattern, turn: np.ndarray) -> YarnPattern:
    """The fabric turned by a rotation that maps the axes onto axes."""
    plane = turn[:2, :2]
    edges = pattern.edges.copy()
    edges[:, 2:] = edges[:, 2:] @ plane.T.astype(np.int64)
    return replace(
        pattern,
        vertices=pattern.vertices @ turn.T,
        edges=edges,
        period=np.abs(plane) @ pattern.period,
        reference_director=pattern.reference_director @ turn.T,
    )


def turned_strain(strain: ShellStrain, turn: np.ndarray) -> ShellStrain:
    """I and II in the turned axes; turning over reverses the normal."""
    plane = turn[:2, :2]
    second = turn[2, 2] * plane @ strain.second_form @ plane.T
    return ShellStrain.from_forms(plane @ strain.first_form @ plane.T, second + 0.0)


@STATES
@pytest.mark.parametrize("name", ["stockinette", "plain"])
def test_translation_and_stored_copies(name: str, strain: ShellStrain) -> None:
    pattern = fabric(name)
    reference = relaxed(pattern, strain)
    raised = replace(pattern, vertices=pattern.vertices + np.array([0.0, 0.0, 0.3 * pattern.radius]))
    rng = np.random.default_rng(0)
    same = {
        "moved in the plane": pattern.shifted(0.37 * pattern.period[0], -1.21 * pattern.period[1]),
        "moved by a period": pattern.shifted(*pattern.period),
        "wrapped": pattern.shifted(0.5 * pattern.period[0], 0.1 * pattern.period[1]).wrapped(),
        "other copies": pattern.retiled(rng.integers(-1, 2, (len(pattern.edges), 2))),
    }
    if strain.is_flat:
        same["raised"] = raised
    for how, other in same.items():
        state = relaxed(other, strain)
        assert state.energy_density == pytest.approx(reference.energy_density, rel=1e-6), how
        # II22 leads off the singly curved states of BENT; what lies off them depends on the tile (see cell.poisson).
        kept = slice(None) if strain.is_flat else slice(0, 5)
        if how == "raised":
            # Stretching a raised tile bends nothing, but bending it stretches the yarns: only in-plane stress stays.
            kept = slice(0, 3)
        np.testing.assert_allclose(
            state.stress[kept],
            reference.stress[kept],
            rtol=1e-4,
            atol=1e-5 * np.abs(reference.stress).max(),
            err_msg=how,
        )


@STATES
@pytest.mark.parametrize("turn", TURNS)
def test_rotation(turn: str, strain: ShellStrain) -> None:
    """Turn the fabric and the state together; stress turns along."""
    pattern = fabric("stockinette")
    matrix = TURNS[turn]
    reference = relaxed(pattern, strain)
    state = relaxed(turned(pattern, matrix), turned_strain(strain, matrix))
    assert state.energy_density == pytest.approx(reference.energy_density, rel=1e-6)
    swap = matrix[0, 0] == 0
    order = [2, 1, 0, 5, 4, 3] if swap else [0, 1, 2, 3, 4, 5]
    mixed = matrix[0, 0] * matrix[1, 1] if not swap else matrix[0, 1] * matrix[1, 0]
    sign = np.array([1, mixed, 1, matrix[2, 2], matrix[2, 2] * mixed, matrix[2, 2]])
    scale = 1e-5 * np.abs(reference.stress).max()
    np.testing.assert_allclose(state.stress, sign * reference.stress[order], rtol=1e-4, atol=scale)


@pytest.mark.parametrize("name", ["stockinette", "plain"])
@pytest.mark.parametrize("strain", [REST, TENSION], ids=["rest", "mild tension"])
def test_a_two_by_two_supercell(name: str, strain: ShellStrain) -> None:
    pattern = fabric(name)
    reference = relaxed(pattern, strain)
    state = relaxed(pattern.repeated(2, 2), strain)
    assert state.energy_density == pytest.approx(reference.energy_density, rel=1e-6)
    np.testing.assert_allclose(state.stress, reference.stress, rtol=1e-4, atol=1e-5 * np.abs(reference.stress).max())


@STATES
@pytest.mark.parametrize("name", ["stockinette", "plain"])
def test_copies_of_an_equilibrium_fill_a_supercell(name: str, strain: ShellStrain) -> None:
    """Any equilibrium, buckled or not, is one of the larger tile, which may only lower the energy further."""
    pattern = library.build(name)
    state = relaxed(pattern, strain)
    energy = PeriodicCell(pattern.repeated(2, 2), MATERIAL).energy(strain)
    copies = energy.start(np.tile(state.fluctuation, (4, 1)) / pattern.radius, np.tile(state.twist, 4))
    value, gradient = energy.gradient(copies)
    density = value * energy.unit / (4 * pattern.area)
    assert density == pytest.approx(state.energy_density, rel=1e-9)
    free = energy.constraints.project(gradient)
    assert np.linalg.norm(free) < 1e-6 * energy.residual_scale


def test_a_supercell_buckles_no_stiffer_than_its_tile() -> None:
    pattern = library.build("stockinette")
    assert relaxed(pattern.repeated(2, 2), REST).energy_density <= relaxed(pattern, REST).energy_density * (1 + 1e-6)


def test_size_does_not_matter() -> None:
    """Ψ/(E r) of a fabric scaled as a whole, with k_c/(E r) kept, is a pure number."""
    pattern = library.build("stockinette")
    reference = relaxed(pattern, TENSION)
    tenth = replace(MATERIAL, contact_stiffness=MATERIAL.contact_stiffness / 10)
    small = PeriodicCell(pattern.scaled(0.1), tenth).with_options(tolerance=1e-8).relax(TENSION)
    assert small.energy_density == pytest.approx(0.1 * reference.energy_density, rel=1e-7)
    np.testing.assert_allclose(small.stress[:3], 0.1 * reference.stress[:3], rtol=1e-6)
    np.testing.assert_allclose(small.stress[3:], 0.01 * reference.stress[3:], rtol=1e-5, atol=1e-12)


def test_a_warm_start_ends_in_the_same_state() -> None:
    cell = PeriodicCell(library.build("stockinette"), MATERIAL).with_options(tolerance=1e-8)
    near = cell.relax(ShellStrain(0.08, 0.05, 0.05))
    cold, warm = cell.relax(TENSION), cell.relax(TENSION, start=near)
    assert warm.energy_density == pytest.approx(cold.energy_density, rel=1e-8)
    assert warm.iterations <= cold.iterations
