"""Contact: derivatives, no penetration, rest on obstacles, layers that stay apart, friction."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import brentq

from yarnscale.errors import InputError
from yarnscale.motion.obstacles import MeshObstacle, Obstacle, Plane, Sphere
from yarnscale.motion.run import simulate
from yarnscale.motion.schedule import Schedule
from yarnscale.shell.contact.cloth_contact import ClothContact, ContactSettings
from yarnscale.shell.dynamics.cloth import Cloth
from yarnscale.shell.dynamics.solver import ClothSolver
from yarnscale.shell.materials.orthotropic import JERSEY
from yarnscale.shell.mesh import TriangleMesh, rectangle
from yarnscale.shell.state import ClothState

SOFT = replace(JERSEY, bend_weft=1e-6, bend_bias=1e-6, bend_warp=1e-6)
NEAR = ContactSettings(thickness=2e-3, friction=0.3)


def ball_mesh(radius: float, depth: float, *, refined: int = 0) -> MeshObstacle:
    """An icosahedron, its triangles quartered so many times, with its top at z = 0, sunk by ``depth``."""
    golden = (1 + math.sqrt(5)) / 2
    corners = np.array([[0, s, t * golden] for s in (-1, 1) for t in (-1, 1)], float)
    points = np.concatenate([corners, corners[:, [1, 2, 0]], corners[:, [2, 0, 1]]])
    points /= np.linalg.norm(points[0])
    faces = []
    for i in range(12):
        for j in range(i + 1, 12):
            for k in range(j + 1, 12):
                sides = [np.linalg.norm(points[a] - points[b]) for a, b in ((i, j), (j, k), (k, i))]
                if max(sides) < 1.06:
                    faces.append([i, j, k])
    for _ in range(refined):
        corners, faces = points[np.array(faces)], []
        middles = corners + np.roll(corners, -1, axis=1)
        parts = [np.stack([corners[:, k], middles[:, k], middles[:, k - 1]], axis=1) for k in range(3)]
        flat = np.concatenate([*parts, middles]).reshape(-1, 3)
        flat /= np.linalg.norm(flat, axis=1)[:, None]
        points, numbers = np.unique(flat.round(12), axis=0, return_inverse=True)
        faces = numbers.reshape(-1, 3)
    return MeshObstacle(points * radius - [0, 0, radius * points[:, 2].max() + depth], np.array(faces))


def folded(mesh: TriangleMesh, gap: float) -> np.ndarray:
    """The sheet folded over a small cylinder so that two layers lie ``gap`` apart."""
    radius = gap / 2
    u = mesh.panel[:, 0]
    half = math.pi * radius / 2
    x = np.where(np.abs(u) < half, radius * np.cos(u / radius), radius * 0 - (np.abs(u) - half))
    z = np.where(np.abs(u) < half, radius * np.sin(u / radius), np.sign(u) * radius)
    return np.column_stack([x, mesh.panel[:, 1], z])


def scene(obstacle: Obstacle | None) -> tuple[ClothContact, np.ndarray]:
    rng = np.random.default_rng(0)
    mesh = rectangle(0.04, 0.04, 0.008)
    if obstacle is None:
        positions = folded(mesh, 1.5e-3)
        positions += 1e-4 * rng.standard_normal(positions.shape)
    else:
        positions = np.column_stack([mesh.panel, np.full(mesh.vertex_count, 1e-3)])
        positions[:, 2] += 2e-4 * rng.standard_normal(mesh.vertex_count)
    settings = ContactSettings(thickness=2e-3, friction=0.3, self_contact=obstacle is None)
    return ClothContact(mesh, settings, () if obstacle is None else (obstacle,)), positions


@pytest.mark.parametrize(
    "obstacle",
    [
        None,
        Sphere((0.002, 0.001, -0.1), 0.1),
        Plane((0.0, 0.0, -5e-4), (0.03, 0.0, 1.0)),
        ball_mesh(0.05, 0.0),
    ],
    ids=["self", "sphere", "plane", "mesh"],
)
def test_gradient_and_hessian_match_finite_differences(obstacle: Obstacle | None, derivatives) -> None:
    contact, positions = scene(obstacle)
    contact.start_step(positions, 0.01)
    positions = positions + 2e-5 * np.random.default_rng(1).standard_normal(positions.shape)
    gradient, model, exact = derivatives(contact, positions)
    assert np.abs(gradient).max() > 1e-4
    # The model drops negative curvature only: along the gradient it is the exact one within a few per cent.
    direction = gradient.ravel() / np.linalg.norm(gradient)
    assert direction @ model @ direction == pytest.approx(direction @ exact @ direction, rel=0.1)


def test_a_sheet_comes_to_rest_on_a_sphere() -> None:
    mesh = rectangle(0.12, 0.12, 0.01)
    ball = Sphere((0.0, 0.0, -0.05), 0.05)
    cloth = Cloth(mesh, SOFT, contact=NEAR, obstacles=(ball,), damping=5.0)
    solver = ClothSolver(cloth)
    start = ClothState.flat(mesh, height=2e-3)
    run = simulate(solver, start, Schedule(0.5, 0.025, to_rest=False))
    assert run.converged
    distance = np.linalg.norm(run.state.positions - ball.centre, axis=1) - ball.radius
    assert distance.min() > 0
    assert not solver.intersects(run.state)
    assert run.state.positions[:, 2].min() < -0.04
    assert run.state.positions[:, 2].max() > 0
    # The ball carries the sheet: contact pushes up with about its weight.
    _, gradient = solver.contact.gradient(run.state.positions)
    assert -gradient[:, 2].sum() == pytest.approx(0.2 * 0.0144 * 9.81, rel=0.25)


def test_a_cap_rests_on_a_ball_as_high_however_finely_that_is_divided() -> None:
    """Edges from two and a half thicknesses to two thirds of one, and the ball as a formula: height and force."""
    radius, thickness, weight = 0.02, 1e-3, 60.0
    mesh = rectangle(0.03, 0.03, 0.002)
    settings = ContactSettings(thickness, self_contact=False)
    away = np.linalg.norm(mesh.panel, axis=1)
    angle, around = away / radius, mesh.panel / np.maximum(away, 1e-12)[:, None]
    directions = np.column_stack([np.sin(angle)[:, None] * around, np.cos(angle)])
    heights, forces = [], []
    for refined in (None, 3, 4, 5):
        if refined is None:
            ball: Obstacle = Sphere((0.0, 0.0, 0.0), radius)
        else:
            ball = ball_mesh(radius, -radius, refined=refined)
        contact = ClothContact(mesh, settings, (ball,))

        def pressure(height: float, contact: ClothContact = contact) -> float:
            gradient = contact.gradient((radius + height) * directions)[1]
            return -float((gradient * directions).sum()) / float(mesh.areas.sum())

        forces.append(pressure(0.5 * thickness))
        found = brentq(lambda height: pressure(height) - weight, 0.3 * thickness, 0.99 * thickness)
        heights.append(float(found) / thickness)  # type: ignore[arg-type]
    # Facets of 2.6 mm lie 0.04 mm below the ball, those of the cloth as much below its vertices.
    np.testing.assert_allclose(heights, heights[-1], atol=0.04)
    assert heights[2] == pytest.approx(heights[3], abs=0.005)
    np.testing.assert_allclose(forces, settings.pressure, rtol=0.15)
    assert forces[2] == pytest.approx(forces[3], rel=0.02)


@pytest.mark.parametrize("obstacle", [Plane(), ball_mesh(0.06, 0.0)], ids=["plane", "mesh"])
def test_nothing_falls_through(obstacle: Obstacle) -> None:
    mesh = rectangle(0.05, 0.05, 0.01)
    solver = ClothSolver(Cloth(mesh, SOFT, contact=NEAR, obstacles=(obstacle,), damping=2.0))
    start = ClothState.flat(mesh, height=0.02)
    fast = ClothState(start.positions, start.velocities - [0, 0, 3.0])
    run = simulate(solver, fast, Schedule(0.1, 0.02, to_rest=False))
    assert run.converged
    assert not solver.intersects(run.state)
    assert 0 < solver.closest(run.state) < NEAR.thickness
    assert run.state.positions[:, 2].max() > -0.02


def test_layers_that_fall_on_each_other_stay_apart() -> None:
    mesh = rectangle(0.06, 0.03, 0.006)
    positions = folded(mesh, 8e-3)
    positions[:, 2] += 6e-3
    cloth = Cloth(mesh, SOFT, contact=ContactSettings(friction=0.1), obstacles=(Plane(),))
    solver = ClothSolver(cloth)
    run = simulate(solver, ClothState(positions, np.zeros_like(positions)), Schedule(0.2, 0.01, to_rest=False))
    assert run.converged
    heights = run.state.positions[:, 2]
    upper, lower = mesh.panel[:, 0] > 0.015, mesh.panel[:, 0] < -0.015
    assert not solver.intersects(run.state)
    assert 0 < heights[lower].max() < 1e-3 < heights[upper].min() < 2.5e-3
    between_layers = ClothContact(mesh, ContactSettings()).closest(run.state.positions)
    assert 0 < between_layers < 1e-3


@pytest.mark.parametrize(("friction", "slides"), [(0.0, True), (0.8, False)])
def test_friction_holds_a_sheet_on_a_slope(friction: float, slides: bool) -> None:
    mesh = rectangle(0.04, 0.04, 0.01)
    angle = 0.3
    slope = Plane((0.0, 0.0, 0.0), (math.sin(angle), 0.0, math.cos(angle)))
    settings = ContactSettings(thickness=2e-3, friction=friction, self_contact=False)
    cloth = Cloth(mesh, SOFT, contact=settings, obstacles=(slope,))
    flat = ClothState.flat(mesh).positions
    turned = np.column_stack([flat[:, 0] * math.cos(angle), flat[:, 1], -flat[:, 0] * math.sin(angle)])
    start = ClothState(turned + 1.2e-3 * np.asarray(slope.normal), np.zeros_like(flat))
    run = simulate(ClothSolver(cloth), start, Schedule(0.2, 0.01, to_rest=False))
    moved = (run.state.positions - start.positions).mean(axis=0)
    downhill = moved @ [math.cos(angle), 0, -math.sin(angle)]
    expected = 0.5 * 9.81 * math.sin(angle) * 0.2**2
    assert downhill == pytest.approx(expected, rel=0.1) if slides else abs(downhill) < 0.05 * expected


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: Sphere((0, 0, 0), -1.0), "sphere radius; expected a positive length"),
        (lambda: Sphere((0, 0), 1.0), "sphere centre; expected three"),  # type: ignore[arg-type]
        (lambda: Plane(normal=(0.0, 0.0, 0.0)), "plane normal; expected a direction"),
        (
            lambda: MeshObstacle(np.zeros((3, 3)), np.array([[0, 1, 5]])),
            "obstacle triangles; expected vertices 0..2",
        ),
        (lambda: ContactSettings(thickness=0.0), "contact thickness; expected a positive"),
        (lambda: ContactSettings(friction=-0.1), "contact friction; expected zero or"),
    ],
)
def test_impossible_obstacles_are_named(call, message: str) -> None:
    with pytest.raises(InputError, match=message):
        call()
