"""Folders of frames: what is written is read back, and damage is named."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from yarnscale.errors import InputError
from yarnscale.files.animation import read_animation, vertex_normals
from yarnscale.files.body_surface import BodySurface, ball
from yarnscale.files.cloth_frames import FrameFolder, read_cloth_frames
from yarnscale.files.curve_frames import CurveFolder, CurveSet, read_curve_frames
from yarnscale.motion.obstacles import MeshObstacle, Plane, Sphere
from yarnscale.shell.mesh import rectangle
from yarnscale.shell.state import ClothState

MESH = rectangle(0.1, 0.08, 0.02)


def state(time: float) -> ClothState:
    flat = ClothState.flat(MESH)
    return ClothState(flat.positions + np.array([0, 0, time**2]), np.full_like(flat.positions, 2 * time), time)


def write_run(folder: Path, times=(0.0, 0.1, 0.3)) -> None:
    frames = FrameFolder(folder, MESH)
    for number, time in enumerate(times):
        frames.write(number, state(time))


def curves() -> CurveSet:
    return CurveSet([0, 4, 7], [1e-3, 2e-3], closed=[False, True])


def test_frames_come_back(tmp_path: Path) -> None:
    folder = tmp_path / "Läufe mit Leerzeichen" / "frames"
    write_run(folder)
    frames = read_cloth_frames(folder)
    np.testing.assert_array_equal(frames.triangles, MESH.triangles)
    np.testing.assert_array_equal(frames.material, MESH.material)
    np.testing.assert_array_equal(frames.times, [0.0, 0.1, 0.3])
    np.testing.assert_array_equal(frames.state(2).positions, state(0.3).positions)
    np.testing.assert_array_equal(frames.state(2).velocities, state(0.3).velocities)


def test_frames_to_keep_stay_and_others_go(tmp_path: Path) -> None:
    write_run(tmp_path)
    FrameFolder(tmp_path, MESH, keep=2)
    assert list(read_cloth_frames(tmp_path).paths) == [0, 1]
    FrameFolder(tmp_path, MESH)
    with pytest.raises(InputError, match="holds no frames"):
        read_cloth_frames(tmp_path)


def test_bodies_go_along(tmp_path: Path) -> None:
    triangle = MeshObstacle(np.eye(3), np.array([[0, 1, 2]]))
    obstacles = (Sphere((0.1, 0.2, 0.3), 0.05), Plane(), triangle)
    frames = FrameFolder(tmp_path, MESH, obstacles=obstacles)
    frames.write(0, state(0.0))
    animation = read_animation(tmp_path)
    assert animation.bodies is not None
    vertices = animation.moment(0).bodies
    assert vertices is not None
    np.testing.assert_array_equal(vertices[-3:], np.eye(3))
    distance = np.linalg.norm(vertices[:-3] - [0.1, 0.2, 0.3], axis=1)
    np.testing.assert_allclose(distance, 0.05, rtol=1e-12)
    np.testing.assert_array_equal(animation.bodies.triangles, BodySurface(obstacles).triangles)


def test_a_ball_is_closed_and_faces_outwards() -> None:
    vertices, triangles = ball()
    a, b, c = (vertices[triangles[:, k]] for k in range(3))
    volume = np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6
    assert volume == pytest.approx(4 * np.pi / 3, rel=0.02)
    edges = np.sort(np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]]), axis=1)
    assert (np.unique(edges, axis=0, return_counts=True)[1] == 2).all()
    assert (vertex_normals(vertices, triangles) * vertices).sum(axis=1).min() > 0.999


def test_curves_come_back_with_and_without_radii_of_a_frame(tmp_path: Path) -> None:
    points = np.random.default_rng(1).normal(size=(7, 3))
    folder = CurveFolder(tmp_path, curves())
    folder.write(0, points, 0.0)
    folder.write(1, points + 1, 0.5, radii=np.full(7, 5e-4))
    read = read_curve_frames(tmp_path)
    np.testing.assert_array_equal(read.curves.offsets, [0, 4, 7])
    np.testing.assert_array_equal(read.curves.closed, [False, True])
    np.testing.assert_array_equal(read.points(0)[0], points)
    np.testing.assert_array_equal(read.points(0)[1], [1e-3] * 4 + [2e-3] * 3)
    np.testing.assert_array_equal(read.points(1)[1], np.full(7, 5e-4))
    np.testing.assert_array_equal(read.times, [0.0, 0.5])


def test_segments_and_parts_of_curves() -> None:
    whole = curves()
    np.testing.assert_array_equal(whole.segments(), [[0, 1], [1, 2], [2, 3], [4, 5], [5, 6], [6, 4]])
    loops, points = whole.chosen(whole.closed)
    np.testing.assert_array_equal(points, [4, 5, 6])
    np.testing.assert_array_equal(loops.offsets, [0, 3])
    np.testing.assert_array_equal(loops.radii, [2e-3] * 3)


@pytest.mark.parametrize(
    ("arguments", "what"),
    [
        (([0, 1, 4], 1e-3), "curve 0"),
        (([1, 4], 1e-3), "offsets"),
        (([0, 4], -1e-3), "radii"),
        (([0, 4], [1e-3, 1e-3]), "radii"),
        (([0, 4], float("nan")), "radii"),
    ],
)
def test_bad_curves_are_named(arguments, what) -> None:
    with pytest.raises(InputError, match=what):
        CurveSet(*arguments)


def test_a_run_is_cloth_and_yarns_of_the_same_numbers(tmp_path: Path) -> None:
    write_run(tmp_path / "frames")
    yarns = CurveFolder(tmp_path / "yarns", curves())
    for number, time in ((1, 0.1), (2, 0.3)):
        yarns.write(number, np.full((7, 3), time), time)
    animation = read_animation(tmp_path)
    np.testing.assert_array_equal(animation.times, [0.1, 0.3])
    first = animation.moment(0)
    assert first.cloth is not None and first.yarns is not None
    np.testing.assert_array_equal(first.cloth, state(0.1).positions)
    assert first.yarns[0, 0] == 0.1
    assert len(list(animation)) == 2


def test_what_is_missing_is_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="folder does not exist"):
        read_animation(tmp_path / "none")
    with pytest.raises(InputError, match="holds no frames"):
        read_animation(tmp_path)
    write_run(tmp_path / "a")
    (tmp_path / "a" / "frame_0001.npz").write_bytes(b"PK\x03\x04 cut off")
    with pytest.raises(InputError, match=r"frame_0001.npz: file is no frame"):
        read_animation(tmp_path / "a")
    write_run(tmp_path / "b", times=(0.0, 0.2, 0.1))
    with pytest.raises(InputError, match="time of frame 2"):
        read_animation(tmp_path / "b")
    write_run(tmp_path / "c")
    CurveFolder(tmp_path / "d", curves()).write(7, np.zeros((7, 3)), 0.1)
    with pytest.raises(InputError, match="share no frame"):
        read_animation(tmp_path / "c", yarns=tmp_path / "d")


def test_frames_of_another_mesh_are_refused(tmp_path: Path) -> None:
    write_run(tmp_path)
    np.savez(tmp_path / "frame_0001.npz", positions=np.zeros((4, 3)), velocities=np.zeros((4, 3)), time=0.1)
    with pytest.raises(InputError, match="positions"):
        list(read_animation(tmp_path))
