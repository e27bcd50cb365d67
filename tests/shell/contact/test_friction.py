"""Coulomb friction against closed forms: slope, moving belt, rope round a drum."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Literal

import numpy as np
import pytest
from scipy.optimize import brentq

from yarnscale.motion.handles import Handle
from yarnscale.motion.obstacles import MeshObstacle, Obstacle, Plane, Sphere
from yarnscale.motion.rigid import STILL, Motion, rotation_matrix
from yarnscale.motion.run import simulate
from yarnscale.motion.schedule import Schedule
from yarnscale.shell.contact.cloth_contact import ContactSettings
from yarnscale.shell.dynamics.cloth import Cloth
from yarnscale.shell.dynamics.solver import ClothSolver, SolverOptions
from yarnscale.shell.materials.orthotropic import JERSEY
from yarnscale.shell.mesh import TriangleMesh, rectangle
from yarnscale.shell.state import ClothState

GRAVITY = 9.81


def floor(kind: str, down: np.ndarray, motion: Motion = STILL) -> Obstacle:
    """A plane through the origin with the direction ``down`` (3,) in it, as a formula or as two triangles."""
    normal = np.cross(down, [0.0, 1.0, 0.0])
    if kind == "plane":
        return Plane(normal=(normal[0], normal[1], normal[2]), motion=motion)
    corners = np.array([a * down + [0.0, b, 0.0] for a in (-0.5, 0.7) for b in (-0.4, 0.4)])
    return MeshObstacle(corners, np.array([[0, 2, 1], [2, 3, 1]]), motion)


def laid(solver: ClothSolver, mesh: TriangleMesh, down: np.ndarray) -> ClothState:
    """The sheet at the height where contact carries its weight."""
    normal = np.cross(down, [0.0, 1.0, 0.0])
    flat = mesh.assembled[:, :1] * down + mesh.assembled[:, 1:2] * [0.0, 1.0, 0.0]
    weight = float(solver.masses.sum()) * GRAVITY * normal[2]
    contact = solver.contact
    assert contact is not None

    def surplus(height: float) -> float:
        positions = np.concatenate([flat + height * normal, contact.places(0.0)])
        return -float((contact.gradient(positions)[1][: mesh.vertex_count] @ normal).sum()) - weight

    thickness = contact.settings.thickness
    height = float(brentq(surplus, 0.01 * thickness, thickness * (1 - 1e-9)))  # type: ignore[arg-type]
    return ClothState(flat + height * normal, np.zeros_like(flat))


def moved(obstacle: Obstacle, friction: float, down: np.ndarray, duration: float) -> tuple[float, float]:
    """Displacement [m] and speed [m/s] along ``down`` of a sheet laid on an obstacle."""
    mesh = rectangle(0.04, 0.04, 0.01)
    settings = ContactSettings(thickness=2e-3, friction=friction, self_contact=False)
    solver = ClothSolver(Cloth(mesh, JERSEY, contact=settings, obstacles=(obstacle,)), SolverOptions(tolerance=1e-5))
    start = laid(solver, mesh, down)
    run = simulate(solver, start, Schedule(duration, 0.01, to_rest=False))
    assert run.converged
    way = (run.state.positions - start.positions) @ down
    return float(way.mean()), float((run.state.velocities @ down).mean())


@pytest.mark.parametrize("kind", ["plane", "mesh"])
@pytest.mark.parametrize("angle", [math.atan(0.3) - 0.03, math.atan(0.3) + 0.1, 0.6])
def test_a_sheet_on_a_slope_sticks_below_the_angle_of_friction_and_slides_above(kind: str, angle: float) -> None:
    friction, duration = 0.3, 0.2
    down = np.array([math.cos(angle), 0.0, -math.sin(angle)])
    way, _ = moved(floor(kind, down), friction, down, duration)
    acceleration = GRAVITY * (math.sin(angle) - friction * math.cos(angle))
    if acceleration < 0:
        # What sticks moves until friction carries it, by a part of the slip that friction needs in one step.
        assert 0 < way < ContactSettings().slip * 0.01
    else:
        # Implicit Euler adds half a step.
        assert way == pytest.approx(0.5 * acceleration * duration * (duration + 0.01), rel=1e-3)


@pytest.mark.parametrize("kind", ["plane", "mesh", "ball", "moving plane"])
@pytest.mark.parametrize("step", [0.01, 1.0 / 30.0])
def test_what_sticks_on_a_slope_stays(kind: str, step: float) -> None:
    """A sheet with friction 0.6 on a slope of 0.4 moves by less than 0.02 mm/s."""
    down = np.array([1.0, 0.0, -0.4]) / math.hypot(1.0, 0.4)
    normal = np.cross(down, [0.0, 1.0, 0.0])
    motion = Motion((0.0, 0.01, 0.0), duration=3.0, ease=False) if kind == "moving plane" else STILL
    slope = floor("mesh" if kind == "mesh" else "plane", down, motion)
    if kind == "ball":  # flat for the sheet
        slope = Sphere((-20.0 * normal[0], -20.0 * normal[1], -20.0 * normal[2]), 20.0)
    mesh = rectangle(0.04, 0.04, 0.01)
    settings = ContactSettings(thickness=2e-3, friction=0.6, self_contact=False)
    solver = ClothSolver(Cloth(mesh, JERSEY, contact=settings, obstacles=(slope,)))
    start, places = laid(solver, mesh, down), {}
    run = simulate(
        solver,
        start,
        Schedule(1.0, step, to_rest=False, frame_interval=0.5),
        on_frame=lambda _, state: places.update({state.time: state.positions}),
    )
    assert run.converged and run.loose_steps == 0
    (_, _), (first, before), (last, after) = sorted(places.items())
    moved_by = after - before - (last - first) / 3.0 * np.array(motion.displacement)
    assert np.abs(moved_by).max() < 0.02e-3 * (last - first)


def test_layers_that_stick_on_each_other_stay() -> None:
    """Two sheets, turned against each other, lie on a slope: pairs of edges and of vertices and triangles hold them."""
    slope, one = math.atan(0.4), rectangle(0.06, 0.06, 0.015)
    turned = one.panel @ rotation_matrix(np.array([0.0, 0.0, 0.4]))[:2, :2].T
    flat = [np.column_stack([xy, np.full(len(xy), z)]) for xy, z in ((one.panel, 6e-4), (turned, 1.3e-3))]
    tilt = rotation_matrix(np.array([0.0, slope, 0.0]))
    mesh = TriangleMesh(
        np.concatenate([one.panel, turned + np.array([0.2, 0.0])]),
        np.concatenate([one.triangles, one.triangles + one.vertex_count]),
        assembled=np.concatenate(flat) @ tilt.T,
    )
    floor_below = Plane(normal=(math.sin(slope), 0.0, math.cos(slope)))
    cloth = Cloth(mesh, JERSEY, contact=ContactSettings(friction=0.6), obstacles=(floor_below,), damping=2.0)
    places: list[np.ndarray] = []
    run = simulate(
        ClothSolver(cloth),
        ClothState.flat(mesh),
        Schedule(1.5, 1.0 / 30.0, to_rest=False, frame_interval=0.5),
        on_frame=lambda _, state: places.append(state.positions.reshape(2, -1, 3).mean(axis=1)),
    )
    assert run.converged and run.faults["intersections"] == 0
    assert np.abs(places[-1] - places[-2]).max() < 0.02e-3 * 0.5


@pytest.mark.parametrize("integrator", ["euler", "bdf2"])
def test_sticking_creates_no_energy(integrator: Literal["euler", "bdf2"]) -> None:
    """A sheet pushed along a floor comes to rest, never with more energy than two steps before (BDF2 overshoots)."""
    mesh, down = rectangle(0.04, 0.04, 0.01), np.array([1.0, 0.0, 0.0])
    settings = ContactSettings(thickness=2e-3, friction=0.5, self_contact=False)
    solver = ClothSolver(
        Cloth(mesh, JERSEY, contact=settings, obstacles=(floor("plane", down),)),
        SolverOptions(tolerance=1e-4, integrator=integrator),
    )
    state = laid(solver, mesh, down)
    state = replace(state, velocities=np.tile([0.2, 0.0, 0.0], (len(state.positions), 1)))
    start, kinetic = state, [solver.energies(state)["kinetic"]]
    for _ in range(40):
        state = solver.advance(state, 0.005).state
        kinetic.append(solver.energies(state)["kinetic"])
    assert (np.array(kinetic[2:]) <= np.array(kinetic[:-2]) + 1e-9 * kinetic[0]).all()
    assert kinetic[-1] < 1e-8 * kinetic[0]
    way = float((state.positions - start.positions).mean(axis=0)[0])
    late = 0.5 * 0.2 * 0.005 if integrator == "euler" else 0.0  # implicit Euler takes the speed of the end of a step
    assert way == pytest.approx(0.2**2 / (2 * 0.5 * GRAVITY) - late, rel=0.03)


@pytest.mark.parametrize("kind", ["plane", "mesh", "turning ball"])
def test_a_belt_takes_a_sheet_along(kind: str) -> None:
    """It gains speed by friction·g until it has that of the belt."""
    speed, friction, along = 0.2, 0.3, np.array([1.0, 0.0, 0.0])
    if kind == "turning ball":
        radius = 20.0  # flat for the sheet
        motion = Motion(rotation=(0.0, speed / radius, 0.0), pivot=(0.0, 0.0, -radius), duration=1.0, ease=False)
        belt: Obstacle = Sphere((0.0, 0.0, -radius), radius, motion)
    else:
        belt = floor(kind, along, Motion((speed, 0.0, 0.0), duration=1.0, ease=False))
    assert moved(belt, friction, along, 0.04)[1] == pytest.approx(friction * GRAVITY * 0.04, rel=5e-3)
    assert moved(belt, friction, along, 0.12)[1] == pytest.approx(speed, rel=1e-2)


@pytest.mark.parametrize("friction", [0.2, 0.4])
def test_a_strip_pulled_round_a_drum_follows_the_rope_law(friction: float) -> None:
    """Forces on both sides of half a turn differ by exp(friction·π) (Euler and Eytelwein)."""
    drum, width, duration = 0.02, 0.012, 0.6
    length, radius = math.pi * drum + 0.12, drum + 5e-4
    mesh = rectangle(length, width, 0.006)
    along = mesh.panel[:, 0]
    angle, side = along / radius, np.sign(along)
    around = np.abs(angle) <= math.pi / 2
    x = np.where(around, radius * np.sin(angle), side * radius)
    z = np.where(around, radius * np.cos(angle), math.pi / 2 * radius - np.abs(along))
    positions = np.column_stack([x, mesh.panel[:, 1], z])
    turn = np.linspace(0.0, 2 * math.pi, 64, endpoint=False)
    ring = np.column_stack([drum * np.sin(turn), np.zeros(64), drum * np.cos(turn)])
    sideways = np.array([0.0, 1.5 * width, 0.0])
    corners = np.concatenate([ring - sideways, ring + sideways])
    here = np.arange(64)
    there = (here + 1) % 64
    faces = np.concatenate(
        [np.stack([here, there, 64 + there], axis=1), np.stack([here, 64 + there, 64 + here], axis=1)]
    )
    ends = []
    for name, sign, way in (("pulled", 1.0, -0.014), ("followed", -1.0, 0.006)):
        held = np.flatnonzero(sign * along > 0.5 * length - 0.0036)
        ends.append(Handle(name, held, positions[held], Motion((0.0, 0.0, way), duration=duration, ease=False)))
    settings = ContactSettings(friction=friction, self_contact=False)
    cloth = Cloth(mesh, JERSEY, tuple(ends), (0.0, 0.0, 0.0), settings, (MeshObstacle(corners, faces),), damping=20.0)
    solver = ClothSolver(cloth)
    run = simulate(solver, ClothState(positions, np.zeros_like(positions)), Schedule(duration, 0.02, to_rest=False))
    assert run.converged
    pulled, followed = (-solver.pull(end, run.state)[2] for end in ends)
    # The strip lies on the drum in chords of 6 mm, 0.3 radians each.
    assert pulled / followed == pytest.approx(math.exp(friction * math.pi), rel=0.05)
