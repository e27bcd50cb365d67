"""Scenes: the built-in ones against closed forms and published shapes, scene files, frames, bad input."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from yarnscale.errors import InputError
from yarnscale.files.cloth_frames import FrameFolder, read_frame
from yarnscale.files.material_json import read_material, write_material
from yarnscale.files.scene_toml import read_scene
from yarnscale.motion.obstacles import MeshObstacle, Plane, Sphere
from yarnscale.motion.scene import run_scene
from yarnscale.motion.schedule import ANIMATION_ITERATIONS
from yarnscale.shell.materials.orthotropic import JERSEY
from yarnscale.shell.scenes.scene import BAR_GAP, BAR_TRAVEL, central_stretch, drape, stretch

CLOTH = replace(JERSEY, bend_bias=2e-6, bend_warp=2e-6)

SCENE = """
material = "cloth.json"
damping = 1.0
[mesh]
width = 0.1
height = 0.1
spacing = 0.02
tilt = 90
position = [0.0, 0.0, 0.3]
[schedule]
duration = 0.1
time_step = 0.02
frame_interval = 0.05
[[handles]]
name = "bar"
box = [[-0.05, 0.045], [0.05, 0.05]]
displacement = [0.0, 0.01, 0.0]
duration = 0.05
[[handles]]
vertex = [0.0, 0.0]
"""


@pytest.fixture
def scene_file(tmp_path: Path) -> Path:
    write_material(tmp_path / "cloth.json", CLOTH)
    path = tmp_path / "scene.toml"
    path.write_text(SCENE)
    return path


@pytest.mark.parametrize("direction", ["course", "wale"])
def test_stretch_opens_the_gap_by_the_amount(direction) -> None:
    scene = stretch(CLOTH, direction=direction, amount=0.1, spacing=0.02)
    result = run_scene(scene)
    assert result.converged
    first, second = scene.cloth.handles
    axis = 0 if direction == "course" else 1
    travel = result.state.positions[second.vertices, axis].mean() - result.state.positions[first.vertices, axis].mean()
    rest = second.rest[:, axis].mean() - first.rest[:, axis].mean()
    assert travel - rest == pytest.approx(0.1 * BAR_GAP, rel=1e-4)
    summary = result.summary()
    # The held vertices are not exactly at the edge of the bars on so coarse a mesh.
    assert summary["lambda_along"] == pytest.approx(1.1, abs=0.02)
    assert 0.9 < summary["lambda_across"] < 1.0
    stress = CLOTH.stretch_weft if axis == 0 else CLOTH.stretch_warp
    assert summary["bar_force"] == pytest.approx(0.1 * stress * 0.25, rel=0.3)
    assert summary["vertices"] == scene.cloth.mesh.vertex_count
    assert summary["seconds"] > 0 and summary["simulated_seconds"] > 0 and summary["steps"] > 3


@pytest.mark.parametrize(("fabric", "seconds"), [("stockinette", 0.4), ("basket", 0.25), ("rib", 0.45)])
def test_bars_move_as_published(fabric: str, seconds: float) -> None:
    """HYLC20 §8.1: way and time of the bars, strips of 21 mm × 201 mm with centre lines 48 mm inside, air drag."""
    scene = stretch(CLOTH, travel=BAR_TRAVEL[fabric], spacing=0.003)
    assert scene.schedule.duration == pytest.approx(seconds) and scene.cloth.air_drag == 10.0
    # Vertices 3 mm apart meet each end of a strip to within that.
    for handle, side in zip(scene.cloth.handles, (-1.0, 1.0), strict=True):
        assert handle.motion.displacement == pytest.approx((side * BAR_TRAVEL[fabric], 0.0, 0.0))
        assert handle.motion.duration == pytest.approx(seconds)
        assert np.abs(handle.rest[:, 0] - side * 0.102).max() <= 0.0105 + 1e-9
        np.testing.assert_allclose(np.ptp(handle.rest[:, :2], axis=0), [0.021, 0.201], atol=0.006)
    slow = stretch(CLOTH, amount=0.2, duration=1.0, air_drag=0.0)
    assert slow.schedule.duration == 1.0 and slow.cloth.air_drag == 0.0
    assert slow.cloth.handles[1].motion.displacement[0] == pytest.approx(0.1 * BAR_GAP)


def test_central_stretch_of_a_uniform_state() -> None:
    mesh = stretch(CLOTH, spacing=0.01).cloth.mesh
    positions = np.column_stack([mesh.panel * [1.3, 0.9], np.zeros(mesh.vertex_count)])
    np.testing.assert_allclose(central_stretch(mesh, positions, 0.03), [1.3, 0.9])


def test_drape_covers_the_ball_and_hangs() -> None:
    result = run_scene(drape(CLOTH, spacing=0.015, duration=0.5))
    assert result.converged
    assert 0 < result.measures["closest"] < 1e-3
    assert 0.07 < result.measures["highest"] < 0.073
    assert result.measures["lowest"] < -0.05


@pytest.mark.parametrize(
    ("material", "direction", "travel", "along", "across"),
    [
        ("satin1.json", "wale", 0.020, 1.214, 0.996),
        ("stock1.json", "course", 0.035, 1.379, 0.892),
        ("stock1.json", "wale", 0.035, 1.388, 0.889),
    ],
)
def test_published_stretch_shapes(shared: Path, material: str, direction, travel: float, along: float, across: float):
    """Centre of the published sheets of HYLC20, pulled as they were, within 2 %: README of the reference data."""
    path = shared / "reference" / material
    result = run_scene(stretch(read_material(path), direction=direction, travel=travel))
    assert result.converged
    assert result.measures["lambda_along"] == pytest.approx(along, rel=0.02)
    assert result.measures["lambda_across"] == pytest.approx(across, rel=0.02)


def test_scene_file_is_read_and_runs(scene_file: Path) -> None:
    scene = read_scene(scene_file)
    assert scene.name == "scene"
    bar, pin = scene.cloth.handles
    assert bar.name == "bar" and len(bar.vertices) > 3 and len(pin.vertices) == 1
    np.testing.assert_allclose(scene.start.positions[bar.vertices, 2], 0.35)
    assert scene.cloth.damping == 1.0 and scene.cloth.contact is None
    frames = FrameFolder(scene_file.parent / "frames", scene.cloth.mesh)
    result = run_scene(scene, on_frame=frames.write)
    assert result.converged
    names = sorted(p.name for p in frames.folder.iterdir())
    assert names == ["frame_0000.npz", "frame_0001.npz", "frame_0002.npz", "mesh.npz"]
    last = read_frame(frames.folder / names[2])
    np.testing.assert_array_equal(last.positions, result.state.positions)
    assert last.time == pytest.approx(0.1)


def test_scene_file_of_statics_ends_as_its_motion_does(scene_file: Path) -> None:
    """Equilibria while the bar moves: the last one is where the motion comes to rest."""
    upwards = SCENE.replace("[0.0, 0.01, 0.0]", "[0.0, 0.0, 0.01]")
    exact = "tolerance = 1e-7\nrest_tolerance = 1e-5\nlongest_step = 10"
    scene_file.write_text(upwards.replace("time_step = 0.02", 'minimiser = "newton"\nto_rest = true\n' + exact))
    scene = read_scene(scene_file)
    assert scene.options.minimiser == "newton"
    moved = run_scene(scene)
    scene_file.write_text(upwards.replace("time_step = 0.02", "statics = true\nfirst_load = 0.25\n" + exact))
    scene = read_scene(scene_file)
    assert scene.schedule.statics and scene.schedule.load_steps.first == 0.25
    times: list[float] = []
    shares: list[float] = []
    followed = run_scene(
        scene,
        on_frame=lambda _, state: times.append(state.time),
        on_step=lambda progress: shares.append(progress.share),
    )
    assert moved.converged and followed.converged and followed.run.steps >= 4
    assert times[0] == 0.0 and times[-1] == pytest.approx(0.1)
    assert shares[-1] == pytest.approx(1.0) and shares == sorted(shares)
    np.testing.assert_allclose(followed.state.positions, moved.state.positions, atol=1e-4)


def test_statics_go_on_from_a_checkpoint(scene_file: Path) -> None:
    scene_file.write_text(SCENE.replace("time_step = 0.02", "statics = true\nfirst_load = 0.25"))
    scene, kept = read_scene(scene_file), []
    whole = run_scene(scene, on_checkpoint=kept.append)
    half = next(place for place in kept if 0.4 < place.state.time / 0.1 < 0.9)
    rest = run_scene(scene, resume=half)
    assert rest.converged and rest.run.steps > half.steps
    np.testing.assert_allclose(rest.state.positions, whole.state.positions, atol=2e-4)


def test_animation_bounds_the_work_of_a_step(scene_file: Path) -> None:
    scene_file.write_text(SCENE.replace("time_step = 0.02", "animation = true\nrough_iterations = 2"))
    scene = read_scene(scene_file)
    assert scene.schedule.time_step == 1 / 30 and not scene.schedule.to_rest
    result = run_scene(scene)
    # Steps of 1/40 s, for frames come every 0.05 s.
    assert result.converged and result.run.steps == 4 and result.run.newton_iterations <= 8
    spent = []
    animated = replace(scene, schedule=stretch(CLOTH, spacing=0.03).schedule.animated())
    run_scene(animated, on_step=lambda progress: spent.append(progress.iterations))
    assert max(spent) <= ANIMATION_ITERATIONS


def test_all_obstacles_are_read(scene_file: Path) -> None:
    (scene_file.parent / "body.obj").write_text("v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1/1 2/2 3//1 -1\n")
    scene_file.write_text(
        SCENE
        + """
[contact]
friction = 0.4
self_contact = false
[[obstacles]]
shape = "sphere"
centre = [0, 0, -1]
radius = 0.5
[[obstacles]]
shape = "plane"
point = [0, 0, -2]
[[obstacles]]
shape = "mesh"
file = "body.obj"
scale = 0.1
position = [0, 0, -3]
"""
    )
    cloth = read_scene(scene_file).cloth
    sphere, plane, body = cloth.obstacles
    assert isinstance(sphere, Sphere) and sphere.radius == 0.5
    assert isinstance(plane, Plane) and plane.normal == (0, 0, 1)
    assert isinstance(body, MeshObstacle) and len(body.triangles) == 2
    np.testing.assert_allclose(body.vertices[2], [0.1, 0.1, -3])
    assert cloth.contact is not None and cloth.contact.friction == 0.4 and not cloth.contact.self_contact


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (
            "damping = 1.0",
            "dampening = 1.0",
            r"scene.toml:\d+: unknown field 'dampening'; expected name, material",
        ),
        (
            "damping = 1.0",
            "damping = 'much'",
            r"scene.toml:\d+: field 'damping'; expected a number; found 'much'",
        ),
        ("damping = 1.0", "damping = -1", "damping; expected zero or more"),
        ("damping = 1.0", "damping = ", r"scene.toml:3: file is not TOML"),
        ('material = "cloth.json"', "", "missing field 'material'"),
        ('"cloth.json"', '"silk.json"', "silk.json: file does not exist"),
        ("width = 0.1\n", "", "missing field 'mesh.width'"),
        ("width = 0.1", "width = -0.1", r"scene.toml:\d+: \[mesh\] width; expected a positive length"),
        ("width = 0.1", "width = nan", "field 'mesh.width'; expected a finite number"),
        (
            "time_step = 0.02",
            'minimiser = "gauss"',
            r"\[schedule\] minimiser; expected quasi-newton or newton",
        ),
        ("time_step = 0.02", "rough_iterations = 0", r"\[schedule\] rough_iterations; expected at least 1"),
        ("time_step = 0.02", "animation = 1", "'schedule.animation'; expected true or false"),
        (
            "time_step = 0.02",
            "animation = true\nstatics = true",
            "'schedule.animation'; expected false with statics",
        ),
        (
            "time_step = 0.02",
            "statics = true\nfirst_load = 2",
            r"\[schedule\] load steps; expected 0 < smallest",
        ),
        (
            "duration = 0.1\ntime",
            "statics = true\nduration = 0\ntime",
            "duration; expected a positive number for stat",
        ),
        ("spacing = 0.02", "spacing = 0.02\nradius = 1", "unknown field 'mesh.radius'"),
        (
            "spacing = 0.02",
            'spacing = 0.02\nshape = "star"',
            "field 'mesh.shape'; expected rectangle or disk",
        ),
        ("[0.0, 0.0, 0.3]", "[0.0, 0.3]", "field 'mesh.position'; expected 3 numbers; found 2 numbers"),
        ("time_step = 0.02", "time_step = 0", r"\[schedule\] time_step; expected a positive number"),
        ("[[-0.05, 0.045], [0.05, 0.05]]", "[[1.0, 1.0], [2.0, 2.0]]", "handle 'bar'; expected vertices"),
        ("vertex = [0.0, 0.0]", "", "'box' or 'vertex'"),
        (
            "vertex = [0.0, 0.0]",
            "[[obstacles]]\nshape = 'cube'",
            "expected sphere or plane or mesh or mannequin; found 'cube'",
        ),
        ("vertex = [0.0, 0.0]", "vertex = [0.0, 0.0]\n[contact]\nself_contact = 1", "expected true or false"),
    ],
)
def test_bad_scene_files_are_told_with_file_and_field(scene_file: Path, old: str, new: str, message: str) -> None:
    assert old in SCENE
    scene_file.write_text(SCENE.replace(old, new))
    with pytest.raises(InputError, match=message) as caught:
        read_scene(scene_file)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("v 0 0\n", "body.obj:1: vertex; expected three finite numbers"),
        ("v 0 0 nan\n", "body.obj:1: vertex; expected three finite numbers"),
        ("v 0 0 0\nf 1 2 3\n", "body.obj:2: face; expected vertices 1..1; found 2"),
        ("v 0 0 0\nf a b c\n", "body.obj:2: face; expected vertex numbers"),
        ("v 0 0 0\n", "file has no faces"),
    ],
)
def test_bad_obstacle_files_are_told_with_file_and_line(scene_file: Path, text: str, message: str) -> None:
    (scene_file.parent / "body.obj").write_text(text)
    scene_file.write_text(SCENE + "[[obstacles]]\nshape = 'mesh'\nfile = 'body.obj'\n")
    with pytest.raises(InputError, match=message):
        read_scene(scene_file)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: stretch(CLOTH, direction="bias"), "direction; expected course or wale"),  # type: ignore[arg-type]
        (lambda: stretch(CLOTH, amount=math.nan), "amount; expected a number"),
        (lambda: stretch(CLOTH, travel=1.0), "travel of a bar; expected between"),
        (lambda: stretch(CLOTH, duration=-1.0), "motion duration; expected"),
        (lambda: stretch(CLOTH, air_drag=-1.0), "air_drag; expected zero or more"),
        (lambda: drape(CLOTH, radius=-0.1), "sphere radius; expected a positive length"),
    ],
)
def test_built_in_scenes_name_the_bad_number(call, message: str) -> None:
    with pytest.raises(InputError, match=message):
        call()


def test_frames_need_a_folder_that_can_be_written(tmp_path: Path) -> None:
    (tmp_path / "taken").write_text("a file")
    with pytest.raises(InputError, match="output cannot be written"):
        FrameFolder(tmp_path / "taken", stretch(CLOTH, spacing=0.05).cloth.mesh)
    (tmp_path / "broken.npz").write_text("no archive")
    with pytest.raises(InputError, match="no frame of a cloth"):
        read_frame(tmp_path / "broken.npz")


def test_a_smaller_stretch_test_is_the_same_test_where_weight_and_bending_do_not_count() -> None:
    stiff = replace(CLOTH, stretch_weft=6e4, stretch_coupling=1e4, stretch_warp=9e4, shear=2e4, area=2e3)
    large, small = (
        run_scene(stretch(stiff, amount=0.1, size=size, spacing=size / 15, air_drag=0.0, self_contact=False)).measures
        for size in (0.3, 0.15)
    )
    for name in ("lambda_along", "lambda_across"):
        assert small[name] == pytest.approx(large[name], rel=2e-3)
    assert small["bar_force"] == pytest.approx(0.5 * large["bar_force"], rel=0.01)


@pytest.mark.parametrize("size", [0.0, -0.1, math.nan, 100.0])
def test_a_sheet_of_a_strange_size_is_told(size: float) -> None:
    with pytest.raises(InputError, match="size of the sheet"):
        stretch(CLOTH, size=size)
