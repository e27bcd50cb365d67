"""Meshes: shape, stencils, grain, and errors that name what is wrong."""

from __future__ import annotations

import math

import numpy as np
import pytest

from yarnscale.errors import InputError
from yarnscale.shell.mesh import TriangleMesh, disk, rectangle


def test_rectangle_has_the_size_and_number_of_vertices_asked_for() -> None:
    mesh = rectangle(0.3, 0.3, 0.0065)
    assert 2500 < mesh.vertex_count < 2700
    assert mesh.areas.sum() == pytest.approx(0.09)
    assert mesh.vertex_areas.sum() == pytest.approx(0.09)
    np.testing.assert_allclose(np.abs(mesh.material).max(axis=0), [0.15, 0.15])
    assert mesh.vertex_count - len(mesh.edges) + len(mesh.triangles) == 1


def test_rectangle_is_its_own_mirror_image() -> None:
    mesh = rectangle(0.1, 0.08, 0.01)
    points = {tuple(p) for p in np.round(mesh.material, 9) + 0.0}
    for sign in ([-1, 1], [1, -1]):
        assert {tuple(p) for p in np.round(mesh.material * sign, 9) + 0.0} == points


def test_inner_triangles_are_nearly_equilateral() -> None:
    mesh = rectangle(0.3, 0.3, 0.0065)
    corners = mesh.material[mesh.triangles[mesh.has_neighbour.all(axis=1)]]
    lengths = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2)
    assert np.median(lengths.max(axis=1) / lengths.min(axis=1)) < 1.05


def test_disk_is_round() -> None:
    mesh = disk(0.1, 0.01)
    assert mesh.areas.sum() == pytest.approx(math.pi * 0.01, rel=3e-3)
    assert (~mesh.has_neighbour).sum() == 60


@pytest.mark.parametrize("mesh", [rectangle(0.05, 0.04, 0.01), disk(0.03, 0.01)])
def test_stencils_hold_the_vertices_across_the_edges(mesh: TriangleMesh) -> None:
    corners = {frozenset(t) for t in mesh.triangles.tolist()}
    for row, stencil in enumerate(mesh.stencils.tolist()):
        assert len(set(stencil)) == 6
        for k in range(3):
            across = frozenset([stencil[k], stencil[(k + 1) % 3], stencil[3 + k]])
            assert (across in corners) == mesh.has_neighbour[row, k]


def test_grain_turns_the_fabric_and_not_the_panel() -> None:
    mesh = rectangle(0.1, 0.1, 0.02)
    bias = mesh.with_grain(math.pi / 4)
    np.testing.assert_allclose(bias.panel, mesh.panel, atol=1e-15)
    np.testing.assert_allclose(bias.areas, mesh.areas)
    # A vertex on the panel's x-axis lies between course and wale, on the side of negative wale.
    vertex = mesh.nearest_vertex([0.05, 0.0])
    expected = np.array([math.cos(math.pi / 4), -math.sin(math.pi / 4)]) * mesh.panel[vertex, 0]
    np.testing.assert_allclose(bias.material[vertex], expected + 0.0, atol=0.01)
    np.testing.assert_allclose(rectangle(0.1, 0.1, 0.02, grain=0.3).material, mesh.with_grain(0.3).material)


def test_irregular_mesh_keeps_its_outline() -> None:
    mesh = rectangle(0.1, 0.1, 0.01, irregularity=0.2, seed=3)
    assert mesh.areas.sum() == pytest.approx(0.01)
    assert np.ptp(mesh.areas) > 1e-5


GOOD = rectangle(0.04, 0.04, 0.02)


@pytest.mark.parametrize(
    ("points", "triangles", "message"),
    [
        (GOOD.material[:, :1], GOOD.triangles, "material coordinates; expected shape"),
        (
            np.where(GOOD.material > 0.01, np.nan, GOOD.material),
            GOOD.triangles,
            "finite numbers; found .*vertex",
        ),
        (GOOD.material, GOOD.triangles[:, :2], "triangles; expected shape"),
        (GOOD.material, GOOD.triangles.astype(float), "expected integers; found float64"),
        (GOOD.material, GOOD.triangles + 3, "triangle .*; expected vertices 0"),
        (GOOD.material, GOOD.triangles[:, ::-1], "triangle 0; expected counter-clockwise"),
        (GOOD.material, GOOD.triangles[:3], "every vertex used; found vertex"),
        (
            GOOD.material,
            np.concatenate([GOOD.triangles, GOOD.triangles[:1]]),
            "edge .*one triangle on each side",
        ),
    ],
)
def test_broken_meshes_are_refused(points: np.ndarray, triangles: np.ndarray, message: str) -> None:
    with pytest.raises(InputError, match=message):
        TriangleMesh(points, triangles)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: rectangle(-1.0, 0.1, 0.01), "width; expected a positive length"),
        (lambda: rectangle(0.1, math.nan, 0.01), "height; expected a positive length"),
        (lambda: rectangle(0.1, 0.1, 0.2), "width; expected at least the spacing"),
        (lambda: rectangle(0.1, 0.1, 1e-6), "spacing; expected at least"),
        (lambda: rectangle(0.1, 0.1, 0.01, irregularity=0.5), "irregularity"),
        (lambda: disk(0.0, 0.01), "radius; expected a positive length"),
    ],
)
def test_builders_name_the_bad_size(call, message: str) -> None:
    with pytest.raises(InputError, match=message):
        call()


def test_finer_edges_keep_the_outline_and_halve_the_rows_there() -> None:
    even, graded = rectangle(0.3, 0.2, 0.003), rectangle(0.3, 0.2, 0.003, finer_edges=0.5)
    assert graded.areas.sum() == pytest.approx(0.06) and graded.areas.min() > 0
    np.testing.assert_array_equal(graded.triangles, even.triangles)
    for axis in range(2):
        before, after = (np.unique(np.round(mesh.panel[:, axis], 9)) for mesh in (even, graded))
        gaps = np.diff(after) / np.diff(before)
        assert gaps[0] == pytest.approx(0.5, abs=0.02) and gaps[-1] == pytest.approx(0.5, abs=0.02)
        assert gaps.max() == pytest.approx(1 + 0.5 * (np.pi / 2 - 1), abs=0.02)
    with pytest.raises(InputError, match="finer_edges; expected between 0 and"):
        rectangle(0.3, 0.2, 0.005, finer_edges=0.8)
