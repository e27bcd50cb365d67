"""What an equilibrium reports."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from yarnscale.cell import Equilibrium, PeriodicCell
from yarnscale.drawing import library
from yarnscale.kinematics import ShellStrain
from yarnscale.numerics.newton import Status
from yarnscale.yarn.material import YarnMaterial

MATERIAL = YarnMaterial.preset("hylc2020-stockinette")
STRAIN = ShellStrain(0.1, 0.05, 0.02)


@pytest.fixture(scope="module")
def cell() -> PeriodicCell:
    return PeriodicCell(library.build("stockinette"), MATERIAL)


@pytest.fixture(scope="module")
def state(cell: PeriodicCell) -> Equilibrium:
    return cell.relax(STRAIN)


def test_readings(cell: PeriodicCell, state: Equilibrium) -> None:
    n = len(cell.pattern.edges)
    assert state.converged and state.status is Status.CONVERGED and state.residual <= cell.options.tolerance
    assert state.strain == STRAIN
    assert state.positions.shape == state.fluctuation.shape == (n, 3)
    assert state.twist.shape == (n,) and state.stress.shape == (6,)
    assert state.iterations > 0 and state.factorisations >= state.iterations and state.seconds > 0
    assert state.contacts > 0
    assert 0.5 < state.min_distance_over_diameter < 1.0
    assert sum(state.energy_parts.values()) == pytest.approx(state.energy_density)


def test_positions_are_the_affine_image_plus_the_fluctuation(cell: PeriodicCell, state: Equilibrium) -> None:
    """A flat state: x = (S ξ, h) + û; a copy in tile (a, b) is moved by S (a px, b py)."""
    values, vectors = np.linalg.eigh(STRAIN.first_form)
    stretch = np.eye(3)
    stretch[:2, :2] = vectors @ np.diag(np.sqrt(values)) @ vectors.T
    expected = cell.pattern.vertices @ stretch + state.fluctuation
    np.testing.assert_allclose(state.positions, expected, atol=1e-15)
    moved = state.positions[cell.pattern.edges[:, 1]] - state.positions
    moved[:, :2] += (cell.pattern.edges[:, 2:] * cell.pattern.period) @ stretch[:2, :2]
    length = np.linalg.norm(moved, axis=1)
    np.testing.assert_allclose(length / cell.pattern.rest_length, 1.0, atol=0.1)


def test_the_rest_state_is_the_default(cell: PeriodicCell) -> None:
    assert cell.relax().energy_density == pytest.approx(cell.relax(ShellStrain()).energy_density, rel=1e-12)


def test_repeated_solves_agree_bit_by_bit(cell: PeriodicCell, state: Equilibrium) -> None:
    again = PeriodicCell(cell.pattern, MATERIAL).relax(STRAIN)
    assert again.energy_density == state.energy_density
    np.testing.assert_array_equal(again.positions, state.positions)


def test_a_solve_that_is_cut_short_says_so(cell: PeriodicCell) -> None:
    short = cell.with_options(max_iterations=1).relax(ShellStrain(0.4))
    assert short.status is Status.ITERATION_LIMIT and not short.converged
    assert np.isfinite(short.energy_density) and np.isfinite(short.stress).all()


def test_free_sliding_costs_no_more(cell: PeriodicCell, state: Equilibrium) -> None:
    sliding = replace(cell, sliding=True).relax(STRAIN, start=state)
    assert sliding.converged
    assert sliding.energy_density <= state.energy_density * (1 + 1e-9)


def test_tension_and_compression_have_the_right_sign(cell: PeriodicCell) -> None:
    rest, pulled = cell.relax(), cell.relax(ShellStrain(0.2))
    assert pulled.energy_density > rest.energy_density
    assert pulled.stress[0] > rest.stress[0]


def test_the_twist_of_every_yarn_has_no_mean(cell: PeriodicCell, state: Equilibrium) -> None:
    for yarn in cell.pattern.yarns:
        assert abs((cell.pattern.rest_length * state.twist)[yarn].sum()) < 1e-12
    weight = cell.pattern.voronoi_length
    np.testing.assert_allclose(weight @ state.fluctuation / weight.sum(), 0, atol=1e-12)


def test_a_slow_solve_is_given_time() -> None:
    """What stops at the limit of iterations on every way is taken on from there."""
    usual = PeriodicCell(library.build("stockinette"), MATERIAL).relax()
    few = usual.iterations // 2 + 1
    hasty = PeriodicCell(library.build("stockinette"), MATERIAL).with_options(max_iterations=few).relax()
    assert hasty.converged and hasty.iterations > usual.iterations // 2 + 1
    assert hasty.energy_density == pytest.approx(usual.energy_density, rel=1e-6)
    assert not PeriodicCell(library.build("stockinette"), MATERIAL).with_options(max_iterations=1).relax().converged
