"""Cloth from equilibrium to equilibrium, as its handles move: no inertia, no velocity, time is the load.

Each load step moves the handles on and solves for the equilibrium, a minimum of the energy. Where that fails, as it
does where the cloth buckles and the equilibrium nearby is gone, the cloth creeps there: steps of a viscous flow,
M (x − x_n) = −Δt² ∇E, which always have a solution, with Δt growing as they become easy; the static solve then
takes the last digits. Where even that fails the load step is halved. After easy steps it grows.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from yarnscale.errors import InputError
from yarnscale.numerics.newton import Status
from yarnscale.shell.dynamics.solver import ClothSolver, StepResult
from yarnscale.shell.state import ClothState


@dataclass(frozen=True)
class LoadSteps:
    """How the load is applied.

    first, smallest, largest: shares of the whole load in one step. easy: iterations of a static solve up to which the
    next step may grow. viscous_step: first Δt of the viscous flow [s]; viscous_steps: at most, for one equilibrium.
    """

    first: float = 0.1
    smallest: float = 1e-3
    largest: float = 0.25
    easy: int = 20
    viscous_step: float = 0.02
    viscous_steps: int = 40

    def __post_init__(self) -> None:
        if not 0 < self.smallest <= self.first <= self.largest <= 1:
            expected = "0 < smallest <= first <= largest <= 1"
            raise InputError("load steps", expected=expected, found=(self.smallest, self.first, self.largest))
        if not (math.isfinite(self.viscous_step) and self.viscous_step > 0):
            raise InputError("viscous_step", expected="a positive number of seconds", found=self.viscous_step)


@dataclass(frozen=True, eq=False)
class LoadPath:
    """Outcome of ``follow_load``: the last equilibrium, how the path ended, and the work done.

    steps: equilibria found; viscous: those that needed the viscous flow; halvings: load steps that failed.
    """

    state: ClothState
    status: Status
    steps: int
    viscous: int
    halvings: int
    iterations: int

    @property
    def converged(self) -> bool:
        """Whether the whole load was applied."""
        return self.status is Status.CONVERGED


def equilibrium(
    solver: ClothSolver, state: ClothState, *, time: float | None = None, loads: LoadSteps = LoadSteps()
) -> tuple[StepResult, bool]:
    """The equilibrium near a state with handles as they are at ``time`` [s] (None: that of the state).

    Also whether the viscous flow was needed. The result's status says whether it is an equilibrium.
    """
    target = state.time if time is None else time
    # Handles and cloth move together in a static solve; a long way is left to the flow before it gets lost.
    result = solver.step(state, math.inf, until=target, iterations=4 * loads.easy)
    if result.status is Status.CONVERGED:
        return result, False
    spent, duration, tolerance = result.iterations, loads.viscous_step, solver.options.tolerance
    for _ in range(loads.viscous_steps):
        result = solver.step(state, duration, inertia=False, until=target)
        spent += result.iterations
        if not result.residual <= solver.options.acceptable:
            duration *= 0.25
            continue
        state = replace(result.state, velocities=np.zeros_like(state.velocities))
        duration *= 2.0
        if result.unrest <= 10.0 * tolerance or duration > 1e3 * loads.viscous_step:
            result = solver.step(state, math.inf, until=target)
            spent += result.iterations
            if result.status is Status.CONVERGED:
                break
    return replace(result, iterations=spent), True


def follow_load(
    solver: ClothSolver,
    start: ClothState,
    duration: float,
    *,
    loads: LoadSteps = LoadSteps(),
    on_equilibrium: Callable[[StepResult], None] | None = None,
) -> LoadPath:
    """Equilibria while the handles move as from the time of ``start`` to ``duration`` [s] later.

    on_equilibrium: gets each of them, with all iterations spent since the one before.
    A load step that fails even at the smallest size ends the path with its status and the last equilibrium.
    """
    if not (math.isfinite(duration) and duration > 0):
        raise InputError("duration", expected="a positive number of seconds", found=duration)
    state, done, share = start, 0.0, loads.first
    steps = viscous = halvings = iterations = spent = 0
    status = Status.CONVERGED
    while done < 1.0 - 1e-12:
        share = min(share, 1.0 - done)
        result, crept = equilibrium(solver, state, time=start.time + (done + share) * duration, loads=loads)
        iterations += result.iterations
        spent += result.iterations
        if result.status is not Status.CONVERGED:
            halvings += 1
            share *= 0.5
            if share < loads.smallest:
                status = result.status
                break
            continue
        state, done, steps, viscous = result.state, done + share, steps + 1, viscous + crept
        if on_equilibrium is not None:
            on_equilibrium(replace(result, iterations=spent))
        spent = 0
        if not crept and result.iterations <= loads.easy:
            share = min(2.0 * share, loads.largest)
        elif crept:
            share = max(0.5 * share, loads.smallest)
    return LoadPath(state, status, steps, viscous, halvings, iterations)
