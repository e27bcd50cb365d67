"""The headline of an estimate: the error against the measurement, each stage's own beside it, and warnings."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from yarnscale.swatches.construction import KnownConstruction
from yarnscale.swatches.measurements import Direction, StretchRun, StretchTest, SwatchMeasurements
from yarnscale.swatches.objective import errors_of
from yarnscale.swatches.uniform_data import UniformCurve, UniformData
from yarnscale.swatches.yarn_estimate import FabricEstimate
from yarnscale.swatches.yarn_states import YarnCurve

STRETCH = np.linspace(0.05, 0.5, 10)
STRESS = 100.0 * STRETCH


def data(factor: float) -> UniformData:
    """Both directions, as stiff as measured times a factor."""
    curve = UniformCurve(Direction.WEFT, STRETCH, 0.4 * STRETCH, factor * STRESS, 0.3)
    return UniformData("fabric", (curve, replace(curve, direction=Direction.WARP)))


def yarn(direction: Direction, factor: float, *, resting: int = 10) -> YarnCurve:
    converged = np.arange(10) < resting
    none = np.zeros((10, 2))
    return YarnCurve(direction, STRETCH, factor * STRESS, 0.4 * STRETCH, converged, (), none, 0)


def estimate(
    *,
    shell: float,
    weft: float,
    warp: float,
    follow: str,
    clamps: float = 1.0,
    assumed: bool = False,
    left: float = 0.0,
    ambiguity: float = 0.0,
) -> FabricEstimate:
    """An estimate whose shell and yarn are stiffer than the measurement by factors."""
    load = clamps * np.append(0.0, STRESS)
    run = StretchRun("1", 0.06 * load, 0.1 * (1 + np.append(0.0, STRETCH)))
    tests = tuple(StretchTest(direction, 0.06, (run,)) for direction in (Direction.WEFT, Direction.WARP))
    curves = (yarn(Direction.WEFT, weft), yarn(Direction.WARP, warp))
    followed = data(shell if follow == "shell" else 1.0)
    rested = SimpleNamespace(stress=np.array([left, 0.0, 0.0]), relaxed=True)
    evaluation = SimpleNamespace(curves=curves, errors=errors_of(curves, followed), failed=0, rested=rested)
    membrane = SimpleNamespace(assumed_contraction=assumed)
    fitted = SimpleNamespace(uniform_data=lambda follow: data(shell if follow == "shell" else 1.0), membrane=membrane)
    fit = SimpleNamespace(evaluation=evaluation, ambiguity=ambiguity)
    measurements = SwatchMeasurements("fabric", tests)
    return FabricEstimate(measurements, follow, fitted, fit, data(1.0), None, None, {})  # type: ignore


def relative(factor: float) -> float:
    """Mean error of σ/(1 + s) in the comfort range over its largest value, for stress off by a factor."""
    second = STRESS / (1 + STRETCH)
    used = STRETCH <= 0.3 + 1e-9
    return abs(factor - 1.0) * second[used].mean() / np.interp(0.3, STRETCH, second)


def test_the_headline_is_the_error_against_the_measurement():
    found = estimate(shell=1.4, weft=1.4, warp=1.45, follow="shell")
    assert found.error.directions[Direction.WEFT].comfort == pytest.approx(relative(1.4))
    assert found.error.directions[Direction.WARP].comfort == pytest.approx(relative(1.45))
    assert found.error.comfort == pytest.approx(0.5 * (relative(1.4) + relative(1.45)))
    assert found.error.compression == pytest.approx(0.0, abs=1e-12)
    assert found.shell_error.comfort == pytest.approx(relative(1.4))
    assert found.yarn_error.comfort < 0.03
    direction, stretch, own, measured = found.largest_deviation or (None, 0.0, 0.0, 0.0)
    assert direction is Direction.WARP and stretch == pytest.approx(0.3)
    assert (own, measured) == (pytest.approx(43.5), pytest.approx(30.0))


def test_a_shell_that_is_the_culprit_is_warned_of():
    (warning,) = estimate(shell=1.4, weft=1.4, warp=1.45, follow="shell").warnings
    assert "--follow measured" in warning and f"{100 * relative(1.4):.0f} % off the measurement" in warning
    assert not estimate(shell=1.1, weft=1.4, warp=1.4, follow="shell").warnings
    assert not estimate(shell=1.4, weft=1.0, warp=1.0, follow="measured").warnings
    (warning,) = estimate(shell=1.4, weft=1.0, warp=1.0, follow="measured", clamps=1.25).warnings
    assert "clamps change the force by up to 20 %" in warning
    (warning,) = estimate(shell=1.0, weft=1.0, warp=1.0, follow="measured", assumed=True).warnings
    assert "contraction was not measured" in warning
    (warning,) = estimate(shell=1.0, weft=1.0, warp=1.0, follow="measured", left=7.0).warnings
    assert "coarse stress of 7 N/m" in warning
    (warning,) = estimate(shell=1.0, weft=1.0, warp=1.0, follow="measured", ambiguity=0.08).warnings
    assert "is not unique" in warning and "differ by 8 %" in warning


def test_clamps_have_no_effect_where_no_state_is_in_the_comfort_range():
    found = estimate(shell=1.0, weft=1.0, warp=1.0, follow="measured", clamps=1.25)
    beyond = tuple(replace(curve, comfort_stretch=0.01) for curve in found.measured.curves)
    assert found.clamp_effect == pytest.approx(0.2)
    assert replace(
        found, measured=UniformData("fabric", (replace(beyond[0], comfort_stretch=0.3), beyond[1]))
    ).clamp_effect == pytest.approx(0.2)
    assert replace(found, measured=UniformData("fabric", beyond)).clamp_effect == 0.0


def test_states_that_are_not_at_rest_are_left_out_of_errors():
    curves = (yarn(Direction.WEFT, 1.2, resting=4), yarn(Direction.WARP, 1.0, resting=0))
    errors = errors_of(curves, data(1.0))
    second = (STRESS / (1 + STRETCH))[:4]
    scale = np.interp(0.3, STRETCH, STRESS / (1 + STRETCH))
    assert errors.comfort == pytest.approx(0.2 * second.mean() / scale)
    assert errors.summary()["directions"]["warp"]["comfort"] is None


def test_what_the_data_do_not_tell_is_said():
    found = estimate(shell=1.0, weft=1.0, warp=1.0, follow="measured")
    found.fit.spread = SimpleNamespace(names=("k_s1", "k_b"), shift=np.array([0.9, 0.1]))  # type: ignore
    said = " | ".join(found.unknown)
    for words in (
        "k_s1: other",
        "along the bias",
        "along weft, warp",
        "bending: it was not measured",
        "was weighed",
        "size of the stitches",
    ):
        assert words in said
    assert "k_b" not in said
    known = KnownConstruction(wales=1400, courses=2000, area_density=0.2)
    told = replace(found, measurements=found.measurements.knowing(known))
    assert not any("weighed" in sentence or "stitches" in sentence for sentence in told.unknown)
