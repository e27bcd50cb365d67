"""One step of cloth: an energy to minimise, made of the state, the integrator and what acts on the cloth.

A step minimises the energy of ``step``. It starts from x + Δt v with the bars where they were: the first
Newton step moves bars and cloth together. Where Newton fails the step is halved.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any, Literal, get_args

import numpy as np

from yarnscale.arrays import Array
from yarnscale.errors import InputError
from yarnscale.kinematics import GRAVITY
from yarnscale.motion.body import Body, Step
from yarnscale.motion.handles import Handle
from yarnscale.motion.integrator import Integrator, StepRule, checked_integrator, remembered, step_rule
from yarnscale.motion.obstacles import current_points, obstacle_name
from yarnscale.numerics.kkt import ConstrainedSolver
from yarnscale.numerics.newton import NewtonOptions, Solution, Status, minimise
from yarnscale.numerics.quasi_newton import KeepRule, minimise_keeping_factors
from yarnscale.numerics.regularisation import ShiftRule
from yarnscale.numerics.sums import Load, Springs, Term
from yarnscale.shell.contact.cloth_contact import ClothContact, ContactSettings
from yarnscale.shell.contact.crossings import CLOTH, Crossing, start_that_crosses
from yarnscale.shell.dynamics.air import drag_entries
from yarnscale.shell.dynamics.cloth import Cloth
from yarnscale.shell.dynamics.step import PatternGrowth, StepObjective
from yarnscale.shell.elastic.energy import ShellEnergy, ShellObjective
from yarnscale.shell.state import Attachment, ClothState

SHELL_SHIFT = ShiftRule(
    start=1.0, lowest=0.1, highest=1.5, growth=2.0, least=0.125, decay=0.5, lowest_is_zero=True, hold_above=10.0
)
"""From the positive model (shift 1) to the exact Hessian (0), once forces are within ten times the weight."""


Minimiser = Literal["quasi-newton", "newton"]

NEWTON_BELOW = 1e-3
"""Residual from which on Newton, which doubles the digits, is faster than a kept factor."""


@dataclass(frozen=True)
class SolverOptions:
    """How exactly steps are solved.

    tolerance: of the residual, forces left over per norm of the vertices' weights. iterations: per step.
    acceptable: residual with which a step is kept though it did not get to the tolerance.
    halvings: how often a failed step is halved. integrator: of the dynamics, see ``integrator``.
    minimiser: ``quasi-newton`` keeps a factor for several iterations, and leaves the last digits, and steps that it
    cannot solve, to Newton; ``newton`` has a factor for every iteration. shift: of Newton; keep: of quasi-Newton.
    """

    tolerance: float = 1e-2
    iterations: int = 400
    acceptable: float = 1.0
    halvings: int = 4
    integrator: Integrator = "euler"
    minimiser: Minimiser = "quasi-newton"
    shift: ShiftRule = SHELL_SHIFT
    keep: KeepRule = field(default_factory=KeepRule)

    def __post_init__(self) -> None:
        checked_integrator(self.integrator)
        if self.minimiser not in get_args(Minimiser):
            raise InputError("minimiser", expected=" or ".join(get_args(Minimiser)), found=self.minimiser)
        if not (math.isfinite(self.tolerance) and 0 < self.tolerance <= self.acceptable):
            raise InputError("tolerance", expected=f"between 0 and {self.acceptable:g}", found=self.tolerance)
        if self.iterations < 1:
            raise InputError("iterations", expected="at least 1", found=self.iterations)


NO_CONTACT = ContactSettings(self_contact=False)
STATIC_SOFTNESS = 1e-8
"""Share of the largest diagonal entry that is added to all, in equilibria."""
OFF_PLACE, OFF_PLACE_SHARE = 5e-4, 0.05
"""How far from its place a handle or obstacle has left its motion: this [m], or this share of an edge if less."""


class ClothSolver(Body[ClothState]):
    """Steps of one cloth; owns the elastic energy, the contact and the growing matrix pattern."""

    def __init__(self, cloth: Cloth, options: SolverOptions = SolverOptions()) -> None:
        self.cloth, self.options = cloth, options
        self.tolerance, self.halvings = options.tolerance, options.halvings
        self.off_place = min(OFF_PLACE, OFF_PLACE_SHARE * cloth.mesh.median_edge)
        self.energy = ShellEnergy(cloth.mesh, cloth.material, free_edges=cloth.free_edges)
        self.masses = self.energy.masses
        self.contact = ClothContact(cloth.mesh, cloth.contact or NO_CONTACT, cloth.obstacles)
        self.elastic = ShellObjective(self.energy, guests=self.contact.guests)
        self.growth = PatternGrowth(self.elastic.pattern)
        self.linear = ConstrainedSolver()
        strength = float(np.linalg.norm(cloth.gravity)) or GRAVITY
        self.scale = float(np.linalg.norm(self.masses)) * strength

    def _step(
        self, state: ClothState, duration: float, inertia: bool, iterations: int | None, until: float
    ) -> Step[ClothState]:
        self._take_up(state)
        begin = self._with_obstacles(state)
        self.contact.start_step(begin, min(duration, 1.0), state.time, until, state.slips)
        static = math.isinf(duration)
        integrator = self.options.integrator
        rule = step_rule(integrator, state.positions, state.velocities, state.before, duration, inertia=inertia)
        weight, centre = rule.inertia(self.cloth.damping)
        masses = Springs(np.repeat(weight * self.masses, 3), centre.ravel())
        held = self._attachments(until)
        load = Load((self.masses[:, None] * np.asarray(self.cloth.gravity)).ravel(), centre.ravel())
        # Without inertia nothing but its own stiffness holds the cloth.
        self.elastic.softness = STATIC_SOFTNESS if weight == 0.0 else 0.0
        objective = StepObjective(
            self.elastic, [masses, load, *held, *self._viscosity(state, rule)], self.scale,
            self.contact, self.growth,
        )  # fmt: skip
        moved = duration * state.velocities if inertia else np.zeros_like(state.velocities)
        # Points of obstacles move to their places.
        moved = np.concatenate([moved, held[-1].targets - begin[len(moved) :]])
        start = self._start(begin, moved).ravel()
        limit = self.options.iterations if iterations is None else iterations
        solution = self._minimise(objective, start, limit, static=static)
        positions, obstacles = np.split(solution.x.reshape(-1, 3), [len(self.masses)])
        new = ClothState(
            positions,
            rule.velocity(positions) if inertia else np.zeros_like(positions),
            until,
            self.energy.elements.reference_angles,
            remembered(integrator, state.positions, state.velocities, duration) if inertia else None,
            obstacles if len(obstacles) else None,
            self.contact.slips(solution.x.reshape(-1, 3)),
            self.energy.remembered(positions),
        )
        inertial = masses.weight * (positions - centre).ravel()
        return Step.of(new, solution, duration, float(np.linalg.norm(inertial)) / self.scale)

    def keeps(self, step: Step[ClothState]) -> bool:
        """Whether the residual is acceptable."""
        return step.residual <= self.options.acceptable

    def check_start(self, state: ClothState) -> None:
        if self.intersects(state):
            raise start_that_crosses(self.crossings(state), self.cloth.mesh.lines)

    def faults(self, state: ClothState) -> dict[str, int]:
        """Whether the cloth crosses itself or an obstacle (``intersections``), or an obstacle; only what is tested."""
        crossed, tested = self.intersects(state), {}
        if self.contact.settings.self_contact:
            tested["intersections"] = int(crossed)
        if self.cloth.obstacles:
            met = crossed and any(c.obstacle != CLOTH for c in self.crossings(state))
            tested["obstacle_intersections"] = int(met)
        return tested

    def energies(self, state: ClothState) -> dict[str, float]:
        """Elastic (of springs of friction inside, too), gravity, kinetic and contact energy [J]."""
        self._take_up(state)
        positions, velocities = state.positions, state.velocities
        height = positions @ np.asarray(self.cloth.gravity)
        return {
            "elastic": self.energy.stored(positions),
            "gravity": -float(self.masses @ height),
            "kinetic": 0.5 * float(self.masses @ (velocities**2).sum(axis=1)),
            "contact": self.contact.value(self._with_obstacles(state)),
        }

    def intersects(self, state: ClothState) -> bool:
        """Whether the cloth crosses itself or an obstacle, by a test of its own over the whole of both."""
        return self.contact.intersects(self._with_obstacles(state))

    def crossings(self, state: ClothState) -> list[Crossing]:
        """Which surfaces cross and where; empty where nothing was found or tested."""
        return self.contact.crossings(self._with_obstacles(state))

    def distances_from_places(self, state: ClothState) -> dict[str, float]:
        """How far handles and moving obstacles are from where their motion takes them, by name [m].

        Of each the vertex that is farthest. Handles are held by stiff springs, obstacles by springs of limited force.
        """
        found = {}
        for handle in self.cloth.handles:
            away = state.positions[handle.vertices] - handle.places(state.time)
            found[f"handle '{handle.name}'"] = float(np.linalg.norm(away, axis=1).max())
        places = current_points(self.cloth.obstacles, state.time, state.obstacles)
        for number, (obstacle, place) in enumerate(zip(self.cloth.obstacles, places, strict=True)):
            if obstacle.moves:
                away = np.linalg.norm(place - obstacle.points(state.time), axis=1)
                found[obstacle_name(obstacle, number)] = float(away.max())
        return found

    def closest(self, state: ClothState) -> float:
        """Smallest distance [m] between surfaces that may meet; inf beyond the thickness of contact."""
        return self.contact.closest(self._with_obstacles(state))

    def pull(self, handle: Handle, state: ClothState) -> Array:
        """Force of a handle on the cloth [N], (3,)."""
        return Attachment(handle.vertices, handle.places(state.time)).pull(state.positions).sum(axis=0)

    def _minimise(self, objective: StepObjective, start: Array, limit: int, *, static: bool) -> Solution:
        tolerance, done = self.options.tolerance, 0
        hooks: Any = {"linear": self.linear, "bound": self._bound, "after_step": self._follow}
        if self.options.minimiser == "quasi-newton" and not static:
            rough = NewtonOptions(max(tolerance, NEWTON_BELOW), max_iterations=limit)
            first = minimise_keeping_factors(objective, start, rough, self.options.keep, **hooks)
            start, done = first.x, first.iterations
            if first.residual <= tolerance or first.status is Status.INVALID:
                return first
            if done >= limit:
                return replace(first, status=Status.ITERATION_LIMIT)
        options = NewtonOptions(tolerance, max_iterations=limit - done, shift=self.options.shift, check_minimum=static)
        last = minimise(objective, start, options, **hooks)
        return replace(last, iterations=done + last.iterations)

    def _take_up(self, state: ClothState) -> None:
        if state.fold_angles is not None:
            self.energy.elements.set_reference_angles(state.fold_angles)
        self._follow(state.positions)
        self.energy.begin_step(state.positions, state.memory)

    def _follow(self, x: Array) -> None:
        self.energy.follow(x.reshape(-1, 3)[: len(self.masses)])

    def _with_obstacles(self, state: ClothState) -> Array:
        """Positions of the cloth and, after them, of the points of moving obstacles."""
        places = self.contact.places(state.time) if state.obstacles is None else state.obstacles
        return np.concatenate([state.positions, places])

    def _bound(self, x: Array, step: Array) -> float:
        return self.contact.bound(x.reshape(-1, 3), step.reshape(-1, 3))

    def _start(self, positions: Array, moved: Array) -> Array:
        """x + Δt v, as far as nothing touches and the energy stays finite."""
        fraction = self.contact.bound(positions, moved)
        for _ in range(4):
            start = positions + fraction * moved
            if math.isfinite(self.energy.value(start[: len(self.masses)])):
                return start
            fraction *= 0.25
        return positions

    def _viscosity(self, state: ClothState, rule: StepRule) -> list[Term]:
        """Damping by stiffness and by the air, against the velocity of the step, if there is any."""
        cloth, pattern = self.cloth, self.energy.pattern
        if rule.rate == 0.0 or not (cloth.stiffness_damping > 0 or cloth.air_drag > 0):
            return []
        entries = np.zeros(pattern.entries)
        if cloth.stiffness_damping > 0:
            stiffness, _ = self.energy.positive_hessian(self.energy.linearise(state.positions), geometric=False)
            entries += cloth.stiffness_damping * stiffness
        if cloth.air_drag > 0:
            entries += drag_entries(cloth.mesh, pattern, state.positions, state.velocities, cloth.air_drag)
        entries *= rule.rate
        return [Springs(entries, rule.positions.ravel(), partial(pattern.multiply, entries))]

    def _attachments(self, time: float) -> list[Attachment]:
        """What holds handles and, last, the points of moving obstacles."""
        handles = [Attachment(handle.vertices, handle.places(time)) for handle in self.cloth.handles]
        return [*handles, self.contact.attachment(time)]
