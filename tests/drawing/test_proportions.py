"""Radii that fit their patterns pass; those of another unit or a tenth of what they should be do not."""

from __future__ import annotations

import warnings
from dataclasses import replace

import numpy as np
import pytest

from yarnscale.drawing import library
from yarnscale.drawing.curves import PeriodicCurve, pattern_from_curves
from yarnscale.drawing.proportions import check_proportions
from yarnscale.errors import InputError, InputNotice
from yarnscale.yarn.pattern import YarnPattern


def straight(spacing: float, *, radius: float = 5e-4) -> YarnPattern:
    """One straight yarn along x in a period of 8 mm × ``spacing``."""
    x = np.arange(8) * 1e-3
    points = np.column_stack([x, np.zeros(8), np.zeros(8)])
    return pattern_from_curves([PeriodicCurve(points, (1, 0))], period=(8e-3, spacing), radius=radius, name="straight")


@pytest.mark.parametrize("name", library.names())
def test_built_in_patterns_pass(name: str) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_proportions(library.build(name))


@pytest.mark.parametrize("name", ["stockinette", "rib-1x1", "interlock", "plain", "satin-5"])
@pytest.mark.parametrize("factor", [10.0, 0.1])
def test_a_radius_of_ten_times_or_a_tenth_is_refused(name: str, factor: float) -> None:
    pattern = library.build(name)
    with pytest.raises(InputError, match=r"a\.pyp: radius of the yarn; expected .*radius .* mm, period .* mm"):
        check_proportions(replace(pattern, radius=factor * pattern.radius), where="a.pyp")


def test_lengths_of_another_unit_are_refused_and_unusual_ones_reported() -> None:
    pattern = library.build("stockinette")
    fine = pattern.scaled(5e-4 / pattern.radius)
    for factor in (1e3, 1e-3):
        with pytest.raises(InputError, match="with all lengths in metres"):
            check_proportions(fine.scaled(factor))
    with pytest.warns(InputNotice, match="unusual size"):
        check_proportions(fine.scaled(10.0))


def test_parallel_yarns_may_be_far_apart() -> None:
    with pytest.warns(InputNotice, match="yarns do not touch"):
        check_proportions(straight(20e-3))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_proportions(straight(1.2e-3))
