"""Equilibria of finite fabrics under holds and loads, in steps from one to the next."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Protocol

import numpy as np

from yarnscale.arrays import Array, Flags, Integers
from yarnscale.fabric.direct_energy import FabricEnergy
from yarnscale.fabric.direct_objective import FabricObjective, NodeForce
from yarnscale.fabric.sheet import YarnSheet
from yarnscale.numerics.kkt import ConstrainedSolver
from yarnscale.numerics.newton import NewtonOptions, Status, minimise
from yarnscale.numerics.sums import Springs
from yarnscale.numerics.threads import on_one_thread
from yarnscale.yarn.stiffness import PatternStiffness

_MOST_PIECES = 400
"""Pieces into which a safe path is cut."""
HOLD = 1000.0
"""Stiffness of what holds a vertex, over that of its yarn in tension."""


class YarnPoints(Protocol):
    """Points of yarns as a function of a state: lengths in ``radius`` [m], forces in ``force_unit`` [N]."""

    @property
    def radius(self) -> float: ...
    @property
    def force_unit(self) -> float: ...
    @property
    def count(self) -> int: ...
    @property
    def stiffness(self) -> PatternStiffness: ...
    def positions(self, x: Array, /) -> Array: ...


@dataclass(frozen=True, eq=False)
class Holds:
    """Vertices held at places: nodes (k,), targets (k, 3) [m]; axes: along which they are held (all).

    spun: edges (j,) whose twist is held at ``angles`` (j,) [rad]. handles: which of the vertices each handle holds, by
    its name, as masks (k,) (none: one holds all).
    """

    nodes: Integers
    targets: Array
    axes: tuple[bool, bool, bool] = (True, True, True)
    spun: Integers = field(default_factory=lambda: np.empty(0, np.int64))
    angles: Array = field(default_factory=lambda: np.empty(0))
    handles: Mapping[str, Flags] = field(default_factory=dict)

    @classmethod
    def none(cls) -> Holds:
        """Nothing is held."""
        return cls(np.empty(0, np.int64), np.empty((0, 3)))

    def _weight(self, energy: YarnPoints) -> Array:
        return HOLD * energy.stiffness.position_scale()[self.nodes, None] * np.array(self.axes, np.float64)

    def springs(self, energy: YarnPoints) -> Springs:
        """Stiff springs to the targets."""
        weight, centre = np.zeros((energy.count, 3)), np.zeros((energy.count, 3))
        weight[self.nodes] = self._weight(energy)
        centre[self.nodes] = self.targets / energy.radius
        spin, angle = np.zeros(energy.count), np.zeros(energy.count)
        spin[self.spun], angle[self.spun] = HOLD * energy.stiffness.twist_scale()[self.spun], self.angles
        return Springs(np.concatenate([weight.ravel(), spin]), np.concatenate([centre.ravel(), angle]))

    def forces(self, energy: YarnPoints, x: Array) -> Array:
        """Force with which each held vertex is held (k, 3) [N]."""
        return (
            self._weight(energy) * (self.targets / energy.radius - energy.positions(x)[self.nodes]) * energy.force_unit
        )

    def reactions(self, energy: FabricEnergy, x: Array) -> Array:
        """Reaction force at each held vertex (k, 3) [N]; that of ``forces`` at rest without load.

        For explicit steps, which prescribe held vertices without springs.
        """
        gradient = energy.positions(energy.gradient(x)[1].sum(axis=0))[self.nodes]
        return gradient * np.array(self.axes, np.float64) * energy.force_unit

    def distances(self, energy: YarnPoints, x: Array) -> dict[str, float]:
        """How far each handle's farthest vertex is from its target [m]."""
        away = energy.positions(x)[self.nodes] * energy.radius - self.targets
        away = np.linalg.norm(away * np.array(self.axes, np.float64), axis=1)
        handles = self.handles or {"held vertices": np.ones(len(away), bool)}
        return {name: float(away[held].max(initial=0.0)) for name, held in handles.items()}


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
