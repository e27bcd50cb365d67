"""Cloth through time: a schedule of steps, first dynamics, then steps without inertia until the cloth rests.

Statics of cloth is fragile (it buckles and wrinkles), so rest is found by steps without inertia and growing Δt. A
schedule of statics has no dynamics: equilibria follow the handles (``quasi_static``).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from yarnscale.checked import checked
from yarnscale.errors import InputError
from yarnscale.numerics.newton import Status
from yarnscale.shell.contact.crossings import CLOTH
from yarnscale.shell.dynamics.checkpoint import Checkpoint
from yarnscale.shell.dynamics.quasi_static import LoadSteps, follow_load
from yarnscale.shell.dynamics.solver import ClothSolver, SolverOptions, StepResult
from yarnscale.shell.state import ClothState
from yarnscale.unfulfilled import Unfulfilled, updated

__all__ = ["ClothSolver", "Progress", "Run", "Schedule", "SolverOptions", "StepResult", "simulate"]


@dataclass(frozen=True)
class Schedule:
    """How long to simulate.

    duration: [s] of dynamics; time_step: [s]; to_rest: whether steps without inertia follow until the cloth rests.
    longest_step: of these [s]; rest_tolerance: unrest (inertial force per weight) that counts as rest.
    frame_interval: [s] between frames, None for the last only. rough_iterations: Newton iterations per step of the
    dynamics, kept unconverged, where only the rest counts (None: all). max_rest_steps: then the cloth is declared
    restless. statics: equilibria while the handles move for ``duration``, by ``load_steps``, instead of all this.
    """

    duration: float
    time_step: float = 0.05
    to_rest: bool = True
    longest_step: float = 0.5
    rest_tolerance: float = 1e-2
    frame_interval: float | None = None
    max_rest_steps: int = 30
    rough_iterations: int | None = None
    statics: bool = False
    load_steps: LoadSteps = field(default_factory=LoadSteps)

    def __post_init__(self) -> None:
        if self.rough_iterations is not None and self.rough_iterations < 1:
            raise InputError("rough_iterations", expected="at least 1", found=self.rough_iterations)
        if self.statics and self.duration == 0:
            raise InputError("duration", expected="a positive number for statics", found=self.duration)
        for name in ("duration", "time_step", "longest_step", "rest_tolerance", "frame_interval"):
            value = getattr(self, name)
            allowed_zero = name == "duration"
            if value is None:
                continue
            if not (math.isfinite(value) and (value > 0 or (allowed_zero and value == 0))):
                raise InputError(name, expected="a positive number", found=value)

        for name in ("time_step", "frame_interval"):
            value = getattr(self, name)
            if value is not None and self.duration > MOST_STEPS * value:
                expected = f"at least duration/{MOST_STEPS:g} = {self.duration / MOST_STEPS:g} s"
                raise InputError(name, expected=expected, found=value)

    def animated(self) -> Schedule:
        """The motion alone, with bounded work: steps and frames of 1/30 s, ``ANIMATION_ITERATIONS`` of Newton each.

        Steps are kept as they are then; the forces left over act in the next one. Contact stays free of crossings.
        """
        frame = min(self.frame_interval or ANIMATION_STEP, ANIMATION_STEP)
        return replace(
            self,
            time_step=ANIMATION_STEP,
            to_rest=False,
            frame_interval=frame,
            rough_iterations=ANIMATION_ITERATIONS,
            statics=False,
        )


MOST_STEPS = 1e6
"""Steps and frames of a schedule."""
OFF_PLACE, OFF_PLACE_SHARE = 5e-4, 0.05
"""How far from its place a handle or body has left its motion: this [m], or this share of an edge if that is less."""
ANIMATION_STEP, ANIMATION_ITERATIONS = 1 / 30, 20
"""Step [s] and iterations a step of an animation."""


@dataclass(frozen=True)
class Progress:
    """What a progress callback sees after each step: ``share`` of the dynamics done, in [0, 1]."""

    time: float
    share: float
    steps: int
    iterations: int
    residual: float
    unrest: float


@dataclass(frozen=True, eq=False)
class Run:
    """Outcome of ``simulate``: the last state, how it ended, and the work done."""

    state: ClothState
    status: Status
    steps: int
    newton_iterations: int
    loose_steps: int
    """Steps kept with a residual above the tolerance (but acceptable)."""
    unrest: float
    intersections: int | None = None
    """Frames, the last state among them, in which the cloth crosses itself or a body; None: not tested."""
    body_intersections: int | None = None
    """Frames in which the cloth crosses a body; None without bodies."""
    unfulfilled: tuple[Unfulfilled, ...] = ()
    """Motions of handles and obstacles that were not carried out."""

    @property
    def converged(self) -> bool:
        """Whether every part of the schedule was reached."""
        return self.status is Status.CONVERGED


@checked
def simulate(
    solver: ClothSolver,
    start: ClothState,
    schedule: Schedule,
    *,
    on_step: Callable[[Progress], None] | None = None,
    on_frame: Callable[[int, ClothState], None] | None = None,
    on_checkpoint: Callable[[Checkpoint], None] | None = None,
    resume: Checkpoint | None = None,
) -> Run:
    """Run a schedule from a state; ``on_frame(number, state)`` gets frames as they finish, the first and last included.

    on_checkpoint: called after each step, and its frame, with all that ``resume`` needs to go on from there; ``start``
    is then ignored. A step that fails even when halved ends the run with its status and the last good state.
    Raises InputError where surfaces cross at the start.
    """
    runner = _Runner(solver, schedule, on_step, on_frame, on_checkpoint)
    return runner.run(resume if resume is not None else Checkpoint(start, start.time, next_frame=start.time))


@dataclass
class _Runner:
    solver: ClothSolver
    schedule: Schedule
    on_step: Callable[[Progress], None] | None
    on_frame: Callable[[int, ClothState], None] | None
    on_checkpoint: Callable[[Checkpoint], None] | None
    begin: float = 0.0
    steps: int = 0
    iterations: int = 0
    loose: int = 0
    frames: int = 0
    next_frame: float = 0.0
    shown: ClothState | None = None
    rest_step: float | None = None
    rest_steps: int = 0
    unrest: float = 0.0
    crossed: int = 0
    crossed_bodies: int = 0
    unfulfilled: tuple[Unfulfilled, ...] = ()
    off_place: float = 0.0

    def run(self, place: Checkpoint) -> Run:
        state, schedule = place.state, self.schedule
        self.begin, self.rest_step, self.rest_steps = place.begin, place.rest_step, place.rest_steps
        self.steps, self.iterations, self.loose = place.steps, place.iterations, place.loose
        self.frames, self.next_frame, self.unrest = place.frames, place.next_frame, place.unrest
        self.shown, self.crossed = state if place.shown else None, place.crossed
        self.crossed_bodies, self.unfulfilled = place.crossed_bodies, place.unfulfilled
        self.off_place = min(OFF_PLACE, OFF_PLACE_SHARE * self.solver.cloth.mesh.median_edge)
        if place.status is not None:
            return self._finish(state, place.status)
        if place.steps == 0:
            _refuse_crossings(self.solver, state)
            self._frame(state)
        end = self.begin + schedule.duration
        if schedule.statics:
            return self._follow_load(state, end)
        while self.rest_step is None and end - state.time > 1e-9 * max(end, 1.0):
            remaining = end - state.time
            count = max(1, math.ceil(remaining / schedule.time_step - 1e-9))
            rough = schedule.rough_iterations
            result = self._advance(state, remaining / count, inertia=True, end=end, rough=rough)
            if result.state is state:
                return self._finish(state, result.status)
            state = result.state
            self._frame(state)
            self._checkpoint(state)
        if not schedule.to_rest:
            return self._finish(state, Status.CONVERGED)
        return self._settle(state, end)

    def _follow_load(self, state: ClothState, end: float) -> Run:
        def reached(result: StepResult) -> None:
            self._count(result, end)
            self._frame(result.state)
            self._checkpoint(result.state)

        path = follow_load(
            self.solver, state, end - state.time, loads=self.schedule.load_steps, on_equilibrium=reached
        )
        return self._finish(path.state, path.status)

    def _settle(self, state: ClothState, end: float) -> Run:
        status, duration = Status.ITERATION_LIMIT, self.rest_step or self.schedule.time_step
        while self.rest_steps < self.schedule.max_rest_steps:
            # Every iteration lowers the energy, so there is no reason to go back where a step did not converge.
            rough = self.solver.options.iterations
            result = self._advance(state, duration, inertia=False, end=end, rough=rough)
            status = result.status
            if result.state is state:
                break
            state = replace(result.state, velocities=np.zeros_like(state.velocities))
            self._frame(state)
            converged = result.residual <= self.solver.options.tolerance
            rests = result.unrest <= self.schedule.rest_tolerance
            if converged and rests and duration >= self.schedule.time_step:
                return self._finish(state, Status.CONVERGED)
            status = Status.ITERATION_LIMIT
            duration = self._next_rest_step(duration, easy=converged and result.duration == duration)
            self.rest_step, self.rest_steps = duration, self.rest_steps + 1
            self._checkpoint(state)
        return self._finish(state, status)

    def _next_rest_step(self, duration: float, *, easy: bool) -> float:
        if easy:
            return min(2.0 * duration, self.schedule.longest_step)
        return max(0.5 * duration, 0.1 * self.schedule.time_step)

    def _advance(
        self, state: ClothState, duration: float, *, inertia: bool, end: float, rough: int | None
    ) -> StepResult:
        result = self.solver.advance(state, duration, inertia=inertia, rough=rough)
        self._count(result, end)
        return result

    def _count(self, result: StepResult, end: float) -> None:
        self.steps += 1
        self.iterations += result.iterations
        self.loose += result.residual > self.solver.options.tolerance
        self.unrest = result.unrest
        distances = self.solver.distances_from_places(result.state)
        self.unfulfilled = updated(self.unfulfilled, result.state.time, distances, self.off_place)
        if self.on_step is not None:
            span = self.schedule.duration
            share = 1.0 - max(end - result.state.time, 0.0) / span if span else 1.0
            self.on_step(
                Progress(
                    result.state.time, share, self.steps, result.iterations, result.residual, result.unrest
                )
            )

    def _frame(self, state: ClothState, *, last: bool = False) -> None:
        interval = self.schedule.frame_interval
        due = interval is not None and state.time >= self.next_frame - 1e-9
        if (due or last) and state is not self.shown:
            if self.solver.intersects(state):
                self.crossed += 1
                self.crossed_bodies += any(c.body != CLOTH for c in self.solver.crossings(state))
            if self.on_frame is not None:
                self.on_frame(self.frames, state)
                self.frames += 1
            self.shown = state
        if due and interval is not None:
            self.next_frame += interval * max(1, math.ceil((state.time - self.next_frame) / interval + 1e-9))

    def _checkpoint(self, state: ClothState, status: Status | None = None) -> None:
        if self.on_checkpoint is None:
            return
        self.on_checkpoint(
            Checkpoint(
                state,
                self.begin,
                self.frames,
                self.next_frame,
                state is self.shown,
                self.steps,
                self.iterations,
                self.loose,
                self.rest_step,
                self.rest_steps,
                self.unrest,
                status,
                self.crossed,
                self.crossed_bodies,
                self.unfulfilled,
            )
        )

    def _finish(self, state: ClothState, status: Status) -> Run:
        self._frame(state, last=True)
        self._checkpoint(state, status)
        contact, bodies = self.solver.cloth.contact, self.solver.cloth.obstacles
        return Run(
            state,
            status,
            self.steps,
            self.iterations,
            self.loose,
            self.unrest,
            self.crossed if contact is not None and contact.self_contact else None,
            self.crossed_bodies if bodies else None,
            self.unfulfilled,
        )


def _refuse_crossings(solver: ClothSolver, state: ClothState) -> None:
    if not solver.intersects(state):
        return
    found = solver.crossings(state)
    lines = solver.cloth.mesh.lines
    told = "; ".join(c.description + _in_file(lines, c.triangles) for c in found) or "some that do"
    remedies = "; ".join(dict.fromkeys(c.remedy for c in found))
    raise InputError(
        "start of the cloth",
        expected="surfaces that do not cross",
        found=f"{told}. {remedies[:1].upper()}{remedies[1:]}" if found else told,
    )


def _in_file(lines: NDArray[np.int64], triangles: Sequence[int]) -> str:
    """Lines of the cloth's file that triangles come from, where there is one."""
    if not (len(lines) and triangles):
        return ""
    return f" (line{'s' * (len(triangles) > 1)} {' and '.join(str(lines[t]) for t in triangles)} of its file)"
