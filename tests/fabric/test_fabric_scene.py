"""Scenes of finite fabrics: how far they fall, what they count, and runs with a folder."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from yarnscale.drawing import library
from yarnscale.errors import InputError
from yarnscale.fabric.rod_fabric import RodFabric
from yarnscale.fabric.rod_scene import RodScene
from yarnscale.fabric.sheet_scene import SheetScene, hang, stretch
from yarnscale.fabric.spline_knit import jersey
from yarnscale.fabric.spline_scene import SplineScene
from yarnscale.fabric.volume import BoundingVolume
from yarnscale.files.curve_frames import read_curve_frames
from yarnscale.files.scene_run import run
from yarnscale.motion.schedule import Schedule
from yarnscale.yarn.material import YarnMaterial

WOOL = YarnMaterial.preset("wool")
STEP, STEPS = 1 / 100, 5
SHORT = Schedule(STEP * STEPS, STEP, to_rest=False, frame_interval=2 * STEP)
FREE = SheetScene((0.0, 3.0, -4.0))


@pytest.fixture(scope="module")
def plain() -> RodFabric:
    return RodFabric.cut(library.build("plain"), WOOL, 2, 2, relax=False)


@pytest.mark.parametrize("reduced", [False, True])
def test_a_free_fabric_falls_as_implicit_steps_let_it(plain: RodFabric, reduced: bool) -> None:
    """g Δt² n (n + 1) / 2 along gravity of 5 m/s², every point of it."""
    volume = BoundingVolume.around(plain.sheet.vertices, (4, 4)) if reduced else None
    result = run(RodScene(plain, FREE, schedule=SHORT, damping=3.0, volume=volume))
    fallen = 5.0 * STEP**2 * STEPS * (STEPS + 1) / 2
    assert result.succeeded
    assert result.measures["centre_drop"] == pytest.approx(fallen, rel=1e-3)
    # Borders that are glued and yarns as drawn move a little on the way.
    assert result.measures["lower_edge_drop"] == pytest.approx(fallen, rel=0.1)
    assert ("reduced_unknowns" in result.summary()) == reduced


def test_without_gravity_nothing_falls(plain: RodFabric) -> None:
    result = run(RodScene(plain, stretch(plain.sheet, amount=0.01, duration=0.02), schedule=Schedule(0.02, STEP)))
    assert result.measures["centre_drop"] is None is result.measures["lower_edge_drop"]
    assert result.measures["force"] is not None and result.measures["force"] > 0.0


def test_hanging_splines_fall_less_in_a_published_volume() -> None:
    knit = jersey(3, 3, WOOL)
    volume = BoundingVolume.around(knit.control, (4, 4))
    drops = []
    within = SplineScene(knit, schedule=SHORT, volume=volume, reduction="published")
    for scene in (SplineScene(knit, schedule=SHORT), within):
        drops.append(float(run(scene).measures["centre_drop"] or 0.0))
    assert 0.0 < drops[1] < drops[0]
    with pytest.raises(InputError, match="a volume"):
        SplineScene(knit, schedule=SHORT, adaptive=True)


def test_a_run_goes_on_in_its_folder_and_refuses_another_scene(plain: RodFabric, tmp_path: Path) -> None:
    scene = RodScene(plain, hang(plain.sheet), schedule=SHORT)
    frames: list[int] = []
    run(scene, tmp_path, on_frame=lambda number, _: frames.append(number))
    assert frames == [0, 1, 2, 3] == list(read_curve_frames(tmp_path).paths)
    again = run(scene, tmp_path, resume=True, on_frame=lambda number, _: frames.append(number))
    assert len(frames) == 4 and again.run.steps == STEPS
    moved = replace(plain, sheet=plain.sheet.moved(1.001 * plain.sheet.vertices))
    other = RodScene(moved, hang(moved.sheet), schedule=SHORT)
    with pytest.raises(InputError, match="another fabric, another loads"):
        run(other, tmp_path, resume=True)
    assert np.isfinite(read_curve_frames(tmp_path).points(3)[0]).all()
