"""Yarns simulated directly: closed forms of rods, momentum, friction, obstacles, and yarns that must not pass."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from yarnscale.fabric.direct_energy import FabricEnergy
from yarnscale.fabric.direct_motion import FabricDynamics, FabricMotion, MotionSettings
from yarnscale.fabric.direct_obstacles import Pushes
from yarnscale.fabric.direct_static import gravity_load, reactions, rod_equilibrium, safe_path
from yarnscale.fabric.holds import HOLD, Holds
from yarnscale.fabric.patches import Patches
from yarnscale.fabric.sheet import YarnSheet
from yarnscale.motion.integrator import Integrator
from yarnscale.motion.obstacles import Plane
from yarnscale.numerics.newton import Status
from yarnscale.yarn.frames import unit_edges
from yarnscale.yarn.material import YarnMaterial

SOLID = YarnMaterial(5e5, 2e5, 1.0, 60.0, 120.0)
"""A yarn that bends and twists as a solid rod does."""
Crossing = Callable[[float], FabricEnergy]
RADIUS = 1e-3


def _straight(edges: int, length: float, *, along: int = 0) -> YarnSheet:
    line = np.zeros((edges + 1, 3))
    line[:, along] = np.linspace(0.0, length, edges + 1)
    return YarnSheet.from_lines([line], RADIUS)


@pytest.mark.parametrize(("integrator", "order"), [("euler", 1), ("bdf2", 2)])
def test_positions_converge_at_the_order_of_the_integrator(integrator: Integrator, order: int) -> None:
    """Differences between solutions with Δt, Δt/2, Δt/4 shrink by 2ᵖ: a free yarn, bent and stretched by a kick."""
    sheet = _straight(8, 0.05)
    settings = MotionSettings((0.0, 0.0, 0.0), tolerance=1e-10, enough=0.0, iterations=30, integrator=integrator)
    ends = []
    for count in (16, 32, 64):
        dynamics = FabricDynamics(FabricEnergy(sheet, SOLID), settings)
        start, along = dynamics.start(), sheet.vertices[:, 0]
        kick = np.column_stack([20.0 * along, 800.0 * along**2, 0.0 * along]) / sheet.radius
        state = replace(start, velocity=np.concatenate([kick.ravel(), np.zeros(len(along))]))
        for _ in range(count):
            state = dynamics.step(state, 4e-4 / count).state
        ends.append(state.x)
    coarse, fine = (np.linalg.norm(b - a) for a, b in itertools.pairwise(ends))
    assert math.log2(coarse / fine) == pytest.approx(order, abs=0.3)
    assert fine < 0.2 * np.linalg.norm(ends[-1] - start.x)


def test_a_hanging_yarn_stretches_under_its_weight_as_a_bar_does() -> None:
    """ρ g L²/(2E): exact at the vertices, the lumped weights act where the tension jumps."""
    sheet = _straight(20, 0.5, along=2)
    sheet = sheet.moved(sheet.vertices * [1, 1, -1])
    energy = FabricEnergy(sheet, SOLID)
    load = gravity_load(energy, np.array([0.0, 0.0, -9.81]))
    holds = Holds(np.array([0]), np.zeros((1, 3)))
    rest = rod_equilibrium(energy, energy.start(), holds, load=load, tolerance=1e-10)
    assert rest.status is Status.CONVERGED
    weight = SOLID.mass_per_length(RADIUS) * 9.81
    ends = energy.positions(rest.x)[[0, -1], 2] * RADIUS
    tension = SOLID.stretch_stiffness(RADIUS)
    assert (ends[0] - ends[1]) - 0.5 == pytest.approx(weight * 0.5**2 / (2 * tension), rel=1e-6)
    # The hold carries the whole weight but that of the lowest half edge's share on its own vertex.
    assert holds.forces(energy, rest.x)[0, 2] == pytest.approx(weight * 0.5, rel=1e-6)


def test_a_cantilever_bends_as_a_beam_and_converges_with_the_square_of_the_edge() -> None:
    """F L³/(3EI); the clamp is half an edge before the last vertex that is held."""
    errors = []
    for edges in (10, 20, 40):
        length = 0.1
        size = length / (edges + 0.5)
        line = np.zeros((edges + 2, 3))
        line[:, 0] = size * np.arange(edges + 2)
        energy = FabricEnergy(YarnSheet.from_lines([line], RADIUS), SOLID)
        stiffness = SOLID.bending_stiffness(RADIUS)
        force = 1e-3 * 3 * stiffness / length**2  # the tip sinks by a thousandth of the length
        load = np.zeros(4 * energy.count)
        load[3 * energy.count - 1] = -force / energy.force_unit
        holds = Holds(np.array([0, 1]), line[:2])
        rest = rod_equilibrium(energy, energy.start(), holds, load=load, tolerance=1e-7)
        assert rest.status is Status.CONVERGED
        tip = -energy.positions(rest.x)[-1, 2] * RADIUS
        errors.append(abs(tip / (force * length**3 / (3 * stiffness)) - 1))
    assert errors[0] < 5e-3
    assert errors[0] / errors[1] == pytest.approx(4.0, rel=0.3)
    assert errors[1] / errors[2] == pytest.approx(4.0, rel=0.4)


def _spun(angle: float, wobble: float) -> tuple[FabricEnergy, Holds, np.ndarray]:
    """A yarn whose ends are clamped, one spun; it may draw its ends together."""
    sheet = _straight(40, 0.2)
    energy = FabricEnergy(sheet, SOLID)
    ends = np.array([0, 1, 39, 40])
    holds = Holds(ends, sheet.vertices[ends], (False, True, True), np.array([0, 39]), np.array([0.0, angle]))
    x = energy.start()
    x[3 * energy.count : -1] = angle * np.linspace(0, 1, 40)
    shape = np.sin(np.linspace(0, math.pi, 41)) ** 2
    positions = energy.positions(x)
    positions[:, 1] += wobble * shape
    positions[:, 2] += 0.5 * wobble * shape
    return energy, holds, x


def test_a_twisted_yarn_has_its_torque_and_turns_evenly() -> None:
    energy, holds, x = _spun(3.0, 0.0)
    x[3 * energy.count : -1] = 0.0
    rest = rod_equilibrium(energy, x, holds, tolerance=1e-10)
    assert rest.status is Status.CONVERGED
    twist = rest.x[3 * energy.count : -1]
    np.testing.assert_allclose(np.diff(twist), (twist[-1] - twist[0]) / 39, rtol=1e-6)
    # Between the middles of the first and the last edge lie 39 of 40 edges.
    torque = SOLID.twist_stiffness(RADIUS) * (twist[-1] - twist[0]) / (0.2 * 39 / 40)
    held = HOLD * energy.stiffness.twist_scale()[39] * (holds.angles[1] - rest.x[3 * energy.count + 39])
    assert held * energy.unit == pytest.approx(torque, rel=1e-6)


def test_held_vertices_withstand_at_rest_what_holds_them() -> None:
    energy, holds, x = _spun(3.0, 0.0)
    ends = np.array([0, 1, 39, 40])
    targets = energy.sheet.vertices[ends] * [1.02, 1.0, 1.0]
    pulled = Holds(ends, targets, spun=holds.spun, angles=holds.angles)
    rest = rod_equilibrium(energy, x, pulled, tolerance=1e-10)
    assert rest.status is Status.CONVERGED
    force = pulled.forces(energy, rest.x)
    np.testing.assert_allclose(reactions(energy, pulled, rest.x), force, atol=1e-6 * np.abs(force).max())
    assert np.abs(force[:, 0]).max() > 0


@pytest.mark.parametrize(("share", "buckles"), [(0.9, False), (1.15, True)])
def test_a_twisted_yarn_buckles_at_greenhills_torque(share: float, buckles: bool) -> None:
    """M L/(EI) = 8.9868 for clamped ends that may draw together (Greenhill 1883; tan(M L/2EI) = M L/2EI)."""
    ratio = SOLID.twist_stiffness(RADIUS) / SOLID.bending_stiffness(RADIUS)
    energy, holds, x = _spun(share * 8.9868 / ratio, 0.2)
    rest = rod_equilibrium(energy, x, holds, tolerance=1e-7, max_iterations=600)
    aside = np.linalg.norm(energy.positions(rest.x)[:, 1:], axis=1).max()
    assert (aside > 1.0) == buckles
    assert rest.status is Status.CONVERGED
    if not buckles:
        assert aside < 1e-2


def _moving() -> tuple[FabricDynamics, FabricMotion]:
    generator = np.random.default_rng(7)
    turn = np.linspace(0, 2 * math.pi, 24, endpoint=False)
    ring = 0.01 * np.stack([np.cos(turn), np.sin(turn), 0.1 * np.sin(3 * turn)], 1)
    sheet = YarnSheet.from_lines([ring], RADIUS, closed=True, bent=True)
    dynamics = FabricDynamics(FabricEnergy(sheet, SOLID), MotionSettings(gravity=(0.0, 0.0, 0.0), method="explicit"))
    start = dynamics.start()
    velocity = np.zeros_like(start.velocity)
    velocity[: 3 * 24] = 20.0 * generator.standard_normal(72)
    return dynamics, FabricMotion(start.x, velocity)


def test_explicit_steps_keep_momentum_and_energy_and_damping_only_what_is_not_rigid() -> None:
    dynamics, motion = _moving()
    count = dynamics.energy.count
    step = 0.1 * dynamics.stable_step(motion)

    def momenta(motion: FabricMotion) -> np.ndarray:
        positions = dynamics.energy.positions(motion.x)
        push = (dynamics.mass * motion.velocity)[: 3 * count].reshape(-1, 3)
        tangents = unit_edges(positions, dynamics.energy.sheet.following)
        spin = (dynamics.mass * motion.velocity)[3 * count :, None] * tangents
        return np.concatenate([push.sum(axis=0), (np.cross(positions, push) + spin).sum(axis=0)])

    before, first = momenta(motion), sum(dynamics.energies(motion).values())
    for _ in range(400):
        motion = dynamics.step(motion, step).state
    # Velocities belong to the middle of steps: those before and after a state make that of the state.
    after = dynamics.step(motion, step).state
    middle = FabricMotion(motion.x, 0.5 * (motion.velocity + after.velocity))
    assert sum(dynamics.energies(middle).values()) == pytest.approx(first, rel=1e-3)
    scale = np.abs(before).max()
    np.testing.assert_allclose(momenta(motion)[:3], before[:3], atol=1e-10 * scale)
    np.testing.assert_allclose(momenta(motion)[3:], before[3:], atol=1e-2 * scale)
    whole = Patches.cubes(dynamics.energy.sheet, 1e6)
    moves = dynamics.energy.positions(motion.velocity).copy()
    rigid = whole.rigid(dynamics.energy.positions(motion.x), moves, dynamics.mass[: 3 * count : 3])
    again = whole.rigid(dynamics.energy.positions(motion.x), rigid, dynamics.mass[: 3 * count : 3])
    np.testing.assert_allclose(again, rigid, atol=1e-9 * np.abs(rigid).max())
    kept = FabricMotion(motion.x, np.concatenate([rigid.ravel(), motion.velocity[3 * count :]]))
    np.testing.assert_allclose(momenta(kept), momenta(motion), atol=1e-10 * scale)


def test_implicit_steps_fall_freely_and_lose_energy_only() -> None:
    dynamics, motion = _moving()
    dynamics = FabricDynamics(dynamics.energy, MotionSettings(tolerance=1e-8, enough=0.0, iterations=60))
    motion = FabricMotion(motion.x, 0.0 * motion.velocity)
    height = dynamics.energy.positions(motion.x)[:, 2].mean() * RADIUS
    total = sum(dynamics.energies(motion).values())
    for _ in range(10):
        step = dynamics.step(motion, 1 / 200)
        assert step.status is Status.CONVERGED
        motion = step.state
        new = sum(dynamics.energies(motion).values())
        assert new <= total + 1e-12
        total = new
    # Implicit Euler falls by g t (t + Δt)/2.
    fallen = height - dynamics.energy.positions(motion.x)[:, 2].mean() * RADIUS
    assert fallen == pytest.approx(9.81 * 0.05 * (0.05 + 1 / 200) / 2, rel=1e-6)


@pytest.mark.parametrize("rate", [100, 10_000])
def test_a_light_yarn_beside_a_held_one_begins_to_fall_however_short_the_steps(rate: int) -> None:
    """Its share of the fabric's weight is a hundredth, and its gain in the first step the less the shorter that is."""
    held, free = _straight(100, 0.2), _straight(2, 0.002)
    lines = [held.vertices, np.add(free.vertices, [0.0, 0.05, 0.0])]
    sheet = YarnSheet.from_lines(lines, RADIUS)
    energy = FabricEnergy(sheet, SOLID)
    nodes = np.arange(101)
    holds = Holds(nodes, sheet.vertices[nodes])
    dynamics = FabricDynamics(energy, MotionSettings(), lambda time: holds)
    motion = dynamics.start()
    for _ in range(5):
        motion = dynamics.step(motion, 1 / rate).state
    fallen = -energy.positions(motion.x)[101:, 2].mean() * RADIUS
    assert fallen == pytest.approx(9.81 * 15 / rate**2, rel=1e-3)


def test_a_step_depends_on_its_motion_alone_and_not_on_steps_made_before(crossing: Crossing) -> None:
    energy = crossing(1.6)
    dynamics = FabricDynamics(energy, MotionSettings(iterations=60))
    start = dynamics.start()
    first = dynamics.step(start, 1 / 240)
    motion = first.state
    for _ in range(3):
        motion = dynamics.step(motion, 1 / 30).state
    again = dynamics.step(start, 1 / 240)
    assert (again.iterations, again.factorisations) == (first.iterations, first.factorisations)
    np.testing.assert_allclose(again.state.x, first.state.x, rtol=0, atol=1e-9)
    # What does make a difference is the regularisation that a motion brings along from its last step.
    assert again.state.shift == first.state.shift < 1e-2
    held_back = dynamics.step(replace(start, shift=1e-2), 1 / 240)
    assert held_back.factorisations != first.factorisations
    np.testing.assert_allclose(held_back.state.x, first.state.x, rtol=0, atol=1e-2)


def test_a_yarn_that_is_forced_through_another_is_counted_and_safe_steps_stop_before(
    crossing: Crossing,
) -> None:
    energy = crossing(2.5)
    start = energy.start()
    through = start.copy()
    energy.positions(through)[21:, 2] -= 5.0
    energy.count_passages()
    energy.anchor(through)
    assert energy.passage_count == 1
    energy.anchor(start)
    assert energy.passage_count == 0  # taken back
    stopped = safe_path(energy, start, through)
    above = energy.positions(stopped)[21:, 2].min()
    assert 0.0 < above < 0.1
    assert energy.passage_count == 0


def test_steps_stop_yarns_that_fly_at_each_other(crossing: Crossing) -> None:
    energy = crossing(4.0)
    energy.count_passages()
    dynamics = FabricDynamics(energy, MotionSettings(gravity=(0.0, 0.0, 0.0), iterations=60))
    motion = dynamics.start()
    energy.positions(motion.velocity)[21:, 2] = -1000.0  # a metre a second
    for _ in range(12):
        motion = dynamics.step(motion, 1 / 500).state
    assert energy.passage_count == 0
    middle = energy.positions(motion.x)
    assert middle[31, 2] > middle[10, 2]


def test_a_yarn_that_falls_on_the_floor_stays_on_it() -> None:
    sheet = _straight(10, 0.02)
    energy = FabricEnergy(sheet, SOLID)
    floor = Pushes(energy, Plane((0.0, 0.0, -0.003), (0.0, 0.0, 1.0)))
    step, motion = 1 / 100, None
    dynamics = FabricDynamics(energy, MotionSettings(damping=20.0, iterations=60), obstacles=(floor,))
    motion = dynamics.start()
    for _ in range(40):
        motion = dynamics.step(motion, step).state
    heights = energy.positions(motion.x)[:, 2]
    np.testing.assert_allclose(heights, -2.0, atol=0.05)  # one radius above the floor
