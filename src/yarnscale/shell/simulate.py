"""Cloth through time: implicit Euler steps by Newton, and dynamics to rest.

A step minimises the energy of ``step``. It starts from x + Δt v with the bars where they were: the first
Newton step moves bars and cloth together. Where Newton fails the step is halved, and the last good state is
never lost. Statics of cloth is fragile (it buckles and wrinkles), so rest is found by steps without inertia
and growing Δt.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from yarnscale.errors import InputError
from yarnscale.numerics.newton import ShiftRule, Status, minimise
from yarnscale.shell.checkpoint import Checkpoint
from yarnscale.shell.cloth import Cloth, Handle
from yarnscale.shell.contact import ClothContact
from yarnscale.shell.energy import ShellEnergy
from yarnscale.shell.state import ClothState
from yarnscale.shell.step import STANDARD_GRAVITY, PatternGrowth, StepObjective

Floats = NDArray[np.float64]

SHELL_SHIFT = ShiftRule(
    start=1.0,
    lowest=0.1,
    highest=1.0,
    growth=2.0,
    least=0.125,
    decay=0.5,
    lowest_is_zero=True,
    hold_above=10.0,
)
"""From the positive model (shift 1) to the exact Hessian (0), once forces are within ten times the weight."""


@dataclass(frozen=True)
class SolverOptions:
    """How exactly steps are solved.

    tolerance: of the residual, forces left over per norm of the vertices' weights. iterations: of Newton per step.
    acceptable: residual with which a step is kept though Newton did not get to the tolerance.
    halvings: how often a failed step is halved.
    """

    tolerance: float = 1e-2
    iterations: int = 150
    acceptable: float = 1.0
    halvings: int = 4
    shift: ShiftRule = SHELL_SHIFT

    def __post_init__(self) -> None:
        if not (math.isfinite(self.tolerance) and 0 < self.tolerance <= self.acceptable):
            raise InputError("tolerance", expected=f"between 0 and {self.acceptable:g}", found=self.tolerance)
        if self.iterations < 1:
            raise InputError("iterations", expected="at least 1", found=self.iterations)


@dataclass(frozen=True, eq=False)
class StepResult:
    """One step: the new state, how Newton ended, and ``unrest``, the force of inertia in units of the weight."""

    state: ClothState
    status: Status
    iterations: int
    residual: float
    unrest: float
    duration: float


class ClothSolver:
    """Steps of one cloth; owns the elastic energy, the contact and the growing matrix pattern."""

    def __init__(self, cloth: Cloth, options: SolverOptions = SolverOptions()) -> None:
        self.cloth, self.options = cloth, options
        self.energy = ShellEnergy(cloth.mesh, cloth.material, free_edges=cloth.free_edges)
        self.masses = self.energy.masses
        touching = cloth.contact is not None and (cloth.contact.self_contact or cloth.obstacles)
        self.contact = (
            ClothContact(cloth.mesh, cloth.contact, cloth.obstacles) if cloth.contact and touching else None
        )
        self.growth = PatternGrowth(self.energy.pattern)
        strength = float(np.linalg.norm(cloth.gravity)) or STANDARD_GRAVITY
        self.scale = float(np.linalg.norm(self.masses)) * strength

    def step(
        self, state: ClothState, duration: float, *, inertia: bool = True, iterations: int | None = None
    ) -> StepResult:
        """One implicit step of ``duration`` [s]; without inertia the cloth forgets its velocity first.

        iterations: of Newton, None for those of the options.

        ``duration`` may be inf: a static equilibrium. The result is to be kept only if its residual is acceptable.
        """
        if not duration > 0:
            raise InputError("time step", expected="a positive number of seconds", found=duration)
        velocities = state.velocities if inertia else np.zeros_like(state.velocities)
        self._take_up(state)
        if self.contact is not None:
            self.contact.start_step(state.positions, min(duration, 1.0))
        objective = self._objective(state.positions, velocities, duration, state.time)
        moved = duration * velocities if math.isfinite(duration) else np.zeros_like(velocities)
        solution = minimise(
            objective,
            self._start(state.positions, moved).ravel(),
            bound=self._bound if self.contact is not None else None,
            after_step=lambda x: self._follow(x),
            tolerance=self.options.tolerance,
            max_iterations=self.options.iterations if iterations is None else iterations,
            shift=self.options.shift,
            check_minimum=math.isinf(duration),
        )
        positions = solution.x.reshape(-1, 3)
        change = positions - state.positions
        new = ClothState(
            positions,
            change / duration if math.isfinite(duration) else np.zeros_like(change),
            state.time + (duration if math.isfinite(duration) else 0.0),
            self.energy.elements.reference_angles,
        )
        inertial = objective.weights[:, None] * (positions - objective.centre)
        unrest = float(np.linalg.norm(inertial)) / self.scale
        return StepResult(new, solution.status, solution.iterations, solution.residual, unrest, duration)

    def advance(
        self, state: ClothState, duration: float, *, inertia: bool = True, rough: int | None = None
    ) -> StepResult:
        """A step, halved until Newton succeeds; where it never does, the given state with the failure's status.

        rough: keep what this many iterations reach, whatever force is left over; it acts in the next step.
        """
        iterations = 0
        for halving in range(self.options.halvings + 1):
            result = self.step(state, duration / 2**halving, inertia=inertia, iterations=rough)
            iterations += result.iterations
            unfinished = rough is not None and result.status is Status.ITERATION_LIMIT
            if unfinished or result.residual <= self.options.acceptable:
                return replace(result, iterations=iterations)
        return replace(result, state=state, iterations=iterations)

    def energies(self, state: ClothState) -> dict[str, float]:
        """Elastic, gravity, kinetic and contact energy [J]."""
        self._take_up(state)
        positions, velocities = state.positions, state.velocities
        height = positions @ np.asarray(self.cloth.gravity)
        return {
            "elastic": self.energy.value(positions),
            "gravity": -float(self.masses @ height),
            "kinetic": 0.5 * float(self.masses @ (velocities**2).sum(axis=1)),
            "contact": self.contact.value(positions) if self.contact is not None else 0.0,
        }

    def pull(self, handle: Handle, state: ClothState) -> Floats:
        """Force of a handle on the cloth [N], (3,)."""
        return handle.attachment(state.time).pull(state.positions).sum(axis=0)

    def _take_up(self, state: ClothState) -> None:
        if state.fold_angles is not None:
            self.energy.elements.set_reference_angles(state.fold_angles)
        self._follow(state.positions)

    def _follow(self, x: Floats) -> None:
        self.energy.follow(x.reshape(-1, 3))

    def _bound(self, x: Floats, step: Floats) -> float:
        assert self.contact is not None
        return self.contact.bound(x.reshape(-1, 3), step.reshape(-1, 3))

    def _start(self, positions: Floats, moved: Floats) -> Floats:
        """x + Δt v, as far as nothing touches and the energy stays finite."""
        fraction = self.contact.bound(positions, moved) if self.contact is not None else 1.0
        for _ in range(4):
            start = positions + fraction * moved
            if math.isfinite(self.energy.value(start)):
                return start
            fraction *= 0.25
        return positions

    def _objective(
        self, positions: Floats, velocities: Floats, duration: float, time: float
    ) -> StepObjective:
        cloth = self.cloth
        if math.isfinite(duration):
            inertia, drag = 1.0 / duration**2, cloth.damping / duration
            predicted = positions + duration * velocities
            # ½ (inertia |x − y|² + drag |x − x_n|²) is one square about a point between y and x_n.
            centre = (inertia * predicted + drag * positions) / (inertia + drag)
            weights, time = (inertia + drag) * self.masses, time + duration
        else:
            centre, weights = positions, np.zeros_like(self.masses)
        return StepObjective(
            self.energy,
            weights,
            centre,
            self.masses[:, None] * np.asarray(cloth.gravity),
            tuple(handle.attachment(time) for handle in cloth.handles),
            self.contact,
            self.scale,
            self.growth,
        )


@dataclass(frozen=True)
class Schedule:
    """How long to simulate.

    duration: [s] of dynamics; time_step: [s]; to_rest: whether steps without inertia follow until the cloth rests.
    longest_step: of these [s]; rest_tolerance: unrest (inertial force per weight) that counts as rest.
    frame_interval: [s] between frames, None for the last only. rough_iterations: Newton iterations per step of the
    dynamics, kept unconverged, where only the rest counts (None: all). max_rest_steps: then the cloth is declared
    restless.
    """

    duration: float
    time_step: float = 0.05
    to_rest: bool = True
    longest_step: float = 0.5
    rest_tolerance: float = 1e-2
    frame_interval: float | None = None
    max_rest_steps: int = 30
    rough_iterations: int | None = None

    def __post_init__(self) -> None:
        for name in ("duration", "time_step", "longest_step", "rest_tolerance", "frame_interval"):
            value = getattr(self, name)
            allowed_zero = name == "duration"
            if value is None:
                continue
            if not (math.isfinite(value) and (value > 0 or (allowed_zero and value == 0))):
                raise InputError(name, expected="a positive number", found=value)


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

    @property
    def converged(self) -> bool:
        """Whether every part of the schedule was reached."""
        return self.status is Status.CONVERGED


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

    def run(self, place: Checkpoint) -> Run:
        state, schedule = place.state, self.schedule
        self.begin, self.rest_step, self.rest_steps = place.begin, place.rest_step, place.rest_steps
        self.steps, self.iterations, self.loose = place.steps, place.iterations, place.loose
        self.frames, self.next_frame, self.unrest = place.frames, place.next_frame, place.unrest
        self.shown = state if place.shown else None
        if place.status is not None:
            return self._finish(state, place.status)
        if place.steps == 0:
            self._frame(state)
        end = self.begin + schedule.duration
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
        self.steps += 1
        self.iterations += result.iterations
        self.loose += result.residual > self.solver.options.tolerance
        self.unrest = result.unrest
        if self.on_step is not None:
            span = self.schedule.duration
            share = 1.0 - max(end - result.state.time, 0.0) / span if span else 1.0
            self.on_step(
                Progress(
                    result.state.time, share, self.steps, result.iterations, result.residual, result.unrest
                )
            )
        return result

    def _frame(self, state: ClothState, *, last: bool = False) -> None:
        interval = self.schedule.frame_interval
        due = interval is not None and state.time >= self.next_frame - 1e-9
        if self.on_frame is not None and (due or last) and state is not self.shown:
            self.on_frame(self.frames, state)
            self.frames, self.shown = self.frames + 1, state
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
            )
        )

    def _finish(self, state: ClothState, status: Status) -> Run:
        self._frame(state, last=True)
        self._checkpoint(state, status)
        return Run(state, status, self.steps, self.iterations, self.loose, self.unrest)
