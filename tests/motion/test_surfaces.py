"""Distances of points from obstacles that move, and where what sticks to them is carried."""

from __future__ import annotations

import numpy as np
import pytest

from yarnscale.files.body_surface import ball
from yarnscale.motion.obstacles import AnimatedMesh, MeshObstacle, Obstacle, Plane, Sphere
from yarnscale.motion.rigid import Motion
from yarnscale.motion.surfaces import surface_of

MOTION = Motion((0.3, -0.2, 0.1), 0.0, 1.0, rotation=(0.2, 0.9, -0.4), pivot=(0.1, 0.0, 0.2), ease=False)
CENTRE = np.array([0.05, 0.1, 0.0])


def bodies() -> list[Obstacle]:
    vertices, triangles = ball(rings=40, sectors=80)
    mesh = MeshObstacle(0.5 * vertices + CENTRE, triangles, MOTION)
    times = np.linspace(0.0, 1.0, 21)
    animated = AnimatedMesh(times, np.stack([mesh.points(time) for time in times]), triangles)
    return [Sphere(tuple(CENTRE), 0.5, MOTION), mesh, animated]


@pytest.mark.parametrize("time", [0.0, 0.35, 2.0])
def test_a_mesh_and_an_animation_of_a_ball_are_as_far_away_as_the_ball(time: float) -> None:
    generator = np.random.default_rng(2)
    points = generator.normal(size=(200, 3))
    points *= (0.5 + 0.03 * generator.standard_normal(200))[:, None] / np.linalg.norm(points, axis=1)[:, None]
    exact, *others = bodies()
    points += exact.points(time)
    distance, normal = surface_of(exact, reach=0.2).at(points, time)
    assert (distance > 0.01).any() and (distance < -0.01).any()
    for other in others:
        found, direction = surface_of(other, reach=0.2).at(points, time)
        np.testing.assert_allclose(found, distance, atol=2e-3)
        assert (np.einsum("ij,ij->i", normal, direction) > 0.99).all()


def test_what_sticks_moves_with_the_body() -> None:
    before = CENTRE + 0.5 * np.array([[0.6, 0.0, 0.8], [0.0, -0.8, 0.6], [-0.36, 0.48, 0.8]])
    wanted = MOTION.place(before, 0.5)
    for body in bodies():
        surface = surface_of(body, reach=0.2)
        start = MOTION.place(before, 0.2)
        np.testing.assert_allclose(surface.carried(start, 0.2, 0.5), wanted, atol=2e-3)
    belt = surface_of(Plane(motion=Motion((0.4, 0.0, 0.0), 0.0, 1.0, ease=False)), reach=0.2)
    np.testing.assert_allclose(belt.carried(before, 0.0, 0.5), before + np.array([0.2, 0.0, 0.0]))


def test_points_out_of_reach_of_a_mesh_are_far_from_it() -> None:
    _, mesh, _ = bodies()
    distance, normal = surface_of(mesh, reach=0.1).at(np.array([[5.0, 0.0, 0.0]]), 0.0)
    assert distance == 0.1 and np.linalg.norm(normal) == 1.0


def test_no_points_are_no_fault() -> None:
    for body in bodies():
        surface = surface_of(body, reach=0.2)
        assert len(surface.at(np.zeros((0, 3)), 0.5)[0]) == 0
        assert surface.carried(np.zeros((0, 3)), 0.0, 0.5).shape == (0, 3)


@pytest.mark.parametrize("rings", [2, 3])
def test_a_coarse_ball_is_closed_and_faces_outwards(rings: int) -> None:
    vertices, triangles = ball(rings=rings, sectors=5)
    a, b, c = (vertices[triangles[:, k]] for k in range(3))
    assert len(triangles) == 2 * len(vertices) - 4
    assert (np.einsum("ni,ni->n", a, np.cross(b, c)) > 0).all()
