"""Friction of yarns from loading and unloading: that of a twin is found, and its elastic yarn with it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from yarnscale.drawing.library import build
from yarnscale.errors import InputError
from yarnscale.swatches import fabric_fit, uniform_cycle, yarn_friction
from yarnscale.swatches.fabric_fit import fit_with_friction, refitted
from yarnscale.swatches.measurements import Direction, StretchRun, StretchTest, SwatchMeasurements, Unloading
from yarnscale.swatches.objective import YarnObjective
from yarnscale.swatches.uniform_cycle import UniformCycle, check_unloading, measured_cycles
from yarnscale.swatches.uniform_data import UniformCurve, UniformData
from yarnscale.swatches.yarn_estimate import FabricEstimate
from yarnscale.swatches.yarn_fit import FitOptions, fit_yarn
from yarnscale.swatches.yarn_friction import LARGEST, YarnFrictionFit, fit_friction, searched_friction
from yarnscale.swatches.yarn_model import yarn_model
from yarnscale.swatches.yarn_states import YarnCurve, cycled
from yarnscale.yarn.friction import YarnFriction

WIDTH, LENGTH = 0.05, 0.1


def swatch(cycle: UniformCycle, *, returned: bool = True) -> SwatchMeasurements:
    """A swatch without clamps that was loaded and unloaded as in a cycle."""
    length = LENGTH * (1.0 + cycle.stretch)
    force = WIDTH * np.maximum.accumulate(np.maximum(cycle.loading, 0.0))
    back = cycle.unloading > 0.0
    lost = 1.0 - cycle.returned if returned else None
    unloading = Unloading(WIDTH * cycle.unloading[back][::-1], length[back][::-1], lost)
    run = StretchRun("1", force, length, unloading=unloading)
    return SwatchMeasurements("twin", (StretchTest(cycle.direction, WIDTH, (run,)),))


@pytest.mark.slow
def test_friction_of_a_twin_is_found_and_its_yarn_is_not_stiffer_for_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(uniform_cycle, "SAMPLES", 8)
    model, truth = yarn_model(build("stockinette"), 60.0, yarn_length=0.01128), np.array([0.8, 0.3, 0.5, 0.5, 0.5])
    stretch = 0.3 * np.arange(1, 4) / 3
    curve = UniformCurve(Direction.WEFT, stretch, stretch, stretch, 0.3, contraction_measured=False)
    twin = YarnObjective(model, UniformData("twin", (curve,))).evaluate(truth)
    cycle = cycled(twin.rested.cell, Direction.WEFT, 0.3 * np.arange(1, 17) / 16, YarnFriction(0.2))
    assert cycle is not None and cycle.returned < 0.8
    data = UniformData("twin", (replace(curve, stress=np.interp(stretch, cycle.stretch, cycle.loading)),))
    fit = fit_yarn(model, data, options=FitOptions("local", samples=3, iterations=2), start=truth)
    plain = FabricEstimate(swatch(cycle), "measured", SimpleNamespace(), fit, data, None, None)  # type: ignore[arg-type]
    found = fit_with_friction(plain)
    assert found.friction is not None and not found.friction.at_bound
    assert found.friction.coefficient == pytest.approx(0.2, rel=0.1)
    assert found.friction.by_direction[Direction.WEFT] == pytest.approx(found.friction.coefficient, rel=0.05)
    (measured, own), elastic = found.friction.pairs[0], twin.curves[0].stress
    assert own.returned == pytest.approx(measured.returned, abs=0.01)
    # Loading alone makes the yarn stiffer than it is, by the part of friction.
    biased, freed = (np.abs(e.fit.evaluation.curves[0].stress / elastic - 1.0).mean() for e in (plain, found))
    assert biased > 0.1 and freed < 0.3 * biased
    assert found.error.full < 0.03
    assert found.cell.materials[0].contact.friction == found.friction.coefficient


def test_a_measured_loop_is_that_of_the_swatch_times_the_effect_of_the_clamps() -> None:
    stretch = np.linspace(0.0, 0.4, 21)
    cycle = UniformCycle(Direction.WARP, stretch, 100.0 * stretch, 120.0 * np.maximum(stretch - 0.1, 0.0))
    tests, own = swatch(cycle), stretch[1:]
    curve = UniformCurve(Direction.WARP, own, 0.3 * own, 0.8 * 100.0 * own, 0.3)
    (found,) = measured_cycles(tests, UniformData("twin", (curve,)))
    np.testing.assert_allclose(found.stretch, stretch, atol=1e-9)
    np.testing.assert_allclose(found.loading, 0.8 * cycle.loading, atol=1e-6)
    np.testing.assert_allclose(found.unloading[7:], 0.8 * cycle.unloading[7:], atol=1e-6)
    assert found.returned == pytest.approx(0.5 * 120.0 * 0.3**2 / (0.5 * 100.0 * 0.4**2), rel=0.02)
    check_unloading(tests)
    with pytest.raises(InputError, match="friction; expected unloading to its end"):
        check_unloading(swatch(cycle, returned=False))


def test_runs_from_larger_loads_than_the_yarn_can_have_are_no_part_of_a_cycle() -> None:
    stretch = np.linspace(0.0, 0.4, 21)
    small = UniformCycle(Direction.WARP, stretch, 225.0 * stretch, 250.0 * np.maximum(stretch - 0.1, 0.0))
    large = UniformCycle(Direction.WARP, 3.0 * stretch, 3.0 * small.loading, 3.0 * small.unloading)
    (test,), (strong,) = swatch(small).stretch, swatch(large).stretch
    both = SwatchMeasurements("twin", (replace(test, runs=(*test.runs, *strong.runs)),))
    curve = UniformCurve(Direction.WARP, stretch[1:], 0.3 * stretch[1:], small.loading[1:], 0.3)
    (found,) = measured_cycles(both, UniformData("twin", (curve,)))
    assert found.stretch[-1] == pytest.approx(0.4) and found.loading[-1] == pytest.approx(90.0)
    with pytest.raises(InputError, match="none from less than 270 N/m"):
        check_unloading(SwatchMeasurements("twin", (strong,)))


@pytest.mark.parametrize("power", [1, 2])
def test_unloading_that_ends_above_zero_force_is_extrapolated_to_it(power: int) -> None:
    """With 19 % of the force left; a cut instead of a line would lose 4 and 8 % of the work."""
    stretch = np.linspace(0.0, 0.4, 401)
    force = 90.0 * (stretch / 0.4) ** power
    (test,) = swatch(UniformCycle(Direction.WEFT, stretch, force, force)).stretch
    (run,), last = test.runs, int(np.flatnonzero(force >= 0.19 * 90.0)[0])
    back = Unloading(WIDTH * force[last:][::-1], run.length[last:][::-1], 0.1)
    measured = SwatchMeasurements("elastic", (replace(test, runs=(replace(run, unloading=back),)),))
    curve = UniformCurve(Direction.WEFT, stretch[1:], stretch[1:], force[1:], 0.3)
    (found,) = measured_cycles(measured, UniformData("elastic", (curve,)))
    # A curve of the second power is between the line through its last readings and a cut.
    assert found.returned == pytest.approx(1.0, abs={1: 1e-6, 2: 0.025}[power])
    assert found.stretch_left == pytest.approx(0.0, abs={1: 1e-6, 2: 0.1}[power])


@pytest.mark.parametrize("guess", [0.05, 0.2, 0.7])
@pytest.mark.parametrize("friction", [0.02, 0.15, 0.4])
def test_the_search_ends_at_the_friction_of_a_wedge(guess: float, friction: float) -> None:
    """Shares of a wedge, (1 − a μ)/(1 + a μ) with a that falls as in knits."""

    def returned(mu: float) -> float:
        lost = 1.2 * mu / (1.0 + mu)
        return (1.0 - lost) / (1.0 + lost) if mu < 0.6 else np.nan

    tried = searched_friction(returned, returned(friction), guess)
    nearest = min(tried, key=lambda mu: abs(tried[mu] - returned(friction)) if np.isfinite(tried[mu]) else np.inf)
    assert nearest == pytest.approx(friction, abs=0.005)
    assert len(tried) <= 6


def test_more_loss_than_any_friction_gives_ends_at_the_largest() -> None:
    tried = searched_friction(lambda mu: 1.0 - 0.1 * mu, 0.5, 0.2)
    assert max(tried) == LARGEST


STRETCH = 0.3 * np.arange(1, 11) / 10


def wedge(direction: Direction, friction: float, stretch: np.ndarray = STRETCH) -> UniformCycle:
    """A cycle of a fabric of 100 N/m in which friction is a share λ = 0.9 μ of the elastic stress."""
    stretch = np.append(0.0, stretch)
    loading, unloading = (100.0 * stretch * (1.0 + sign * 0.9 * friction) for sign in (1, -1))
    return UniformCycle(direction, stretch, loading, unloading, 0.4 * stretch)


def elastic(direction: Direction, stretch: np.ndarray = STRETCH) -> YarnCurve:
    n = len(stretch)
    return YarnCurve(direction, stretch, 100.0 * stretch, 0.3 * stretch, np.ones(n, bool), (), np.zeros((n, 2)), 0)


def curve_of(cycle: UniformCycle) -> UniformCurve:
    assert cycle.contraction is not None
    return UniformCurve(cycle.direction, cycle.stretch[1:], cycle.contraction[1:], cycle.loading[1:], 0.2)


def following(largest: dict[Direction, float]) -> Callable[..., UniformCycle | None]:
    """Cells of wedges that follow up to some friction by direction, 1 where it is not said."""

    def simulated(_: object, direction: Direction, stretch: np.ndarray, friction: YarnFriction) -> UniformCycle | None:
        followed = friction.coefficient <= largest.get(direction, 1.0)
        return wedge(direction, friction.coefficient, stretch) if followed else None

    return simulated


CELL: Any = SimpleNamespace()
BOTH = (Direction.WEFT, Direction.WARP)


def test_beyond_the_cycle_nothing_is_known_and_curves_stay_as_measured() -> None:
    short, curve = wedge(Direction.WEFT, 0.2, STRETCH[:5]), curve_of(wedge(Direction.WEFT, 0.2))
    # To rounding, the end of the cycle is within it.
    curve = replace(curve, stretch=curve.stretch * (1 + 1e-12))
    fit = YarnFrictionFit(0.2, 0.01, 0.0, {}, (short,), (short,), (elastic(Direction.WEFT),))
    stress, contraction = fit.loading_at(curve)
    assert np.isfinite(stress[:5]).all() and np.isnan(stress[5:]).all() and np.isnan(contraction[5:]).all()
    (free,) = fit.removed_from(UniformData("wedge", (curve,))).curves
    np.testing.assert_allclose(free.stress[:5], 100.0 * STRETCH[:5])
    np.testing.assert_allclose(free.contraction[:5], 0.3 * STRETCH[:5])
    np.testing.assert_array_equal(free.stress[5:], curve.stress[5:])
    np.testing.assert_array_equal(free.contraction[5:], curve.contraction[5:])


def test_the_friction_of_a_wedge_and_its_uncertainty_are_found(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(yarn_friction, "cycled", following({}))
    tried: list[float] = []
    measured = [wedge(along, 0.3) for along in BOTH]
    found = fit_friction(CELL, measured, [elastic(along) for along in Direction], guess=0.29, on_cycle=tried.append)
    assert found is not None and found.matched and not found.at_bound
    assert found.coefficient == pytest.approx(0.3, abs=0.005)
    change = wedge(BOTH[0], found.coefficient + 1e-4).returned - wedge(BOTH[0], found.coefficient - 1e-4).returned
    assert found.uncertainty == pytest.approx(0.02 * 2e-4 / -change, rel=1e-3)
    assert {cycle.direction for cycle in found.simulated} == set(Direction)
    # Two directions for every coefficient, and once the one that was not unloaded.
    assert len(tried) == 2 * len(set(tried)) + 1 and tried[-1] == found.coefficient


def test_a_coefficient_counts_where_all_directions_follow(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(yarn_friction, "cycled", following({Direction.WARP: 0.25}))
    found = fit_friction(CELL, [wedge(along, 0.35) for along in BOTH], [elastic(along) for along in BOTH])
    assert found is not None and 0.2 <= found.coefficient <= 0.25
    assert {cycle.direction for cycle in found.simulated} == set(BOTH)
    assert not found.matched
    assert found.missed == pytest.approx(found.simulated[0].returned - wedge(BOTH[0], 0.35).returned)
    monkeypatch.setattr(yarn_friction, "cycled", following({Direction.WARP: 0.0}))
    assert fit_friction(CELL, [wedge(along, 0.35) for along in BOTH], [elastic(along) for along in BOTH]) is None


@dataclass(frozen=True)
class Fit:
    """A fit of a yarn as far as friction asks for it."""

    evaluation: Any
    model: Any = None
    options: Any = None
    evaluations: int = 5
    solves: int = 50
    cpu_seconds: float = 1.0
    seconds: float = 1.0
    ambiguity: float = 0.0


def fitted() -> FabricEstimate:
    """An estimate of a fabric whose weft was unloaded, with a cell that is a stub."""
    rested = SimpleNamespace(relaxed=True, cell=CELL, stress=np.zeros(3))
    evaluation = SimpleNamespace(curves=(elastic(Direction.WEFT),), rested=rested, unknowns=np.zeros(1), failed=0)
    measured = wedge(Direction.WEFT, 0.2)
    data = UniformData("wedge", (curve_of(measured),))
    evaluation.errors = data.errors([data.curves[0].stress], [data.curves[0].contraction])
    membrane = SimpleNamespace(assumed_contraction=False)
    shell = SimpleNamespace(uniform_data=lambda follow: data, membrane=membrane)
    fit: Any = Fit(evaluation)
    return FabricEstimate(swatch(measured), "measured", shell, fit, data, None, None)  # type: ignore[arg-type]


def test_where_the_cell_cannot_follow_there_is_a_warning(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(yarn_friction, "cycled", lambda *_: None)
    found = fit_with_friction(fitted())
    assert found.friction is None
    (warning,) = found.warnings
    assert "cannot follow the measured cycle" in warning and "friction was not fitted" in warning
    assert found.fit.cpu_seconds > 1.0 and found.fit.seconds > 1.0


def test_where_the_cell_of_a_later_yarn_cannot_follow_the_one_before_stays(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(yarn_friction, "cycled", following({}))
    targets = []

    def again(model: object, data: UniformData, **_: object) -> Fit:
        targets.append(data)
        monkeypatch.setattr(yarn_friction, "cycled", lambda *_: None)
        return Fit(fitted().fit.evaluation)

    monkeypatch.setattr(fabric_fit, "fit_yarn", again)
    found = fit_with_friction(fitted())
    assert found.friction is not None and found.friction.rounds == 0
    assert found.friction.coefficient == pytest.approx(0.2, abs=0.005)
    np.testing.assert_allclose(targets[0].curves[0].stress, 100.0 * STRETCH, rtol=0.01)
    assert found.warnings == found.remarks and "yarn and friction are those before" in found.remarks[0]
    assert found.fit.evaluations == 10 and found.fit.cpu_seconds > 2.0


@pytest.mark.parametrize("follows", [True, False])
def test_a_yarn_that_is_fitted_again_has_its_own_friction_or_none(
    monkeypatch: pytest.MonkeyPatch, follows: bool
) -> None:
    monkeypatch.setattr(yarn_friction, "cycled", following({} if follows else {Direction.WEFT: 0.0}))
    first, clean = fitted(), fitted().measured
    other = wedge(Direction.WEFT, 0.2)
    old = YarnFrictionFit(0.2, 0.01, 0.0, {}, (other,), (other,), (elastic(Direction.WEFT),), rounds=2)
    cloth: Any = SimpleNamespace()
    monkeypatch.setattr(fabric_fit, "without_own_clamps", lambda *_: clean)
    monkeypatch.setattr(fabric_fit, "fit_yarn", lambda *_, **__: Fit(first.fit.evaluation))
    model: Any = SimpleNamespace()
    first = replace(first, cloth=cloth, friction=old, fit=replace(first.fit, model=model))
    found = refitted(first)
    assert found.clamps == "cloth" and found.cloth is None
    if follows:
        assert found.friction is not None and found.friction is not old and found.friction.rounds == 0
        assert found.friction.coefficient == pytest.approx(0.2, abs=0.005) and not found.warnings
    else:
        assert found.friction is None and "was not fitted" in found.warnings[-1]
        # Where friction was sought in vain before, that is still said.
        assert refitted(replace(first, friction=None, remarks=("in vain",))).warnings == ("in vain",)
