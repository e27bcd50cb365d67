"""Spline yarns through time: steps one after another, frames as they finish, energies on the way."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from yarnscale.errors import InputError
from yarnscale.fabric.adaptive_volume import AdaptiveRule, AdaptiveVolume
from yarnscale.fabric.spline_motion import Method, SplineMotion, YarnMotion
from yarnscale.numerics.newton import Status
from yarnscale.unfulfilled import Unfulfilled, updated

_HALVINGS = 5
_EXPLICIT_SHARE = 0.7
"""Explicit steps over the longest stable one at rest."""
OFF_PLACE = 1.0
"""Distance of what is held from its place, in yarn radii, from which a grip has left its motion."""


@dataclass(frozen=True)
class MotionSchedule:
    """How long and how fast: duration [s], implicit step [s], frame interval [s], method.

    Explicit steps take what is stable. Raises InputError.
    """

    duration: float
    time_step: float = 1 / 240
    frame_interval: float = 1 / 30
    method: Method = "implicit"

    def __post_init__(self) -> None:
        for name in ("duration", "time_step", "frame_interval"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0):
                raise InputError(name, expected="a positive number of seconds", found=value)


@dataclass(frozen=True, eq=False)
class MotionRun:
    """Outcome of a run: the last motion, how it ended, steps, Newton iterations, seconds of work.

    moving: what moved, in the volume of the end. energies: of every frame, with its ``time`` [s] and [J]. unfulfilled:
    grips that were not where they are to be.
    """

    moving: SplineMotion
    motion: YarnMotion
    status: Status
    steps: int
    iterations: int
    seconds: float
    energies: list[dict[str, float]] = field(default_factory=list)
    unfulfilled: tuple[Unfulfilled, ...] = ()


def run_motion(
    moving: SplineMotion,
    schedule: MotionSchedule,
    *,
    start: YarnMotion | None = None,
    adaptive: AdaptiveRule | None = None,
    on_frame: Callable[[int, YarnMotion], None] | None = None,
    on_step: Callable[[float], None] | None = None,
) -> MotionRun:
    """Run from ``start`` (default: at rest); ``on_frame(number, yarns)`` gets frames as they finish.

    adaptive: let the volume change at frames. on_step(share done). An implicit step that fails is halved; where that
    does not help, the run ends with its status.
    """
    begin = time.perf_counter()
    follower = AdaptiveVolume(moving, adaptive) if adaptive is not None else None
    motion = moving.start if start is None else start
    longest = schedule.time_step
    if schedule.method == "explicit":
        longest = _EXPLICIT_SHARE * moving.stable_step(motion)
    end = motion.time + schedule.duration
    frames = max(1, round(schedule.duration / schedule.frame_interval))
    steps = iterations = 0
    energies, status = [], Status.CONVERGED
    unfulfilled: tuple[Unfulfilled, ...] = ()

    def frame(number: int) -> None:
        energies.append({"time": motion.time, **moving.energies(motion)})
        if on_frame is not None:
            on_frame(number, moving.yarns(motion))

    frame(0)
    for number in range(1, frames + 1):
        goal = end - schedule.duration * (1.0 - number / frames)
        while goal - motion.time > 1e-9 * end and status is Status.CONVERGED:
            remaining = goal - motion.time
            motion, status, work = _advance(
                moving, motion, remaining / math.ceil(remaining / longest - 1e-9), schedule
            )
            steps, iterations = steps + 1, iterations + work
            distances = {"held row": moving.distance_from_places(motion)}
            unfulfilled = updated(unfulfilled, motion.time, distances, OFF_PLACE * moving.fabric.radius)
            if on_step is not None:
                on_step(1.0 - (end - motion.time) / schedule.duration)
        if status is not Status.CONVERGED:
            break
        frame(number)
        if follower is not None and number < frames:
            motion = follower.adapt(motion, longest)
            moving = follower.moving
    seconds = time.perf_counter() - begin
    return MotionRun(moving, motion, status, steps, iterations, seconds, energies, unfulfilled)


def _advance(
    moving: SplineMotion, motion: YarnMotion, duration: float, schedule: MotionSchedule
) -> tuple[YarnMotion, Status, int]:
    iterations = 0
    status = Status.INVALID
    for halving in range(_HALVINGS):
        result = moving.step(motion, duration / 2**halving, method=schedule.method)
        iterations, status = iterations + result.iterations, result.status
        if status is Status.CONVERGED and np.isfinite(result.motion.positions).all():
            return result.motion, status, iterations
        if schedule.method == "explicit":
            break
    return motion, status, iterations
