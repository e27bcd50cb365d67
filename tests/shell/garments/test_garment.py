"""Panels, sewing, ready garments and the body: sizes, seams, and nothing that touches at the start."""

from __future__ import annotations

import math
from dataclasses import replace

import ipctk
import numpy as np
import pytest

from yarnscale.errors import InputError
from yarnscale.shell.garments.garment import Seam, sew
from yarnscale.shell.garments.mannequin import body_distance, mannequin
from yarnscale.shell.garments.panels import Panel, cut_panel
from yarnscale.shell.garments.wardrobe import SWEATER, T_SHIRT, ShirtCut, shirt
from yarnscale.shell.mesh import TriangleMesh
from yarnscale.shell.scenes.body_scenes import THIN

SQUARE = {
    "bottom": [[0.0, 0.0], [0.2, 0.0]],
    "right": [[0.2, 0.0], [0.2, 0.1]],
    "top": [[0.2, 0.1], [0.0, 0.1]],
    "left": [[0.0, 0.1], [0.0, 0.0]],
}


def quality(mesh: TriangleMesh) -> np.ndarray:
    """One for an equilateral triangle, zero for one without area."""
    corners = mesh.material[mesh.corners]
    square = ((corners - np.roll(corners, 1, axis=1)) ** 2).sum(axis=(1, 2))
    return 4 * math.sqrt(3) * mesh.areas / square


def crossing(positions: np.ndarray, triangles: np.ndarray) -> bool:
    points, faces = np.asfortranarray(positions), np.asfortranarray(triangles.astype(np.int32))
    return bool(ipctk.has_intersections(ipctk.CollisionMesh(points, ipctk.edges(faces), faces), points))


def test_a_panel_fills_its_outline_with_good_triangles() -> None:
    angle = np.linspace(-0.5 * math.pi, 0.5 * math.pi, 200)
    arc = np.column_stack([0.2 + 0.05 * np.cos(angle), 0.05 + 0.05 * np.sin(angle)])
    arc[[0, -1], 0] = 0.2
    panel = cut_panel("tongue", SQUARE | {"right": arc}, 0.01)
    mesh = panel.mesh()
    assert mesh.areas.sum() == pytest.approx(0.02 + 0.5 * math.pi * 0.05**2, rel=2e-3)
    assert quality(mesh).min() > 0.5 and np.median(quality(mesh)) > 0.98
    assert (~mesh.has_neighbour).sum() == sum(len(e) - 1 for e in panel.edges.values())
    ears = (~mesh.has_neighbour).sum(axis=1)
    assert ears.max() == 1


def test_seams_of_a_shirt_have_the_angles_they_are_given() -> None:
    angles = {"side": 0.4, "under": -0.3}
    garment = shirt("shirt", T_SHIRT, 0.04, rest_angles=angles)
    mesh, plain = garment.mesh, shirt("shirt", T_SHIRT, 0.04).mesh
    assert (plain.rest_angles == 0).all()
    assert (mesh.rest_angles[~mesh.seams] == 0).all()
    for edge, angle in (
        ("front.right side", 0.4),
        ("right sleeve.first under", -0.3),
        ("front.left armhole", 0.0),
    ):
        chain = garment.edges[edge]
        tails, heads = mesh.triangles, np.roll(mesh.triangles, -1, axis=1)
        on_it = np.isin(tails, chain) & np.isin(heads, chain) & mesh.seams
        assert on_it.sum() == 2 * (len(chain) - 1)
        np.testing.assert_allclose(mesh.rest_angles[on_it], angle)
    with pytest.raises(InputError, match="seam of a shirt; expected side or shoulder"):
        shirt("shirt", T_SHIRT, 0.04, rest_angles={"hem": 0.1})


def test_edges_are_divided_as_told_and_grain_turns_the_fabric() -> None:
    panel = cut_panel("square", SQUARE, 0.02, segments={"left": 7}, grain=0.3)
    assert len(panel.edge("left")) == 8 and len(panel.edge("right")) == 6
    np.testing.assert_allclose(panel.mesh().panel, panel.points, atol=1e-15)
    lengths = np.linalg.norm(np.diff(panel.points[panel.edge("left")], axis=0), axis=1)
    np.testing.assert_allclose(lengths, 0.1 / 7)


@pytest.mark.parametrize(
    ("outline", "spacing", "message"),
    [
        (SQUARE, -1.0, "spacing of panel 'a'; expected a positive length"),
        (
            SQUARE | {"top": [[0.2, 0.1], [0.0, 0.2]]},
            0.02,
            "edge 'left' of panel 'a'; expected to begin where 'top'",
        ),
        ({k: np.array(v)[::-1] for k, v in reversed(SQUARE.items())}, 0.02, "expected counter-clockwise"),
        (SQUARE | {"top": [[0.2, 0.1]]}, 0.02, "edge 'top' of panel 'a'; expected finite points"),
    ],
)
def test_impossible_panels_are_refused(outline, spacing: float, message: str) -> None:
    with pytest.raises(InputError, match=message):
        cut_panel("a", outline, spacing)


def two_squares() -> tuple[list[Panel], dict[str, np.ndarray]]:
    panels = [cut_panel("one", SQUARE, 0.02), cut_panel("two", SQUARE, 0.02, grain=math.pi / 2)]
    flat = [np.column_stack([p.points, np.zeros(len(p.points))]) for p in panels]
    return panels, {"one": flat[0], "two": flat[1] + [0.2, 0.0, 0.0]}


def test_sewn_panels_share_vertices_and_keep_their_grain() -> None:
    panels, positions = two_squares()
    garment = sew("pair", panels, [Seam(("one", "right"), ("two", "left"))], positions)
    mesh = garment.mesh
    assert len(mesh.material) - mesh.vertex_count == 6
    assert mesh.areas.sum() == pytest.approx(0.04)
    assert mesh.seams.sum() == 10
    np.testing.assert_array_equal(garment.edges["one.right"], garment.edges["two.left"][::-1])
    assert mesh.panel_numbers.max() == 1 and garment.panels == ("one", "two")
    # Assembled as cut: no strain whatever the direction of the fabric; the two do not overlap in the fabric.
    x = mesh.assembled[mesh.triangles]
    gradient = np.stack([x[:, 1] - x[:, 0], x[:, 2] - x[:, 0]], axis=2) @ mesh.inverse_rest
    np.testing.assert_allclose(
        gradient.transpose(0, 2, 1) @ gradient, np.broadcast_to(np.eye(2), (len(x), 2, 2)), atol=1e-9
    )
    second = mesh.panel_numbers[mesh.corners[:, 0]] == 1
    np.testing.assert_allclose(
        gradient[second][:, :, 0], np.broadcast_to([0.0, 1.0, 0.0], (second.sum(), 3)), atol=1e-9
    )
    low, high = (mesh.material[mesh.panel_numbers == k, 0] for k in (0, 1))
    assert low.max() < high.min()


@pytest.mark.parametrize(
    ("seam", "message"),
    [
        (Seam(("one", "right"), ("two", "top")), "expected edges of equal division; found 5 and 10"),
        (Seam(("one", "right"), ("three", "top")), "panel 'three' of a seam; expected one or two"),
        (Seam(("one", "right"), ("two", "side")), "edge 'side' of panel 'two'; expected bottom or right"),
    ],
)
def test_impossible_seams_are_refused(seam: Seam, message: str) -> None:
    panels, positions = two_squares()
    with pytest.raises(InputError, match=message):
        sew("pair", panels, [seam], positions)
    with pytest.raises(InputError, match="positions of panel 'two'"):
        sew("pair", panels, [], {"one": positions["one"]})


@pytest.mark.parametrize(("cut", "holes"), [(SWEATER, 4), (T_SHIRT, 4)], ids=["sweater", "t-shirt"])
@pytest.mark.parametrize("spacing", [0.03, 0.018])
def test_shirts_are_whole_and_clear_of_the_thin_body(cut: ShirtCut, holes: int, spacing: float) -> None:
    mesh = shirt("shirt", cut, spacing).mesh
    assert mesh.panel_numbers.max() == 3
    # A sphere with holes for neck, hem and two wrists.
    assert mesh.vertex_count - len(mesh.edges) + len(mesh.triangles) == 2 - holes
    assert quality(mesh).min() > 0.45
    x = mesh.assembled[mesh.triangles]
    gradient = np.stack([x[:, 1] - x[:, 0], x[:, 2] - x[:, 0]], axis=2) @ mesh.inverse_rest
    stretch = np.linalg.svd(gradient, compute_uv=False)
    assert stretch.min() > 0.6 and stretch.max() < 1.7
    assert np.percentile(np.abs(stretch - 1), 90) < 0.05
    body = mannequin()
    triangles = np.concatenate([mesh.triangles, body.triangles + mesh.vertex_count])
    assert not crossing(np.concatenate([mesh.assembled, body.pose(depth=THIN)]), triangles)
    # The right side faces outwards: away from the plane between the layers.
    normals = np.cross(x[:, 1] - x[:, 0], x[:, 2] - x[:, 0])
    flat = np.abs(x[:, :, 1]).min(axis=1) > 0.025
    assert flat.sum() > 100
    assert (normals[flat, 1] * x[flat, 0, 1] > 0).all()


def test_cuts_name_the_bad_size() -> None:
    with pytest.raises(InputError, match="cuff of the cut; expected a positive length"):
        replace(SWEATER, cuff=0.0)
    with pytest.raises(InputError, match="cut; expected neck and armholes smaller"):
        replace(SWEATER, neck=0.3)


def test_the_body_is_closed_smooth_and_symmetric() -> None:
    body = mannequin()
    sides = np.sort(body.triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    assert set(np.unique(sides, axis=0, return_counts=True)[1]) == {2}
    assert len(body.vertices) - len(np.unique(sides, axis=0)) + len(body.triangles) == 2
    assert np.abs(body_distance(body.vertices)).max() < 1e-4
    x = body.vertices[body.triangles]
    volume = (x[:, 0] * np.cross(x[:, 1], x[:, 2])).sum() / 6
    assert 0.04 < volume < 0.07
    mirrored = body.vertices * [-1, 1, 1]
    for vertex in mirrored[::200]:
        assert np.linalg.norm(body.vertices - vertex, axis=1).min() < 5e-3


def test_the_body_moves_without_crossing_itself() -> None:
    body = mannequin()
    lowered = body.pose(lowered=1.0, turned=0.5)
    assert not crossing(lowered, body.triangles)
    hand = np.argmax(body.vertices[:, 0])
    unturned = body.pose(lowered=1.0)[hand]
    assert unturned[2] < -0.45 and unturned[0] < 0.55
    np.testing.assert_allclose(np.linalg.norm(lowered, axis=1), np.linalg.norm(body.pose(lowered=1.0), axis=1))
    torso = (np.abs(body.vertices[:, 0]) < 0.08) | (body.vertices[:, 2] < -0.16)
    np.testing.assert_allclose(body.pose(lowered=1.0)[torso], body.vertices[torso])
    with pytest.raises(InputError, match="spacing of the body"):
        mannequin(0.5)
