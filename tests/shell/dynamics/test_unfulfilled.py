"""Motions that were not carried out: bodies that gave way, handles driven into a floor; what is told about them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from yarnscale.files.checkpoint_file import CheckpointFile
from yarnscale.files.cloth_frames import FrameFolder, read_cloth_frames
from yarnscale.motion.handles import Handle
from yarnscale.motion.obstacles import AnimatedMesh, MeshObstacle, Obstacle, Plane, Sphere
from yarnscale.motion.rigid import Motion
from yarnscale.motion.run import Run
from yarnscale.motion.scene import run_scene
from yarnscale.motion.schedule import Schedule
from yarnscale.motion.unfulfilled import Unfulfilled
from yarnscale.shell.contact.cloth_contact import ContactSettings
from yarnscale.shell.dynamics.cloth import Cloth
from yarnscale.shell.dynamics.solver import SolverOptions
from yarnscale.shell.materials.orthotropic import JERSEY
from yarnscale.shell.mesh import rectangle
from yarnscale.shell.scenes.scene import Scene, SceneResult
from yarnscale.shell.state import ClothState

DOWN = Motion((0.0, 0.0, -0.1), 0.0, 0.2, (0.0, 0.0, 0.5), ease=False)
FORCE = 0.2
"""Of each point of a body [N]: less than it takes to press the cloth down."""


def body(kind: str) -> Obstacle:
    """Something 12 mm above the plane z = 0 that is to go down 0.1 m; "animated" comes back."""
    if kind == "sphere":
        return Sphere((0.0, 0.0, 0.022), 0.01, DOWN)
    points = 0.02 * np.array([[-1, -1, 0.6], [1, -1, 0.6], [1, 1, 0.6], [-1, 1, 0.6]])
    faces = np.array([[0, 1, 2], [0, 2, 3]])
    if kind == "mesh":
        return MeshObstacle(points, faces, DOWN)
    low = points - np.array([0.0, 0.0, 0.1])
    return AnimatedMesh(np.array([0.0, 0.1, 0.2]), np.stack([points, low, points]), faces)


def scene(obstacle: Obstacle, *, schedule: Schedule, force: float = FORCE, integrator: str = "euler") -> Scene:
    """Cloth held along two edges, without weight, and a body that presses on it."""
    mesh = rectangle(0.1, 0.1, 0.02)
    start = ClothState.flat(mesh)
    sides = np.flatnonzero(np.abs(mesh.panel[:, 0]) > 0.045)
    settings = ContactSettings(holding_force=force, friction=0.3)
    cloth = Cloth(
        mesh, JERSEY, (Handle("sides", sides, start.positions[sides]),), (0.0, 0.0, 0.0), settings, (obstacle,),
        damping=5.0,
    )  # fmt: skip
    return Scene("pressed", cloth, start, schedule, SolverOptions(integrator=integrator))  # type: ignore[arg-type]


def ran(given: Scene, folder: Path, resume: Run | None = None) -> tuple[SceneResult, list[Run]]:
    kept: list[Run] = []
    frames = FrameFolder(folder, given.cloth.mesh, obstacles=given.cloth.obstacles, keep=resume.frames if resume else 0)
    return run_scene(given, on_frame=frames.write, on_checkpoint=kept.append, resume=resume), kept


@pytest.mark.parametrize(
    ("kind", "integrator"),
    [("sphere", "euler"), ("sphere", "bdf2"), ("mesh", "euler"), ("animated", "euler")],
)
def test_a_body_that_gives_way_is_where_it_is(kind: str, integrator: str, tmp_path: Path) -> None:
    given = scene(body(kind), schedule=Schedule(0.2, 0.01, to_rest=False, frame_interval=0.02), integrator=integrator)
    result, kept = ran(given, tmp_path / "whole")
    assert result.converged and not result.succeeded and result.intersections == 0
    (found,) = result.unfulfilled
    assert found.what == f"obstacles[0] ({'sphere' if kind == 'sphere' else 'mesh'})"
    assert 0.02 < found.first <= 0.12
    belongs = given.cloth.obstacles[0].points(0.2)
    assert result.state.obstacles is not None
    away = np.linalg.norm(result.state.obstacles - belongs, axis=1).max()
    assert found.remaining == pytest.approx(away, abs=1e-12)
    assert 0.01 < found.distance < 0.1
    if kind == "animated":
        assert found.remaining < 1e-4, "it comes back, and was off its place all the same"
    else:
        assert found.distance == found.remaining
    # Drawn where it is: above the cloth that it presses on.
    frames = read_cloth_frames(tmp_path / "whole")
    last = frames.bodies(max(frames.paths))
    assert last is not None
    centre = 0.5 * (last.min(axis=0) + last.max(axis=0))
    np.testing.assert_allclose(
        centre, 0.5 * (result.state.obstacles.min(axis=0) + result.state.obstacles.max(axis=0)), atol=1e-12
    )
    # A run that goes on knows what happened before, and where the body was.
    place = kept[15]
    file = CheckpointFile(tmp_path / "place.npz", ClothState, given.settings)
    file.write(place)
    read = file.read()
    assert read.unfulfilled == place.unfulfilled != ()
    again, _ = ran(given, tmp_path / "whole", resume=read)
    assert again.unfulfilled[0].first == found.first
    assert again.unfulfilled[0].distance == pytest.approx(found.distance, abs=1e-5)
    np.testing.assert_allclose(again.state.obstacles, result.state.obstacles, atol=1e-5)  # type: ignore[arg-type]
    assert replace(result, scene=replace(given, may_give_way=True)).succeeded


def test_a_body_that_is_held_firmly_goes_where_it_is_sent() -> None:
    ball = Sphere((0.0, 0.0, 0.022), 0.01, replace(DOWN, displacement=(0.0, 0.0, -0.02), duration=0.05))
    result = run_scene(scene(ball, schedule=Schedule(0.06, 0.01, to_rest=False), force=100.0))
    assert result.succeeded and result.unfulfilled == ()
    assert result.summary()["unfulfilled"] == []
    crossed = replace(result, run=replace(result.run, faults={"obstacle_intersections": 1}))
    assert not crossed.succeeded and crossed.summary()["obstacle_intersections"] == 1


def test_statics_tell_it_too() -> None:
    ball = Sphere((0.0, 0.0, 0.022), 0.01, replace(DOWN, displacement=(0.0, 0.0, -0.04)))
    result = run_scene(scene(ball, schedule=Schedule(0.2, statics=True)))
    assert [entry.what for entry in result.unfulfilled] == ["obstacles[0] (sphere)"]
    assert result.unfulfilled[0].distance > 5e-3


def test_a_pin_sent_through_a_floor_stops_at_it() -> None:
    mesh = rectangle(0.06, 0.06, 0.02)
    start = ClothState.flat(mesh, height=0.02)
    pin = Handle("pin", np.array([4]), start.positions[[4]], Motion((0.0, 0.0, -0.05), 0.0, 0.1))
    cloth = Cloth(mesh, JERSEY, (pin,), contact=ContactSettings(), obstacles=(Plane(),))
    result = run_scene(Scene("pin", cloth, start, Schedule(0.12, 0.02, to_rest=False)))
    assert result.converged and not result.succeeded
    (found,) = result.unfulfilled
    assert found.what == "handle 'pin'" and found.distance == pytest.approx(0.03, abs=1e-4)
    assert result.summary()["unfulfilled"] == [
        {
            "what": "handle 'pin'",
            "first": found.first,
            "distance": found.distance,
            "remaining": found.remaining,
        }
    ]


def test_sentences_name_what_when_and_how_far() -> None:
    text = str(Unfulfilled("handle 'pin'", 0.08, 0.15, 0.15))
    assert text == "handle 'pin' is off its prescribed place from 0.08 s, by up to 0.15 m"
    assert str(Unfulfilled("a body", 0.1, 0.2, 0.01)).endswith("by up to 0.2 m, 0.01 m at the end")
