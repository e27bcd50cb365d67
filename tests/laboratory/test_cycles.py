"""Cycles of a cell with friction: loops, work that comes back, and the hysteresis of KES."""

from __future__ import annotations

import math
from collections.abc import Callable

import pytest

import yarnscale as ys
from yarnscale.laboratory import cycles
from yarnscale.laboratory.cycles import Cycle, cycled_tests
from yarnscale.laboratory.programme import FabricTests
from yarnscale.laboratory.summary import tensile_summary
from yarnscale.laboratory.table import measured
from yarnscale.yarn.friction import YarnFriction


@pytest.fixture(scope="module")
def pulled() -> Callable[[float, int], tuple[list, list[Cycle]]]:
    """Stockinette along its wales with a friction, in so many cycles: points of the first way, and the cycles."""
    cell = ys.PeriodicCell(ys.patterns.build("stockinette"), ys.YarnMaterial.preset("hylc2020-stockinette"))
    test = next(cycled_tests(cell, (90.0,), (1.0, 5.0), "flat", None))
    return lambda friction, count: test.run(cell, YarnFriction(friction), count)


@pytest.fixture(autouse=True)
def few_steps(monkeypatch):
    monkeypatch.setattr(cycles, "STEPS", 2)


def test_without_friction_all_work_comes_back(pulled):
    _, (cycle,) = pulled(0.0, 1)
    assert cycle.status == "converged" and cycle.dissipated == 0.0
    # Loads are met to a thousandth; loose loops then stretch by almost any amount.
    assert cycle.returned == pytest.approx(1.0, abs=0.02)


def test_with_friction_a_share_of_the_work_comes_back(pulled):
    points, (first, second) = pulled(0.3, 2)
    assert [p.load for p in points] == [1.0, 5.0] and [load for _, load in first.loading] == [0.0, 1.0, 5.0]
    assert [load for _, load in first.unloading] == [5.0, 1.0, 0.0]
    assert first.unloading[1][0] > first.loading[1][0]
    assert 0.3 < first.returned < 0.8
    assert first.dissipated > 0.0 and second.dissipated > 0.0
    assert second.loading[0] == first.unloading[2] and second.loading[0][0] > 0.0
    summary = tensile_summary(points, first)
    assert pytest.approx(summary.RT) == 100 * first.returned and first.work == summary.WT
    assert first.plain()["unloading"][2] == {"stretch": first.unloading[2][0], "load": 0.0}


def test_a_cycle_that_is_not_completed_has_no_numbers(pulled, monkeypatch):
    monkeypatch.setattr(cycles, "followed", lambda *_: iter(()))
    points, (cycle, second) = pulled(0.3, 2)
    said = "no equilibrium at 0.5 N/m, loading of cycle 1; values that are closer (--loads) make shorter steps"
    assert cycle.stopped == second.stopped == said
    assert [p.status for p in points] == ["stalled", "stalled"] and math.isnan(points[0].stretch)
    assert cycle.status == "stalled" and math.isnan(cycle.work) and cycle.hysteresis(0.1) is None


def test_hysteresis_is_the_width_of_the_loop():
    """A spring of 2 N/m per degree beside a slider of 0.3 N/m."""
    ways = {side: [side * a for a in (0.0, 0.4, 1.0, 8.0)] for side in (1.0, -1.0)}
    up = tuple((a, 2 * a + 0.3 * side) for side in ways for a in ways[side])
    down = tuple((a, 2 * a - 0.3 * side) for side in ways for a in reversed(ways[side]))
    cycle = Cycle("shear", 0.0, 1, up, down, 1.0, 0.5, 0.5, "converged")
    assert cycle.hysteresis(5.0) == pytest.approx(0.6)
    assert cycle.hysteresis(0.2) == pytest.approx(0.6)
    assert cycle.hysteresis(9.0) is None


def test_the_table_has_the_points_and_works_of_cycles():
    cycle = Cycle("shear", 0.0, 1, ((0.0, 0.0), (8.0, 1.5)), ((8.0, 1.5), (0.0, -0.3)), 1.0, 0.6, 0.4, "converged")
    tests = FabricTests("x", "cell", 0.1, [], [], [], [], [], [], friction=0.2, cycles=(cycle,))
    rows = list(measured(tests))
    assert {(r.test, r.unit, r.value_unit) for r in rows[2:4]} == {("shear cycle 1 unloading", "degrees", "N/m")}
    assert [(r.at, r.value) for r in rows[2:4]] == [(8.0, 1.5), (0.0, -0.3)]
    assert {r.quantity: r.value for r in rows[4:]} == {"work": 1.0, "work_returned": 0.6, "dissipated": 0.4}
