"""Ready scenes: each starts clear of everything, names bad numbers, and the clothes stay on a body that moves."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from yarnscale.errors import InputError
from yarnscale.motion.run import simulate
from yarnscale.motion.scene import run_scene
from yarnscale.shell.dynamics.solver import ClothSolver
from yarnscale.shell.garments.mannequin import MovingMannequin, Pose, mannequin
from yarnscale.shell.materials.orthotropic import JERSEY
from yarnscale.shell.scenes.body_scenes import scarf, sweater
from yarnscale.shell.scenes.ready import READY, ready_scene
from yarnscale.shell.scenes.sheet_scenes import pull_through, torus, twist

QUICK = MovingMannequin(mannequin(0.03), (Pose(0.0, depth=0.15), Pose(0.25)))
"""A body that grows fast, to see it at work within a few steps."""


@pytest.mark.parametrize("name", READY)
def test_ready_scenes_start_clear_of_everything(name: str) -> None:
    scene = ready_scene(name, JERSEY, spacing=0.03)
    solver = ClothSolver(scene.cloth, scene.options)
    assert not solver.intersects(scene.start)
    assert scene.schedule.frame_interval is not None
    for handle in scene.cloth.handles:
        np.testing.assert_allclose(handle.places(0.0), scene.start.positions[handle.vertices])


def test_the_sweater_is_put_on_without_crossing_anything() -> None:
    scene = sweater(JERSEY, spacing=0.05, duration=2 / 15)
    scene = replace(scene, cloth=replace(scene.cloth, obstacles=(QUICK,)))
    solver = ClothSolver(scene.cloth, scene.options)
    crossings = []
    run = simulate(
        solver,
        scene.start,
        scene.schedule,
        on_frame=lambda _, state: crossings.append(solver.intersects(state)),
    )
    assert run.converged and run.loose_steps == 0
    assert len(crossings) == 5 and not any(crossings)
    # The chest has pushed the front out, and the back stays behind the body.
    front, back = run.state.positions[:, 1].min(), run.state.positions[:, 1].max()
    assert front < 1.5 * scene.start.positions[:, 1].min() and back > 1.5 * scene.start.positions[:, 1].max()


def test_twisting_bars_turn_the_strip() -> None:
    scene = twist(JERSEY, spacing=0.025, turns=0.5, duration=0.8)
    result = run_scene(scene)
    assert result.converged and result.measures["closest"] > 0
    left, right = scene.cloth.handles
    across = [result.state.positions[bar.vertices] for bar in (left, right)]
    along = [
        line[np.argmax(bar.rest[:, 1])] - line[np.argmin(bar.rest[:, 1])]
        for line, bar in zip(across, (left, right), strict=True)
    ]
    cosine = along[0] @ along[1] / np.linalg.norm(along[0]) / np.linalg.norm(along[1])
    assert cosine == pytest.approx(-1.0, abs=1e-3)


def test_the_body_eases_from_pose_to_pose() -> None:
    body = MovingMannequin(mannequin(), (Pose(0.0, depth=0.15), Pose(1.0, lowered=0.5)))
    np.testing.assert_allclose(body.points(-1.0), body.body.pose(depth=0.15))
    np.testing.assert_allclose(body.points(0.5), body.body.pose(depth=0.575, lowered=0.25))
    np.testing.assert_allclose(body.points(3.0), body.body.pose(lowered=0.5))
    with pytest.raises(InputError, match="times of the poses; expected increasing"):
        MovingMannequin(mannequin(), (Pose(1.0), Pose(1.0)))


def test_the_ring_is_closed_and_faces_outwards() -> None:
    points, triangles = torus(0.03, 0.01)
    x = points[triangles]
    volume = (x[:, 0] * np.cross(x[:, 1], x[:, 2])).sum() / 6
    assert volume == pytest.approx(2 * math.pi**2 * 0.03 * 0.01**2, rel=0.02)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: ready_scene("ballgown", JERSEY), "ready scene; expected stretch-course or"),
        (lambda: ready_scene("sweater", JERSEY, spacing=-1.0), "spacing of panel 'front'"),
        (lambda: scarf(JERSEY, length=0.1), "length of the scarf"),
        (lambda: twist(JERSEY, turns=math.inf), "turns; expected up to 5"),
        (lambda: pull_through(JERSEY, opening=0.0), "opening of the ring"),
    ],
)
def test_ready_scenes_name_the_bad_number(call, message: str) -> None:
    with pytest.raises(InputError, match=message):
        call()
