"""Garments from OBJ files: one file with texture coordinates or two, and what is wrong told with file and line."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from yarnscale.errors import InputError
from yarnscale.files.obj import obj_text
from yarnscale.files.obj_garment import read_garment
from yarnscale.files.obj_surface import read_obj, read_obj_poses, read_obj_surface
from yarnscale.shell.garments.wardrobe import T_SHIRT, shirt
from yarnscale.shell.mesh import TriangleMesh


def t_shirt() -> TriangleMesh:
    return shirt("shirt", T_SHIRT, 0.05).mesh


def same(one: TriangleMesh, two: TriangleMesh) -> None:
    """Equal up to the numbering of vertices and points."""
    np.testing.assert_allclose(one.assembled[one.triangles], two.assembled[two.triangles], atol=1e-8)
    np.testing.assert_allclose(one.inverse_rest, two.inverse_rest, rtol=1e-6, atol=1e-5)
    np.testing.assert_array_equal(one.has_neighbour, two.has_neighbour)
    np.testing.assert_array_equal(one.seams, two.seams)
    assert len(one.material) == len(two.material) and one.vertex_count == two.vertex_count


def test_a_garment_with_texture_coordinates_comes_back(tmp_path: Path) -> None:
    mesh = t_shirt()
    path = tmp_path / "shirt.obj"
    path.write_text(obj_text(100 * mesh.assembled, mesh.triangles, 5 * mesh.material, mesh.corners))
    same(read_garment(path, scale=0.01, material_scale=0.2), mesh)
    turned = read_garment(path, scale=0.01, material_scale=0.2, grain=0.4)
    np.testing.assert_allclose(turned.areas, mesh.areas, rtol=1e-5)
    np.testing.assert_allclose(turned.grain, 0.4)


def test_a_garment_of_two_files_comes_back(tmp_path: Path) -> None:
    mesh = t_shirt()
    world, flat = tmp_path / "shirt-w.obj", tmp_path / "shirt-m.obj"
    world.write_text(obj_text(mesh.assembled, mesh.triangles))
    panels = np.column_stack([mesh.material, np.full(len(mesh.material), 0.7)])
    flat.write_text(obj_text(panels, mesh.corners))
    same(read_garment(world, material=flat), mesh)
    # Panels apart in space, of the same numbers as in the fabric: sewn where they meet.
    world.write_text(obj_text(mesh.assembled[mesh.point_vertices], mesh.corners))
    assert not read_garment(world, material=flat, weld=False, on_notice=[].append).seams.any()
    same(read_garment(world, material=flat, weld=1e-5), mesh)


def test_a_garment_split_for_every_face_is_sewn_as_it_was(tmp_path: Path) -> None:
    mesh, path = t_shirt(), tmp_path / "shirt.obj"
    corners = np.arange(mesh.triangles.size).reshape(-1, 3)
    space, fabric = mesh.assembled[mesh.triangles].reshape(-1, 3), mesh.material[mesh.corners].reshape(-1, 2)
    path.write_text(obj_text(space, corners, fabric, corners))
    with pytest.raises(InputError, match=f"weld = true.*; {len(corners)} loose pieces"):
        read_garment(path)
    same(read_garment(path, weld=True), mesh)


def test_a_panel_drawn_with_its_back_up_is_turned_over(tmp_path: Path) -> None:
    mesh = t_shirt()
    material = mesh.material.copy()
    back = mesh.panel_numbers == 1
    material[back, 0] *= -1.0
    path = tmp_path / "shirt.obj"
    path.write_text(obj_text(mesh.assembled, mesh.triangles, material, mesh.corners))
    same(read_garment(path), mesh)


def test_panels_that_share_texture_are_kept_apart(tmp_path: Path) -> None:
    """Both sleeves with the texture of one, as is usual: points of their own, equal places in the fabric."""
    mesh = t_shirt()
    numbers = mesh.panel_numbers
    corners = mesh.corners.copy()
    right, left = np.flatnonzero(numbers == 2), np.flatnonzero(numbers == 3)
    place = np.arange(len(mesh.material))
    place[left] = right
    path = tmp_path / "shirt.obj"
    path.write_text(obj_text(mesh.assembled, mesh.triangles, mesh.material, place[corners]))
    same(read_garment(path), mesh)


TRIANGLES = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 2 0 0\nv 2 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\nvt 2 0\nvt 2 1\n"


def test_cloth_without_an_area_in_space_is_refused_whatever_its_units(tmp_path: Path) -> None:
    path = tmp_path / "a.obj"
    line = "".join(f"v {k} {0.1 * k} {0.3 * k}\n" for k in range(6))
    path.write_text(line + TRIANGLES[TRIANGLES.index("vt") :] + "f 1/1 2/2 3/3 4/4\nf 2/2 5/5 6/6 3/3\n")
    for options in ({}, {"unit": "cm"}, {"scale": 1.0, "material_scale": 1.0}):
        with pytest.raises(InputError, match=r"a.obj: cloth in space; expected faces with an area") as caught:
            read_garment(path, **options)  # type: ignore[arg-type]
        assert "\n" not in str(caught.value)


def test_faces_of_a_body_that_cross_themselves_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.obj"
    path.write_text(TRIANGLES + "f 2 5 6 3\nf 1 3 2 4\n")
    with pytest.raises(InputError, match=r"a.obj:14: face; expected a polygon .* does not cross itself"):
        read_obj_surface(path)


@pytest.mark.parametrize(
    ("faces", "message"),
    [
        (
            "f 1/1 2/2 3/3 4/4\nf 2/2 5/5 6/6 3\n",
            "a.obj:14: face; expected a texture coordinate at every corner",
        ),
        ("f 1 2 3\n", "a.obj:13: face; expected a texture coordinate"),
        ("f 1/1 2/2 3/3 4/4\nf 2/2 5/9 6/6\n", "a.obj:14: face; expected texture coordinates 1..6; found 9"),
        ("f 1/1 2/2 3/3 4/4\nf 2/2 5/5 6/6\nf 2/2 6/3 3/6\n", "a.obj:15: face; expected one orientation"),
        ("f 1/1 2/2 3/3 4/4\nf 2/2 5/1 6/1\n", "a.obj:14: face; expected a triangle with an area"),
        ("f 1/1 2/2 3/3 4/4\nf 2/2 5/5 6/6 3/3\nf 2/2 5/5 6/6\n", "expected one triangle on each side"),
    ],
)
def test_faces_without_sense_in_the_fabric_are_told(tmp_path: Path, faces: str, message: str) -> None:
    path = tmp_path / "a.obj"
    path.write_text(TRIANGLES + faces)
    with pytest.raises(InputError, match=message) as caught:
        read_garment(path, on_notice=[].append)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("flat", "message"),
    [
        ("v 0 0 0\nv 1 0 0\nv 1 1 0\nf 1 2 3\n", "b.obj: faces; expected the 2 of a.obj; found 1"),
        (
            TRIANGLES.replace("v 2 1 0", "v 2 1 5") + "f 1 2 3 4\nf 2 5 6 3\n",
            "b.obj: vertex 6; expected flat panels",
        ),
        ("v 0 0 0\nvt 1\n", "b.obj:2: texture coordinates; expected two finite numbers"),
    ],
)
def test_second_files_that_do_not_fit_are_told(tmp_path: Path, flat: str, message: str) -> None:
    (tmp_path / "a.obj").write_text(TRIANGLES + "f 1 2 3 4\nf 2 5 6 3\n")
    (tmp_path / "b.obj").write_text(flat)
    with pytest.raises(InputError, match=message):
        read_garment(tmp_path / "a.obj", material=tmp_path / "b.obj")


def test_poses_of_an_animation_must_be_of_one_surface(tmp_path: Path) -> None:
    paths = [tmp_path / f"{k}.obj" for k in range(3)]
    for k, path in enumerate(paths):
        path.write_text(f"v 0 0 {k}\nv 1 0 {k}\nv 1 1 {k}\nf 1 2 3\n")
    poses, triangles = read_obj_poses(paths)
    np.testing.assert_allclose(poses[:, 0, 2], [0, 1, 2])
    np.testing.assert_array_equal(triangles, [[0, 1, 2]])
    assert read_obj(paths[0]).place(0).endswith("0.obj:4")
    paths[1].write_text("v 0 0 0\nv 1 0 0\nv 1 1 0\nf 1 3 2\n")
    with pytest.raises(InputError, match=r"1\.obj: faces; expected those of 0.obj"):
        read_obj_poses(paths)
    paths[1].write_text("v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 0 0\nf 1 2 3\n")
    with pytest.raises(InputError, match=r"1\.obj: vertices; expected 3 as in 0.obj; found 4"):
        read_obj_poses(paths)
