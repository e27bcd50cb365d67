"""Searches on a problem with a known answer, twins of a real cell, remembered evaluations."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from types import SimpleNamespace

import numpy as np
import pytest

from yarnscale.drawing.library import build
from yarnscale.errors import InputError
from yarnscale.swatches.evaluations import Evaluations, Residuals
from yarnscale.swatches.gauss_newton import GaussNewton, advance, gauss_newton, jacobian
from yarnscale.swatches.measurements import Direction
from yarnscale.swatches.objective import ErrorWeights, YarnObjective, coarser
from yarnscale.swatches.search import race, sobol_starts
from yarnscale.swatches.uniform_data import UniformBend, UniformCurve, UniformData
from yarnscale.swatches.yarn_fit import FitOptions, ParameterSpread, ambiguity, usual_starts, work_ahead
from yarnscale.swatches.yarn_model import yarn_model
from yarnscale.swatches.yarn_rest import RestRule


@dataclass(frozen=True)
class Bowl:
    """Stands for an evaluation: residuals of a curved valley whose only zero is at ``ANSWER``."""

    residuals: np.ndarray
    solves: int = 1
    seconds: float = 0.0

    def rests_lower(self, other):
        return False


ANSWER = np.array([0.3, 0.8, 0.55])


@dataclass(frozen=True)
class Names:
    names: tuple[str, ...] = ("a", "b", "c")


@dataclass(frozen=True)
class Valley:
    model: Names = field(default_factory=Names)

    def evaluate(self, unknowns, *, near=None):
        away = unknowns - ANSWER
        return Bowl(np.array([away[0], 3 * (away[1] - away[0] ** 2), np.sin(away[2]) + 0.3 * away[0]]))


def valley(**others) -> Evaluations:
    return Evaluations(Valley(), **others)  # pyright: ignore[reportArgumentType]


def test_a_point_that_is_asked_for_twice_is_evaluated_once():
    evaluations = valley()
    first, second = evaluations.many([ANSWER, ANSWER.copy()])
    assert evaluations.count == 1
    np.testing.assert_array_equal(first.residuals, second.residuals)


def test_gauss_newton_finds_the_answer_of_a_valley():
    np.testing.assert_allclose(gauss_newton(valley(), np.array([0.9, 0.1, 0.1])), ANSWER, atol=1e-4)


def test_steps_cost_less_than_a_jacobian_each():
    evaluations = valley()
    descent = GaussNewton(evaluations, np.array([0.9, 0.1, 0.1]))
    steps = 0
    while not descent.ended and steps < 30:
        before = descent.value
        advance(evaluations, [descent], 1)
        steps += 1
        assert descent.value <= before
    assert descent.ended and descent.value < 1e-10
    # With differences for every step it would be 3 and 2 of a step and the start.
    assert evaluations.count < 0.8 * (1 + 5 * steps), (evaluations.count, steps)


def test_a_descent_that_is_taken_up_again_goes_the_same_way():
    start = np.array([0.9, 0.1, 0.1])
    evaluations = valley()
    whole, halves = GaussNewton(evaluations, start), GaussNewton(evaluations, start)
    advance(evaluations, [whole], 4)
    for _ in range(2):
        advance(evaluations, [halves], 2)
    np.testing.assert_array_equal(whole.here, halves.here)


def test_descents_side_by_side_do_not_touch_each_other_and_try_fewer_points():
    starts = [np.array([0.9, 0.1, 0.1]), np.array([0.2, 0.9, 0.9]), np.array([0.5, 0.5, 0.2])]
    evaluations, fewer, alone = valley(), valley(), valley()
    three, two = (
        [GaussNewton(own, start) for start in some] for own, some in ((evaluations, starts), (fewer, starts[:2]))
    )
    advance(evaluations, three, 4)
    advance(fewer, two, 4)
    np.testing.assert_array_equal(three[0].here, two[0].here)
    np.testing.assert_array_equal(three[1].here, two[1].here)
    for start in starts[:2]:
        advance(alone, [GaussNewton(alone, start)], 4)
    assert fewer.count < alone.count


class Basins(Valley):
    """A shallow basin that starts look good in, and a steep one that ends deeper."""

    def evaluate(self, unknowns, *, near=None):
        shallow = np.append(0.2 * (unknowns - 0.15), 0.3)
        steep = np.append(2.0 * (unknowns - 0.85), 0.0)
        share = 1.0 / (1.0 + np.exp(-40.0 * (unknowns[0] - 0.4)))
        return Bowl((1.0 - share) * shallow + share * steep)


def test_the_start_that_comes_down_fastest_wins_the_race():
    starts = [np.array([0.2, 0.2, 0.1]), np.array([0.6, 0.55, 0.6])]
    evaluations = Evaluations(Basins())  # pyright: ignore[reportArgumentType]
    values = [found.objective for found in evaluations.many(starts)]
    assert values[0] < values[1], values
    alone = [gauss_newton(evaluations, start) for start in starts]
    ends = [found.objective for found in evaluations.many(alone)]
    assert ends[1] < 0.5 * ends[0], ends
    np.testing.assert_allclose(race(evaluations, starts, iterations=20), alone[1], atol=1e-6)


def test_searches_repeat_themselves_with_the_seed():
    first, second = (sobol_starts(valley(), 16, 2, seed=2) for _ in range(2))
    np.testing.assert_array_equal(first, second)


def test_jacobian_turns_inwards_at_bounds():
    slopes = jacobian(valley(), np.array([1.0, 1.0, 1.0]))
    away = 1.0 - ANSWER
    exact = [[1, 0, 0], [-6 * away[0], 3, 0], [0.3, 0, np.cos(away[2])]]
    np.testing.assert_allclose(slopes, exact, atol=5e-3)


@dataclass(frozen=True)
class Shaped(Bowl):
    """An evaluation of a yarn that rests in the upper or the lower of two shapes."""

    upper: bool = False

    @property
    def curves(self):
        return (SimpleNamespace(stress=np.array([1.0 + 0.3 * self.upper]), converged=np.array([True])),)

    def rests_lower(self, other):
        return other.upper and not self.upper


class TwoShapes(Valley):
    """Rests in the upper shape from the drawing where the first unknown is small, beside a neighbour as that does."""

    data = SimpleNamespace(stress_scale=1.0)

    def evaluate(self, unknowns, *, near=None):
        upper = unknowns[0] < 0.6 if near is None else near.upper
        return Shaped(super().evaluate(unknowns).residuals + (3.0 if upper else 0.0), upper=bool(upper))


def two_shapes(**others) -> Evaluations:
    return Evaluations(TwoShapes(), **others)  # pyright: ignore[reportArgumentType]


def test_a_descent_stays_in_the_lower_of_two_rest_shapes():
    evaluations = two_shapes()
    end = gauss_newton(evaluations, np.array([0.62, 0.6, 0.5]), iterations=40)
    np.testing.assert_allclose(end, ANSWER, atol=1e-3)
    assert evaluations.objective.evaluate(end).upper and not evaluations.whole(end).upper  # pyright: ignore
    # Derivatives are those of that shape.
    np.testing.assert_allclose(jacobian(evaluations, end), jacobian(valley(), end), atol=1e-9)


def test_yarns_near_each_other_settle_in_the_lower_shape():
    low, high = np.array([0.61, 0.5, 0.5]), np.array([0.59, 0.5, 0.5])
    for one, other in ((low, high), (high, low)):
        evaluations, store = two_shapes(), Memory()
        kept = two_shapes(store=store)
        for own in (evaluations, kept, two_shapes(store=store)):
            before = own.many([high])[0].objective
            slopes = jacobian(own, high)
            assert own.settle(one, other) is high and own.settle(one, other) is None
            np.testing.assert_array_equal(own.residuals(high), Valley().evaluate(high).residuals)
            assert own.residuals(high) @ own.residuals(high) < before
            # Differences from the states of the other shape are not taken for those of this one.
            np.testing.assert_allclose(jacobian(own, high), slopes, atol=1e-9)
        assert (kept.count, kept.solves) == (evaluations.count, evaluations.solves)


def test_yarns_that_rest_in_one_shape_have_nothing_to_settle():
    evaluations = two_shapes()
    assert evaluations.settle(np.array([0.7, 0.5, 0.5]), np.array([0.71, 0.5, 0.5])) is None
    assert evaluations.settle(np.array([0.3, 0.5, 0.5]), np.array([0.31, 0.5, 0.5])) is None


@pytest.mark.parametrize(("place", "change"), [(0.6005, 0.3), (0.3, 0.0)])
def test_ambiguity_sees_a_shape_that_only_neighbours_lead_to(place, change):
    evaluations = two_shapes()
    assert ambiguity(evaluations, np.array([place, 0.4, 0.4])) == pytest.approx(change)


class Memory:
    """A store in memory that counts."""

    def __init__(self):
        self.entries, self.hits = {}, 0

    def find(self, key):
        self.hits += key in self.entries
        return self.entries.get(key)

    def keep(self, key, unknowns, found: Residuals):
        self.entries[key] = found


def test_a_second_run_finds_everything_in_the_store_and_tells_the_same():
    store, start = Memory(), np.array([0.9, 0.1, 0.1])
    first = valley(store=store)
    here = gauss_newton(first, start)
    kept = len(store.entries)
    second = valley(store=store)
    np.testing.assert_array_equal(gauss_newton(second, start), here)
    assert len(store.entries) == kept and store.hits == kept
    assert (second.count, second.solves) == (first.count, first.solves)


def test_an_executor_changes_nothing():
    with ThreadPoolExecutor(2) as pool:
        there = gauss_newton(valley(executor=pool), np.array([0.9, 0.1, 0.1]))
    np.testing.assert_array_equal(there, gauss_newton(valley(), np.array([0.9, 0.1, 0.1])))


def test_spread_tells_what_data_do_not_see():
    slopes = np.array([[1.0, 0.0], [0.0, 0.0], [1.0, 0.0]])
    spread = ParameterSpread.of(("seen", "hidden"), slopes)
    assert spread.shift[0] == pytest.approx(0.01 / np.sqrt(2.0), rel=1e-4)
    assert spread.shift[1] == pytest.approx(1.0)
    fewer = ParameterSpread.of(("one", "other"), np.array([[1.0, 1.0]]))
    np.testing.assert_allclose(fewer.singular, [np.sqrt(2.0), 0.0])
    np.testing.assert_allclose(fewer.shift, np.sqrt(0.5), rtol=1e-4)


def test_a_yarn_reproduces_its_own_data_and_is_found_again():
    """Twin: bending and contact of a stockinette from its own curves, from a start a tenth of the ranges away.

    Rounds that stop on their way, as those of kept periods do, jump by 1 % of the stress between yarns.
    """
    model = yarn_model(build("stockinette"), 60.0, yarn_length=0.01128)
    truth = np.array([0.35, 0.5, 0.4, 0.6, 0.6])
    stretch = np.linspace(0.05, 0.3, 5)

    def curve(direction, stress=None, contraction=None):
        zero = np.ones(len(stretch))
        return UniformCurve(direction, stretch, zero if contraction is None else contraction,
                            zero if stress is None else stress, float(stretch[-1]))  # fmt: skip

    directions = (Direction.WEFT, Direction.WARP)
    nothing, rule = UniformData("twin", tuple(curve(d) for d in directions)), RestRule()
    blank = YarnObjective(model, nothing, rule).evaluate(truth)
    assert blank.failed == 0
    data = UniformData("twin", tuple(curve(c.direction, c.stress, c.contraction) for c in blank.curves))
    evaluations = Evaluations(YarnObjective(model, data, rule))
    assert evaluations.many([truth])[0].objective < 1e-12
    found = gauss_newton(evaluations, truth + np.array([0.0, 0.0, 0.05, -0.04, 0.05]), iterations=8)
    assert evaluations.many([found])[0].objective < 1e-5
    np.testing.assert_allclose(model.values(found)[[2, 3, 4]], model.values(truth)[[2, 3, 4]], rtol=0.05)


def test_derivatives_of_kept_periods_are_those_of_the_shape_that_the_drawing_leads_to():
    """This stockinette has two rest shapes: rounds that stop on their way must stop at the same place for both."""
    model = yarn_model(build("stockinette"), 60.0, yarn_length=0.01128)
    stretch, here = np.array([0.05, 0.1]), np.array([0.35, 0.5, 0.4, 0.6, 0.6])
    blank = UniformData("two", (UniformCurve(Direction.WEFT, stretch, stretch, stretch, 0.1),))
    objective = YarnObjective(model, blank, weights=ErrorWeights(contraction=0.0))
    base = objective.evaluate(here)
    for k in (0, 2, 4):
        there = here + 1e-3 * np.eye(5)[k]
        alone, beside = objective.evaluate(there), objective.evaluate(there, near=base)
        change = np.abs(alone.residuals - base.residuals).max()
        np.testing.assert_allclose(beside.residuals, alone.residuals, rtol=0.0, atol=0.05 * change)


def test_pear_loops_fix_the_bending_that_forces_leave_open():
    """Two readings of force for five unknowns: many yarns have them, one of those bends as the loops did."""
    model = yarn_model(build("stockinette"), 60.0, yarn_length=0.01128)
    truth, stretch = np.array([0.35, 0.5, 0.4, 0.6, 0.6]), np.array([0.05, 0.1])
    forces = ErrorWeights(contraction=0.0)
    bends = tuple(UniformBend(d, 1.0) for d in (Direction.WEFT, Direction.WARP))
    blank = UniformData("twin", (UniformCurve(Direction.WEFT, stretch, stretch, stretch, 0.1),), bends)
    twin = YarnObjective(model, blank, weights=replace(forces, bending=0.01)).evaluate(truth)
    curve = replace(blank.curves[0], stress=twin.curves[0].stress)
    loops = tuple(replace(b, stiffness=float(k)) for b, k in zip(bends, twin.bending, strict=True))
    data = UniformData("twin", (curve,), loops)
    start, found, shifts = truth + np.array([0.0, 0.0, 0.08, 0.0, 0.0]), [], []
    for weight in (0.0, 0.1):
        evaluations = Evaluations(YarnObjective(model, data, weights=replace(forces, bending=weight)))
        assert evaluations.many([truth])[0].objective < 1e-12
        end = gauss_newton(evaluations, start, iterations=5)
        assert np.abs(evaluations.residuals(end)[:2]).max() < 0.01
        found.append(model.values(end)[2] / model.values(truth)[2])
        shifts.append(ParameterSpread.of(model.names, jacobian(evaluations, truth)).shift[2])
    assert abs(found[0] - 1.0) > 0.2 and abs(found[1] - 1.0) < 0.05, found
    assert shifts[0] > 0.1 and shifts[1] < 0.1 * shifts[0], shifts


def test_refuses_a_weight_of_bending_without_loops():
    curve = UniformCurve(Direction.WEFT, np.array([0.1]), np.array([0.1]), np.array([1.0]), 0.1)
    model = yarn_model(build("stockinette"), 60.0)
    with pytest.raises(InputError, match="pear loops"):
        YarnObjective(model, UniformData("line", (curve,)), weights=ErrorWeights(bending=1.0))


def test_coarser_data_keep_the_end_of_the_comfort_range():
    stretch = np.linspace(0.02, 0.4, 20)
    curve = UniformCurve(Direction.WEFT, stretch, 0.2 * stretch, 100 * stretch, 0.13)
    found = coarser(UniformData("line", (curve,)), 7).curves[0]
    assert len(found.stretch) == 7 and 0.13 in found.stretch and found.stretch[-1] == pytest.approx(0.4)
    np.testing.assert_allclose(found.stress, 100 * found.stretch, rtol=1e-9)


def test_a_drawn_in_yarn_is_refined_where_the_shape_is_free():
    free = yarn_model(build("rib-1x1"), 60.0, free_shape=True)
    (start,) = usual_starts(free)
    assert free.draw_in(free.values(start)) == pytest.approx(0.75)
    assert usual_starts(yarn_model(build("rib-1x1"), 60.0)) == []
    assert work_ahead(FitOptions(), 8) > work_ahead(FitOptions(), 5) > FitOptions().starts


def test_refuses_an_unknown_solver():
    with pytest.raises(InputError, match="solver"):
        FitOptions("guess")  # pyright: ignore[reportArgumentType]
