"""A finite fabric through time: steps one after another, frames as they finish, and what to know about the run."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from yarnscale.fabric.direct_motion import FabricDynamics, FabricMotion, FabricStep
from yarnscale.fabric.run import OFF_PLACE, MotionSchedule
from yarnscale.numerics.newton import Status
from yarnscale.unfulfilled import Unfulfilled, updated

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class DirectRun:
    """Outcome: the last motion, steps, those that met their tolerance, Newton iterations, factorisations, seconds.

    frames: time [s] and energies [J] of every frame. passages: how often a yarn went through another. unfulfilled:
    grips that were not where they are to be.
    """

    motion: FabricMotion
    status: Status
    steps: int
    converged_steps: int
    iterations: int
    factorisations: int
    seconds: float
    passages: int
    frames: list[dict[str, float]] = field(default_factory=list)
    unfulfilled: tuple[Unfulfilled, ...] = ()


def run_fabric(
    dynamics: FabricDynamics,
    schedule: MotionSchedule,
    *,
    start: FabricMotion | None = None,
    on_frame: Callable[[int, FabricMotion], None] | None = None,
    on_step: Callable[[float], None] | None = None,
) -> DirectRun:
    """Run from ``start`` (default: at rest as the sheet lies); ``on_frame(number, motion)`` gets frames as they finish.

    Steps of a fabric with many contacts seldom meet a tight tolerance in a few Newton iterations; those that do not
    are taken as they are, counted, and safe all the same. A run ends early only where energies are no numbers. Explicit
    steps are as long as is stable at the frame before.
    """
    begin = time.perf_counter()
    motion = dynamics.start() if start is None else start
    explicit = schedule.method == "explicit"
    longest = schedule.time_step
    end = motion.time + schedule.duration
    count = max(1, round(schedule.duration / schedule.frame_interval))
    steps = good = iterations = factorisations = 0
    status, frames = Status.CONVERGED, []
    energy = dynamics.energy
    unfulfilled: tuple[Unfulfilled, ...] = ()

    def frame(number: int) -> None:
        frames.append({"time": motion.time, **dynamics.energies(motion)})
        if on_frame is not None:
            on_frame(number, motion)

    frame(0)
    for number in range(1, count + 1):
        goal = end - schedule.duration * (1.0 - number / count)
        if explicit:  # yarns that are pressed together are stiffer
            longest = dynamics.stable_step(motion)
        while goal - motion.time > 1e-9 * end:
            remaining = goal - motion.time
            size = remaining / math.ceil(remaining / longest - 1e-9)
            step: FabricStep = (dynamics.explicit if explicit else dynamics.implicit)(motion, size)
            if step.status is Status.INVALID:
                status = step.status
                break
            motion, steps = step.motion, steps + 1
            distances = dynamics.holds(motion.time).distances(energy, motion.x)
            unfulfilled = updated(unfulfilled, motion.time, distances, OFF_PLACE * energy.radius)
            good += step.status is Status.CONVERGED
            iterations, factorisations = iterations + step.iterations, factorisations + step.factorisations
            if on_step is not None:
                on_step(1.0 - (end - motion.time) / schedule.duration)
        if status is Status.INVALID:
            break
        frame(number)
    passages = 0 if dynamics.count is None else dynamics.count.passages
    seconds = time.perf_counter() - begin
    return DirectRun(
        motion, status, steps, good, iterations, factorisations, seconds, passages, frames, unfulfilled
    )
