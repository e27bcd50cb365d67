"""Friction of yarns from loading and unloading: that of a twin is found, and its elastic yarn with it."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from yarnscale.drawing.library import build
from yarnscale.errors import InputError
from yarnscale.swatches import uniform_loop
from yarnscale.swatches.fabric_fit import with_friction
from yarnscale.swatches.measurements import Direction, StretchRun, StretchTest, SwatchMeasurements, Unloading
from yarnscale.swatches.objective import YarnObjective
from yarnscale.swatches.uniform_data import UniformCurve, UniformData
from yarnscale.swatches.uniform_loop import UniformLoop, check_loops, measured_loops
from yarnscale.swatches.yarn_estimate import FabricEstimate
from yarnscale.swatches.yarn_fit import FitOptions, fit_yarn
from yarnscale.swatches.yarn_friction import LARGEST, searched_friction
from yarnscale.swatches.yarn_model import yarn_model
from yarnscale.swatches.yarn_states import cycled
from yarnscale.yarn.friction import YarnFriction

WIDTH, LENGTH = 0.05, 0.1


def swatch(loop: UniformLoop, *, returned: bool = True) -> SwatchMeasurements:
    """A swatch without clamps that was loaded and unloaded as in a loop."""
    length = LENGTH * (1.0 + loop.stretch)
    force = WIDTH * np.maximum.accumulate(np.maximum(loop.loading, 0.0))
    back = loop.unloading > 0.0
    lost = 1.0 - loop.returned if returned else None
    unloading = Unloading(WIDTH * loop.unloading[back][::-1], length[back][::-1], lost)
    run = StretchRun("1", force, length, unloading=unloading)
    return SwatchMeasurements("twin", (StretchTest(loop.direction, WIDTH, (run,)),))


@pytest.mark.slow
def test_friction_of_a_twin_is_found_and_its_yarn_is_not_stiffer_for_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(uniform_loop, "SAMPLES", 8)
    model, truth = yarn_model(build("stockinette"), 60.0, yarn_length=0.01128), np.array([0.8, 0.3, 0.5, 0.5, 0.5])
    stretch = 0.3 * np.arange(1, 4) / 3
    curve = UniformCurve(Direction.WEFT, stretch, stretch, stretch, 0.3, contraction_measured=False)
    twin = YarnObjective(model, UniformData("twin", (curve,))).evaluate(truth)
    loop = cycled(twin.rested.cell, Direction.WEFT, 0.3 * np.arange(1, 17) / 16, YarnFriction(0.2))
    assert loop is not None and loop.returned < 0.8
    data = UniformData("twin", (replace(curve, stress=np.interp(stretch, loop.stretch, loop.loading)),))
    fit = fit_yarn(model, data, options=FitOptions("local", samples=3, iterations=2), start=truth)
    plain = FabricEstimate(swatch(loop), "measured", SimpleNamespace(), fit, data, None, None)  # type: ignore[arg-type]
    found = with_friction(plain)
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
    loop = UniformLoop(Direction.WARP, stretch, 100.0 * stretch, 120.0 * np.maximum(stretch - 0.1, 0.0))
    tests, own = swatch(loop), stretch[1:]
    curve = UniformCurve(Direction.WARP, own, 0.3 * own, 0.8 * 100.0 * own, 0.3)
    (found,) = measured_loops(tests, UniformData("twin", (curve,)))
    np.testing.assert_allclose(found.stretch, stretch, atol=1e-9)
    np.testing.assert_allclose(found.loading, 0.8 * loop.loading, atol=1e-6)
    np.testing.assert_allclose(found.unloading[7:], 0.8 * loop.unloading[7:], atol=1e-6)
    assert found.returned == pytest.approx(0.5 * 120.0 * 0.3**2 / (0.5 * 100.0 * 0.4**2), rel=0.02)
    check_loops(tests)
    with pytest.raises(InputError, match="friction; expected unloading to its end"):
        check_loops(swatch(loop, returned=False))


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
