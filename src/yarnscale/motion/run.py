"""A body through a schedule: dynamics, then steps without inertia until it rests; or equilibria under a growing load.

Statics of cloth is fragile (it buckles and wrinkles), so rest is found by steps without inertia and growing Δt. A
schedule of statics has no dynamics: equilibria follow what is moved (``quasi_static``).
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Generic

from yarnscale.checked import checked
from yarnscale.errors import InputError
from yarnscale.motion.body import Body, State, Step
from yarnscale.motion.quasi_static import follow_load
from yarnscale.motion.schedule import Schedule
from yarnscale.motion.unfulfilled import Unfulfilled, plain, updated
from yarnscale.numerics.newton import Status

_LONGER = 0.01
"""By which share steps may be longer than asked for, where that saves one before a frame."""


@dataclass(frozen=True)
class RunProgress:
    """What a progress callback sees after each step: ``share`` of the dynamics done, in [0, 1]."""

    time: float
    share: float
    steps: int
    iterations: int
    residual: float
    unrest: float


@dataclass(frozen=True, eq=False)
class Run(Generic[State]):
    """A run at its end or between two steps: everything that is needed to continue it.

    Continued equilibria (``statics``) begin with load steps of their first length, and so pass through other states.

    state: reached. begin: time at which the schedule began [s]. status: how the run ended, None while it goes on.
    frames: made so far; next_frame: time from which the next is due [s]; shown: whether the state is the last frame.
    steps, newton_iterations, factorisations: work done; loose_steps: kept though they did not converge. unrest: of the
    last step, force of inertia per weight. rest_step: length of the next step on the way to rest [s], None during the
    dynamics; rest_steps: done of these. faults: frames with each kind of fault that is tested. unfulfilled: motions
    that were not carried out up to now.
    """

    state: State
    begin: float
    status: Status | None = None
    frames: int = 0
    next_frame: float = 0.0
    shown: bool = False
    steps: int = 0
    newton_iterations: int = 0
    factorisations: int = 0
    loose_steps: int = 0
    unrest: float = 0.0
    rest_step: float | None = None
    rest_steps: int = 0
    faults: Mapping[str, int] = field(default_factory=dict)
    unfulfilled: tuple[Unfulfilled, ...] = ()

    @property
    def converged(self) -> bool:
        """Whether every part of the schedule was reached."""
        return self.status is Status.CONVERGED

    @property
    def outcome(self) -> str:
        """How the run ended, in words."""
        return "unfinished" if self.status is None else self.status.value

    def summary(self) -> dict[str, object]:
        """Outcome and work as plain values."""
        return {
            "status": self.outcome,
            "steps": self.steps,
            "newton_iterations": self.newton_iterations,
            "factorisations": self.factorisations,
            "loose_steps": self.loose_steps,
            **self.faults,
            "unfulfilled": plain(self.unfulfilled),
            "simulated_seconds": self.state.time - self.begin,
        }


@checked
def simulate(
    body: Body[State],
    start: State,
    schedule: Schedule,
    *,
    on_step: Callable[[RunProgress], None] | None = None,
    on_frame: Callable[[int, State], None] | None = None,
    on_checkpoint: Callable[[Run[State]], None] | None = None,
    resume: Run[State] | None = None,
) -> Run[State]:
    """Run a schedule from a state; ``on_frame(number, state)`` gets frames as they finish, the first and last included.

    on_checkpoint: gets the run at its start and after each step, and its frame; ``resume`` goes on from there, and
    ``start`` is then ignored. Steps are shortened to end at frames, unless frames are closer than steps. A step that
    fails even when halved ends the run with its status and the last good state. Raises InputError where no motion can
    begin.
    """
    runner = _Runner(body, schedule, on_step, on_frame, on_checkpoint, resume or Run(start, start.time))
    return runner.run()


@dataclass
class _Runner(Generic[State]):
    body: Body[State]
    schedule: Schedule
    on_step: Callable[[RunProgress], None] | None
    on_frame: Callable[[int, State], None] | None
    on_checkpoint: Callable[[Run[State]], None] | None
    now: Run[State]
    longest: float = math.inf

    def run(self) -> Run[State]:
        schedule, state = self.schedule, self.now.state
        if self.now.status is not None:
            return self._finish(self.now.status)
        if (schedule.to_rest or schedule.statics) and self.body.method == "explicit":
            raise InputError("steps without inertia", expected="the implicit method", found=self.body.method)
        if self.now.steps == self.now.frames == 0:
            self.body.check_start(state)
            self._put(next_frame=state.time)
            self._frame()
            self._checkpoint()
        if schedule.statics:
            left, loads = self.end - self.now.state.time, schedule.load_steps
            if not self._remaining():
                return self._finish(Status.CONVERGED)
            path = follow_load(self.body, self.now.state, left, loads=loads, on_equilibrium=self._reached)
            return self._finish(path[1])
        self.longest = self._longest()
        rough = schedule.rough_iterations
        while self.now.rest_step is None and (remaining := self._remaining()) > 0.0:
            duration = remaining / max(1, math.ceil(remaining / self.longest - _LONGER))
            step = self.body.advance(self.now.state, duration, iterations=rough, unfinished=rough is not None)
            if step.state is self.now.state:
                self._count(step)
                return self._finish(step.status)
            self._reached(step)
        return self._settle() if schedule.to_rest else self._finish(Status.CONVERGED)

    @property
    def end(self) -> float:
        """Time at which the dynamics end [s]."""
        return self.now.begin + self.schedule.duration

    def _remaining(self) -> float:
        """Time to the next frame, or to the end of the dynamics, where 0 is left [s]."""
        interval, time = self.schedule.frame_interval, self.now.state.time
        if self.end - time <= 1e-9 * max(self.end, 1.0):
            return 0.0
        met = interval is not None and interval >= self.longest * (1.0 - _LONGER)
        return min(self.end, self.now.next_frame if met else math.inf) - time

    def _longest(self) -> float:
        return min(self.schedule.time_step, self.body.longest_step(self.now.state))

    def _settle(self) -> Run[State]:
        schedule = self.schedule
        duration = self.now.rest_step or schedule.time_step
        while self.now.rest_steps < schedule.max_rest_steps:
            # Every iteration lowers the energy, so there is no reason to go back where a step did not converge.
            step = self.body.advance(self.now.state, duration, inertia=False, unfinished=True)
            if step.state is self.now.state:
                self._count(step)
                return self._finish(step.status)
            solved = step.status is Status.CONVERGED
            if solved and step.unrest <= schedule.rest_tolerance and duration >= schedule.time_step:
                self._count(step)
                return self._finish(Status.CONVERGED)
            if solved and step.duration == duration:
                duration = min(2.0 * duration, schedule.longest_step)
            else:
                duration = max(0.5 * duration, 0.1 * schedule.time_step)
            self._reached(step, rest_step=duration, rest_steps=self.now.rest_steps + 1)
        return self._finish(Status.ITERATION_LIMIT)

    def _put(self, **changes: Any) -> None:
        self.now = replace(self.now, **changes)

    def _reached(self, step: Step[State], **changes: Any) -> None:
        self._count(step)
        self._put(**changes)
        self._frame()
        self._checkpoint()

    def _count(self, step: Step[State]) -> None:
        now, state, time = self.now, step.state, step.state.time
        off = self.body.distances_from_places(state)
        self._put(
            state=state, shown=now.shown and state is now.state, steps=now.steps + 1, unrest=step.unrest,
            newton_iterations=now.newton_iterations + step.iterations,
            factorisations=now.factorisations + step.factorisations,
            loose_steps=now.loose_steps + (step.status is not Status.CONVERGED),
            unfulfilled=updated(now.unfulfilled, time, off, self.body.off_place),
        )  # fmt: skip
        if self.on_step is not None:
            span = self.schedule.duration
            share = 1.0 - max(self.end - time, 0.0) / span if span else 1.0
            self.on_step(RunProgress(time, share, self.now.steps, step.iterations, step.residual, step.unrest))

    def _frame(self, *, last: bool = False) -> None:
        now, interval, time = self.now, self.schedule.frame_interval, self.now.state.time
        due = interval is not None and time >= now.next_frame - 1e-9
        if (due or last) and not now.shown:
            faults = Counter(now.faults)
            faults.update(self.body.faults(now.state))
            if self.on_frame is not None:
                self.on_frame(now.frames, now.state)
            self._put(shown=True, frames=now.frames + 1, faults=dict(faults))
        if due and interval is not None:
            passed = max(1, math.ceil((time - now.next_frame) / interval + 1e-9))
            self._put(next_frame=now.next_frame + interval * passed)
            if self._remaining() > 0.0:
                self._put(state=self.body.renewed(self.now.state, self._longest()))
                self.longest = self._longest()

    def _checkpoint(self) -> None:
        if self.on_checkpoint is not None:
            self.on_checkpoint(self.now)

    def _finish(self, status: Status) -> Run[State]:
        self._frame(last=True)
        self._put(status=status)
        self._checkpoint()
        return self.now
