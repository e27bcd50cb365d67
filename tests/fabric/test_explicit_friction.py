"""Friction in explicit steps: Coulomb's law on a slope of yarns and on a plane, momentum, and no energy gained."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest

from yarnscale.fabric.direct_energy import FabricEnergy
from yarnscale.fabric.direct_motion import FabricDynamics, FabricMotion, MotionSettings
from yarnscale.fabric.direct_obstacles import Pushes
from yarnscale.fabric.direct_static import gravity_load, rod_equilibrium
from yarnscale.fabric.holds import Holds
from yarnscale.fabric.sheet import YarnSheet
from yarnscale.motion.obstacles import Plane
from yarnscale.yarn.friction import Rubbing, YarnFriction
from yarnscale.yarn.material import YarnMaterial

SOLID = YarnMaterial(5e5, 2e5, 1.0, 60.0, 120.0)
Crossing = Callable[[float], FabricEnergy]
RADIUS = 1e-3
SLOPE = math.radians(30.0)
GRAVITY = 9.81
DOWN_SLOPE = (GRAVITY * math.sin(SLOPE), 0.0, -GRAVITY * math.cos(SLOPE))


def _on_rails(friction: float) -> FabricDynamics:
    """A short yarn across two that are held, in gravity that pulls it along them with the slope's share."""
    along = np.linspace(-0.004, 0.004, 17)
    rail = np.stack([along, np.zeros(17), np.zeros(17)], 1)
    across = np.linspace(-0.004, 0.004, 9)
    rider = np.stack([np.zeros(9), across, np.full(9, 1.97 * RADIUS)], 1)
    sheet = YarnSheet.from_lines([np.add(rail, [0, -0.003, 0]), np.add(rail, [0, 0.003, 0]), rider], RADIUS)
    nodes = np.arange(34)
    holds = Holds(nodes, sheet.vertices[nodes])
    settings = MotionSettings(DOWN_SLOPE, friction=YarnFriction(friction), method="explicit")
    return FabricDynamics(FabricEnergy(sheet, SOLID), settings, lambda time: holds)


def _slide(dynamics: FabricDynamics, seconds: float) -> tuple[float, float]:
    """Way and speed along the slope of what is not held [m, m/s], in explicit steps from where it is pressed."""
    pressed = gravity_load(dynamics.energy, np.array([0.0, 0.0, DOWN_SLOPE[2]]))
    rest = rod_equilibrium(
        dynamics.energy, dynamics.energy.start(), dynamics.holds(0.0), load=pressed, obstacles=dynamics.obstacles,
        tolerance=1e-9,
    )  # fmt: skip
    motion = FabricMotion(rest.x, 0.0 * rest.x)
    step = dynamics.stable_step(motion)
    count = round(seconds / step)
    for _ in range(count):
        motion = dynamics.step(motion, seconds / count).state
    free = dynamics.holds(0.0).springs(dynamics.energy).weight[: 3 * dynamics.energy.count : 3] == 0
    weight = dynamics.mass[: 3 * dynamics.energy.count : 3] * free
    weight = weight / weight.sum()
    moved = dynamics.energy.positions(motion.x - rest.x)
    return (
        float(weight @ moved[:, 0]) * RADIUS,
        float(weight @ dynamics.energy.positions(motion.velocity)[:, 0]) * RADIUS,
    )


@pytest.mark.parametrize("friction", [0.0, 0.3, 0.8])
def test_a_yarn_slides_down_two_others_as_coulomb_says(friction: float) -> None:
    """Speed g t (sin φ − μ cos φ), or none where μ > tan φ but for what bends."""
    seconds = 0.002
    way, speed = _slide(_on_rails(friction), seconds)
    pull = GRAVITY * (math.sin(SLOPE) - friction * math.cos(SLOPE))
    if pull > 0:
        assert speed == pytest.approx(pull * seconds, rel=0.05)
        assert way == pytest.approx(0.5 * pull * seconds**2, rel=0.1)
    else:
        assert abs(way) < 1e-2 * 0.5 * GRAVITY * seconds**2


@pytest.mark.parametrize("friction", [0.0, 0.3, 0.8])
def test_a_yarn_slides_down_a_plane_as_coulomb_says(friction: float) -> None:
    line = np.stack([np.zeros(12), np.linspace(0.0, 0.022, 12), np.full(12, 0.99 * RADIUS)], 1)
    energy = FabricEnergy(YarnSheet.from_lines([line], RADIUS), SOLID)
    floor = Pushes(energy, Plane((0.0, 0.0, 0.0), (0.0, 0.0, 1.0)), friction=friction)
    dynamics = FabricDynamics(energy, MotionSettings(DOWN_SLOPE, method="explicit"), obstacles=(floor,))
    way, speed = _slide(dynamics, 0.005)
    pull = GRAVITY * (math.sin(SLOPE) - friction * math.cos(SLOPE))
    if pull > 0:
        assert speed == pytest.approx(pull * 0.005, rel=1e-3)
    else:
        assert abs(way) < 1e-2 * 0.5 * GRAVITY * 0.005**2


def test_impulses_keep_momentum_stop_slip_and_are_bounded_by_the_pressure(crossing: Crossing) -> None:
    energy = crossing(1.6)
    x, n = energy.start(), energy.count
    contacts = energy.contacts(x).stencils
    pairs = Rubbing.of(contacts, x)
    mass = energy.masses() * RADIUS**2 / energy.unit
    velocity = np.zeros((n, 3))
    velocity[21:, 0] = 50.0
    momentum = mass @ velocity
    step, friction = 1e-9, YarnFriction(0.3)
    slower = friction.slowed(velocity, 1.0 / mass, contacts, x, step)
    np.testing.assert_allclose(mass @ slower, momentum, atol=1e-12 * np.abs(momentum).max())
    # Every pair is far from stopped and rubs with μ N across its own pressure.
    lost = float((mass[21:] @ (velocity - slower)[21:])[0])
    across = np.sqrt(1.0 - pairs.normal[:, 0] ** 2)
    assert lost == pytest.approx(0.3 * step * float(pairs.pressure @ across), rel=1e-4)
    # With a grip that holds, no place slips on the other any more, and the kinetic energy is less. Twelve pairs share
    # four edges: the ten rounds of a step leave 6 % of the slip, eighty 0.3 %.
    slips, energies = [], [float(mass @ (velocity**2).sum(axis=1))]
    for _ in range(8):
        velocity = YarnFriction(1e3).slowed(velocity, 1.0 / mass, contacts, x, 1e-2)
        slip = np.einsum("kj,kji->ki", pairs.weights, velocity[pairs.nodes])
        slip -= np.einsum("ki,ki->k", slip, pairs.normal)[:, None] * pairs.normal
        slips.append(np.abs(slip).max() / 50.0)
        energies.append(float(mass @ (velocity**2).sum(axis=1)))
    assert slips[0] < 0.07 and slips[-1] < 0.005
    assert (np.diff(energies) < 0).all()
    np.testing.assert_allclose(mass @ velocity, momentum, atol=1e-12 * np.abs(momentum).max())


def test_friction_takes_energy_at_steps_as_long_as_without_it(crossing: Crossing) -> None:
    """Yarns that rub and vibrate at the largest stable step lose energy; without friction they keep it."""
    ends = []
    for coefficient in (0.0, 0.5):
        energy = crossing(1.9)
        dynamics = FabricDynamics(
            energy, MotionSettings((0.0, 0.0, 0.0), friction=YarnFriction(coefficient), method="explicit")
        )
        velocity = np.zeros(4 * energy.count)
        energy.positions(velocity)[21:] = [30.0, 30.0, -30.0]
        motion = FabricMotion(energy.start(), velocity)
        first, step = sum(dynamics.energies(motion).values()), dynamics.stable_step(motion)
        for _ in range(150):
            motion = dynamics.step(motion, step).state
            assert sum(dynamics.energies(motion).values()) < 1.05 * first
        ends.append(sum(dynamics.energies(motion).values()) / first)
    assert ends[0] == pytest.approx(1.0, abs=0.05)
    assert ends[1] < 0.97 * ends[0]
