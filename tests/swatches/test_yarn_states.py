"""States free across: exact against minimisation, slopes against differences, rest without stress."""

from dataclasses import replace

import numpy as np
import pytest

from yarnscale.cell import PeriodicCell
from yarnscale.drawing.library import build
from yarnscale.kinematics import ShellStrain
from yarnscale.swatches.measurements import Direction
from yarnscale.swatches.yarn_model import YarnModel, yarn_model
from yarnscale.swatches.yarn_rest import KEPT_PERIODS, RestRule, rested_cell
from yarnscale.swatches.yarn_states import pulled, pulled_strain
from yarnscale.yarn.material import YarnMaterial

UNKNOWNS = np.array([0.8, 0.3, 0.5, 0.5, 0.5])
"""Of a yarn whose loops have one rest shape; near (0.8, 0.3, 0.4, 0.6, 0.6) there are two, 0.3 radii apart."""
STRETCHES = np.array([0.03, 0.06, 0.1])
EXACT = 1e-7
"""Stress across over the stress along; what equilibria leave of it may be a hundredth of that."""


@pytest.fixture(scope="module")
def model() -> YarnModel:
    return yarn_model(build("stockinette"), 60.0, yarn_length=0.01128)


@pytest.fixture(scope="module")
def rested(model):
    found = rested_cell(model.cell(model.values(UNKNOWNS)), RestRule())
    assert found.relaxed
    return found.cell.with_options(tolerance=1e-9)


@pytest.mark.parametrize("angle", [0.0, 0.4, np.pi / 4, np.pi / 2])
def test_slopes_of_the_strain(angle):
    step, s, c = 1e-5, 0.2, 0.07
    strain, along, across = pulled_strain(angle, s, c)
    forms, turn = ShellStrain.from_vector(strain).first_form, np.array([np.cos(angle), np.sin(angle)])
    assert turn @ forms @ turn == pytest.approx((1 + s) ** 2)
    assert np.linalg.det(forms) == pytest.approx(((1 + s) * (1 - c)) ** 2)
    ends = [pulled_strain(angle, s + sign * step, c)[0] for sign in (1, -1)]
    np.testing.assert_allclose(along, (ends[0] - ends[1]) / (2 * step), atol=1e-9)
    ends = [pulled_strain(angle, s, c + sign * step)[0] for sign in (1, -1)]
    np.testing.assert_allclose(across, (ends[0] - ends[1]) / (2 * step), atol=1e-9)


def test_the_cell_is_free_of_stress_at_rest(rested):
    state = rested.relax()
    pulled_once = rested.relax(ShellStrain(s_x=0.02))
    assert np.abs(state.stress[[0, 2]]).max() < 1e-3 * abs(pulled_once.stress[0])
    np.testing.assert_allclose(state.fluctuation, 0.0, atol=1e-4 * rested.pattern.radius)


@pytest.mark.parametrize("direction", [Direction.WEFT, Direction.WARP])
def test_stress_across_vanishes_and_energy_is_least(rested, direction):
    curve = pulled(rested, direction, STRETCHES)
    assert curve.converged.all()
    k = 2
    energies = []
    for shift in (-0.01, 0.0, 0.01):
        strain, *_ = pulled_strain(direction.angle, STRETCHES[k], curve.contraction[k] + shift)
        state = rested.relax(ShellStrain.from_vector(strain), start=curve.states[k])
        energies.append(state.energy_density)
    assert energies[1] < min(energies[0], energies[2])
    # The stress is the derivative of the energy along the curve: its integral is the energy gained.
    ahead = pulled(rested, direction, STRETCHES[k] + np.array([-1e-3, 1e-3]), near=None)
    slope = (ahead.states[1].energy_density - ahead.states[0].energy_density) / 2e-3
    assert slope == pytest.approx(curve.stress[k], rel=2e-3)


def test_the_step_that_is_not_solved_for_takes_away_what_stress_is_left(rested):
    usual, exact = (
        pulled(rested, Direction.WEFT, STRETCHES),
        pulled(rested, Direction.WEFT, STRETCHES, tolerance=EXACT),
    )
    assert usual.converged.all() and exact.converged.all()
    assert usual.solves < exact.solves
    np.testing.assert_allclose(usual.stress, exact.stress, rtol=1e-4)
    np.testing.assert_allclose(usual.contraction, exact.contraction, rtol=0.0, atol=1e-5)
    # Without it: contractions are those of the states.
    reached = [1.0 - (1.0 + state.strain.s_y) for state in usual.states]
    assert np.abs(np.array(reached) - exact.contraction).max() > 5 * np.abs(usual.contraction - exact.contraction).max()


def test_a_cell_beside_another_comes_to_its_own_rest_and_states(model, rested):
    """Followed stage by stage from a yarn nearby, with the same outcome as from the drawing, and sooner."""
    rule, other = RestRule(), UNKNOWNS + np.array([0.0, 0.0, 1e-3, -1e-3, 1e-3])
    cells = [model.cell(model.values(u)).with_options(tolerance=1e-9) for u in (UNKNOWNS, other)]
    here = rested_cell(cells[0], rule, draw_in=0.4)
    alone, beside = rested_cell(cells[1], rule, draw_in=0.4), rested_cell(cells[1], rule, draw_in=0.4, near=here)
    assert alone.relaxed and beside.relaxed
    moved = np.abs(alone.change - here.change).max()
    assert moved > 1e-5 and beside.solves < 0.6 * alone.solves
    np.testing.assert_allclose(beside.change, alone.change, rtol=0.0, atol=0.01 * moved)
    curves = [pulled(found.cell, Direction.WEFT, STRETCHES, tolerance=EXACT) for found in (here, alone)]
    assert curves[0].converged.all() and curves[1].converged.all()
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
    """A stage that one of them leaves out is no other stage."""
    cell, rule = model.cell(model.values(UNKNOWNS)).with_options(tolerance=1e-9), RestRule(release=release)
    near, alone = rested_cell(cell, rule, draw_in=here), rested_cell(cell, rule, draw_in=there)
    beside = rested_cell(cell, rule, draw_in=there, near=near)
    assert beside.relaxed and len(beside.stages) == len(near.stages)
    assert (beside.stages[0] is None) == (there == 0.0) and beside.solves <= alone.solves
    moved = np.abs(alone.cell.pattern.vertices - near.cell.pattern.vertices).max()
    np.testing.assert_allclose(beside.cell.pattern.vertices, alone.cell.pattern.vertices, rtol=0.0, atol=0.01 * moved)


def test_a_neighbour_that_ended_earlier_has_no_stage_to_start_from():
    cell = PeriodicCell(build("plain"), YarnMaterial.preset("hylc2020-basket"))
    near = rested_cell(cell, RestRule(rounds=0, release=False))
    alone, beside = rested_cell(cell, RestRule(rounds=1)), rested_cell(cell, RestRule(rounds=1), near=near)
    assert len(near.stages) == 1 and len(beside.stages) == len(alone.stages)
    np.testing.assert_allclose(beside.change, alone.change, rtol=0.0, atol=1e-6)


@pytest.mark.parametrize("there", [(True, False, True), (False, False, False)])
def test_beside_a_curve_that_failed_states_are_found_from_their_own(rested, there):
    whole = pulled(rested, Direction.WEFT, STRETCHES)
    states = whole.states if any(there) else ()
    lost = replace(whole, converged=np.array(there), states=states, contraction=np.where(there, whole.contraction, 0.5))
    found = pulled(rested, Direction.WEFT, STRETCHES, near=lost)
    assert found.converged.all()
    np.testing.assert_allclose(found.stress, whole.stress, rtol=1e-4)


class Crossing:
    """A cell whose yarns pass through each other beyond a stretch."""

    def __init__(self, cell, beyond):
        self.cell, self.beyond = cell, beyond

    def relax(self, strain=None, *, start=None, nearby=False):
        state = self.cell.relax(strain, start=start, nearby=nearby)
        return replace(state, passages=strain is not None and strain.s_x > self.beyond)


def test_states_of_crossed_yarns_do_not_count(rested):
    curve = pulled(Crossing(rested, 0.05), Direction.WEFT, STRETCHES)
    assert curve.converged.tolist() == [True, False, False]


def test_a_drawing_of_known_shape_keeps_its_periods_and_says_what_stress_is_left():
    """EST22 §7.2: rounds lower the coarse stress at the drawn periods, rest lengths change by 20 % at most."""
    model = yarn_model(build("stockinette"), 20.0)
    drawn = model.cell(model.values(np.full(5, 0.5)))
    found = rested_cell(drawn, KEPT_PERIODS)
    assert found.relaxed and (found.change == 0.0).all()
    np.testing.assert_array_equal(found.cell.pattern.period, drawn.pattern.period)
    np.testing.assert_allclose(found.stress, found.cell.relax().stress[:3], atol=1e-3)
    assert np.abs(found.stress).max() < 0.05 * np.abs(drawn.relax().stress[:3]).max()
    change = found.cell.pattern.rest_length / drawn.pattern.rest_length
    assert 0.01 < np.abs(change - 1.0).max() < 0.2 + 1e-12
