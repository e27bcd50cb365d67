"""Surfaces that cross at the start: which triangles, of what, where, how many; and what was not tested is not told."""

from __future__ import annotations

from dataclasses import replace

import ipctk
import numpy as np
import pytest

from yarnscale.errors import InputError
from yarnscale.motion.obstacles import MeshObstacle, Obstacle, Plane, Sphere
from yarnscale.motion.run import simulate
from yarnscale.motion.schedule import Schedule
from yarnscale.shell.contact.cloth_contact import ClothContact, ContactSettings
from yarnscale.shell.contact.crossings import CLOTH, crossing_triangles
from yarnscale.shell.dynamics.cloth import Cloth
from yarnscale.shell.dynamics.solver import ClothSolver
from yarnscale.shell.materials.orthotropic import JERSEY
from yarnscale.shell.mesh import TriangleMesh, rectangle
from yarnscale.shell.state import ClothState

FLOOR = (np.array([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]), np.array([[0, 1, 2], [0, 2, 3]]))


def two_sheets(height: float) -> TriangleMesh:
    """Two triangles in the plane z = 0, and one upright that reaches down to a height over the middle of the first."""
    panel = np.array([[0.0, 0], [1, 0], [0, 1], [1, 1], [3, 0], [4, 0], [3, 1]])
    space = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0], [0.2, 0.3, 1], [0.2, 0.4, 1], [0.2, 0.3, height]])
    return TriangleMesh(panel, np.array([[0, 1, 2], [2, 1, 3], [4, 5, 6]]), assembled=space)


def test_a_crossing_of_the_cloth_with_itself_has_triangles_and_a_place() -> None:
    mesh = two_sheets(-0.5)
    contact = ClothContact(mesh, ContactSettings())
    assert contact.intersects(mesh.assembled)
    (found,) = contact.crossings(mesh.assembled)
    assert found.obstacle == CLOTH
    assert found.description == "triangles 0 and 2 of the cloth at (0.2, 0.3, 0) m, their only pair"
    assert "self_contact" in found.remedy and "weld" not in found.remedy
    apart = two_sheets(0.1)
    assert not contact.intersects(apart.assembled) and contact.crossings(apart.assembled) == []
    with pytest.raises(InputError, match=r"do not cross; found triangles 0 and 2 of the cloth at \(0.2, 0.3, 0\)"):
        simulate(ClothSolver(Cloth(mesh, JERSEY, contact=ContactSettings())), ClothState.flat(mesh), Schedule(0.1))


def test_borders_at_the_same_place_are_to_be_sewn() -> None:
    """Two squares with a common side, whose vertices are there twice."""
    square = np.array([[0.0, 0], [1, 0], [0, 1], [1, 1]])
    panel = np.concatenate([square, square + np.array([1.0, 0.0])])
    mesh = TriangleMesh(panel, np.array([[0, 1, 2], [2, 1, 3], [4, 5, 6], [6, 5, 7]]))
    (found,) = ClothContact(mesh, ContactSettings()).crossings(mesh.assembled)
    assert "(weld)" in found.remedy


def test_crossing_triangles_are_those_of_ipctk() -> None:
    """Of two crumpled sheets near each other, in any order, with and without crossings of the first with itself."""
    rng, sheet = np.random.default_rng(3), rectangle(1.0, 1.0, 0.2)
    count, faces = sheet.vertex_count, np.concatenate([sheet.triangles, sheet.triangles + sheet.vertex_count])
    edges, seen = ipctk.edges(faces.astype(np.int32)), []
    owner = (np.arange(2 * count) >= count).astype(int)
    for size in np.repeat([0.02, 0.05, 0.1, 0.15], 4):
        places = np.concatenate([sheet.assembled, sheet.assembled + np.array([0.03, 0.07, 0.25])])
        places += size * rng.standard_normal(places.shape)
        for within in (True, False):
            expected = set()
            for k, edge in enumerate(edges):
                for t, face in enumerate(faces):
                    own = owner[edge[0]] == owner[face[0]]
                    if not set(edge) & set(face) and (not own or (within and owner[face[0]] == 0)):
                        ends, corners = places[edge], places[face]
                        apart = (ends.min(0) > corners.max(0)).any() or (ends.max(0) < corners.min(0)).any()
                        if not apart and ipctk.is_edge_intersecting_triangle(*ends, *corners):
                            expected.add((k, t))
            pairs, _ = crossing_triangles(places, faces, len(sheet.triangles), within_cloth=within)
            found = {frozenset(pair) for pair in pairs.tolist()}
            around = [set(np.flatnonzero(np.isin(faces, edge).sum(axis=1) == 2)) for edge in edges]
            assert found == {
                frozenset((int(one), t))
                for k, t in expected
                for one in around[k]
                if not set(faces[one]) & set(faces[t])
            }
            seen.append(len(found))
    assert min(seen) == 0 and max(seen) > 20


@pytest.mark.parametrize(
    ("obstacle", "told"),
    [
        (MeshObstacle(*FLOOR), "triangle 2 of the cloth and triangle 1 of obstacles[1] (mesh) at (0.2, 0.3, 0) m"),
        (Plane(), "1 of 7 vertices of the cloth at or behind obstacles[1] (plane), by up to 0.5 m at (0.2, 0.3"),
        (Sphere((0.2, 0.3, 0.0), 0.1), "1 of 3 triangles of the cloth at or inside obstacles[1] (sphere), by up to"),
    ],
    ids=["mesh", "plane", "sphere"],
)  # fmt: skip
def test_a_crossing_with_a_body_names_the_body(obstacle: Obstacle, told: str) -> None:
    """Of two bodies one is far away."""
    mesh = two_sheets(-0.5)
    places = mesh.assembled.copy()
    places[:4, 2] += 3.0
    far = MeshObstacle(FLOOR[0] - [0.0, 0.0, 2.0], FLOOR[1])
    contact = ClothContact(mesh, ContactSettings(), (far, obstacle))
    (found,) = contact.crossings(places)
    assert found.obstacle == 1 and found.description.startswith(told)
    assert "obstacles[1]" in found.remedy


@pytest.mark.parametrize("obstacle", [MeshObstacle(*FLOOR), Plane()], ids=["mesh", "plane"])
@pytest.mark.parametrize("tilt", [0.0, 0.5, 1.5])
def test_a_floor_wholly_below_the_cloth_crosses_nothing(obstacle: Obstacle, tilt: float) -> None:
    mesh = rectangle(0.2, 0.2, 0.04)
    x, y, _ = mesh.assembled.T
    places = np.column_stack([x, np.cos(tilt) * y, np.sin(tilt) * y])
    places[:, 2] += 1e-6 - places[:, 2].min()
    contact = ClothContact(mesh, ContactSettings(), (obstacle,))
    assert not contact.intersects(places) and contact.crossings(places) == []


def test_what_was_not_tested_is_none_and_not_zero() -> None:
    mesh = rectangle(0.04, 0.04, 0.02)
    start, floor = ClothState.flat(mesh, height=0.1), Plane()
    settings = ContactSettings()
    obstacles_alone = replace(settings, self_contact=False)
    for contact, obstacles, expected in (
        (None, (), {}),
        (obstacles_alone, (), {}),
        (obstacles_alone, (floor,), {"obstacle_intersections": 0}),
        (settings, (), {"intersections": 0}),
        (settings, (floor,), {"intersections": 0, "obstacle_intersections": 0}),
    ):
        cloth = Cloth(mesh, JERSEY, contact=contact, obstacles=obstacles)
        run = simulate(ClothSolver(cloth), start, Schedule(0.01, 0.01, to_rest=False))
        assert run.faults == expected
