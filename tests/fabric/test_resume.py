"""Yarns and volumes go on from a checkpoint file as if they had never stopped: bit by bit."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from yarnscale.drawing import library
from yarnscale.fabric.adaptive_volume import AdaptiveRule, AdaptiveVolume
from yarnscale.fabric.direct_energy import FabricEnergy
from yarnscale.fabric.direct_motion import FabricDynamics, FabricMotion, MotionSettings
from yarnscale.fabric.rod_volume import RodVolume, VolumeDynamics
from yarnscale.fabric.sheet import YarnSheet
from yarnscale.fabric.sheet_scene import drape, stretch
from yarnscale.fabric.spline_knit import jersey
from yarnscale.fabric.spline_motion import SplineMotion, YarnMotion
from yarnscale.fabric.spline_points import SplinePoints
from yarnscale.fabric.volume import BoundingVolume
from yarnscale.fabric.volume_cells import Reduction
from yarnscale.files.checkpoint_file import CheckpointFile
from yarnscale.motion.body import Body
from yarnscale.motion.run import Run, simulate
from yarnscale.motion.schedule import Schedule
from yarnscale.yarn.friction import YarnFriction
from yarnscale.yarn.material import YarnMaterial

WOOL = YarnMaterial.preset("wool")
Made = tuple[Body[Any], Any, Schedule]


def rods(scene: str, *, volume: bool = False, explicit: bool = False) -> Made:
    sheet = YarnSheet.of(library.build("stockinette"), 2, 2)
    energy = FabricEnergy(sheet, WOOL)
    made = drape(sheet, friction=0.3) if scene == "drape" else stretch(sheet, amount=0.5, duration=0.04)
    settings = MotionSettings(made.gravity, 1.0, YarnFriction(0.1), method="explicit" if explicit else "implicit")
    energy.count_passages()
    parts = energy, settings, made.holds, made.pushes(energy)
    body = (
        VolumeDynamics(*parts, volume=RodVolume(energy, BoundingVolume.around(energy.sheet.vertices, (4, 4))))
        if volume
        else FabricDynamics(*parts)
    )
    schedule = Schedule(0.001, 1.0, to_rest=False, frame_interval=0.00025) if explicit else Schedule(
        0.04, 0.005, to_rest=False, frame_interval=0.01
    )  # fmt: skip
    return body, body.start(), schedule


def splines(
    *, volume: bool = False, explicit: bool = False, adaptive: bool = False, reduction: Reduction = "published"
) -> Made:
    fabric = jersey(4, 3, WOOL)
    around = BoundingVolume.around(fabric.control, (4, 4)) if volume else None
    moving = SplineMotion(
        fabric, volume=around, reduction=reduction, held=fabric.top, method="explicit" if explicit else "implicit",
        damping=1.0,
    )  # fmt: skip
    schedule = Schedule(0.02, 1 / 240, to_rest=False, frame_interval=1 / 240 if adaptive else 0.005)
    if adaptive:
        return AdaptiveVolume(moving, AdaptiveRule(gain=1e-7, narrowest=6.0)), moving.start, schedule
    return moving, moving.start, schedule


def stretched_splines() -> Made:
    """Under handles, after a passage."""
    fabric = jersey(3, 3, WOOL)
    loads = stretch(SplinePoints(fabric).sheet, amount=0.1, duration=0.02)
    moving = SplineMotion(fabric, loads=loads, gravity=loads.gravity, damping=1.0)
    start = replace(moving.start, passages=np.array([[3.0, 200.0, 0.5, 0.25, 0.75, 1.0]]))
    return moving, start, Schedule(0.02, 1 / 240, to_rest=False, frame_interval=0.005)


CASES: dict[str, tuple[type, Callable[[], Made]]] = {
    "rods, stretched": (FabricMotion, lambda: rods("stretch")),
    "rods on a ball": (FabricMotion, lambda: rods("drape")),
    "rods in a volume": (FabricMotion, lambda: rods("stretch", volume=True)),
    "rods, explicit": (FabricMotion, lambda: rods("stretch", explicit=True)),
    "splines": (YarnMotion, lambda: splines()),
    "splines under handles": (YarnMotion, stretched_splines),
    "splines in a volume": (YarnMotion, lambda: splines(volume=True)),
    "splines in a homogenized volume": (YarnMotion, lambda: splines(volume=True, reduction="homogenized")),
    "splines, explicit": (YarnMotion, lambda: splines(volume=True, explicit=True)),
    "splines in an adaptive volume": (YarnMotion, lambda: splines(volume=True, adaptive=True)),
}


@pytest.mark.parametrize("case", CASES)
def test_a_run_goes_on_bit_by_bit(case: str, tmp_path: Path) -> None:
    kind, make = CASES[case]
    body, start, schedule = make()
    states: list[Any] = []
    files: list[CheckpointFile[Any]] = []

    def keep(run: Run[Any]) -> None:
        if run.shown:
            files.append(CheckpointFile(tmp_path / f"{run.frames}.npz", kind, {"case": case}, interval=math.inf))
            files[-1].write(run)

    whole = simulate(body, start, schedule, on_frame=lambda _, state: states.append(state), on_checkpoint=keep)
    assert whole.converged and whole.frames == len(states) >= 5
    fresh, start, _ = make()
    place = files[2].read()
    assert place.frames == 3
    rest: list[Any] = []
    again = simulate(fresh, start, schedule, on_frame=lambda _, state: rest.append(state), resume=place)
    for one, other in zip(states[3:], rest, strict=True):
        assert one.time == other.time
        splined = ("positions", "velocities", "knots", "passages")
        for name in ("x", "velocity", "passages") if kind is FabricMotion else splined:
            np.testing.assert_array_equal(getattr(one, name), getattr(other, name), err_msg=name)
    work = ("steps", "newton_iterations", "factorisations", "loose_steps", "unfulfilled", "frames")
    assert [getattr(again, name) for name in work] == [getattr(whole, name) for name in work]
    if "adaptive" in case:
        assert len(whole.state.knots) >= 2
    if "handles" in case:
        assert len(whole.state.passages) == 1
    # The last checkpoint says that there is nothing left to do.
    done = simulate(fresh, start, schedule, resume=files[-1].read())
    assert done.converged and done.steps == whole.steps
