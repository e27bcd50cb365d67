"""Friction of yarns on a body: Coulomb's law on a slope, and exact derivatives."""

from __future__ import annotations

import math

import numpy as np
import pytest

from yarnscale.errors import InputError
from yarnscale.fabric.direct_energy import FabricEnergy
from yarnscale.fabric.direct_motion import FabricDynamics, FabricMotion, MotionSettings
from yarnscale.fabric.direct_obstacles import Pushes
from yarnscale.fabric.direct_static import rod_equilibrium
from yarnscale.fabric.holds import Holds
from yarnscale.fabric.sheet import YarnSheet
from yarnscale.motion.obstacles import MeshObstacle, Plane, Sphere
from yarnscale.motion.rigid import Motion
from yarnscale.motion.run import simulate
from yarnscale.motion.schedule import Schedule
from yarnscale.yarn.material import YarnMaterial

SOLID = YarnMaterial(5e5, 2e5, 1.0, 60.0, 120.0)
RADIUS = 1e-3
SLOPE = math.radians(30.0)
DOWN = np.array([math.cos(SLOPE), 0.0, -math.sin(SLOPE)])
UP = (math.sin(SLOPE), 0.0, math.cos(SLOPE))


def _on_slope(friction: float) -> tuple[FabricEnergy, Pushes]:
    """A straight yarn across the slope, as deep in it as its weight presses it."""
    line = np.zeros((12, 3))
    line[:, 1] = np.linspace(0.0, 0.022, 12)
    energy = FabricEnergy(YarnSheet.from_lines([line], RADIUS), SOLID)
    slope = Pushes(energy, Plane((0.0, 0.0, 0.0), UP), friction=friction)
    weight = energy.masses() * 9.81 * math.cos(SLOPE) / energy.force_unit
    sheet = energy.sheet
    height = RADIUS * (1.0 - np.sqrt(weight / slope.stiffness))
    energy = FabricEnergy(sheet.moved(sheet.vertices + height[:, None] * np.array(UP)), SOLID)
    return energy, Pushes(energy, Plane((0.0, 0.0, 0.0), UP), friction=friction)


def _next_speed(speed: float, friction: float, slip: float) -> float:
    """Speed after an implicit step of 1/400 s of a point on the slope, friction smoothed within a slip [m]."""
    low, high = speed - 0.1, speed + 0.1
    for _ in range(60):
        new = 0.5 * (low + high)
        way = new / 400
        push = math.sin(SLOPE) - friction * math.cos(SLOPE) * way / math.hypot(way, slip)
        low, high = (new, high) if new < speed + 9.81 * push / 400 else (low, new)
    return low


@pytest.mark.parametrize("friction", [0.0, 0.2, 0.4, 0.8])
def test_a_yarn_slides_down_a_slope_as_coulomb_says(friction: float) -> None:
    """Acceleration g (sin φ − μ cos φ), and rest but for a creep of the smoothing where μ > tan φ."""
    energy, slope = _on_slope(friction)
    settings = MotionSettings(damping=0.0, tolerance=1e-9, enough=0.0, iterations=40)
    dynamics = FabricDynamics(energy, settings, obstacles=(slope,))
    run = simulate(dynamics, dynamics.start(), Schedule(0.1, 1 / 400, to_rest=False))
    moved = (energy.positions(run.state.x) - energy.positions(energy.start())) * RADIUS
    velocity = energy.positions(run.state.velocity) * RADIUS
    weight = energy.masses() / energy.masses().sum()
    speed = way = 0.0
    for _ in range(40):
        speed = _next_speed(speed, friction, slope.slip * RADIUS)
        way += speed / 400
    assert float(weight @ velocity @ DOWN) == pytest.approx(speed, rel=5e-3, abs=1e-6)
    assert float(weight @ moved @ DOWN) == pytest.approx(way, rel=0.03)
    if friction < 0.5:  # sharp friction would end at 0.1 s times this
        assert speed == pytest.approx(0.981 * (math.sin(SLOPE) - friction * math.cos(SLOPE)), rel=0.06)
    else:  # below the slip in which friction builds up, in every step
        assert way < 40 * 1.1 * slope.slip * RADIUS
    assert np.abs(moved @ np.array(UP)).max() < 0.1 * RADIUS


def test_every_step_rubs_whoever_calls_it() -> None:
    energy, slope = _on_slope(0.8)
    dynamics = FabricDynamics(energy, MotionSettings(tolerance=1e-9, enough=0.0, iterations=40), obstacles=(slope,))
    motion = dynamics.start()
    for _ in range(20):
        motion = dynamics.step(motion, 1 / 400).state
    moved = (energy.positions(motion.x) - energy.positions(energy.start())) * RADIUS
    assert float((moved @ DOWN).mean()) < 20 * 1.1 * slope.slip * RADIUS  # freely, it would have slid by six times that


def test_friction_has_exact_derivatives_and_begins_at_zero() -> None:
    generator = np.random.default_rng(8)
    energy, _ = _on_slope(0.0)
    ball = Pushes(energy, Sphere((0.0, 0.011, -0.02), 0.0205), stiffness=3.0, friction=0.5)
    plain = Pushes(energy, Sphere((0.0, 0.011, -0.02), 0.0205), stiffness=3.0)
    x = energy.positions(energy.start()) + 0.05 * generator.standard_normal((energy.count, 3))
    ball.begin(x, 0.0, 0.0)
    assert ball.at(x)[0] == pytest.approx(plain.at(x)[0], rel=1e-12) and plain.at(x)[0] > 0
    x = x + 0.03 * generator.standard_normal(x.shape)
    step = 1e-6
    direction = generator.standard_normal(x.shape)
    # The body's own push leaves the curvature of its surface out: friction is looked at by itself.
    ahead, behind = x + step * direction, x - step * direction
    rub = [ball.at(y)[0] - plain.at(y)[0] for y in (ahead, behind)]
    force = [ball.at(y)[1] - plain.at(y)[1] for y in (ahead, behind)]
    gradient, hessian = (ball.at(x)[k] - plain.at(x)[k] for k in (1, 2))
    assert (rub[0] - rub[1]) / (2 * step) == pytest.approx(float((gradient * direction).sum()), rel=1e-6)
    expected = (force[0] - force[1]) / (2 * step)
    found = np.einsum("nij,nj->ni", hessian, direction)
    np.testing.assert_allclose(found, expected, rtol=1e-5, atol=1e-6 * np.abs(expected).max())
    assert (np.linalg.eigvalsh(hessian) > -1e-9).all()
    with pytest.raises(InputError, match="friction"):
        Pushes(energy, Sphere((0.0, 0.0, 0.0), 0.01), friction=-0.1)


@pytest.mark.parametrize("method", ["implicit", "explicit"])
@pytest.mark.parametrize("shape", ["plane", "mesh"])
def test_a_moving_belt_takes_a_yarn_along_as_coulomb_says(method: str, shape: str) -> None:
    """It gains μ g t of speed while it slips, and moves with the belt afterwards."""
    speed, friction = 0.05, 0.4
    line = np.stack([np.zeros(12), np.linspace(0.0, 0.022, 12), np.full(12, 0.99 * RADIUS)], 1)
    energy = FabricEnergy(YarnSheet.from_lines([line], RADIUS), SOLID)
    motion = Motion((speed, 0.0, 0.0), 0.0, 1.0, ease=False)
    square = 0.1 * np.array([[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [1.0, 1.0, 0.0], [-1.0, 1.0, 0.0]])
    belt = Plane(motion=motion) if shape == "plane" else MeshObstacle(square, np.array([[0, 1, 2], [0, 2, 3]]), motion)
    settings = MotionSettings(tolerance=1e-9, enough=0.0, iterations=40, method=method)  # type: ignore[arg-type]
    dynamics = FabricDynamics(energy, settings, obstacles=(Pushes(energy, belt, friction=friction, slip=1e-3),))
    pressed = rod_equilibrium(
        energy,
        energy.start(),
        Holds.none(),
        load=dynamics.load,
        obstacles=dynamics.obstacles,
        tolerance=1e-9,
    )
    state = FabricMotion(pressed.x, 0.0 * pressed.x)
    weight = energy.masses() / energy.masses().sum()
    for seconds, expected in ((0.006, friction * 9.81 * 0.006), (0.012, speed)):
        schedule = Schedule(seconds, 1 / 2000, to_rest=False, frame_interval=None)
        state = simulate(dynamics, state, schedule).state
        gained = weight @ energy.positions(state.velocity) * RADIUS
        assert gained[0] == pytest.approx(expected, rel=0.01)
        assert abs(gained[1]) < 1e-6
