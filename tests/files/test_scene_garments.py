"""Scene files of garments and bodies that move, and the ready scenes by name."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from yarnscale.cli import main
from yarnscale.errors import InputError
from yarnscale.files.material_json import write_material
from yarnscale.files.obj import obj_text
from yarnscale.files.scene_toml import read_scene
from yarnscale.motion.obstacles import AnimatedMesh, MeshObstacle, Plane, Sphere
from yarnscale.shell.garments.mannequin import MovingMannequin
from yarnscale.shell.garments.wardrobe import T_SHIRT, shirt
from yarnscale.shell.materials.orthotropic import JERSEY
from yarnscale.shell.mesh import rectangle

HEAD = 'material = "cloth.json"\n'
SCHEDULE = "[schedule]\nduration = 0.02\n"
SQUARE = rectangle(0.1, 0.1, 0.02)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    write_material(tmp_path / "cloth.json", JERSEY)
    return tmp_path


def scene_of(folder: Path, text: str):
    path = folder / "scene.toml"
    path.write_text(HEAD + text)
    return read_scene(path)


def test_a_ready_garment_by_its_name(folder: Path) -> None:
    scene = scene_of(folder, 'garment = "sweater"\nspacing = 0.04\ndamping = 3\n' + SCHEDULE)
    assert scene.name == "scene" and scene.cloth.damping == 3
    assert scene.schedule.duration == 0.02 and scene.schedule.frame_interval == pytest.approx(1 / 30)
    assert scene.cloth.mesh.panel_numbers.max() == 3
    assert isinstance(scene.cloth.obstacles[0], MovingMannequin)
    bare = scene_of(folder, 'scene = "twist"\nspacing = 0.04\nobstacles = []\n')
    assert bare.cloth.obstacles == () and bare.schedule.duration == 2.0


def test_a_cut_of_ones_own_on_the_mannequin(folder: Path) -> None:
    scene = scene_of(
        folder,
        """
[mesh]
shape = "tshirt"
spacing = 0.04
sleeve = 0.25
rest_angle = {side = 30}
[[obstacles]]
shape = "mannequin"
spacing = 0.03
poses = [{time = 0, depth = 0.15}, {time = 0.5, lowered = 40, turned = 90}]
"""
        + SCHEDULE,
    )
    assert scene.start.positions[:, 0].max() > 0.4
    assert set(np.unique(scene.cloth.mesh.rest_angles)) == {0.0, math.radians(30)}
    body = scene.cloth.obstacles[0]
    assert isinstance(body, MovingMannequin) and body.poses[1].turned == pytest.approx(0.5 * math.pi)
    # Turned by a quarter, the arms lie along y.
    assert np.ptp(body.points(0.5)[:, 1]) > 1.0 > 2 * np.ptp(body.points(0.5)[:, 0])


@pytest.mark.parametrize(
    ("mesh", "rest", "meets"),
    [
        ('shape = "tshirt"\nspacing = 0.05\n', "", True),
        ('file = "own.obj"\n', "", True),
        ('file = "own.obj"\n', "[contact]\nself_contact = false\n", False),
        ("width = 0.1\nheight = 0.1\nspacing = 0.02\n", "", False),
    ],
)
def test_garments_meet_themselves_and_sheets_where_told(folder: Path, mesh: str, rest: str, meets: bool) -> None:
    text = obj_text(SQUARE.assembled, SQUARE.triangles, SQUARE.material, SQUARE.corners)
    (folder / "own.obj").write_text(text)
    cloth = scene_of(folder, f"[mesh]\n{mesh}{SCHEDULE}{rest}").cloth
    assert (cloth.contact is not None and cloth.contact.self_contact) == meets
    if meets:
        assert cloth.contact is not None
        assert cloth.contact.thickness == pytest.approx(1e-3)


def test_units_of_sheets_files_and_bodies(folder: Path) -> None:
    """A sheet in mm, a file with texture in mm, a body in cm; each begins with its sizes."""
    (folder / "cloth.obj").write_text(
        obj_text(SQUARE.assembled, SQUARE.triangles, 1e3 * SQUARE.material, SQUARE.corners)
    )
    sheet = 'unit = "mm"\nwidth = 100\nheight = 100\nspacing = 20\n'
    body = '[[obstacles]]\nshape = "mesh"\nfile = "cloth.obj"\nunit = "cm"\nposition = [0, 0, -1]\n'
    for mesh in (sheet, 'file = "cloth.obj"\nunit = "mm"\n'):
        scene = scene_of(folder, f"[mesh]\n{mesh}{SCHEDULE}{body}")
        np.testing.assert_allclose(scene.cloth.mesh.areas.sum(), 0.01)
        assert scene.notices[0].startswith("fabric 10 × 10 cm, 100 cm²; in space 10 × 10 × 0 cm, 100 cm²; ")
        assert np.ptp(scene.cloth.obstacles[0].points(0.0)[:, 0]) == pytest.approx(1e-3)
        assert any("another size" in notice for notice in scene.notices[1:])
    for text, message in (
        (
            'file = "cloth.obj"\n',
            r'cloth\.obj: sizes; expected .* \(texture coordinates in mm would fit: unit = "mm"',
        ),
        (
            'file = "cloth.obj"\nunit = "km"\n',
            r"scene\.toml:4: field 'mesh.unit'; expected m or cm or mm or inch",
        ),
        ('file = "cloth.obj"\nweld = "yes"\n', r"field 'mesh.weld'; expected true, false or a distance"),
        (
            "width = 300\nheight = 300\nspacing = 20\n",
            r"scene\.toml:2: \[mesh\] size of the fabric; .* found 30000 × ",
        ),
    ):
        with pytest.raises(InputError, match=message):
            scene_of(folder, f"[mesh]\n{text}{SCHEDULE}")


@pytest.mark.parametrize("normal", ["[0, 0, 1]", "[0, 0, -1]"])
def test_a_floor_below_the_cloth_is_one_whatever_its_normal(folder: Path, normal: str) -> None:
    floor = f'[[obstacles]]\nshape = "plane"\npoint = [0, 0, -0.1]\nnormal = {normal}\n'
    mesh = "[mesh]\nwidth = 0.1\nheight = 0.1\nspacing = 0.02\n"
    scene = scene_of(folder, mesh + SCHEDULE + floor)
    (plane,) = scene.cloth.obstacles
    assert isinstance(plane, Plane) and plane.normal == (0.0, 0.0, 1.0)
    assert any("obstacles[0] is turned round" in text for text in scene.notices) == ("-1" in normal)


def test_a_garment_from_files_with_bodies_that_move(folder: Path) -> None:
    mesh = shirt("shirt", T_SHIRT, 0.05).mesh
    (folder / "a-w.obj").write_text(obj_text(mesh.assembled, mesh.triangles))
    flat = np.column_stack([mesh.material, np.zeros(len(mesh.material))])
    (folder / "a-m.obj").write_text(obj_text(flat, mesh.corners))
    for k in (8, 9, 10):
        (folder / f"body_{k}.obj").write_text(f"v 0 0 {k}\nv 1 0 {k}\nv 1 1 {k}\nf 1 2 3\n")
    scene = scene_of(
        folder,
        """
[mesh]
file = "a-w.obj"
material_file = "a-m.obj"
grain = 90
rest_angle = -20
tilt = 90
position = [0, 0, 1]
[[handles]]
region = [[-1, -1, 1.02], [1, 1, 3]]
rotation = [0, 0, 90]
pivot = [0, 0, 1]
duration = 1
[[obstacles]]
shape = "mesh"
frames = "body_*.obj"
frame_rate = 10
start = 0.5
position = [0, 0, -20]
[[obstacles]]
shape = "mesh"
file = "body_8.obj"
displacement = [0, 0, 1]
duration = 2
[[obstacles]]
shape = "sphere"
centre = [0, 0, -9]
radius = 1
displacement = [1, 0, 0]
duration = 1
ease = false
"""
        + SCHEDULE,
    )
    np.testing.assert_allclose(scene.cloth.mesh.areas.sum(), mesh.areas.sum(), rtol=1e-6)
    seams = scene.cloth.mesh.seams
    np.testing.assert_allclose(scene.cloth.mesh.rest_angles[seams], math.radians(-20))
    assert seams.any() and not scene.cloth.mesh.rest_angles[~seams].any()
    np.testing.assert_allclose(scene.start.positions[:, 2], scene.cloth.mesh.assembled[:, 1] + 1)
    held = scene.cloth.handles[0]
    assert (scene.start.positions[held.vertices, 2] >= 1.02).all()
    np.testing.assert_allclose(held.motion.turn(1.0) @ [1, 0, 0], [0, 1, 0], atol=1e-12)
    animated, rigid, ball = scene.cloth.obstacles
    assert isinstance(animated, AnimatedMesh) and isinstance(rigid, MeshObstacle) and isinstance(ball, Sphere)
    np.testing.assert_allclose(animated.points(0.55)[:, 2], -11.5)
    np.testing.assert_allclose(rigid.points(2.0)[:, 2], 9)
    np.testing.assert_allclose(ball.points(0.25), [[0.25, 0, -9]])


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('garment = "gown"', "field 'garment'; expected stretch-course or"),
        ('garment = "sweater"\nspacing = -1', "field 'spacing'; expected a positive number"),
        ('garment = "sweater"\n[mesh]\nshape = "disk"', "unknown field 'mesh'"),
        ('[mesh]\nshape = "sweater"\nwidth = -1', r"\[mesh\] width of the cut; expected a positive length"),
        ('[mesh]\nshape = "sweater"\nradius = 1', "unknown field 'mesh.radius'"),
        ('[mesh]\nfile = "none.obj"', "none.obj: file does not exist"),
        ('[mesh]\nshape = "sweater"\nrest_angle = {hem = 3}', "unknown field 'mesh.rest_angle.hem'"),
        ('[mesh]\nfile = "none.obj"\nscale = 0', "field 'mesh.scale'; expected a positive number"),
        (
            '[[obstacles]]\nshape = "mesh"\nframes = "body.obj"\nframe_rate = 1',
            "expected a file name with one star",
        ),
        (
            '[[obstacles]]\nshape = "mesh"\nframes = "body_*.obj"\nframe_rate = 1',
            "expected files with numbers",
        ),
        (
            '[[obstacles]]\nshape = "mesh"\nframes = "body_*.obj"',
            "missing field 'obstacles\\[0\\].frame_rate'",
        ),
        ('[[obstacles]]\nshape = "mannequin"\npose = 1', "unknown field 'obstacles\\[0\\].pose'"),
        (
            '[[obstacles]]\nshape = "mannequin"\n[[obstacles.poses]]\ntime = 0\ndepth = 0',
            "depth'; expected 0.05 to 1.5",
        ),
        ('[[obstacles]]\nshape = "mannequin"\nspacing = 1', "spacing of the body; expected between"),
        ("[[handles]]\nregion = [[0, 0, 9], [1, 1, 9]]", "handle 'handles\\[0\\]'; expected vertices"),
        ("[[handles]]\nregion = [[0, 0, 9], [1, 1, 9]]\nvertex = [0, 0]", "found vertex and region"),
        ('[schedule]\nduration = 1\nintegrator = "rk4"', "integrator; expected euler or bdf2; found rk4"),
    ],
)
def test_bad_garment_scenes_are_told_with_file_and_field(folder: Path, text: str, message: str) -> None:
    if "[mesh]" not in text and "garment" not in text:
        text = "[mesh]\nwidth = 0.1\nheight = 0.1\nspacing = 0.02\n" + text
    if "[schedule]" not in text and "garment" not in text:
        text += "\n" + SCHEDULE
    with pytest.raises(InputError, match=message) as caught:
        scene_of(folder, text)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["sweater"], "sweater: ready scene; expected --shell, a name of the library or a file; found none"),
        (["gown"], "no such scene; expected a scene file or one of stretch-course"),
        (["scene.toml", "--spacing", "0.1"], "--spacing; expected it in the scene file"),
    ],
)
def test_the_command_tells_what_it_needs(folder: Path, monkeypatch, capsys, arguments, message: str) -> None:
    monkeypatch.chdir(folder)
    (folder / "scene.toml").write_text(HEAD + 'garment = "sweater"\n')
    assert main(["simulate", *arguments, "--out", "run"]) == 2
    assert message in capsys.readouterr().err
