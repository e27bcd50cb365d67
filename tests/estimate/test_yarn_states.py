"""States free across: exact against minimisation, derivatives against differences, rest without stress."""

from dataclasses import replace

import numpy as np
import pytest

from yarnscale.estimate.measurements import Direction
from yarnscale.estimate.yarn_model import YarnModel, yarn_model
from yarnscale.estimate.yarn_rest import RestRule, at_rest
from yarnscale.estimate.yarn_states import differentiated, pulled, strain_map, strain_slopes
from yarnscale.kinematics import ShellStrain
from yarnscale.yarn.library import build

UNKNOWNS = np.array([0.8, 0.3, 0.4, 0.6, 0.6])
STRETCHES = np.array([0.03, 0.06, 0.1])


@pytest.fixture(scope="module")
def model() -> YarnModel:
    return yarn_model(build("stockinette"), 60.0, yarn_length=0.01128)


@pytest.fixture(scope="module")
def rested(model):
    found = at_rest(model.cell(model.values(UNKNOWNS)), RestRule())
    assert found.relaxed
    return replace(found.cell, tolerance=1e-9)


@pytest.mark.parametrize("angle", [0.0, 0.4, np.pi / 4, np.pi / 2])
def test_slopes_of_the_strain_map(angle):
    strain, step, s, c = strain_map(angle), 1e-5, 0.2, 0.07
    along, across, twice, mixed = strain_slopes(angle, s, c)
    np.testing.assert_allclose(along, (strain(s + step, c) - strain(s - step, c)) / (2 * step), atol=1e-9)
    np.testing.assert_allclose(across, (strain(s, c + step) - strain(s, c - step)) / (2 * step), atol=1e-9)
    sides = [strain_slopes(angle, s, c + sign * step) for sign in (1, -1)]
    np.testing.assert_allclose(twice, (sides[0][1] - sides[1][1]) / (2 * step), atol=1e-9)
    np.testing.assert_allclose(mixed, (sides[0][0] - sides[1][0]) / (2 * step), atol=1e-9)


def test_the_cell_is_free_of_stress_at_rest(rested):
    state = rested.relax()
    pulled_once = rested.relax(ShellStrain(s_x=0.02))
    assert np.abs(state.stress[[0, 2]]).max() < 1e-3 * abs(pulled_once.stress[0])
    np.testing.assert_allclose(state.fluctuation, 0.0, atol=1e-4 * rested.pattern.radius)


@pytest.mark.parametrize("direction", [Direction.WEFT, Direction.WARP])
def test_stress_across_vanishes_and_energy_is_least(rested, direction):
    curve = pulled(rested, direction, STRETCHES)
    assert curve.converged.all()
    k, strain = 2, strain_map(direction.angle)
    energies = []
    for shift in (-0.01, 0.0, 0.01):
        state = rested.relax(
            ShellStrain.from_vector(strain(STRETCHES[k], curve.contraction[k] + shift)), start=curve.states[k]
        )
        energies.append(state.energy_density)
    assert energies[1] < min(energies[0], energies[2])
    # The stress is the derivative of the energy along the curve: its integral is the energy gained.
    ahead = pulled(rested, direction, STRETCHES[k] + np.array([-1e-3, 1e-3]), near=None)
    slope = (ahead.states[1].energy_density - ahead.states[0].energy_density) / 2e-3
    assert slope == pytest.approx(curve.stress[k], rel=2e-3)


def test_the_step_that_is_not_solved_for_takes_away_what_stress_is_left(rested):
    usual, exact = (
        pulled(rested, Direction.WEFT, STRETCHES),
        pulled(rested, Direction.WEFT, STRETCHES, tolerance=1e-9),
    )
    assert usual.solves < exact.solves
    np.testing.assert_allclose(usual.stress, exact.stress, rtol=1e-4)
    np.testing.assert_allclose(usual.contraction, exact.contraction, rtol=0.0, atol=1e-5)
    # Without it: contractions are those of the states.
    reached = [1.0 - (1.0 + state.strain.s_y) for state in usual.states]
    assert (
        np.abs(np.array(reached) - exact.contraction).max()
        > 5 * np.abs(usual.contraction - exact.contraction).max()
    )


def test_a_cell_beside_another_comes_to_its_own_rest_and_states(model, rested):
    """Followed stage by stage from a yarn nearby, with the same outcome as from the drawing, and sooner."""
    rule, other = RestRule(), UNKNOWNS + np.array([0.0, 0.0, 1e-3, -1e-3, 1e-3])
    cells = [replace(model.cell(model.values(u)), tolerance=1e-9) for u in (UNKNOWNS, other)]
    here = at_rest(cells[0], rule, draw_in=0.4)
    alone, beside = at_rest(cells[1], rule, draw_in=0.4), at_rest(cells[1], rule, draw_in=0.4, near=here)
    assert alone.relaxed and beside.relaxed
    moved = np.abs(alone.change - here.change).max()
    assert moved > 1e-5 and beside.solves < 0.6 * alone.solves
    np.testing.assert_allclose(beside.change, alone.change, rtol=0.0, atol=0.01 * moved)
    curves = [pulled(found.cell, Direction.WEFT, STRETCHES, tolerance=1e-9) for found in (here, alone)]
    near = pulled(beside.cell, Direction.WEFT, STRETCHES, near=curves[0])
    assert near.solves < curves[1].solves
    apart = np.abs(curves[1].stress - curves[0].stress)
    assert (np.abs(near.stress - curves[1].stress) < 0.02 * apart).all(), (
        near.stress - curves[1].stress,
        apart,
    )


@pytest.mark.parametrize("release", [True, False])
@pytest.mark.parametrize(("here", "there"), [(0.0, 1e-3), (1e-3, 0.0)])
def test_a_cell_that_draws_in_may_follow_one_that_does_not(model, release, here, there):
    """A stage that one of them leaves out is no other stage of the way."""
    cell, rule = replace(model.cell(model.values(UNKNOWNS)), tolerance=1e-9), RestRule(release=release)
    near, alone = at_rest(cell, rule, draw_in=here), at_rest(cell, rule, draw_in=there)
    beside = at_rest(cell, rule, draw_in=there, near=near)
    assert beside.relaxed and len(beside.way) == len(near.way)
    assert (beside.way[0] is None) == (there == 0.0) and beside.solves <= alone.solves
    moved = np.abs(alone.cell.pattern.vertices - near.cell.pattern.vertices).max()
    np.testing.assert_allclose(
        beside.cell.pattern.vertices, alone.cell.pattern.vertices, rtol=0.0, atol=0.01 * moved
    )


@pytest.mark.parametrize("there", [(True, False, True), (False, False, False)])
def test_beside_a_curve_that_failed_states_are_found_from_their_own(rested, there):
    whole = pulled(rested, Direction.WEFT, STRETCHES)
    states = whole.states if any(there) else ()
    lost = replace(
        whole, converged=np.array(there), states=states, contraction=np.where(there, whole.contraction, 0.5)
    )
    found = pulled(rested, Direction.WEFT, STRETCHES, near=lost)
    assert found.converged.all()
    np.testing.assert_allclose(found.stress, whole.stress, rtol=1e-4)


class Crossing:
    """A cell whose yarns pass through each other beyond a stretch."""

    def __init__(self, cell, beyond):
        self.cell, self.beyond = cell, beyond

    def relax(self, strain=None, *, start=None):
        state = self.cell.relax(strain, start=start)
        return replace(state, crossed=strain is not None and strain.s_x > self.beyond)


def test_states_of_crossed_yarns_do_not_count(rested):
    curve = pulled(Crossing(rested, 0.05), Direction.WEFT, STRETCHES)
    assert curve.converged.tolist() == [True, False, False]
    derivatives = differentiated(rested, curve)
    for values in (*derivatives.stress.values(), *derivatives.contraction.values()):
        assert np.isfinite(values[0]).all() and np.isnan(values[1:]).all()
    assert not differentiated(rested, replace(curve, converged=np.zeros(3, bool))).stress


def test_derivatives_with_the_rest_shape_held(model, rested):
    """By the implicit function theorem against differences of curves of cells with other yarns."""
    curve = pulled(rested, Direction.WEFT, STRETCHES)
    derivatives = differentiated(rested, curve)
    exact = model.by_parameter(derivatives.stress), model.by_parameter(derivatives.contraction)
    values = model.values(UNKNOWNS)
    for k in (2, 3, 4):
        sides = []
        for sign in (1, -1):
            other = values.copy()
            other[k] *= 1.0 + sign * 1e-3
            cell = replace(rested, material=model.material(other))
            sides.append(pulled(cell, Direction.WEFT, STRETCHES, near=curve, tolerance=1e-9))
        for found, name in ((exact[0], "stress"), (exact[1], "contraction")):
            slope = (getattr(sides[0], name) - getattr(sides[1], name)) / (2e-3 * values[k])
            np.testing.assert_allclose(found[:, k], slope, rtol=0.03, atol=0.03 * np.abs(slope).max())
