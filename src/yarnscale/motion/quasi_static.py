"""A body from equilibrium to equilibrium, as what holds it moves: no inertia, no velocity, time is the load.

Each load step moves the holds on and solves for the equilibrium, a minimum of the energy. Where that fails, as it
does where cloth buckles and the equilibrium nearby is gone, the body creeps there: steps of a viscous flow,
M (x − x_n) = −Δt² ∇E, which always have a solution, with Δt growing as they become easy; the static solve then
takes the last digits. Where even that fails the load step is halved. After easy steps it grows.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

from yarnscale.errors import positive
from yarnscale.motion.body import Body, State, Step
from yarnscale.motion.schedule import LoadSteps
from yarnscale.numerics.newton import Status

LOADS = LoadSteps()


def equilibrium(
    body: Body[State], state: State, *, time: float | None = None, loads: LoadSteps = LOADS
) -> tuple[Step[State], bool]:
    """The equilibrium near a state with holds as they are at ``time`` [s] (None: that of the state).

    Also whether the viscous flow was needed. The result's status says whether it is an equilibrium.
    """
    target = state.time if time is None else time
    # Holds and body move together in a static solve; a long distance is left to the flow before it gets lost.
    result = body.step(state, math.inf, until=target, iterations=4 * loads.easy)
    if result.status is Status.CONVERGED:
        return result, False
    spent, duration = result.iterations, loads.viscous_step
    for _ in range(loads.viscous_steps):
        result = body.step(state, duration, inertia=False, until=target)
        spent += result.iterations
        if not body.keeps(result):
            duration *= 0.25
            continue
        state = result.state
        duration *= 2.0
        if result.unrest <= 10.0 * body.tolerance or duration > 1e3 * loads.viscous_step:
            result = body.step(state, math.inf, until=target)
            spent += result.iterations
            if result.status is Status.CONVERGED:
                break
    else:
        result = body.step(state, math.inf, until=target)
        spent += result.iterations
    return replace(result, iterations=spent), True


def follow_load(
    body: Body[State],
    start: State,
    duration: float,
    *,
    loads: LoadSteps = LOADS,
    on_equilibrium: Callable[[Step[State]], None] | None = None,
) -> tuple[State, Status]:
    """Equilibria while holds move as from the time of ``start`` to ``duration`` [s] later; the last, and how it ended.

    on_equilibrium: gets each of them, with all iterations spent since the one before.
    A load step that fails even at the smallest size ends the path with its status.
    """
    positive("duration", duration, "a positive number of seconds")
    state, done, share, spent = start, 0.0, loads.first, 0
    while done < 1.0 - 1e-12:
        share = min(share, 1.0 - done)
        result, crept = equilibrium(body, state, time=start.time + (done + share) * duration, loads=loads)
        spent += result.iterations
        if result.status is not Status.CONVERGED:
            share *= 0.5
            if share < loads.smallest:
                return state, result.status
            continue
        state, done = result.state, done + share
        if on_equilibrium is not None:
            on_equilibrium(replace(result, iterations=spent))
        spent = 0
        if not crept and result.iterations <= loads.easy:
            share = min(2.0 * share, loads.largest)
        elif crept:
            share = max(0.5 * share, loads.smallest)
    return state, Status.CONVERGED
