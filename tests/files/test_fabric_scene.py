"""Scene files of finite fabrics."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from yarnscale.drawing import library
from yarnscale.errors import InputError
from yarnscale.fabric.sheet import YarnSheet
from yarnscale.files.fabric_scene import read_fabric_scene
from yarnscale.motion.obstacles import MeshObstacle, Sphere

SCENE = """
may_give_way = true
gravity = [0, 0, -5]
damping = 3
[fabric]
position = [0.1, 0.2, 0.3]
[schedule]
duration = 0.2
time_step = 0.01
statics = true
[contact]
friction = 0.4
[[handles]]
name = "left"
box = [[-1, -1], [-0.004, 1]]
[[handles]]
region = [[0.104, 0, 0], [1, 1, 1]]
displacement = [0.002, 0, 0]
duration = 0.1
[[obstacles]]
shape = "sphere"
centre = [0, 0, 0.012]
radius = 0.009
displacement = [0, 0, -0.006]
duration = 0.2
[[obstacles]]
shape = "mesh"
file = "table.obj"
"""


@pytest.fixture
def path(tmp_path: Path) -> Path:
    (tmp_path / "table.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    found = tmp_path / "Szene ü.toml"
    found.write_text(SCENE, encoding="utf-8")
    return found


def test_a_scene_holds_moves_and_meets_what_the_file_says(path: Path) -> None:
    read = read_fabric_scene(path)
    assert read.may_give_way and read.damping == 3.0
    assert (read.schedule.duration, read.schedule.time_step, read.schedule.statics) == (0.2, 0.01, True)
    assert read.schedule.frame_interval == pytest.approx(1 / 30) and not read.schedule.to_rest
    sheet = read.laid(YarnSheet.of(library.build("plain"), 3, 3))
    low, high = sheet.vertices.min(axis=0), sheet.vertices.max(axis=0)
    np.testing.assert_allclose(0.5 * (low + high), [0.1, 0.2, 0.3])
    scene = read.of(sheet)
    assert scene.gravity == (0.0, 0.0, -5.0) and scene.friction == 0.4
    ball, table = scene.obstacles
    assert isinstance(ball, Sphere) and isinstance(table, MeshObstacle)
    np.testing.assert_allclose(ball.points(0.2), [[0.0, 0.0, 0.006]])
    start, end = scene.holds(0.0), scene.holds(0.1)
    assert list(start.handles) == ["handle 'left'", "handle 'handles[1]'"]
    left, right = start.handles.values()
    np.testing.assert_array_equal(start.nodes[left], np.flatnonzero(sheet.vertices[:, 0] <= 0.096))
    np.testing.assert_array_equal(start.nodes[right], np.flatnonzero(sheet.vertices[:, 0] >= 0.104))
    np.testing.assert_allclose(start.targets, sheet.vertices[start.nodes])
    np.testing.assert_allclose(end.targets - start.targets, right[:, None] * [0.002, 0.0, 0.0], atol=1e-15)


def test_a_pin_holds_the_nearest_vertex(path: Path) -> None:
    path.write_text(SCENE.replace("box = [[-1, -1], [-0.004, 1]]", "vertex = [-0.02, 0.02]"))
    planned = read_fabric_scene(path)
    sheet = planned.laid(YarnSheet.of(library.build("plain"), 3, 3))
    held = planned.of(sheet).holds(0.0)
    (pin,) = held.nodes[held.handles["handle 'left'"]]
    away = np.linalg.norm(sheet.vertices[:, :2] - [0.08, 0.22], axis=1)
    assert away[pin] == away.min()


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("damping = 3", "mesh = 3", "unknown field 'mesh'"),
        ("duration = 0.2\ntime_step", "duration = -1\ntime_step", "duration"),
        ("time_step = 0.01", 'integrator = "bdf2"', "unknown field"),
        ("friction = 0.4", "thickness = 0.4", "unknown field"),
        ('name = "left"', 'name = "left"\nvertex = [0, 0]', "one of 'box' or 'vertex' or 'region'"),
        ("radius = 0.009", "radius = -1", "radius"),
    ],
)
def test_what_is_wrong_is_said_with_its_file(path: Path, old: str, new: str, said: str) -> None:
    assert old in SCENE
    path.write_text(SCENE.replace(old, new, 1))
    with pytest.raises(InputError, match="Szene ü") as caught:
        read_fabric_scene(path)
    assert said in str(caught.value)


def test_handles_that_hold_nothing_or_the_same_are_refused(path: Path) -> None:
    for box, said in (("[[1, 1], [2, 2]]", "in its region"), ("[[-1, -1], [1, 1]]", "different vertices")):
        path.write_text(SCENE.replace("[[-1, -1], [-0.004, 1]]", box))
        planned = read_fabric_scene(path)
        with pytest.raises(InputError, match=said):
            planned.of(planned.laid(YarnSheet.of(library.build("plain"), 3, 3)))
