"""Distances of segments over explicit periodic images."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from yarnscale.drawing.curves import PeriodicCurve, pattern_from_curves
from yarnscale.drawing.library import build, names
from yarnscale.errors import InputError
from yarnscale.files.pyp import read_pyp
from yarnscale.yarn.clearance import check_clearance, closest_approach


def straight(axis: int, across: float, height: float, length: float, count: int = 8) -> PeriodicCurve:
    points = np.zeros((count, 3))
    points[:, axis] = np.arange(count) * length / count
    points[:, 1 - axis] = across
    points[:, 2] = height
    return PeriodicCurve(points, (1, 0) if axis == 0 else (0, 1))


def test_the_image_across_the_period_counts() -> None:
    period = np.array([8e-3, 3e-3])
    pattern = pattern_from_curves([straight(0, 0.0, 0.0, 8e-3)], period, 1e-3)
    approach = closest_approach(pattern)
    assert approach.distance == pytest.approx(3e-3)
    assert abs(approach.tile[1]) == 1
    assert closest_approach(pattern, within=2e-3).distance == np.inf


def test_a_straight_yarn_does_not_touch_itself() -> None:
    for count in (8, 200):
        pattern = pattern_from_curves([straight(0, 0.0, 0.0, 8e-3, count)], [8e-3, 9e-3], 1e-3)
        assert closest_approach(pattern).distance > 2e-3
        assert closest_approach(pattern, within=2e-3).distance == np.inf


@pytest.mark.parametrize("name", names())
def test_the_description_does_not_matter(name: str) -> None:
    pattern = build(name)
    distance = closest_approach(pattern).distance
    assert closest_approach(pattern.wrapped()).distance == pytest.approx(distance, rel=1e-9)
    assert closest_approach(pattern.shifted(1.7e-3, 0.4e-3)).distance == pytest.approx(distance, rel=1e-9)
    assert closest_approach(pattern.repeated(2, 2)).distance == pytest.approx(distance, rel=1e-9)


def test_published_patterns_are_slightly_compressed(shared) -> None:
    stockinette = closest_approach(read_pyp(shared / "reference" / "stockinette.pyp"))
    satin = closest_approach(read_pyp(shared / "reference" / "satin.pyp"))
    assert stockinette.distance / 2e-3 == pytest.approx(0.938, abs=0.01)
    assert satin.distance / 2e-3 == pytest.approx(0.989, abs=0.01)


def test_yarns_through_each_other_are_named() -> None:
    period = np.array([8e-3, 8e-3])
    # They meet in the middle of segment 3-4 of the first and of segment 3-4 of the second (vertices 11, 12).
    crossing = [straight(0, 3.5e-3, 0.0, 8e-3), straight(1, 3.5e-3, 2e-5, 8e-3)]
    pattern = pattern_from_curves(crossing, period, 1e-3)
    with pytest.raises(InputError) as error:
        check_clearance(pattern, where="bad.pyp")
    message = str(error.value)
    assert message.startswith("bad.pyp: yarns run through each other: segment 3-4 and segment 11-12")
    assert "expected centre lines at least 0.05 diameters (0.0001 m) apart" in message
    assert "found 0.01 diameters" in message
    raised = [straight(0, 3.5e-3, 0.0, 8e-3), straight(1, 3.5e-3, 1.5e-3, 8e-3)]
    assert check_clearance(pattern_from_curves(raised, period, 1e-3)).distance == pytest.approx(1.5e-3)


def test_a_search_without_end_is_refused() -> None:
    pattern = pattern_from_curves([straight(0, 0.0, 0.0, 8e-3)], [8e-3, 3e-3], 1e-3)
    tiny = replace(pattern, period=np.array([8e-3, 1e-9]), radius=1e-9)
    with pytest.raises(InputError, match="copies that yarns may touch are too many"):
        closest_approach(tiny)
