"""Measured runs: zero force, means and spreads, and what is refused."""

from __future__ import annotations

import numpy as np
import pytest

from yarnscale.errors import InputError
from yarnscale.swatches.loading_start import at_zero_force
from yarnscale.swatches.measurements import (
    BendTest,
    BiaxialTest,
    Direction,
    StretchRun,
    StretchTest,
    SwatchMeasurements,
    YarnComposition,
)

FORCE = np.arange(0.5, 6.0, 0.5)


def run(name: str = "1", scale: float = 1.0, rest: float = 0.1) -> StretchRun:
    stretch = scale * (0.2 * FORCE - 0.01 * FORCE**2)
    return StretchRun(name, FORCE, rest * (1 + stretch), 0.06 * (1 - 0.4 * stretch))


def test_zero_force_is_exact_for_parabolas_and_lines():
    assert at_zero_force(FORCE, 0.1 + 0.02 * FORCE - 0.001 * FORCE**2) == pytest.approx(0.1, rel=1e-12)
    assert at_zero_force(FORCE, 0.1 + 0.02 * FORCE) == pytest.approx(0.1, rel=1e-9)


def test_zero_force_takes_a_line_where_a_parabola_would_bend_the_wrong_way():
    length = 0.1 + 0.004 * FORCE**2
    assert at_zero_force(FORCE, length) == pytest.approx(np.polyfit(FORCE[:5], length[:5], 1)[-1])


def test_readings_at_zero_force_are_taken_as_they_are():
    assert at_zero_force(np.append(0.0, FORCE), np.append(0.2, 0.3 + FORCE)) == 0.2


def test_strain_is_relative_to_the_rest_length_of_the_same_run():
    for rest in (0.1, 0.13):
        found = run(rest=rest)
        assert found.rest_length == pytest.approx(rest, rel=1e-12)
        np.testing.assert_allclose(found.stretch, 0.2 * FORCE - 0.01 * FORCE**2, rtol=1e-10)
        np.testing.assert_allclose(found.contraction, 0.4 * found.stretch, rtol=1e-9)


def test_runs_are_averaged_at_equal_force_with_their_spread():
    test = StretchTest(Direction.WEFT, 0.06, (run("1", 0.9), run("2", 1.1), run("3", 1.0, rest=0.12)))
    curve = test.curve
    np.testing.assert_allclose(curve.load[1:], FORCE / 0.06)
    np.testing.assert_allclose(curve.stretch[1:], 0.2 * FORCE - 0.01 * FORCE**2, rtol=1e-6)
    np.testing.assert_allclose(curve.stretch_spread[1:], 0.1 * curve.stretch[1:], rtol=1e-6)
    assert curve.load[0] == curve.stretch[0] == 0.0
    assert test.swatch_length == pytest.approx((0.1 + 0.1 + 0.12) / 3)
    assert test.gauge_width == pytest.approx(0.06)


def test_runs_of_other_forces_count_over_the_common_range():
    other = StretchRun("2", FORCE[1:8] + 0.1, 0.1 * (1 + 0.2 * (FORCE[1:8] + 0.1) - 0.01 * (FORCE[1:8] + 0.1) ** 2))
    curve = StretchTest(Direction.WARP, 0.06, (run(), other)).curve
    assert curve.load[-1] == pytest.approx(4.1 / 0.06)
    assert curve.contraction is None  # one run did not measure it
    force = 0.06 * curve.load
    np.testing.assert_allclose(curve.stretch, 0.2 * force - 0.01 * force**2, atol=3e-3)


def test_a_curve_ends_at_a_load():
    curve = StretchTest(Direction.WEFT, 0.06, (run(),)).curve.up_to(40.0)
    assert curve.load[-1] == 40.0
    assert curve.stretch[-1] == pytest.approx(0.2 * 2.4 - 0.01 * 2.4**2, rel=1e-2)
    assert curve.stretch_at(1e9) == curve.stretch[-1]


@pytest.mark.parametrize(
    ("force", "length", "word"),
    [
        ([1.0, 2.0, 1.5], [0.1, 0.11, 0.12], "reading 3"),
        ([1.0, 2.0], [0.1, 0.11], "readings"),
        ([1.0, 2.0, 3.0], [0.1, -0.11, 0.12], "length"),
        ([1.0, 2.0, np.nan], [0.1, 0.11, 0.12], "force"),
        ([1.0, 1.0, 1.0], [0.1, 0.11, 0.12], "grows"),
        ([1.0, 2.0, 3.0], [0.1, 0.11], "readings"),
    ],
)
def test_runs_that_are_none_are_refused(force, length, word):
    with pytest.raises(InputError, match=word):
        StretchRun("a", np.array(force), np.array(length))


def test_fabrics_are_checked_as_a_whole():
    test = StretchTest(Direction.WEFT, 0.06, (run(),))
    bend = BendTest(Direction.WEFT, 0.1, 0.06, np.array([0.01]), np.array([2.0]))
    with pytest.raises(InputError, match="stretch or bend"):
        SwatchMeasurements("empty")
    with pytest.raises(InputError, match="one test"):
        SwatchMeasurements("twice", (test, test))
    with pytest.raises(InputError, match="area_density"):
        SwatchMeasurements("weightless", bend=(bend,))
    with pytest.raises(InputError, match="sum of 1"):
        SwatchMeasurements("half", (test,), yarns=(YarnComposition("polyester", 72.0, 75, 0.5),))
    with pytest.raises(InputError, match="2/π"):
        BendTest(Direction.WEFT, 0.1, 0.06, np.array([0.07]), np.array([2.0]))


def test_a_direction_that_is_left_out_takes_biaxial_tests_along():
    tests = tuple(StretchTest(along, 0.06, (run(),)) for along in Direction)
    fabric = SwatchMeasurements("all", tests, biaxial=BiaxialTest(np.full((3, 2), 0.1), np.full((3, 2), 5.0)))
    assert fabric.only(Direction.WEFT, Direction.WARP).biaxial is fabric.biaxial
    assert fabric.only(Direction.WEFT, Direction.BIAS).biaxial is None


def test_yarns_of_plated_fabric():
    yarns = (
        YarnComposition("polyester", 72.0, 75, 0.9, stiffness=3.0),
        YarnComposition("spandex", 20.0, 1, 0.1, stiffness=0.1),
    )
    fabric = SwatchMeasurements("DKIN8", (StretchTest(Direction.WEFT, 0.06, (run(),)),), yarns=yarns)
    assert fabric.stiffest_yarn == 3.0


def test_a_curve_cut_at_a_reading_that_rounding_moves_rises_everywhere():
    runs = tuple(run(name, scale) for name, scale in (("1", 1.0), ("2", 1.05)))
    curve = StretchTest(Direction.WEFT, 0.06, runs).curve
    for factor in (1.0 + 2e-16, 1.0 - 1e-16, 1.0 + 1e-12):
        cut = curve.up_to(float(curve.load[5]) * factor)
        assert (np.diff(cut.stretch) > 1e-6).all() and np.isfinite(cut.load_at(cut.stretch)).all()
