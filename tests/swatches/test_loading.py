"""Loadings out of logs: the known curve comes back whatever the rate, noise, slack, offset, unloading and cycles."""

from __future__ import annotations

import numpy as np
import pytest

from yarnscale.errors import InputError
from yarnscale.swatches.loading import loading
from yarnscale.swatches.measurements import StretchRun

REST = 0.1


def force_of(stretch):
    """A knit that stiffens: 5.4 N at a stretch of 0.7."""
    return 0.35 * (np.exp(4.0 * np.maximum(stretch, 0.0)) - 1.0)


def log(stretch, *, noise=0.0, offset=0.0, seed=0):
    random = np.random.default_rng(seed)
    return force_of(stretch) + offset + noise * random.normal(size=len(stretch)), REST * (1.0 + stretch)


def error(found, *, least=0.05, largest=0.65) -> float:
    """Largest error of the curve, as stretch: what force is off over the slope of the curve there."""
    run = StretchRun("1", found.force, found.length)
    stretch = np.linspace(least, largest, 25)
    slope = 4.0 * (force_of(stretch) + 0.35)
    return float((np.abs(np.interp(stretch, run.stretch, run.force) - force_of(stretch)) / slope).max())


@pytest.mark.parametrize("readings", [60, 500, 5000, 100_000])
@pytest.mark.parametrize(
    ("noise", "offset", "slack"),
    [
        (0.0, 0.0, 0.0),
        (0.005, 0.0, 0.0),
        (0.005, 0.1, 0.1),
        (0.005, -0.1, 0.05),
        (0.0, 0.0, 0.1),
        (0.02, 0.0, 0.0),
    ],
)
def test_the_curve_comes_back_at_any_rate(readings, noise, offset, slack):
    found = loading(*log(np.linspace(-slack, 0.7, readings), noise=noise, offset=offset))
    assert len(found.force) <= 202
    # A stretch of one percent, or what noise of the force is at the slope of the toe over a few readings.
    assert error(found) < 0.013 + 3.0 * noise / 1.4 * np.sqrt(60 / readings)
    assert any("slack" in remark for remark in found.remarks) == (slack > 0)


def test_pretension_is_extrapolated_to_zero_force():
    start = np.log(1.0 + 0.05 / 0.35) / 4.0
    for readings in (30, 1000, 50_000):
        force, length = log(np.linspace(start, 0.7, readings), noise=0.003)
        run = StretchRun("1", *(lambda found: (found.force, found.length))(loading(force, length)))
        assert run.rest_length == pytest.approx(REST, rel=0.01)


def test_an_offset_that_cannot_be_a_pretension_is_taken_off():
    for readings in (200, 5000):
        force, length = log(np.linspace(0.0, 1.0, readings), noise=0.01, offset=1.5)
        found = loading(force, length)
        assert StretchRun("1", found.force, found.length).rest_length == pytest.approx(REST, rel=0.02)
        assert "offset" in found.remarks[0]


def test_slack_is_found_in_a_curve_that_stiffens_much():
    """Hundreds of times stiffer at its end than in its toe, which alone shows where slack ends."""
    stretch = np.linspace(-0.1, 1.4, 3000)
    found = loading(*log(stretch, noise=0.003, offset=2.0))
    assert StretchRun("1", found.force, found.length).rest_length == pytest.approx(REST, rel=0.015)


def test_a_stiffening_toe_is_no_slack():
    stretch = np.linspace(0.0, 0.7, 2000)
    found = loading(30.0 * stretch**3, REST * (1.0 + stretch))
    assert StretchRun("1", found.force, found.length).rest_length == pytest.approx(REST, rel=1e-3)
    assert not found.remarks


def test_few_readings_stay_as_they_are():
    force, length = np.array([0.0, 0.5, 1.0, 2.0, 4.0]), np.array([0.1, 0.11, 0.118, 0.13, 0.15])
    found = loading(force, length, 0.5 * length)
    np.testing.assert_array_equal(found.force, force)
    np.testing.assert_array_equal(found.length, length)
    np.testing.assert_array_equal(found.width, 0.5 * length)


def test_a_force_that_falls_by_noise_is_averaged():
    found = loading(np.array([0.5, 0.49, 1.0, 2.0]), np.array([0.1052, 0.1053, 0.1094, 0.115]))
    np.testing.assert_allclose(found.force, [0.495, 0.495, 1.0, 2.0])


def test_unloading_is_left_out():
    up = np.linspace(0.0, 0.6, 200)
    force, length = log(np.concatenate([up, up[::-1]]), noise=0.003)
    # Hysteresis: unloading at a lower force.
    force[200:] *= 0.7
    found = loading(force, length)
    assert error(found, largest=0.55) < 0.01
    assert "200 readings after the loading" in found.remarks[0] or "199 readings" in found.remarks[0]


def test_few_readings_of_unloading_are_left_out_too():
    force = np.array([0.0, 0.5, 1.0, 2.0, 1.2, 0.6, 0.2])
    length = np.array([0.1, 0.11, 0.118, 0.13, 0.126, 0.118, 0.108])
    found = loading(force, length)
    np.testing.assert_array_equal(found.force, force[:4])
    assert "3 readings after the loading" in found.remarks[0]


@pytest.mark.parametrize(("cycle", "factor"), [("first", 1.0), ("last", 0.95)])
def test_of_cycles_the_first_or_the_last_counts(cycle, factor):
    up = np.linspace(0.0, 0.6, 300)
    stretch = np.concatenate([up, up[::-1], up, up[::-1], up])
    force, length = log(stretch, noise=0.002)
    force[1200:] *= 0.95
    found = loading(force, length, cycle=cycle)
    np.testing.assert_allclose(
        np.interp(REST * 1.5, found.length, found.force), factor * force_of(np.array([0.5]))[0], rtol=0.02
    )
    assert cycle in found.remarks[0] and "3 loadings" in found.remarks[0]


def test_a_cycle_to_a_small_force_is_not_the_loading():
    small, large = np.linspace(0.0, 0.2, 100), np.linspace(0.0, 0.6, 300)
    found = loading(*log(np.concatenate([small, small[::-1], large]), noise=0.002))
    assert found.length[-1] == pytest.approx(0.16, rel=0.01)


def test_a_log_that_begins_with_unloading():
    up = np.linspace(0.0, 0.6, 300)
    found = loading(*log(np.concatenate([up[::-1], up]), noise=0.002))
    assert error(found, largest=0.55) < 0.01


def test_a_break_ends_the_loading():
    force, length = log(np.linspace(0.0, 0.8, 400))
    force[350:] = 0.02
    found = loading(force, length)
    assert found.length[-1] == pytest.approx(length[349], rel=0.01)


def test_the_range_that_is_used_keeps_the_resolution():
    """A log that goes on to a break at a hundred times the force of use."""
    stretch = np.linspace(0.0, 1.8, 200_000)
    found = loading(*log(stretch, noise=0.005), largest_force=2.0)
    assert error(found, largest=0.45) < 0.01 and found.force[-1] < 2.2


def test_no_loading_is_refused():
    for force, length in (
        ([1.0, 1.0, 1.0], [0.1, 0.11, 0.12]),
        ([3.0, 2.0, 1.0], [0.12, 0.11, 0.1]),
        ([1.0], [0.1]),
    ):
        with pytest.raises(InputError, match="loading"):
            loading(np.array(force), np.array(length))
