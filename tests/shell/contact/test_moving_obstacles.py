"""Obstacles that move and cloth in tight places: derivatives, places reached, and no frame that intersects."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from yarnscale.errors import InputError
from yarnscale.motion.handles import Handle
from yarnscale.motion.obstacles import AnimatedMesh, MeshObstacle, Obstacle, Plane, Sphere
from yarnscale.motion.rigid import Motion, rotation_matrix
from yarnscale.motion.run import Run, simulate
from yarnscale.motion.schedule import Schedule
from yarnscale.shell.contact.cloth_contact import ClothContact, ContactSettings
from yarnscale.shell.dynamics.cloth import Cloth
from yarnscale.shell.dynamics.solver import ClothSolver
from yarnscale.shell.materials.orthotropic import JERSEY
from yarnscale.shell.mesh import TriangleMesh, rectangle
from yarnscale.shell.state import Attachment, ClothState

SOFT = replace(JERSEY, bend_weft=1e-6, bend_bias=1e-6, bend_warp=1e-6)
STEP = 1.0 / 60.0


def box(size: float, height: float) -> tuple[np.ndarray, np.ndarray]:
    """A cube of twelve triangles with its top at a height."""
    corners = np.array([[i, j, k] for i in (-0.5, 0.5) for j in (-0.5, 0.5) for k in (-1.0, 0.0)])
    faces = [[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1]]
    faces += [[2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3]]
    return corners * size + [0, 0, height], np.array(faces)


def grid(places: np.ndarray) -> np.ndarray:
    """Triangles between places (n, m) of vertices in rows; the last row and column meet the first."""
    here, right = places, np.roll(places, -1, axis=1)
    above, across = np.roll(here, -1, axis=0), np.roll(right, -1, axis=0)
    halves = [np.stack([here, right, across], axis=-1), np.stack([here, across, above], axis=-1)]
    return np.stack(halves, axis=2)


def ring(radius: float, thick: float) -> MeshObstacle:
    """A torus about the z-axis."""
    u, v = np.meshgrid(np.arange(24) * math.pi / 12, np.arange(8) * math.pi / 4, indexing="ij")
    reach = radius + thick * np.cos(v)
    points = np.stack([reach * np.cos(u), reach * np.sin(u), thick * np.sin(v)], axis=-1).reshape(-1, 3)
    return MeshObstacle(points, grid(np.arange(192).reshape(24, 8)).reshape(-1, 3))


def pipe(radius: float, length: float) -> tuple[np.ndarray, np.ndarray]:
    """An open cylinder along the y-axis."""
    y, u = np.meshgrid(np.linspace(-0.5, 0.5, 7) * length, np.arange(16) * math.pi / 8, indexing="ij")
    points = np.stack([radius * np.sin(u), y, radius * np.cos(u)], axis=-1).reshape(-1, 3)
    return points, grid(np.arange(112).reshape(7, 16))[:-1].reshape(-1, 3)


def holding(mesh: TriangleMesh, chosen: np.ndarray, start: ClothState, motion: Motion) -> Handle:
    vertices = np.flatnonzero(chosen)
    return Handle("held", vertices, start.positions[vertices], motion)


def run(cloth: Cloth, start: ClothState, duration: float) -> tuple[ClothSolver, Run]:
    """Simulate and check every frame by the test of ``ipctk`` over all triangles."""
    solver, crossed = ClothSolver(cloth), []
    outcome = simulate(
        solver,
        start,
        Schedule(duration, STEP, to_rest=False, frame_interval=STEP),
        on_frame=lambda number, state: crossed.append(solver.intersects(state)),
    )
    assert outcome.converged
    assert len(crossed) >= duration / STEP
    assert not any(crossed) and outcome.faults["intersections"] == 0
    return solver, outcome


@pytest.mark.parametrize(
    "obstacle",
    [
        Sphere((0.002, 0.001, -0.03), 0.03, Motion((0.0, 0.0, 0.01), 0.0, 1.0, (0.0, 5.0, 0.0))),
        Plane((0.0, 0.0, -5e-4), (0.03, 0.0, 1.0), Motion((0.1, 0.0, 0.0), 0.0, 1.0)),
        MeshObstacle(*box(0.03, -2e-4), Motion((0.0, 0.0, 0.01), 0.0, 1.0, (0.0, 0.0, 5.0))),
    ],
    ids=["sphere", "plane", "mesh"],
)
@pytest.mark.parametrize("friction", [0.0, 0.3])
def test_derivatives_by_cloth_and_obstacle_match_finite_differences(
    obstacle: Obstacle, friction: float, derivatives
) -> None:
    rng = np.random.default_rng(0)
    mesh = rectangle(0.04, 0.04, 0.01)
    settings = ContactSettings(thickness=2e-3, friction=friction, self_contact=False)
    contact = ClothContact(mesh, settings, (obstacle,))
    positions = mesh.assembled + [0, 0, 1e-3] + 2e-4 * rng.standard_normal(mesh.assembled.shape)
    positions = np.concatenate([positions, contact.places(0.0)])
    assert len(positions) == mesh.vertex_count + contact.guests
    contact.start_step(positions, 0.01, 0.5)
    positions = positions + 2e-5 * rng.standard_normal(positions.shape)
    gradient, model, exact = derivatives(contact, positions)
    scale, stiffest = np.abs(gradient).max(), np.abs(model).max()
    assert np.abs(gradient[mesh.vertex_count :]).max() > 1e-4
    # Action and reaction: no total force.
    np.testing.assert_allclose(gradient.sum(axis=0), 0.0, atol=1e-9 * scale)
    # The model leaves out negative curvature only.
    left_out = np.linalg.eigvalsh(0.5 * (exact + exact.T) - model)
    assert left_out[-1] < 1e-3 * stiffest
    assert left_out[0] > -0.5 * stiffest


def test_a_motion_turns_about_its_carried_pivot() -> None:
    motion = Motion((1.0, 0.0, 0.0), 0.5, 1.0, (0.0, 0.0, math.pi / 2), (0.0, 2.0, 0.0))
    point = np.array([[1.0, 2.0, 3.0]])
    np.testing.assert_allclose(motion.place(point, 0.2), point)
    np.testing.assert_allclose(motion.place(point, 2.0), [[1.0, 3.0, 3.0]], atol=1e-15)
    assert motion.share(1.0) == pytest.approx(0.5)
    axis = np.array([0.3, -0.2, 0.9])
    matrix = rotation_matrix(axis)
    np.testing.assert_allclose(matrix @ matrix.T, np.eye(3), atol=1e-15)
    np.testing.assert_allclose(matrix @ axis, axis, atol=1e-15)
    assert np.trace(matrix) == pytest.approx(1 + 2 * math.cos(np.linalg.norm(axis)))


def test_an_animated_mesh_moves_straight_between_poses() -> None:
    points, faces = box(1.0, 0.0)
    body = AnimatedMesh(np.array([1.0, 3.0]), np.stack([points, 2.0 * points]), faces)
    np.testing.assert_allclose(body.points(0.0), points)
    np.testing.assert_allclose(body.points(1.5), 1.25 * points)
    np.testing.assert_allclose(body.points(3.5), 2.0 * points)
    with pytest.raises(InputError, match="animation times; expected 2 increasing"):
        AnimatedMesh(np.array([1.0, 1.0]), np.stack([points, points]), faces)


@pytest.mark.parametrize("kind", ["ball", "box", "animated"])
def test_a_body_that_rises_lifts_the_cloth(kind: str) -> None:
    """A sheet held at its corners is met at up to 0.9 m/s, several times its thickness a step."""
    mesh = rectangle(0.16, 0.16, 0.016)
    start = ClothState.flat(mesh)
    corners = np.abs(mesh.panel).min(axis=1) > 0.065
    motion = Motion((0.0, 0.0, 0.06), 0.0, 0.1, (0.3, 0.2, 1.0), (0.0, 0.0, -0.02))
    if kind == "ball":
        body: Obstacle = Sphere((0.0, 0.0, -0.055), 0.05, motion)
    elif kind == "box":
        body = MeshObstacle(*box(0.05, -0.006), motion)
    else:
        points, faces = pipe(0.03, 0.12)
        poses = np.stack([points + np.array([0, 0, height]) for height in (-0.035, 0.02, 0.0)])
        poses[1:, :, 2] += 0.3 * points[:, 1]
        body = AnimatedMesh(np.array([0.0, 0.1, 0.2]), poses, faces)
    cloth = Cloth(
        mesh,
        SOFT,
        (holding(mesh, corners, start, Motion()),),
        contact=ContactSettings(friction=0.3),
        obstacles=(body,),
        damping=1.0,
    )
    solver, outcome = run(cloth, start, 0.15)
    assert outcome.state.obstacles is not None
    # The springs that carry the body give way by micrometres.
    belong = solver.contact.places(outcome.state.time)
    np.testing.assert_allclose(outcome.state.obstacles, belong, atol=1e-5)
    assert outcome.state.positions[:, 2].max() > 0.03
    assert 0 < solver.closest(outcome.state) < 1e-3


def test_cloth_drapes_over_sharp_corners() -> None:
    mesh = rectangle(0.16, 0.16, 0.016)
    cloth = Cloth(
        mesh,
        SOFT,
        contact=ContactSettings(friction=0.3),
        obstacles=(MeshObstacle(*box(0.07, 0.0)),),
        damping=2.0,
    )
    _, outcome = run(cloth, ClothState.flat(mesh, height=5e-3), 0.25)
    heights = outcome.state.positions[:, 2]
    assert heights.max() < 5e-3
    assert heights.min() < -0.03


def test_three_layers_rest_on_each_other() -> None:
    """Three sheets as one mesh, turned against each other, fall on a floor and lie in order."""
    one = rectangle(0.08, 0.08, 0.016)
    count = one.vertex_count
    turned = [one.panel @ rotation_matrix(np.array([0.0, 0.0, 0.4 * k]))[:2, :2].T for k in range(3)]
    panel = np.concatenate([layer + np.array([0.2 * k, 0.0]) for k, layer in enumerate(turned)])
    assembled = np.concatenate([np.column_stack([turned[k], np.full(count, 2e-3 * (k + 1))]) for k in range(3)])
    triangles = np.concatenate([one.triangles + k * count for k in range(3)])
    mesh = TriangleMesh(panel, triangles, assembled=assembled)
    cloth = Cloth(mesh, SOFT, contact=ContactSettings(friction=0.2), obstacles=(Plane(),), damping=5.0)
    _, outcome = run(cloth, ClothState.flat(mesh), 0.15)
    layers = outcome.state.positions[:, 2].reshape(3, count)
    means = layers.mean(axis=1)
    assert 2e-4 < means[0] < 1e-3
    assert (np.diff(means) > 2e-4).all() and (np.diff(means) < 1e-3).all()


def test_cloth_is_pulled_through_a_ring() -> None:
    mesh = rectangle(0.14, 0.14, 0.014)
    start = ClothState.flat(mesh, height=0.012)
    middle = np.abs(mesh.panel).max(axis=1) < 0.012
    pulled = holding(mesh, middle, start, Motion((0.0, 0.0, -0.15), 0.0, 0.25))
    cloth = Cloth(
        mesh,
        SOFT,
        (pulled,),
        contact=ContactSettings(friction=0.1),
        obstacles=(ring(0.032, 0.008),),
        damping=1.0,
    )
    _, outcome = run(cloth, start, 0.3)
    assert outcome.state.positions[:, 2].max() < 0.0


def test_cloth_is_pulled_between_two_balls_that_close() -> None:
    mesh = rectangle(0.04, 0.16, 0.01)
    start = ClothState.flat(mesh)
    radius = 0.03
    balls = (
        Sphere((0.0, 0.1, radius + 4e-3), radius, Motion((0.0, 0.0, -3.7e-3), 0.0, 0.1)),
        Sphere((0.0, 0.1, -radius - 4e-4), radius),
    )
    pulled = holding(mesh, mesh.panel[:, 1] > 0.07, start, Motion((0.0, 0.15, 0.0), 0.1, 0.2))
    cloth = Cloth(mesh, SOFT, (pulled,), contact=ContactSettings(friction=0.2), obstacles=balls, damping=1.0)
    solver, outcome = run(cloth, start, 0.32)
    # The balls leave 0.7 mm, in which the cloth stays in the middle of the gap.
    assert outcome.state.positions[:, 1].max() > 0.1
    assert 5e-5 < solver.closest(outcome.state) < 3.6e-4


@pytest.mark.parametrize("kind", ["balls", "boxes"])
def test_bodies_that_would_meet_in_the_cloth_give_way(kind: str) -> None:
    """They are to overlap by 2 mm with the cloth between them, and stop short of each other."""
    mesh = rectangle(0.05, 0.05, 0.01)
    motions = [Motion((0.0, 0.0, way), 0.0, 0.05) for way in (-4e-3, 4e-3)]
    if kind == "balls":
        bodies: tuple[Obstacle, ...] = tuple(
            Sphere((0.0, 0.0, side * 0.033), 0.03, motion) for side, motion in zip((1, -1), motions, strict=True)
        )
    else:
        points, faces = box(0.02, -3e-3)
        above = MeshObstacle(points * [1, 1, -1], faces[:, ::-1], motions[0])
        bodies = (above, MeshObstacle(points, faces, motions[1]))
    settings = ContactSettings(pressure=1e3, friction=0.2)
    cloth = Cloth(mesh, SOFT, contact=settings, obstacles=bodies, damping=1.0)
    solver, outcome = run(cloth, ClothState.flat(mesh), 4 * STEP)
    assert outcome.state.obstacles is not None
    # Springs that do not give way press them ten times closer.
    assert solver.closest(outcome.state) > 1e-7
    upper, lower = np.split(outcome.state.obstacles[:, 2], 2)
    if kind == "balls":
        assert upper[0] - lower[0] > 0.06
    else:
        assert (upper > lower).all()


def test_springs_that_give_way_pull_with_the_gradient_of_their_energy() -> None:
    rng = np.random.default_rng(0)
    targets, positions = 1e-3 * rng.standard_normal((2, 5, 3))
    springs = Attachment(np.arange(5), targets, 1e4, 3.0)
    _, force, stiffness = springs.forces(positions)
    step = 1e-8
    for i, k in np.ndindex(5, 3):
        change = np.zeros((5, 3))
        change[i, k] = step
        slope = (springs.forces(positions + change)[0] - springs.forces(positions - change)[0]) / (2 * step)
        assert slope == pytest.approx(force[i, k], rel=1e-5, abs=1e-6)
    lengths = np.linalg.norm(force, axis=1)
    assert (lengths < 3.0).all() and lengths.max() > 2.5
    np.testing.assert_allclose(positions - force / stiffness[:, None], targets, atol=1e-15)
    far = springs.forces(positions + 10.0)[1]
    np.testing.assert_allclose(np.linalg.norm(far, axis=1), 3.0, rtol=1e-6)
    loose = Attachment(np.arange(5), targets, 1e4).forces(positions)
    gap = positions - targets
    assert loose[0] == pytest.approx(0.5e4 * float(np.vdot(gap, gap)))
    np.testing.assert_allclose(loose[1], 1e4 * gap)


def test_a_ball_cannot_poke_through_a_coarse_triangle() -> None:
    mesh = TriangleMesh(
        0.1 * np.array([[-1.0, -1.0], [1.0, -1.0], [0.0, 1.0], [2.0, 1.0], [1.0, 3.0], [-1.0, 3.0]]),
        np.array([[0, 1, 2], [1, 3, 2], [2, 3, 4], [2, 4, 5]]),
    )
    ball = Sphere((0.0, -0.03, -0.0101), 0.01)
    contact = ClothContact(mesh, ContactSettings(self_contact=False), (ball,))
    # All vertices are more than 8 cm away from a ball that comes within 0.1 mm of the triangle.
    assert contact.closest(mesh.assembled) == pytest.approx(1e-4, abs=1e-12)
    assert contact.gradient(mesh.assembled)[1][:3, 2].max() < 0
    fraction = contact.bound(mesh.assembled, np.tile([0.0, 0.0, -1e-3], (6, 1)))
    assert 0.08 < fraction < 0.1
    assert contact.intersects(mesh.assembled - [0.0, 0.0, 2e-4])


def test_the_check_of_frames_sees_crossings() -> None:
    mesh = rectangle(0.04, 0.04, 0.01)
    body = MeshObstacle(*box(0.02, 5e-3), Motion((0.0, 0.0, -0.01), 0.0, 1.0))
    solver = ClothSolver(Cloth(mesh, SOFT, contact=ContactSettings(), obstacles=(body,)))
    flat = ClothState.flat(mesh)
    assert solver.intersects(flat)
    assert not solver.intersects(ClothState(flat.positions, flat.velocities, 1.0))
    above = flat.positions + np.array([0.0, 0.0, 0.1])
    assert not solver.intersects(ClothState(above, flat.velocities))
    # Up, and then back down through the middle.
    above[np.isclose(mesh.panel[:, 0], 0.01), 2] += 0.01
    above[np.isclose(mesh.panel[:, 0], 0.02)] += np.array([-0.035, 0.0, -0.005])
    crossing = ClothState(above, flat.velocities)
    assert solver.intersects(crossing)
    with pytest.raises(InputError, match="start of the cloth; expected surfaces that do not cross"):
        simulate(solver, crossing, Schedule(0.1))


def test_friction_of_a_turning_ball_knows_where_the_load_step_ends() -> None:
    """An equilibrium takes no time and a viscous step has a time of its own: the ball turns as far as is prescribed."""
    mesh = rectangle(0.04, 0.04, 0.01)
    settings = ContactSettings(thickness=2e-3, friction=0.3, self_contact=False)
    turn = Motion((0.0, 0.0, 0.0), 0.0, 1.0, (0.0, 0.3, 0.0))
    ball = (0.0, 0.0, -0.03), 0.03

    def force(motion: Motion | None, until: float) -> np.ndarray:
        sphere = Sphere(*ball) if motion is None else Sphere(*ball, motion)
        contact = ClothContact(mesh, settings, (sphere,))
        places = np.concatenate([mesh.assembled + np.array([0.0, 0.0, 1e-3]), contact.places(0.0)])
        contact.start_step(places, 1.0, 0.0, until)
        return contact.gradient(places)[1][: mesh.vertex_count]

    still = force(None, 0.5)
    np.testing.assert_allclose(force(turn, 0.0), still, atol=1e-12 * np.abs(still).max())
    assert np.abs(force(turn, 0.5) - still).max() > 1e-3 * np.abs(still).max()
