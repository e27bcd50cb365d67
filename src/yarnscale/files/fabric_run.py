"""Run the scene of a finite fabric; with a folder, frames are written as they finish, and a killed run can continue."""

from __future__ import annotations

import math
import os
import time
from collections.abc import Callable, Mapping
from pathlib import Path

from yarnscale.checked import checked
from yarnscale.fabric.fabric_scene import FabricResult, FabricScene
from yarnscale.files.checkpoint_file import NAME, CheckpointFile
from yarnscale.files.cloth_frames import BODIES
from yarnscale.files.curve_frames import CURVES, CurveFolder, CurveSet
from yarnscale.motion.body import State
from yarnscale.motion.run import Progress, simulate

MAKES = ("frame_*.npz", CURVES, BODIES, NAME)
"""All that a run writes into its folder."""


def checkpoint(folder: Path, kind: type[State], settings: Mapping[str, object]) -> CheckpointFile[State]:
    """The checkpoint of a run in its folder; kind: of states; settings: all that shapes the run, by name."""
    # Between frames a run depends on lists of contacts that are not in the checkpoint.
    return CheckpointFile(folder / NAME, kind, settings, interval=math.inf)


@checked
def run(
    scene: FabricScene[State],
    folder: str | os.PathLike[str] | None = None,
    *,
    resume: bool = False,
    settings: Mapping[str, object] | None = None,
    on_step: Callable[[Progress], None] | None = None,
    on_frame: Callable[[int, State], None] | None = None,
) -> FabricResult[State]:
    """Simulate a finite fabric, a ``RodScene`` or a ``SplineScene``.

    folder: for frames of curves and a checkpoint; those of an earlier run are replaced. resume: continue from the
    checkpoint in the folder instead. settings: all
    that shapes the run, by name, for which a checkpoint is refused if they differ; by default the fields of the scene.
    Callbacks: as of ``simulate``. Raises InputError.
    """
    settings = scene.settings if settings is None else settings
    place = None if folder is None else checkpoint(Path(folder), type(scene.start), settings)
    begun = place.read() if place is not None and resume else None
    frames = None if folder is None else _frames(scene, Path(folder), 0 if begun is None else begun.frames)

    def show(number: int, state: State) -> None:
        if frames is not None:
            frames.write(number, scene.points(state), state.time)
        if on_frame is not None:
            on_frame(number, state)

    began = time.perf_counter()
    done = simulate(
        scene.body, scene.start, scene.schedule, on_step=on_step, on_frame=show,
        on_checkpoint=None if place is None else place.write, resume=begun,
    )  # fmt: skip
    seconds = time.perf_counter() - began
    return FabricResult(scene, done, seconds, {**scene.measures(done.state), **scene.drops(done.state)})


def _frames(scene: FabricScene[State], folder: Path, keep: int) -> CurveFolder:
    lines = scene.lines
    curves = CurveSet(lines.offsets, lines.radii, closed=lines.closed, yarn=lines.colours)
    return CurveFolder(folder, curves, obstacles=scene.obstacles, keep=keep)
