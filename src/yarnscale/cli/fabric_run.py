"""One run of the command ``fabric``, whatever moves: frames, checkpoints, progress, and going on after a kill."""

from __future__ import annotations

import argparse
import math
import time
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Generic

import numpy as np
from numpy.typing import NDArray

from yarnscale.cli.console import ProgressLine
from yarnscale.files.checkpoint_file import NAME as CHECKPOINT
from yarnscale.files.checkpoint_file import CheckpointFile
from yarnscale.files.cloth_frames import BODIES
from yarnscale.files.curve_frames import CURVES, CurveFolder, CurveSet
from yarnscale.motion.body import Body, State
from yarnscale.motion.obstacles import Obstacle
from yarnscale.motion.run import Run, simulate
from yarnscale.motion.schedule import Schedule

Floats = NDArray[np.float64]
FRAME = 1 / 30
"""Time from frame to frame [s]."""
MAKES = ("frame_*.npz", CURVES, BODIES, CHECKPOINT)
"""All that a run writes, but for converted frames."""
SHAPING = (
    "rows", "columns", "method", "volume", "adaptive", "scene", "unit", "weld", "tube", "border", "as_drawn", "amount",
    "direction", "friction", "ball_friction", "explicit", "damping", "duration", "time_step",
)  # fmt: skip
"""Options that say how a fabric moves."""


class FabricRun(Generic[State]):
    """A run that is about to begin, or to go on with the last checkpoint in its folder.

    results: that folder. kind: of the body's states. parts: what the options name, such as the pattern and its yarns.
    Raises InputError where there is nothing to resume, or a run of other options or parts.
    """

    def __init__(
        self,
        options: argparse.Namespace,
        results: AbstractContextManager[Path | None],
        kind: type[State],
        **parts: object,
    ) -> None:
        settings = {f"--{name.replace('_', '-')}": getattr(options, name) for name in SHAPING} | parts
        # Between frames a run goes on from lists of contacts that no checkpoint holds.
        self._checkpoints = CheckpointFile(options.out / CHECKPOINT, kind, settings, interval=math.inf)
        self._place = self._checkpoints.read() if options.resume else None
        self._results, self._options = results, options
        self.seconds = 0.0

    def simulate(
        self,
        body: Body[State],
        start: State,
        curves: CurveSet,
        points: Callable[[State], Floats],
        *,
        obstacles: Sequence[Obstacle] = (),
        schedule: Schedule | None = None,
    ) -> Run[State]:
        """Run to the end; points: of the curves at a state (n, 3) [m]; schedule: instead of that of the options."""
        options, kept = self._options, 0 if self._place is None else self._place.frames
        usual = Schedule(options.duration, options.time_step, to_rest=False, frame_interval=FRAME)
        with self._results:
            folder, began = (
                CurveFolder(options.out, curves, obstacles=obstacles, keep=kept),
                time.perf_counter(),
            )
            run = simulate(
                body, start, schedule or usual,
                on_frame=lambda number, state: folder.write(number, points(state), state.time),
                on_step=ProgressLine("fabric").show_step,
                on_checkpoint=self._checkpoints.write, resume=self._place,
            )  # fmt: skip
            self.seconds = time.perf_counter() - began
        return run
