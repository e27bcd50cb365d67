"""Drawing in: straight yarn free of stress at its end, halfway in between, a smooth rest shape."""

from dataclasses import replace

import numpy as np
import pytest

from yarnscale.cell.periodic import PeriodicCell
from yarnscale.cell.rest_shape import set_as_drawn
from yarnscale.drawing.library import build
from yarnscale.kinematics import ShellStrain
from yarnscale.swatches.yarn_model import yarn_model
from yarnscale.swatches.yarn_rest import RestRule, drawn_in, rested_cell

VALUES = np.array([20.0, 0.1, 1e-8, 3.4e-4, 60.0, 0.74, 0.05, 0.5])


@pytest.fixture(scope="module")
def cell() -> PeriodicCell:
    model = yarn_model(build("rib-1x1"), 60.0, yarn_length=0.0161, free_shape=True)
    return model.cell(VALUES)


def test_straight_yarn_draws_a_rib_in_to_where_it_has_no_stress(cell):
    end = drawn_in(cell, 1.0)
    assert end.relaxed and end.change[0] < -0.4
    none = np.zeros_like(cell.pattern.rest_twist)
    bare = replace(end.cell.pattern, rest_curvature=np.zeros_like(end.cell.pattern.rest_curvature), rest_twist=none)
    straight = replace(end.cell, pattern=bare)
    state = straight.relax()
    wider = straight.relax(ShellStrain(s_x=0.02), start=state)
    assert np.abs(state.stress[[0, 2]]).max() < 0.02 * abs(wider.stress[0])
    np.testing.assert_array_equal(end.cell.pattern.rest_length, cell.pattern.rest_length)


def test_the_way_in_is_measured_by_the_periods(cell):
    end, half = drawn_in(cell, 1.0), drawn_in(cell, 0.5)
    np.testing.assert_allclose(half.change, 0.5 * end.change, rtol=1e-9)
    np.testing.assert_allclose(half.cell.pattern.period, cell.pattern.period * (1.0 + half.change), rtol=1e-9)
    # A rib folds as it narrows, which no affine motion of the drawing does.
    depths = [np.ptp(found.pattern.vertices[:, 2]) for found in (cell, half.cell, end.cell)]
    assert depths[0] < 0.7 * depths[1] < depths[2]


def test_yarn_forgets_the_drawing_as_it_draws_in(cell):
    end = drawn_in(cell, 1.0).cell.pattern
    again = set_as_drawn(end, lengths=False)
    np.testing.assert_allclose(again.rest_curvature, end.rest_curvature, rtol=0, atol=1e-9)
    none = drawn_in(cell, 0.0).cell
    np.testing.assert_array_equal(none.pattern.rest_curvature, cell.pattern.rest_curvature)
    # Not drawn in at all, the drawing at equilibrium comes to rest as the drawing does.
    without, begun = rested_cell(cell, RestRule()), rested_cell(cell, RestRule(), draw_in=0.0)
    np.testing.assert_allclose(without.change, begun.change, atol=1e-3)


def test_periods_at_rest_are_smooth_in_how_far_it_draws_in(cell):
    def periods(share: float) -> np.ndarray:
        found = rested_cell(cell, RestRule(), draw_in=share)
        assert found.relaxed
        return found.cell.pattern.period / cell.pattern.period

    slopes = [(periods(0.7 + step) - periods(0.7 - step)) / (2 * step) for step in (1e-3, 4e-3)]
    np.testing.assert_allclose(slopes[0], slopes[1], rtol=0.02, atol=2e-3)
    assert slopes[0][0] < -0.1
