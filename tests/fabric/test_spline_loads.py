"""Spline yarns that touch, and under handles and obstacles."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from yarnscale.errors import InputError
from yarnscale.fabric.adaptive_volume import AdaptiveRule, AdaptiveVolume
from yarnscale.fabric.measures import penetration
from yarnscale.fabric.sheet_scene import drape, stretch
from yarnscale.fabric.spline_knit import CurvePoints, SplineFabric, jersey
from yarnscale.fabric.spline_motion import SplineMotion
from yarnscale.fabric.spline_points import PointForces, SplinePoints
from yarnscale.fabric.spline_scene import SplineScene
from yarnscale.fabric.spline_touch import SplineTouch
from yarnscale.fabric.volume import BoundingVolume
from yarnscale.fabric.volume_cells import Reduction
from yarnscale.files.fabric_scene import read_fabric_scene
from yarnscale.motion.body import Method
from yarnscale.motion.run import simulate
from yarnscale.motion.scene import run_scene
from yarnscale.motion.schedule import Schedule
from yarnscale.numerics.newton import Solution, Status
from yarnscale.numerics.regularisation import ShiftedHessian
from yarnscale.yarn.material import YarnMaterial

WOOL = YarnMaterial.preset("wool")
MODELS: list[Reduction | None] = [None, "published", "homogenized"]
"""All yarns, and the reductions of a volume."""


@pytest.fixture(scope="module")
def knit() -> SplineFabric:
    return jersey(3, 3, WOOL)


def _cross(gap: float) -> SplineFabric:
    """A straight yarn along x and one along y, so many radii above it."""
    along, zero = np.linspace(-12e-3, 12e-3, 9), np.zeros(9)
    none = CurvePoints(np.empty(0, np.int64), np.empty(0))
    lines = [np.stack([along, zero, zero], 1), np.stack([zero, along, zero + gap * 1e-3], 1)]
    return SplineFabric(np.array(lines), 1e-3, WOOL, none, none, none)


def test_contact_has_its_derivatives_and_none_at_rest(knit: SplineFabric) -> None:
    touch, rng = SplineTouch(SplinePoints(knit)), np.random.default_rng(0)
    assert touch.value(knit.control.ravel()) == 0.0
    x = (knit.control * [1.0, 1.0, 0.6]).ravel() + 1e-5 * rng.standard_normal(knit.control.size)
    direction, h = rng.standard_normal(x.size), 1e-9
    value, gradient = touch.gradient(x)
    assert value > 0.0
    slope = (touch.value(x + h * direction) - touch.value(x - h * direction)) / (2 * h)
    assert gradient @ direction == pytest.approx(slope, rel=1e-6)
    inner = SplineMotion(knit).energy.pattern
    again, push, model = touch.quadratic(x, ShiftedHessian(inner, np.zeros(inner.entries)))
    assert again == pytest.approx(value)
    np.testing.assert_allclose(push, gradient, rtol=1e-9, atol=1e-9 * np.abs(gradient).max())
    change = (touch.gradient(x + h * direction)[1] - touch.gradient(x - h * direction)[1]) / (2 * h)
    found = model.pattern.multiply(model.entries, direction)
    np.testing.assert_allclose(found, change, atol=1e-6 * np.abs(change).max())
    # Apart again, with the pattern of before: nothing is added.
    stiff = ShiftedHessian(inner, rng.standard_normal(inner.entries))
    again, push, model = touch.quadratic(knit.control.ravel(), stiff)
    assert again == 0.0 and not push.any()
    product = inner.multiply(stiff.entries, direction)
    np.testing.assert_allclose(model.pattern.multiply(model.entries, direction), product, atol=1e-12)


def test_a_yarn_that_falls_on_another_stays_above_it() -> None:
    """The lower one is held; without contact the upper one would be 20 mm below it."""
    fabric = _cross(2.5)
    ends = CurvePoints(np.zeros(7, np.int64), np.arange(7.0))
    moving = SplineMotion(fabric, held=ends, gravity=(0.0, 0.0, -9.81))
    state = moving.start
    for _ in range(16):
        state = moving.step(state, 1 / 240).state
    middle = fabric.at(state.positions, CurvePoints(np.array([1]), np.array([3.0])))[0]
    assert 1.4e-3 < middle[2] < 1.8e-3
    assert moving.touch.lasting(state.passages) == 0


def test_passages_of_a_step_are_counted() -> None:
    fabric = _cross(2.5)
    touch, x = SplineTouch(SplinePoints(fabric)), fabric.control
    below = x.copy()
    below[1, :, 2] -= 5e-3
    rows = touch.passages(x.ravel(), below.ravel(), np.empty((0, 6)))
    assert touch.lasting(rows) == 1
    assert touch.lasting(touch.passages(below.ravel(), x.ravel(), rows)) == 0


@pytest.mark.parametrize(("detour", "passed"), [(False, 1), (True, 0)])
def test_passages_are_counted_along_the_iterates_of_a_step(
    detour: bool, passed: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The upper yarn comes below the lower one in one step: through it, or aside, down and back."""
    moving = SplineMotion(_cross(2.5))
    aside, under, below = (moving.start.positions.reshape(2, -1, 3).copy() for _ in range(3))
    away = 1.1 * np.ptp(aside[0], axis=0)
    aside[1] += away
    under[1] += away - [0.0, 0.0, 5e-3]
    below[1] -= [0.0, 0.0, 5e-3]

    def minimised(objective, start, options, *, linear, bound, after_step):  # type: ignore[no-untyped-def]
        for x in [aside, under, below] if detour else [below]:
            after_step(x.ravel())
        return Solution(below.ravel(), 0.0, 0.0 * start, 0.0, Status.CONVERGED, 1, 1, ())

    monkeypatch.setattr("yarnscale.fabric.spline_motion.minimise", minimised)
    assert moving.touch.lasting(moving.step(moving.start, 1e-3).state.passages) == passed


def test_handles_and_obstacles_have_their_derivatives(knit: SplineFabric) -> None:
    points, rng = SplinePoints(knit), np.random.default_rng(1)
    led, pattern = stretch(points.sheet, amount=0.1), SplineMotion(knit).energy.pattern
    x = (knit.control - [0.0, 0.0, 1.5e-3]).ravel()
    direction, h = rng.standard_normal(x.size), 1e-8
    for loads in (led, replace(led, obstacles=drape(points.sheet).obstacles)):
        forces = PointForces(points, loads, pattern)
        forces.begin(x, 0.0, 0.5)
        before, here, after, again = (np.zeros(x.size) for _ in range(4))
        low, value, high = (
            forces.gradient(x + k * h * direction, slope) for k, slope in ((-1, before), (0, here), (1, after))
        )
        assert value > 0.0
        assert here @ direction == pytest.approx((high - low) / (2 * h), rel=1e-6)
        entries = np.zeros(pattern.entries)
        assert forces.hessian(x, again, pattern, entries) == pytest.approx(forces.value(x))
        np.testing.assert_allclose(again, here)
        if loads is led:  # the curvature of obstacles is left out
            change = (after - before) / (2 * h)
            found = pattern.multiply(entries, direction)
            np.testing.assert_allclose(found, change, atol=1e-6 * np.abs(change).max())


def test_steps_with_handles_end_as_asked(knit: SplineFabric) -> None:
    loads = stretch(SplinePoints(knit).sheet, amount=0.1, duration=0.02)
    spent = []
    for asked in ({}, {"iterations": 1}, {"enough": 0.0, "tolerance": 1e-6, "iterations": 30}):
        moving = SplineMotion(knit, loads=loads, gravity=loads.gravity, **asked)  # type: ignore[arg-type]
        step = moving.step(moving.start, 1 / 240)
        assert moving.keeps(step)
        spent.append(step.iterations)
    assert spent[1] == 1 < spent[0] < spent[2]


def test_splines_drape_over_a_ball(knit: SplineFabric) -> None:
    loads = drape(SplinePoints(knit).sheet)
    scene = SplineScene(knit, loads, schedule=Schedule(0.05, 1 / 240, to_rest=False, frame_interval=0.05))
    result = run_scene(scene)
    assert result.succeeded and result.measures["passages"] == 0
    assert 0.0 < result.measures["centre_drop"] < 0.5 * 9.81 * 0.05**2  # type: ignore[operator]
    (ball,) = loads.obstacles
    away = np.linalg.norm(scene.points(result.state) - np.array(ball.centre), axis=1) - ball.radius  # type: ignore[attr-defined]
    assert away.min() > 0.5 * knit.radius
    assert result.measures["penetration"] < 0.3  # type: ignore[operator]


@pytest.mark.parametrize("shape", [None, (6, 6)])
def test_grips_pull_splines_apart(shape: tuple[int, int] | None) -> None:
    knit = jersey(3, 5, WOOL)
    volume = None if shape is None else BoundingVolume.around(knit.control, shape)
    loads = stretch(SplinePoints(knit).sheet, amount=0.05, duration=0.05)
    schedule = Schedule(0.05, 1 / 240, to_rest=False, frame_interval=0.05)
    scene = SplineScene(knit, loads, schedule=schedule, volume=volume, damping=20.0)
    result = run_scene(scene)
    assert result.succeeded, result.summary()
    assert result.measures["force"] > 0.0  # type: ignore[operator]
    width = np.ptp(scene.points(result.state)[:, 0]) - np.ptp(scene.points(scene.start)[:, 0])
    grips = loads.holds(1.0).targets[:, 0]
    assert width == pytest.approx(np.ptp(grips) - np.ptp(scene.points(scene.start)[:, 0]), abs=knit.radius)
    assert penetration(knit, scene.body.yarns(result.state).positions) < (0.3 if shape is None else 0.6)


def test_handles_take_implicit_steps(knit: SplineFabric) -> None:
    loads = stretch(SplinePoints(knit).sheet)
    with pytest.raises(InputError, match="implicit"):
        SplineMotion(knit, loads=loads, method="explicit")


def _volume(knit: SplineFabric, model: Reduction | None) -> BoundingVolume | None:
    return None if model is None else BoundingVolume.around(knit.control, (4, 4))


@pytest.mark.parametrize("model", MODELS)
def test_a_fabric_hangs_alike_wherever_it_is(knit: SplineFabric, model: Reduction | None) -> None:
    away, states = (0.01, -0.02, 0.1), []
    for displacement in ((0.0, 0.0, 0.0), away):
        scene = SplineScene(
            knit,
            displacement=displacement,
            volume=_volume(knit, model),
            reduction=model,
            schedule=Schedule(0.01, 1 / 200, to_rest=False),
        )
        body, state = scene.body, scene.start
        for _ in range(2):
            step = body.step(state, 1 / 200)
            assert step.status is Status.CONVERGED
            state = step.state
        assert max(body.distances_from_places(state).values()) < 1e-8
        states.append(body.yarns(state).positions)
    assert np.abs(states[0] - knit.control.reshape(-1, 3)).max() > 1e-5
    np.testing.assert_allclose(states[1] - away, states[0], atol=1e-8)


SCENE = """
gravity = [0, 0, 0]
damping = 20
[fabric]
position = [0.02, -0.01, 0.03]
[schedule]
duration = 0.05
[[handles]]
name = "left"
box = [[-1, -1], [-0.006, 1]]
displacement = [-0.001, 0.002, 0.003]
duration = 0.02
"""


@pytest.mark.parametrize("model", MODELS)
def test_a_handle_of_a_scene_file_goes_where_it_says(
    knit: SplineFabric, tmp_path: Path, model: Reduction | None
) -> None:
    (file := tmp_path / "scene.toml").write_text(SCENE)
    plan = read_fabric_scene(file)
    scene = SplineScene.in_place(
        knit, plan, volume=_volume(knit, model), reduction=model, schedule=plan.schedule, damping=plan.damping
    )
    points, middle = SplinePoints(knit), np.array(plan.position)
    places = points.sheet.vertices - 0.5 * (points.sheet.vertices.min(axis=0) + points.sheet.vertices.max(axis=0))
    held = places[:, 0] < -0.006
    assert 10 < held.sum() < 0.5 * len(held)
    wanted = places[held] + middle + [-0.001, 0.002, 0.003]
    result = run_scene(scene)
    assert result.succeeded, result.summary()
    found = points.positions(scene.body.yarns(result.state).positions)[held] * knit.radius
    # The cells of a homogenized volume relax, the mid-surface goes to its place.
    np.testing.assert_allclose(found, wanted, atol=(0.5 if model == "homogenized" else 0.05) * knit.radius)


def test_an_adaptive_volume_takes_handles(knit: SplineFabric) -> None:
    loads = stretch(SplinePoints(knit).sheet, amount=0.1, duration=0.02)
    volume = BoundingVolume.around(knit.control, (4, 4))
    moving = SplineMotion(knit, volume=volume, loads=loads, gravity=loads.gravity)
    adaptive = AdaptiveVolume(moving, AdaptiveRule(gain=1e-7, narrowest=3.0))
    run = simulate(adaptive, moving.start, Schedule(2 / 240, 1 / 240, to_rest=False, frame_interval=1 / 240))
    assert run.converged and len(run.state.knots)
    assert adaptive.counts()["reduced_unknowns"] > moving.counts()["reduced_unknowns"]


@pytest.mark.parametrize("schedule", [Schedule(0.01), Schedule(0.01, to_rest=False, statics=True)])
def test_all_yarns_have_no_steps_without_inertia(knit: SplineFabric, schedule: Schedule) -> None:
    with pytest.raises(InputError, match="or a volume"):
        SplineScene(knit, schedule=schedule)
    SplineScene(knit, schedule=schedule, volume=_volume(knit, "published"))


@pytest.mark.parametrize("method", ["implicit", "explicit"])
@pytest.mark.parametrize("count", [1, 2])
def test_yarns_that_nothing_joins_fall(method: Method, count: int) -> None:
    """By g Δt² n (n + 1)/2, 50 mm apart."""
    fabric = _cross(50.0)
    alone = SplineFabric(fabric.control[:count], fabric.radius, WOOL, *3 * [fabric.first])
    moving = SplineMotion(alone, gravity=(0.0, 0.0, -9.81), method=method, tolerance=1e-6)
    state, step = moving.start, 1e-5
    for _ in range(3):
        state = moving.step(state, step).state
    fallen = state.positions - alone.control.reshape(-1, 3)
    np.testing.assert_allclose(
        fallen, np.tile([0.0, 0.0, -9.81 * step**2 * 6], (len(fallen), 1)), rtol=1e-4, atol=1e-14
    )


def test_a_single_row_drapes() -> None:
    row = jersey(1, 3, WOOL)
    scene = SplineScene(row, drape(SplinePoints(row).sheet), schedule=Schedule(0.01, 1 / 200, to_rest=False))
    assert run_scene(scene).succeeded


def test_a_hanging_fabric_takes_any_gravity_and_loads_have_their_own(knit: SplineFabric) -> None:
    moon = SplineScene(knit, gravity=(0.0, -1.62, 0.0), schedule=Schedule(0.01, 1 / 200, to_rest=False))
    result = run_scene(moon)
    fallen = [run_scene(replace(moon, gravity=g)).measures["centre_drop"] for g in ((0.0, -9.81, 0.0), (0.0, 0.0, 0.0))]
    assert 0.0 < result.measures["centre_drop"] < 0.3 * fallen[0]  # type: ignore[operator]
    assert fallen[1] is None
    loads = drape(SplinePoints(knit).sheet)
    draped = SplineScene(knit, loads)
    assert draped.gravity == loads.gravity == replace(draped, damping=2.0).gravity
    with pytest.raises(InputError, match="beside that of the loads"):
        SplineScene(knit, loads, gravity=(0.0, -1.62, 0.0))


def test_explicit_steps_count_passages_and_are_shorter_under_contact() -> None:
    fabric = _cross(2.5)
    moving = SplineMotion(fabric, method="explicit", gravity=(0.0, 0.0, 0.0))
    falling = np.zeros_like(moving.start.positions)
    falling[fabric.points_per_yarn :, 2] = -1.0
    state = moving.step(replace(moving.start, velocities=falling), 5e-3).state
    assert moving.touch.lasting(state.passages) == 1
    assert moving.touch.lasting(moving.step(replace(state, velocities=-falling), 5e-3).state.passages) == 0
    # Yarns in tension are the stiffest by far.
    pressed = replace(moving.start, positions=_cross(0.01).control.reshape(-1, 3))
    assert moving.stable_step(pressed) < 0.999 * moving.stable_step(moving.start)
