"""Run a scene; with a folder, frames are written as they finish, and a killed run can continue."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from yarnscale.checked import checked
from yarnscale.files.checkpoint_file import INTERVAL, NAME, CheckpointFile
from yarnscale.files.cloth_frames import BODIES, FrameFolder
from yarnscale.files.curve_frames import CURVES, CurveFolder, CurveSet
from yarnscale.motion.body import State
from yarnscale.motion.run import RunProgress
from yarnscale.motion.scene import Result, SimulatedScene, run_scene
from yarnscale.shell.scenes.scene import Scene
from yarnscale.shell.state import ClothState

MAKES = ("frame_*.npz", CURVES, BODIES, NAME)
"""All that a run of a finite fabric writes into its folder."""


def checkpoint(folder: Path, kind: type[State], settings: Mapping[str, object]) -> CheckpointFile[State]:
    """The checkpoint of a run in its folder; kind: of states; settings: all that shapes the run, by name."""
    # Between frames a run of yarns depends on lists of contacts that are not in the checkpoint.
    interval = INTERVAL if kind is ClothState else math.inf
    return CheckpointFile(folder / NAME, kind, settings, interval=interval)


@checked
def run(
    scene: SimulatedScene[State, Result],
    folder: str | os.PathLike[str] | None = None,
    *,
    resume: bool = False,
    settings: Mapping[str, object] | None = None,
    on_step: Callable[[RunProgress], None] | None = None,
    on_frame: Callable[[int, State], None] | None = None,
) -> Result:
    """Simulate a scene: a ``Scene`` of cloth, or a finite fabric as ``RodScene`` or ``SplineScene``.

    folder: for frames (of cloth in ``frames``) and a checkpoint; those of an earlier run are replaced. resume: continue
    from the checkpoint in the folder instead. settings: everything that the run depends on, by name: a checkpoint
    of others is refused; by default those of the scene. Callbacks: as of ``simulate``. Raises InputError.
    """
    settings = scene.settings if settings is None else settings
    place = None if folder is None else checkpoint(Path(folder), type(scene.start), settings)
    begun = place.read() if place is not None and resume else None
    writes = None if folder is None else _frames(scene, Path(folder), 0 if begun is None else begun.frames)

    def show(number: int, state: State) -> None:
        if writes is not None:
            writes(number, state)
        if on_frame is not None:
            on_frame(number, state)

    return run_scene(
        scene, on_step=on_step, on_frame=show, on_checkpoint=None if place is None else place.write, resume=begun
    )  # fmt: skip


def _frames(scene: Any, folder: Path, keep: int) -> Callable[[int, Any], None]:
    """What writes the frames of a scene."""
    if isinstance(scene, Scene):
        cloth = scene.cloth
        return FrameFolder(folder / "frames", cloth.mesh, obstacles=cloth.obstacles, keep=keep).write
    lines = scene.lines
    curves = CurveSet(lines.offsets, lines.radii, closed=lines.closed, yarn=lines.colours)
    frames = CurveFolder(folder, curves, obstacles=scene.obstacles, keep=keep)
    return lambda number, state: frames.write(number, scene.points(state), state.time)
