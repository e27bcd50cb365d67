"""Panels sewn together: neighbours in space, each with its own place and direction in the fabric."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from yarnscale.errors import InputError
from yarnscale.motion.run import simulate
from yarnscale.motion.schedule import Schedule
from yarnscale.shell.dynamics.cloth import Cloth
from yarnscale.shell.dynamics.solver import ClothSolver, SolverOptions
from yarnscale.shell.elastic.elements import shell_elements
from yarnscale.shell.elastic.energy import ShellEnergy
from yarnscale.shell.materials.orthotropic import JERSEY
from yarnscale.shell.mesh import TriangleMesh, rectangle
from yarnscale.shell.state import ClothState


def cut(mesh: TriangleMesh, *, shift: float = 0.5) -> TriangleMesh:
    """The flat mesh cut along x = 0 in the fabric and sewn up again: the right half lies elsewhere in it."""
    right = mesh.material[mesh.triangles, 0].mean(axis=1) > 0
    middle = np.flatnonzero(np.abs(mesh.material[:, 0]) < 1e-9)
    doubles = np.arange(mesh.vertex_count)
    doubles[middle] = mesh.vertex_count + np.arange(len(middle))
    material = np.concatenate([mesh.material, mesh.material[middle]])
    corners = np.where(right[:, None], doubles[mesh.triangles], mesh.triangles)
    moved = np.zeros(len(material), bool)
    moved[corners[right]] = True
    material[moved] += [shift, 0.0]
    return TriangleMesh(material, mesh.triangles, 0.0, corners, mesh.assembled)


def even_rectangle() -> TriangleMesh:
    """A rectangle with a straight line of edges x = 0: rows of equilateral triangles, turned by a right angle."""
    mesh = rectangle(0.06, 0.08, 0.01)
    turned = np.column_stack([mesh.material[:, 1], -mesh.material[:, 0]])
    return TriangleMesh(turned, mesh.triangles)


def random_positions(mesh: TriangleMesh, seed: int = 4) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return mesh.assembled + 2e-3 * rng.standard_normal(mesh.assembled.shape)


@pytest.mark.parametrize("free_edges", ["zero", "extrapolate"])
def test_a_seam_of_equal_fabric_is_invisible(free_edges) -> None:
    """Cut and sewn: the fold angles across the seam count as before; only free edges borrow from fewer neighbours."""
    whole = even_rectangle()
    sewn = cut(whole)
    assert sewn.has_seams and not whole.has_seams
    assert sewn.seams.sum() == 2 * (len(sewn.material) - sewn.vertex_count - 1)
    np.testing.assert_array_equal(sewn.stencils, whole.stencils)
    np.testing.assert_allclose(sewn.vertex_areas, whole.vertex_areas)
    positions = random_positions(whole)
    one, two = (ShellEnergy(m, JERSEY, free_edges=free_edges).linearise(positions) for m in (whole, sewn))
    if free_edges == "zero":
        assert two.value == pytest.approx(one.value, rel=1e-12)
        np.testing.assert_allclose(two.gradient, one.gradient, atol=1e-12)
    inner = np.abs(whole.material[:, 1]) < 0.015
    np.testing.assert_allclose(two.gradient[inner], one.gradient[inner], atol=1e-9)


def test_panels_keep_their_own_direction_of_the_fabric() -> None:
    """Half of the sheet cut on the wale: stretched along x, one half resists with its weft, the other its warp."""
    whole = even_rectangle()
    sewn = cut(whole, shift=0.0)
    turned = sewn.panel_numbers == sewn.panel_numbers[np.argmax(sewn.material[:, 0])]
    x, y = sewn.material.T
    material = np.where(turned[:, None], np.column_stack([y, -x]), sewn.material)
    mixed = replace(sewn, material=material, grain=np.where(turned, math.pi / 2, 0.0))
    np.testing.assert_allclose(mixed.panel, sewn.panel, atol=1e-15)
    positions = whole.assembled * [1.1, 1.0, 1.0]
    strain = 0.5 * (1.1**2 - 1)
    densities = ShellEnergy(mixed, JERSEY).densities(positions).ravel()
    elements = shell_elements(mixed)
    right = mixed.material[mixed.corners][elements.triangles.ravel()]
    is_turned = turned[mixed.corners[elements.triangles.ravel(), 0]]
    assert right.shape[1:] == (3, 2)
    common = 0.5 * JERSEY.area * 0.1**2 + 0.5 * JERSEY.log_area * math.log(1.1) ** 2
    for half, stiffness in ((~is_turned, JERSEY.stretch_weft), (is_turned, JERSEY.stretch_warp)):
        pulled = 0.5 * stiffness * strain**2
        # The area terms are written with their own factors; the difference of the halves is that of the stiffness.
        np.testing.assert_allclose(densities[half] - pulled, densities[half][0] - pulled, rtol=1e-9)
        assert densities[half][0] == pytest.approx(pulled + common, rel=0.5)
    difference = densities[is_turned][0] - densities[~is_turned][0]
    assert difference == pytest.approx(0.5 * (JERSEY.stretch_warp - JERSEY.stretch_weft) * strain**2)


def tube(columns: int = 12, rows: int = 8, radius: float = 0.05) -> TriangleMesh:
    """A rectangle rolled up and sewn along its side."""
    step = 2 * math.pi * radius / columns
    i, j = np.meshgrid(np.arange(columns + 1), np.arange(rows + 1))
    x = (i + 0.5 * (j % 2)) * step
    material = np.column_stack([x.ravel(), (j * step * math.sqrt(3) / 2).ravel()])
    vertices = (j * columns + i % columns).ravel()
    corners = []
    for r in range(rows):
        for c in range(columns):
            a, b = r * (columns + 1) + c, (r + 1) * (columns + 1) + c
            corners += [[a, a + 1, b], [a + 1, b + 1, b]] if r % 2 == 0 else [[a, a + 1, b + 1], [a, b + 1, b]]
    corners = np.array(corners)
    angle = material[:, 0] / radius
    assembled = np.zeros((columns * (rows + 1), 3))
    assembled[vertices] = np.column_stack([radius * np.sin(angle), -radius * np.cos(angle), material[:, 1]])
    return TriangleMesh(material, vertices[corners], 0.0, corners, assembled)


def test_a_tube_sewn_shut_has_the_curvature_of_its_cylinder_everywhere() -> None:
    mesh = tube(columns=24)
    assert mesh.seams.sum() == 16
    assert (~mesh.has_neighbour).sum() == 48
    forms = shell_elements(mesh).forms(mesh.assembled).transpose(1, 0, 2).reshape(6, -1)
    elements = shell_elements(mesh)
    real = elements.areas.ravel() > 0
    # Outside is the right side: z falls away from the normal, so II11 = −1/r, up to the chord of the polygon.
    np.testing.assert_allclose(forms[3, real], -1 / 0.05, rtol=0.02)
    np.testing.assert_allclose(forms[4:, real], 0.0, atol=0.05 / 0.05)


def folded(mesh: TriangleMesh, angle: float) -> np.ndarray:
    """The flat mesh bent down along x = 0 by an angle, the right side outside."""
    x, y, _ = mesh.assembled.T
    return np.column_stack([x * math.cos(0.5 * angle), y, -np.abs(x) * math.sin(0.5 * angle)])


@pytest.mark.parametrize("angle", [0.0, 0.7, -1.2])
def test_a_seam_is_at_rest_at_its_angle_and_bends_from_there_as_the_fabric_does(angle: float) -> None:
    sewn = cut(even_rectangle())
    energy = ShellEnergy(sewn.with_seam_angle(angle), JERSEY)
    at_rest = folded(sewn, angle)
    energy.follow(at_rest)
    linear = energy.linearise(at_rest)
    assert abs(linear.value) < 1e-20 and np.abs(linear.gradient).max() < 1e-9
    # Beyond its rest it has the energy of a flat seam folded by the difference.
    flat = ShellEnergy(sewn, JERSEY)
    for more in (0.3, -0.5):
        energy.follow(folded(sewn, angle + more))
        found = energy.value(folded(sewn, angle + more))
        assert found == pytest.approx(flat.value(folded(sewn, more)), rel=1e-9)
        assert found > 0


def test_a_folded_seam_bends_with_the_stiffness_of_the_fabric() -> None:
    """A fold θ over an edge of length l counts as curvature θ l/(2A) across it on the triangles of both sides."""
    sewn, angle = cut(even_rectangle()), 0.4
    energy = ShellEnergy(sewn, JERSEY, free_edges="zero").value(folded(sewn, angle))
    rows = sewn.seams.any(axis=1)
    edge = sewn.material[sewn.sewn_edges[:, 1]] - sewn.material[sewn.sewn_edges[:, 0]]
    np.testing.assert_allclose(edge[:, 0], 0.0, atol=1e-15)
    lengths, areas = np.abs(edge[:, 1]), sewn.areas[rows]
    expected = areas * JERSEY.bend_weft * (angle * lengths / (2 * areas)) ** 2
    assert energy == pytest.approx(float(expected.sum()), rel=1e-9)


def test_a_seam_springs_back_to_its_angle() -> None:
    mesh, angle = cut(even_rectangle()).with_seam_angle(0.8), 0.8
    cloth = Cloth(mesh, JERSEY, gravity=(0.0, 0.0, 0.0), damping=20.0)
    solver = ClothSolver(cloth, SolverOptions(tolerance=1e-5))
    run = simulate(solver, ClothState.flat(mesh), Schedule(0.5, 0.02))
    assert run.converged
    x, y, _ = mesh.assembled.T
    inside = np.abs(y) < 0.02
    normals = []
    for side in (-1.0, 1.0):
        own = run.state.positions[inside & (side * x > 0)]
        normals.append(np.linalg.svd(own - own.mean(axis=0))[2][2])
    turned = math.acos(min(1.0, abs(float(normals[0] @ normals[1]))))
    assert turned == pytest.approx(angle, abs=0.01)


def test_an_angle_of_seams_leaves_other_folds_as_they_are() -> None:
    sewn = cut(even_rectangle())
    creased = replace(sewn, rest_angles=np.where(sewn.seams, 0.1, 0.2)).with_seam_angle(0.5)
    np.testing.assert_array_equal(creased.rest_angles, np.where(sewn.seams, 0.5, 0.2))
    np.testing.assert_array_equal(creased.corners, sewn.corners)
    np.testing.assert_array_equal(creased.with_grain(0.3).rest_angles, creased.rest_angles)


def test_panels_are_counted() -> None:
    assert rectangle(0.04, 0.04, 0.02).panel_numbers.max() == 0
    sewn = cut(even_rectangle())
    assert sewn.panel_numbers.max() == 1
    assert tube().panel_numbers.max() == 0


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"assembled": np.zeros((0, 3))}, "assembled positions; expected given with seams"),
        ({"assembled": np.zeros((3, 3))}, "assembled positions; expected finite, shape"),
        ({"triangles": tube().triangles[:4]}, "corners; expected one per corner"),
        ({"triangles": tube().triangles[:, [1, 2, 0]]}, "material point .*expected one vertex in space"),
        ({"grain": np.zeros(3)}, "grain; expected a finite angle"),
        (
            {"rest_angles": np.full((192, 3), 4.0)},
            "fold angles at rest; expected between -pi and pi .*found 4",
        ),
        ({"rest_angles": np.zeros((2, 3))}, r"fold angles at rest; expected shape \(192, 3\)"),
    ],
)
def test_broken_seams_are_refused(change: dict, message: str) -> None:
    with pytest.raises(InputError, match=message):
        replace(tube(), **change)


def test_a_vertex_of_three_triangles_is_refused() -> None:
    """Its triangles would meet one vertex twice."""
    angle = np.arange(3) * 2 * math.pi / 3
    ring = np.column_stack([np.cos(angle), np.sin(angle)])
    points = np.concatenate([[[0.0, 0.0]], ring, 2.5 * ring])
    triangles = [[0, 1, 2], [0, 2, 3], [0, 3, 1]]
    for k in range(3):
        n = (k + 1) % 3
        triangles += [[1 + k, 4 + k, 4 + n], [1 + k, 4 + n, 1 + n]]
    with pytest.raises(InputError, match="vertex 0; expected a free edge or four"):
        TriangleMesh(points, np.array(triangles))
