"""Motion of finite fabrics, every yarn of it: implicit steps by Newton's method, or explicit ones.

Unknowns are positions in radii and twists; frames are carried along from step to step. What is not rigid in the motion
of small patches is damped, which leaves momentum and angular momentum as they are (Kaldor et al. 2008; HYLC20 §8.1).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from yarnscale.arrays import Array, Flags
from yarnscale.errors import not_negative
from yarnscale.fabric.direct_energy import STITCH, EdgeFrames, FabricEnergy
from yarnscale.fabric.direct_friction import FrictionHistory, FrictionStep
from yarnscale.fabric.direct_objective import FabricObjective, NodeForce
from yarnscale.fabric.direct_static import gravity_load
from yarnscale.fabric.holds import Holds
from yarnscale.fabric.patches import Patches
from yarnscale.kinematics import GRAVITY
from yarnscale.motion.body import Body, Method, Step, checked_method
from yarnscale.motion.integrator import (
    ENOUGH,
    Earlier,
    Integrator,
    checked_integrator,
    fall_energy,
    longest_stable_step,
    remembered,
    step_rule,
)
from yarnscale.numerics.kkt import ConstrainedSolver
from yarnscale.numerics.newton import NewtonOptions, Solution, Status, minimise
from yarnscale.numerics.regularisation import ShiftRule
from yarnscale.numerics.sums import Springs
from yarnscale.numerics.threads import on_one_thread
from yarnscale.yarn.friction import YarnFriction

_PATCH = 5.0
"""Side of the patches whose motion is taken for rigid, in stitches."""
_LEAST_SHIFT, _LARGEST_SHIFT = 1e-5, 1e-2
"""A step starts with the regularisation of the one before, within these bounds."""
_SHIFT = ShiftRule(start=_LEAST_SHIFT, growth=10.0, lowest=1e-9, lowest_is_zero=True, least=1e-6)
_STABLE_SHARE = 0.6
"""Explicit steps over the longest stable one."""


@dataclass(frozen=True, eq=False)
class FabricMotion:
    """State x and velocity, both (4n,) [r, rad; per s], at a time [s].

    shift: regularisation that the last implicit step ended with; the next begins with it. frames: of the edges (None:
    those of the energy). passages: rows of ``Passages`` up to now. before: the state one step earlier, where the
    integrator needs it. friction: what contacts remember (None: nothing yet, and in explicit steps).
    """

    x: Array
    velocity: Array
    time: float = 0.0
    shift: float = _LEAST_SHIFT
    frames: EdgeFrames | None = None
    passages: Array = field(default_factory=lambda: np.empty((0, 6)))
    before: Earlier | None = None
    friction: FrictionHistory | None = None


@dataclass(frozen=True)
class MotionSettings:
    """gravity [m/s²]; damping: rate at which non-rigid motion decays [1/s]; friction of yarns on each other.

    An implicit step is done where forces left over fall below ``tolerance`` times the weight of the fabric, or with the
    first Newton iteration that gains less than ``enough`` of the energy m (g Δt)²/2 of the fabric after a step of free
    fall: velocities are then off by about its root, 5 %, of g Δt. iterations: the most of Newton in a step. method: of
    steps; explicit ones are as long as is stable. integrator: of implicit ones; BDF2 is of second order without damping
    and friction.
    """

    gravity: tuple[float, float, float] = (0.0, 0.0, -GRAVITY)
    damping: float = 0.0
    friction: YarnFriction | None = None
    tolerance: float = 1e-3
    enough: float = ENOUGH
    iterations: int = 40
    method: Method = "implicit"
    integrator: Integrator = "euler"

    def __post_init__(self) -> None:
        checked_method(self.method)
        checked_integrator(self.integrator)
        not_negative("damping", self.damping, "zero or more [1/s]")


@dataclass(eq=False)
class FabricDynamics(Body[FabricMotion]):
    """A fabric that moves under gravity, holds that may move, and obstacles.

    holds: what is held where at a time [s]. Steps of a fabric with many contacts seldom meet a tight tolerance in a few
    Newton iterations; all whose energy is a number are kept, and are safe all the same.
    """

    energy: FabricEnergy
    settings: MotionSettings = field(default_factory=MotionSettings)
    holds: Callable[[float], Holds] = field(default=lambda time: Holds.none())
    obstacles: tuple[NodeForce, ...] = ()

    def __post_init__(self) -> None:
        energy = self.energy
        self.tolerance, self.off_place = self.settings.tolerance, energy.radius
        self.method, self.loose = self.settings.method, True
        mass = energy.masses() * energy.radius**2 / energy.unit
        spin = np.where(energy.spins() > 0, energy.spins(), 1.0) / energy.unit
        self.mass = np.concatenate([np.repeat(mass, 3), spin])
        self.load = gravity_load(energy, np.array(self.settings.gravity))
        # Tolerances are counted in the weight on earth, whatever the gravity of the scene.
        self.force_scale = float(np.linalg.norm(gravity_load(energy, np.array([0.0, 0.0, GRAVITY]))))
        self._linear = ConstrainedSolver()
        self._patches = Patches.cubes(energy.sheet, _PATCH * STITCH)

    def start(self) -> FabricMotion:
        """At rest in the sheet's own shape."""
        x, sheet = self.energy.start(), self.energy.sheet
        frames = EdgeFrames(sheet.reference_director, sheet.reference_twist)
        return FabricMotion(x, np.zeros(len(x)), frames=frames)

    # --- steps ----------------------------------------------------------------------------------------

    @on_one_thread
    def _step(
        self, state: FabricMotion, duration: float, inertia: bool, iterations: int | None, until: float
    ) -> Step[FabricMotion]:
        if self.method == "explicit":
            return self._explicit(state, duration)
        energy, settings = self.energy, self.settings
        rubbing = self._begin(state, until, state.velocity * duration if inertia else None, rubs=True)
        rule = step_rule(settings.integrator, state.x, state.velocity, state.before, duration, inertia=inertia)
        weight, ahead = rule.inertia()
        mass = Springs(weight * self.mass, ahead)
        objective = FabricObjective(
            energy, [mass, self.holds(until).springs(energy)], self.load, self.obstacles,
            force_floor=self.force_scale, pull_share=0.0, tied=True,
        )  # fmt: skip
        # From where the fabric is: an extrapolation may press yarns into each other, and Newton's method knows inertia.
        fallen = fall_energy(float(energy.masses().sum()), duration) / energy.unit
        enough = settings.enough * fallen if inertia else 0.0
        shift = replace(_SHIFT, start=state.shift)
        options = NewtonOptions(self.tolerance, enough, iterations or settings.iterations, shift, check_minimum=False)
        solution = self._minimised(objective, state, options)
        x, shift = solution.x, min(max(solution.shift, _LEAST_SHIFT), _LARGEST_SHIFT)
        velocity = self._damped(x, rule.velocity(x), duration) if inertia else np.zeros_like(x)
        before = remembered(settings.integrator, state.x, state.velocity, duration) if inertia else None
        unrest = float(np.linalg.norm(mass.weight * (x - ahead))) / self.force_scale
        history = None if rubbing is None else rubbing.end(x)
        moved = replace(self._moved(state, x, velocity, until, shift), before=before, friction=history)
        return Step.of(moved, solution, duration, unrest)

    def distances_from_places(self, state: FabricMotion) -> dict[str, float]:
        return self.holds(state.time).distances(self.energy, state.x)

    def renewed(self, state: FabricMotion, duration: float) -> FabricMotion:
        """The same, with contacts listed anew, so that sums are taken in an order that the state alone decides."""
        self.energy.forget_contacts()
        return state

    def take_up(self, motion: FabricMotion) -> None:
        """Set the frames and passages of the energy to those of a state."""
        self.energy.anchor(motion.x, motion.frames)
        if self.energy.passages is not None:
            self.energy.count_passages(motion.passages)

    def _begin(
        self, motion: FabricMotion, end: float, predicted: Array | None = None, *, rubs: bool = False
    ) -> FrictionStep | None:
        """Begin a step: frames, and all that resists to slip from here on; rubs: yarns on each other, as a potential.

        predicted: the move of the step that velocities lead to (4n,).
        """
        energy, friction = self.energy, self.settings.friction if rubs else None
        self.take_up(motion)
        rubbing = None
        if friction is None or friction.coefficient == 0.0:
            energy.rub(None)
        else:
            rubbing = (motion.friction or FrictionHistory.slack(energy)).begin(
                energy, friction, motion.x, predicted=predicted
            )
        for obstacle in self.obstacles:
            obstacle.begin(energy.positions(motion.x), motion.time, end)
        return rubbing

    def _moved(self, motion: FabricMotion, x: Array, velocity: Array, time: float, shift: float) -> FabricMotion:
        """The state at the end of a step, where the frames of the energy are."""
        found = self.energy.passages
        passages = motion.passages if found is None else found.rows
        return FabricMotion(x, velocity, time, shift, self.energy.frames, passages)

    def _minimised(self, objective: FabricObjective, motion: FabricMotion, options: NewtonOptions) -> Solution:
        """The least of a step's energy, from where the fabric is."""
        return minimise(
            objective, motion.x, options, bound=self.energy.bound,
            after_step=self.energy.anchor, linear=self._linear,
        )  # fmt: skip

    def _explicit(self, motion: FabricMotion, duration: float) -> Step[FabricMotion]:
        """One step of symplectic Euler [s]."""
        energy = self.energy
        self._begin(motion, motion.time)
        objective = FabricObjective(energy, [], self.load, self.obstacles)
        value, gradient = objective.gradient(motion.x)
        if not (math.isfinite(value) and np.isfinite(gradient).all()):
            return Step(motion, Status.INVALID, duration)
        velocity = motion.velocity - duration * gradient / self.mass
        velocity = self._damped(motion.x, velocity, duration)
        # Stiff springs would shorten the steps: what is held goes to its place.
        holds = self.holds(motion.time + duration).springs(energy)
        held = holds.weight > 0
        led = (holds.centre[held] - motion.x[held]) / duration
        velocity[held] = led
        self._rub(velocity, held, motion.x, duration)
        velocity[held] = led
        step = duration * velocity
        share = min(1.0, energy.bound(motion.x, step))
        x = motion.x + share * step
        energy.anchor(x)
        moved = self._moved(motion, x, velocity, motion.time + duration, motion.shift)
        # Yarns that would pass through each other stop before; such a step counts as loose.
        return Step(moved, Status.CONVERGED if share == 1.0 else Status.STALLED, duration)

    def _rub(self, velocity: Array, held: Flags, x: Array, duration: float) -> None:
        """Take from velocities what friction does in an explicit step."""
        n = self.energy.count
        yielding = np.where(held[: 3 * n].reshape(-1, 3).all(axis=1), 0.0, 1.0 / self.mass[: 3 * n : 3])
        moves = velocity[: 3 * n].reshape(-1, 3)
        if (friction := self.settings.friction) is not None:
            moves[:] = friction.slowed(moves, yielding, self.energy.contacts(x).stencils, x, duration)
        for obstacle in self.obstacles:
            moves[:] = obstacle.slowed(moves, yielding, duration)

    def stable_step(self, state: FabricMotion) -> float:
        """A stable explicit step at a state [s]: yarns that are pressed together are stiffer.

        Friction, which only takes velocities away, makes it no shorter.
        """
        self.energy.anchor(state.x, state.frames)
        self.energy.rub(None)
        _, _, block, entries = self.energy.hessian(state.x)

        def times(vector: Array) -> Array:
            return block.pattern.multiply(entries, vector) / self.mass

        return _STABLE_SHARE * longest_stable_step(times, len(state.x), 40)

    def _damped(self, x: Array, velocity: Array, duration: float) -> Array:
        """Velocity at a state whose non-rigid part, patch by patch, has decayed."""
        rate = self.settings.damping
        if rate == 0.0:
            return velocity
        n = self.energy.count
        kept = math.exp(-rate * duration)
        velocity = velocity.copy()
        moves = velocity[: 3 * n].reshape(-1, 3)
        rigid = self._patches.rigid(self.energy.positions(x), moves, self.mass[: 3 * n : 3])
        velocity[: 3 * n] = (rigid + kept * (moves - rigid)).ravel()
        velocity[3 * n :] *= kept
        return velocity

    # --- read-outs ------------------------------------------------------------------------------------

    def energies(self, motion: FabricMotion) -> dict[str, float]:
        """Elastic, gravity (zero at the origin), kinetic energy, and that of the springs of friction [J]."""
        self.take_up(motion)
        self.energy.rub(None)
        unit = self.energy.unit
        return {
            "friction": 0.0 if motion.friction is None else motion.friction.stored(self.energy),
            "elastic": self.energy.value(motion.x) * unit,
            "gravity": -float(self.load @ motion.x) * unit,
            "kinetic": 0.5 * float((self.mass * motion.velocity) @ motion.velocity) * unit,
        }
