"""The headline of an estimate: the error against the measurement, each stage's own beside it, and warnings."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from yarnscale.swatches.construction import KnownConstruction
from yarnscale.swatches.measurements import Direction, StretchRun, StretchTest, SwatchMeasurements
from yarnscale.swatches.objective import errors_of
from yarnscale.swatches.uniform_cycle import UniformCycle
from yarnscale.swatches.uniform_data import UniformCurve, UniformData
from yarnscale.swatches.yarn_estimate import FabricEstimate
from yarnscale.swatches.yarn_friction import YarnFrictionFit
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


def rubbing(*along: Direction, missed: float = 0.0, coefficient: float = 0.25) -> YarnFrictionFit:
    """Friction with which loading takes 1.2 and unloading 0.8 times the elastic stress, as measured but for a share."""
    stretch, elastic = np.append(0.0, STRETCH), np.append(0.0, STRESS)
    measured = UniformCycle(Direction.WEFT, stretch, 1.2 * elastic, 0.7 * elastic)
    simulated = tuple(UniformCycle(d, stretch, 1.2 * elastic, 0.8 * elastic, 0.4 * stretch) for d in along)
    curves = (yarn(Direction.WEFT, 1.0), yarn(Direction.WARP, 1.0))
    alone = {Direction.WEFT: coefficient}
    return YarnFrictionFit(coefficient, 0.01, missed, alone, (measured,), simulated, curves, rounds=1)


def test_with_friction_errors_are_those_of_loading_and_stages_are_called_without_it():
    plain = replace(estimate(shell=1.0, weft=1.0, warp=1.0, follow="measured"), short=None)
    found = replace(plain, friction=rubbing(Direction.WEFT, Direction.WARP))
    assert found.error.comfort == pytest.approx(relative(1.2)) and found.failed == 0 and not found.warnings
    names = [name for name, _, _ in found.error_rows()]
    assert names[0] == "yarn against the measurement"
    assert names[-1] == "stage 2: yarn against the measurement, both without friction"
    assert [name for name, _, _ in plain.error_rows()][-1] == "stage 2: yarn against the measurement"
    assert found.friction is not None
    summary = found.friction.summary(found.measured)
    assert (summary["coefficient"], summary["missed"], summary["rounds"]) == (0.25, 0.0, 1)
    weft = summary["directions"]["weft"]  # type: ignore[index]
    assert weft["returned"] == pytest.approx(0.8 / 1.2) and weft["measured_returned"] == pytest.approx(0.7 / 1.2)
    second = np.append(0.0, STRESS / (1 + STRETCH))
    scale = found.measured.stress_scale
    assert weft["unloading_error"] == pytest.approx(0.1 * second.mean() / scale)


def test_a_direction_that_is_not_followed_with_friction_is_warned_of_and_counts_as_failed():
    found = estimate(shell=1.0, weft=1.0, warp=1.0, follow="measured")
    found = replace(found, friction=rubbing(Direction.WEFT), short=None)
    assert found.failed == 10 and next(iter(found.error_rows()))[2] == 10
    (warning,) = found.warnings
    assert "cannot be loaded and unloaded along warp" in warning


def test_the_held_out_direction_is_predicted_with_friction():
    found = estimate(shell=1.0, weft=1.0, warp=1.0, follow="measured")
    weft, warp = found.measured.curves
    ahead = SimpleNamespace(curves=(yarn(Direction.WARP, 1.0),), failed=0)
    apart = {"measured": UniformData("fabric", (weft,)), "held_out": UniformData("fabric", (warp,))}
    found = replace(found, **apart, prediction=ahead)
    assert found.held_out_error is not None and found.held_out_error.comfort == pytest.approx(0.0, abs=1e-12)
    found = replace(found, friction=rubbing(Direction.WEFT, Direction.WARP))
    assert found.held_out_error is not None and found.held_out_error.comfort == pytest.approx(relative(1.2))


@pytest.mark.parametrize(
    ("missed", "coefficient", "page", "warning"),
    [
        (0.0, 0.25, "returns as much of the work of loading as was measured", None),
        (0.0, 0.8, "returns as much of the work of loading as was measured", None),
        (0.12, 0.25, "returns 12.0 % more of the work of loading than was measured", "12.0 % of the work more than"),
        (-0.05, 0.001, "returns 5.0 % less of the work of loading than was measured", "5.0 % of the work less than"),
        (0.12, 0.8, "12.0 % more of the work", "more of the work than was measured at any friction up to 0.8"),
    ],
)
def test_page_and_warnings_say_whether_the_work_was_matched(missed, coefficient, page, warning):
    plt = pytest.importorskip("matplotlib.pyplot")
    from yarnscale.show.estimate import _cycle, _friction

    found = estimate(shell=1.0, weft=1.0, warp=1.0, follow="measured")
    friction = rubbing(Direction.WEFT, Direction.WARP, missed=missed, coefficient=coefficient)
    found = replace(found, friction=friction, short=None)
    assert [warning in said for said in found.warnings] == ([] if warning is None else [True])
    section = _friction(friction, found)
    assert page in section.text[0]
    (row,) = section.tables[0].rows
    assert row[0] == "weft" and str(row[2]).startswith("66.7") and str(row[3]).startswith("58.3")
    figure, axes = plt.subplots()
    _cycle(axes, found, found.measured.curves[0], 2.0)
    (line,) = axes.lines
    assert line.get_ydata().max() == pytest.approx(2.0 * 1.2 * STRESS[-1])
    plt.close(figure)
