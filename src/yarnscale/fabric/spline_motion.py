"""Motion of spline yarns: of all control points under contact constraints, or of a bounding volume without them.

Both are the same equations, M q̈ = Q with q = Γ α in the published volume, M_V = Γᵀ M Γ and Q_V = Γᵀ Q (LOD03 §5). A
step is explicit (symplectic Euler; the constant mass matrix is factored once) or implicit (Newton's method). A
homogenized volume has the elasticity of ``VolumeCells``, and of full yarns at some borders, in place of theirs.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import get_args

import numpy as np
from scipy.sparse import csr_array, vstack

from yarnscale.arrays import Array
from yarnscale.errors import InputError, not_negative
from yarnscale.fabric.sheet_scene import SheetScene
from yarnscale.fabric.spline_contacts import SplineContacts
from yarnscale.fabric.spline_knit import CurvePoints, SplineFabric
from yarnscale.fabric.spline_model import SplineEnergy, point_rows
from yarnscale.fabric.spline_points import PointForces, SplinePoints
from yarnscale.fabric.spline_touch import SplineTouch, TouchingObjective
from yarnscale.fabric.volume import BoundingVolume
from yarnscale.fabric.volume_cells import Reduction
from yarnscale.fabric.volume_rows import cells_of, spline_counts
from yarnscale.kinematics import GRAVITY
from yarnscale.motion.body import Body, Method, Step, checked_method
from yarnscale.motion.integrator import (
    ENOUGH,
    Earlier,
    Integrator,
    StepRule,
    checked_integrator,
    fall_energy,
    longest_stable_step,
    remembered,
    step_rule,
)
from yarnscale.numerics.affine import KeptPull, MappedObjective, NodeMap
from yarnscale.numerics.kkt import LinearConstraints
from yarnscale.numerics.linear_solver import LinearSolver, linear_solver
from yarnscale.numerics.newton import NewtonOptions, Objective, Status, minimise
from yarnscale.numerics.regularisation import ShiftedHessian, ShiftRule
from yarnscale.numerics.saddle import SparseConstraints
from yarnscale.numerics.sums import Load, Springs, SumOfEnergies

STANDARD_GRAVITY = (0.0, -GRAVITY, 0.0)
"""Down the wales [m/s²]: fabric hangs by its last row."""
_STABLE_SHARE = 0.7
"""Explicit steps over the longest stable one."""
_ITERATIONS, _LED_ITERATIONS = 50, 12
"""Of Newton, the most in a step, without handles and obstacles and with them."""
_SHIFT = ShiftRule(start=0.0, lowest=1e-6, lowest_is_zero=True, least=1e-3)


@dataclass(frozen=True, eq=False)
class YarnMotion:
    """Where control points are and how fast: of yarns, or of a volume; both (n, 3), [m] and [m/s], at a time [s].

    Of a homogenized volume: of its full yarns and mid-surface, then the fluctuations of its cells.

    knots: that an adaptive volume has taken in, axis and place [m] of each (k, 2). before: the state one step earlier,
    where the integrator needs it. passages: rows of ``Passages`` of the yarns up to now, but not
    of explicit steps in a volume.
    """

    positions: Array
    velocities: Array
    time: float = 0.0
    knots: Array = field(default_factory=lambda: np.empty((0, 2)))
    before: Earlier | None = None
    passages: Array = field(default_factory=lambda: np.empty((0, 6)))


class SplineMotion(Body[YarnMotion]):
    """A fabric of spline yarns in motion, by all control points of its yarns or by those of a volume.

    gravity: [m/s²]; held: points of yarns that stay where they are at rest; loads: handles, by stiff springs, and
    obstacles, both in implicit steps only; displacement: of the fabric at the start from where it is drawn [m];
    damping: rate [1/s] at which free motion decays. Contacts constrain the yarns themselves, and where they touch
    elsewhere they press on each other (``SplineTouch``); in a volume yarns need no constraints, and only those of the
    cells and full yarns of a homogenized one press on each other. reduction: of a volume; a homogenized one has full
    yarns where it is held and cast on (``RowsOnCells``), loads at its mid-surface, and implicit steps only. tolerance:
    of steps, forces left over per weight of the fabric; enough: share of ``fall_energy`` that an iteration must gain to
    go on, by default ``ENOUGH`` with loads, whose steps are kept as they are, and in homogenized volumes, else 0;
    iterations: of Newton, the most in a step, by default 12 with loads, else 50. method: of steps; integrator: of
    implicit ones. energy: of the fabric's yarns, if it is known. Raises InputError.
    """

    def __init__(
        self,
        fabric: SplineFabric,
        *,
        volume: BoundingVolume | None = None,
        reduction: Reduction = "published",
        gravity: tuple[float, float, float] = STANDARD_GRAVITY,
        held: CurvePoints | None = None,
        loads: SheetScene | None = None,
        displacement: tuple[float, float, float] = (0.0, 0.0, 0.0),
        damping: float = 0.0,
        tolerance: float = 1e-2,
        enough: float | None = None,
        iterations: int | None = None,
        method: Method = "implicit",
        integrator: Integrator = "euler",
        energy: SplineEnergy | None = None,
    ) -> None:
        if reduction not in get_args(Reduction):
            raise InputError("reduction", expected=" or ".join(get_args(Reduction)), found=reduction)
        homogenized = volume is not None and reduction == "homogenized"
        if checked_method(method) == "explicit" and (homogenized or loads is not None):
            what = "of a homogenized volume" if homogenized else "of splines with handles or obstacles"
            raise InputError(f"steps {what}", expected="the implicit method", found=method)
        fabric = fabric if loads is None else fabric.unclosed()
        self.fabric, self.volume, self.held, self.loads = fabric, volume, held, loads
        self.reduction: Reduction = reduction
        self.gravity, self.displacement = np.asarray(gravity, dtype=np.float64), displacement
        self.damping = not_negative("damping", damping, "zero or more [1/s]")
        self.tolerance, self.loose = tolerance, loads is not None
        self.enough = enough if enough is not None else ENOUGH if self.loose or homogenized else 0.0
        self.iterations = iterations if iterations is not None else _LED_ITERATIONS if self.loose else _ITERATIONS
        self.method: Method = method
        self.integrator: Integrator = checked_integrator(integrator)
        self.halvings, self.off_place = 4 if method == "implicit" else 0, fabric.radius
        self.of_yarns = energy if energy is not None else SplineEnergy(fabric)
        loaded = loads is not None
        self.cells = cells_of(self.of_yarns, volume, held, loaded) if volume is not None and homogenized else None
        self.energy = self.of_yarns if self.cells is None else self.cells
        self.load = self.energy.weight(self.gravity)
        standard = self.energy.weight(np.asarray(STANDARD_GRAVITY))
        self.force_scale = float(np.linalg.norm(self.load if self.load.any() else standard))
        self._mass = self.energy.mass_matrix()
        rest, within = fabric.control.reshape(-1, 3), volume is not None and not homogenized
        self.map = NodeMap(volume.fast_weights(rest), np.zeros(rest.size)) if volume is not None and within else None
        self.start, self._held = self._displaced(), self._held_rows()
        self._held_at = self._held @ self.expanded(self.start).positions.ravel()
        self._contacts = SplineContacts.of(fabric)
        points = SplinePoints(fabric)
        self.touch, self.forces = SplineTouch(points), None if loads is None else self._forces(points, loads)
        constrain = self._tied if volume is None else self._held_volume
        self._constraints = constrain(self.start.positions)
        self._pull = None if self.map is None else KeptPull(self.map)
        self._linear = linear_solver(self._constraints)
        self._mass_solve: LinearSolver | None = None
        self._mass_model: ShiftedHessian | None = None

    def _displaced(self) -> YarnMotion:
        """At rest in its own shape, where it is at the start."""
        if self.cells is not None:
            start, moved = self.cells.at_rest.copy(), len(self.load) // 3
        else:
            rest = self.fabric.control.reshape(-1, 3) if self.volume is None else self.volume.control_at_rest
            start, moved = rest.copy(), None
        start[:moved] += self.displacement
        return YarnMotion(start, np.zeros_like(start))

    def _held_rows(self) -> csr_array:
        """Matrix to the held points."""
        if self.held is None:
            return csr_array((0, self.energy.size))
        rows = point_rows(self.fabric, self.held)
        return rows if self.cells is None else self.cells.rows(rows)

    def _forces(self, points: SplinePoints, loads: SheetScene) -> PointForces:
        """Handles and obstacles on the yarns, or on the mid-surface of a homogenized volume."""
        if self.cells is not None:
            heights = points.sheet.vertices * [0.0, 0.0, 1.0]
            flat = (replace(handle, rest=handle.rest - heights[handle.vertices]) for handle in loads.handles)
            loads, points = replace(loads, handles=tuple(flat)), points.on_surface(self.cells.rows(points.rows))
        return PointForces(points, loads, self.energy.pattern)

    def counts(self) -> dict[str, int]:
        """Sizes as LOD03 Figure 9 counts them; ``reduced_unknowns`` with a volume."""
        return spline_counts(self.fabric, self.volume, self.reduction, self.held)

    def with_volume(self, volume: BoundingVolume) -> SplineMotion:
        """The same fabric under the same conditions in another volume."""
        return SplineMotion(
            self.fabric, volume=volume, reduction=self.reduction, gravity=tuple(self.gravity), held=self.held,
            loads=self.loads, displacement=self.displacement, damping=self.damping, tolerance=self.tolerance,
            enough=self.enough, iterations=self.iterations, method=self.method, integrator=self.integrator,
            energy=self.of_yarns,
        )  # fmt: skip

    def yarns(self, motion: YarnMotion) -> YarnMotion:
        """Control points of the yarns: the motion itself, or what the volume makes of them."""
        if self.cells is not None:
            return YarnMotion(*self.cells.yarns(motion.positions, motion.velocities), motion.time)
        return self.expanded(motion)

    def expanded(self, motion: YarnMotion) -> YarnMotion:
        """The points that the energy is a function of."""
        if self.map is None:
            return motion
        positions = self.map.expand(motion.positions.ravel()).reshape(-1, 3)
        return YarnMotion(positions, np.asarray(self.map.weights @ motion.velocities), motion.time)

    def renewed(self, state: YarnMotion, duration: float) -> YarnMotion:
        """The same, with contacts listed anew, so that sums are taken in an order that the state alone decides."""
        self.touch.forget()
        if self.cells is not None:
            self.cells.forget()
        return state

    def distances_from_places(self, state: YarnMotion) -> dict[str, float]:
        """How far the farthest point of what is held is from its place [m]."""
        x = self.expanded(state).positions.ravel()
        if self.forces is not None:
            return self.forces.loads.holds(state.time).distances(self.forces.points, x)
        away = self._held @ x - self._held_at
        return {"held row": float(np.linalg.norm(away.reshape(-1, 3), axis=1).max(initial=0.0))}

    def times_mass(self, vector: Array) -> Array:
        """M v of the points that have mass, (3n,): control points of yarns, of full yarns and of mid-surfaces."""
        return (self._mass @ vector[: len(self.load)].reshape(-1, 3)).ravel()

    def energies(self, motion: YarnMotion) -> dict[str, float]:
        """Elastic, gravity (from the start on) and kinetic energy [J]."""
        points = self.expanded(motion)
        x = points.positions.ravel()
        moved = (x - self.expanded(self.start).positions.ravel())[: len(self.load)]
        velocity = points.velocities.ravel()[: len(self.load)]
        return {
            "elastic": self.energy.value(x) + (self.touch.value(x) if self.volume is None else 0.0),
            "gravity": -float(self.load @ moved),
            "kinetic": 0.5 * float(velocity @ self.times_mass(velocity)),
        }

    def _step(
        self, state: YarnMotion, duration: float, inertia: bool, iterations: int | None, until: float
    ) -> Step[YarnMotion]:
        self._aim_constraints(state)
        if self.method == "explicit":
            step = self._explicit(state, duration)
            # In a volume counting would take longer than the steps.
            rows = self._passages(state, [step.state.positions]) if self.volume is None else state.passages
            return replace(step, state=replace(step.state, time=until, passages=rows))
        if not inertia and self.volume is None:  # contacts, linearised in every step, would not be satisfied
            raise InputError("steps without inertia", expected="spline yarns in a volume", found="all of them")
        still = replace(state, velocities=np.zeros_like(state.velocities), before=None)
        limit = self.iterations if iterations is None else iterations
        if self.forces is not None:
            self.forces.begin(self.expanded(state).positions.ravel(), state.time, until)
        path: list[Array] = []
        step = self._implicit(state if inertia else still, duration, limit, path.append)
        # Contact bounds the step to each iterate of all yarns, not the straight line to the last one.
        passed = path[:-1] if self.volume is None else []
        rows = self._passages(state, [*passed, self.yarns(step.state).positions])
        moved = replace(step.state, time=until, passages=rows)
        return replace(step, state=moved if inertia else replace(moved, velocities=still.velocities, before=None))

    def _passages(self, before: YarnMotion, path: list[Array]) -> Array:
        """Rows of passages up to a state, and those on straight lines from there through positions of the yarns."""
        rows, start = before.passages, self.yarns(before).positions.ravel()
        for positions in path:
            rows, start = self.touch.passages(start, positions.ravel(), rows), positions.ravel()
        return rows

    def still_to_gain(self, motion: YarnMotion, duration: float, reached: Array) -> float:
        """Energy [J] that an implicit step from ``motion`` could still save from positions (n, 3): ½ gᵀ K⁻¹ g."""
        self._aim_constraints(motion)
        if self.forces is not None:
            self.forces.begin(self.expanded(motion).positions.ravel(), motion.time, motion.time + duration)
        _, gradient, model = self._objective(*self._balance(self._rule(motion, duration))).quadratic(reached.ravel())
        linear, shift = linear_solver(self._constraints), 0.0
        while not linear.factorise(model, shift):
            shift = _SHIFT.raised(shift)
        return -0.5 * float(gradient @ linear.step(-gradient, None))

    def nearest(self, yarns: YarnMotion) -> tuple[YarnMotion, float]:
        """The motion of the volume nearest to that of the yarns, in the mass matrix; and how far yarns are away [m]."""
        assert self.map is not None
        solver, right = self._mass_solver(), None
        if self._constraints is not None:
            right = self._constraints.right
        wanted = (self.map.pull_gradient(self.times_mass(v.ravel())) for v in (yarns.positions, yarns.velocities))
        positions, velocities = (solver.step(w, gap) for w, gap in zip(wanted, (right, None), strict=True))
        found = YarnMotion(positions.reshape(-1, 3), velocities.reshape(-1, 3), yarns.time)
        away = np.linalg.norm(self.yarns(found).positions - yarns.positions, axis=1).max()
        return found, float(away)

    def stable_step(self, state: YarnMotion) -> float:
        self._aim_constraints(state)
        solver = self._mass_solver()
        x = self.yarns(state).positions.ravel()
        model = self.energy.quadratic(x)[2]
        if self.volume is None:
            model = self.touch.quadratic(x, model)[2]

        def times(vector: Array) -> Array:
            full = vector
            if self.map is not None:
                full = np.asarray(self.map.weights @ vector.reshape(-1, 3)).ravel()
            return solver.step(self._pulled(model.pattern.multiply(model.entries, full)), None)

        return _STABLE_SHARE * longest_stable_step(times, state.positions.size, 60)

    def _explicit(self, motion: YarnMotion, duration: float) -> Step[YarnMotion]:
        solver = self._mass_solver()
        yarns = self.yarns(motion)
        _, gradient = self.energy.gradient(yarns.positions.ravel())
        if self.volume is None:
            gradient += self.touch.gradient(yarns.positions.ravel())[1]
        velocity = motion.velocities.ravel()
        force = self._pulled(self.load - gradient)
        gap = None
        if self._constraints is not None:
            reach = motion.positions.ravel() + duration * velocity
            gap = (self._constraints.right - self._constraints.matrix @ reach) / duration
        change = solver.step(duration * force, gap)
        velocity = (velocity + change) / (1.0 + self.damping * duration)
        positions = motion.positions + duration * velocity.reshape(-1, 3)
        status = Status.CONVERGED if np.isfinite(positions).all() else Status.INVALID
        moved = replace(motion, positions=positions, velocities=velocity.reshape(-1, 3))
        return Step(moved, status, duration)

    def _implicit(
        self, motion: YarnMotion, duration: float, iterations: int, after: Callable[[Array], object]
    ) -> Step[YarnMotion]:
        # Yarns extrapolated along their velocities would stretch where they turn, in their stiffest direction by far.
        rule = self._rule(motion, duration)
        weight, centre = self._balance(rule)
        fallen = fall_energy(float(self.of_yarns.masses.sum()), duration) if rule.rate > 0.0 else 0.0
        options = NewtonOptions(self.tolerance, self.enough * fallen, iterations, _SHIFT, check_minimum=False)
        start, objective = motion.positions.ravel(), self._objective(weight, centre)
        bound = self.touch.bound if self.volume is None else self.cells.bound if self.cells is not None else None
        solution = minimise(objective, start, options, linear=self._linear, bound=bound, after_step=after)
        positions = solution.x.reshape(-1, 3)
        before = remembered(self.integrator, motion.positions, motion.velocities, duration)
        new = replace(motion, positions=positions, velocities=rule.velocity(positions), before=before)
        away = self.expanded(new).positions.ravel()[: len(centre)] - centre
        unrest = float(np.linalg.norm(self._pulled(weight * self.times_mass(away)))) / self.force_scale
        return Step.of(new, solution, duration, unrest)

    def _rule(self, motion: YarnMotion, duration: float) -> StepRule:
        return step_rule(self.integrator, motion.positions, motion.velocities, motion.before, duration)

    def _balance(self, rule: StepRule) -> tuple[float, Array]:
        """Factor of the mass matrix in an implicit step [1/s²], and where what has mass would be without forces."""
        weight, centre = rule.inertia(self.damping)
        full = centre.ravel() if self.map is None else self.map.expand(centre.ravel())
        return weight, full[: len(self.load)]

    def _objective(self, weight: float, centre: Array) -> Objective:
        inertia = Springs(weight * self.energy.mass_entries, centre, lambda away: weight * self.times_mass(away))
        terms = [Load(self.load), inertia, *([] if self.forces is None else [self.forces])]
        objective = SumOfEnergies(self.energy, terms, self.force_scale)
        if self.volume is None:
            return TouchingObjective(objective, self.touch)
        return objective if self.map is None else MappedObjective(objective, self.map, pull=self._pull)

    def _pulled(self, force: Array) -> Array:
        return force if self.map is None else self.map.pull_gradient(force)

    def _aim_constraints(self, motion: YarnMotion) -> None:
        """Linearise the contacts at the start of a step."""
        if isinstance(self._constraints, SparseConstraints):
            self._constraints = self._constraints.renewed(*self._contacts_at(motion.positions))
            self._linear.constraints = self._constraints  # type: ignore[assignment]

    def _tied(self, positions: Array) -> SparseConstraints | LinearConstraints | None:
        """Contacts and held points as constraints on the yarns; None where there are none."""
        rows, right = self._contacts_at(positions)
        return SparseConstraints(rows, right) if len(right) else None

    def _contacts_at(self, positions: Array) -> tuple[csr_array, Array]:
        """Rows and right sides of constraints: contacts of the yarns, linearised, and held points."""
        rows, missed = self._contacts.linearised(positions)
        right = np.concatenate([rows @ positions.ravel() - missed, self._held_at])
        return csr_array(vstack([rows, self._held])), right

    def _held_volume(self, control: Array) -> LinearConstraints | None:
        """Held points as constraints on the volume, without linearly dependent ones."""
        if self._held.shape[0] == 0:  # type: ignore[index]
            return None
        columns = [self._pulled(row) for row in self._held.toarray()]
        _, sizes, directions = np.linalg.svd(np.array(columns), full_matrices=False)
        kept = directions[sizes > 1e-9 * sizes[0]]
        return LinearConstraints(kept, kept @ control.ravel())

    def _mass_solver(self) -> LinearSolver:
        """The mass matrix with the constraints, factored; for a volume once, else once a step as contacts turn."""
        if self._mass_solve is None:
            pattern, entries = self.energy.pattern, self.energy.mass_entries
            if self._pull is not None:
                pull = self._pull.of(pattern)
                pattern, entries = pull.pattern, pull.entries(entries)
            self._mass_model, self._mass_solve = ShiftedHessian(pattern, entries), linear_solver(self._constraints)
            self._factorise_mass()
        elif isinstance(self._constraints, SparseConstraints):
            self._mass_solve.constraints = self._constraints  # type: ignore[assignment]
            self._factorise_mass()
        return self._mass_solve

    def _factorise_mass(self) -> None:
        assert self._mass_solve is not None and self._mass_model is not None
        if not self._mass_solve.factorise(self._mass_model, 0.0):
            raise ArithmeticError("the mass matrix is singular: the volume has patches without yarn")
