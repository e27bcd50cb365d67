"""Equilibria of finite fabrics under holds and loads, in steps from one to the next."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace

import numpy as np

from yarnscale.arrays import Array
from yarnscale.fabric.direct_energy import FabricEnergy
from yarnscale.fabric.direct_objective import FabricObjective, NodeForce
from yarnscale.fabric.holds import Holds
from yarnscale.fabric.sheet import YarnSheet
from yarnscale.numerics.kkt import ConstrainedSolver
from yarnscale.numerics.newton import NewtonOptions, Status, minimise
from yarnscale.numerics.threads import on_one_thread

_MOST_PIECES = 400
"""Pieces into which a safe path is cut."""


@dataclass(frozen=True, eq=False)
class Rest:
    """A fabric at rest: its state [positions / r, twists], how the solve ended, iterations and seconds."""

    x: Array
    status: Status
    residual: float
    iterations: int
    seconds: float


def gravity_load(energy: FabricEnergy, gravity: Array) -> Array:
    """Weight of every vertex as a load on the full vector (4n,); gravity (3,) [m/s²]."""
    force = energy.masses()[:, None] * np.asarray(gravity, np.float64) / energy.force_unit
    return np.concatenate([force.ravel(), np.zeros(energy.count)])


def reactions(energy: FabricEnergy, holds: Holds, x: Array) -> Array:
    """Reaction force at each held vertex (k, 3) [N]; that of ``Holds.forces`` at rest without load.

    For explicit steps, which prescribe held vertices without springs.
    """
    gradient = energy.positions(energy.gradient(x)[1].sum(axis=0))[holds.nodes]
    return gradient * np.array(holds.axes, np.float64) * energy.force_unit


@on_one_thread
def rod_equilibrium(
    energy: FabricEnergy,
    start: Array,
    holds: Holds,
    *,
    load: Array | None = None,
    obstacles: tuple[NodeForce, ...] = (),
    tolerance: float = 1e-5,
    max_iterations: int = 300,
    linear: ConstrainedSolver | None = None,
) -> Rest:
    """The equilibrium reached from a state (4n,); frames are transported with the edges.

    load: (4n,), see ``gravity_load``. tolerance: forces left over where the terms' forces count as 1. linear: a solver
    from an earlier call.
    """
    began = time.perf_counter()
    load = np.zeros(len(start)) if load is None else load
    objective = FabricObjective(
        energy, [holds.springs(energy)], load, obstacles, force_floor=1e-6 + float(np.linalg.norm(load))
    )
    energy.anchor(start)
    solution = minimise(
        objective, start, NewtonOptions(tolerance, max_iterations=max_iterations, check_minimum=False),
        bound=energy.bound, after_step=energy.anchor, linear=linear,
    )  # fmt: skip
    return Rest(solution.x, solution.status, solution.residual, solution.iterations, time.perf_counter() - began)


def relaxed_sheet(energy: FabricEnergy, *, max_iterations: int = 25) -> YarnSheet:
    """The energy's sheet after some Newton iterations towards equilibrium: drawn yarns no longer overlap."""
    rest = rod_equilibrium(energy, energy.start(), Holds.none(), tolerance=1e-2, max_iterations=max_iterations)
    sheet = energy.sheet.moved(energy.positions(rest.x) * energy.radius, twist=rest.x[3 * energy.count :])
    # Twists are those against the frames of the solve, carried step by step, not in one.
    return replace(sheet, reference_director=energy.frames.director, reference_twist=energy.frames.twist)


def safe_path(energy: FabricEnergy, start: Array, goal: Array) -> Array:
    """The farthest state on the straight path to ``goal`` (4n,) that is reached without yarns passing each other."""
    x = start
    for _ in range(_MOST_PIECES):
        step = goal - x
        if not step.any():
            break
        fraction = energy.bound(x, step)
        x = goal if fraction >= 1.0 else x + fraction * step
        energy.anchor(x)
        if fraction < 1e-3:
            break
    return x
