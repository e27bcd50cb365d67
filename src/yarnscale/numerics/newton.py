"""Minimise an energy under linear constraints: regularised Newton with a step bound and a line search.

Each step solves the KKT system of HYLC20 eq. 29, ``(H + shift·M) p + Cᵀ λ = −g, C p = d − C x``, with the few
constraints eliminated by a Schur complement. The shift grows when the matrix is not positive definite or a step
disappoints, and decays otherwise; exact Hessians with a small shift converge where projected ones do not. Of large
systems each factor serves for some more steps, corrected by the changes of the gradient (``Reuse``).
"""

from __future__ import annotations

import enum
import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from yarnscale.arrays import Array
from yarnscale.numerics.kkt import ConstrainedSolver, QuadraticModel
from yarnscale.numerics.linear_solver import LinearSolver
from yarnscale.numerics.regularisation import ShiftRule
from yarnscale.numerics.secant import SecantPairs


class Status(enum.Enum):
    """How a minimisation ended; the value is the message."""

    CONVERGED = "converged"
    STALLED = "stalled: no step lowers the energy"
    ITERATION_LIMIT = "stopped at the iteration limit"
    INVALID = "invalid: the energy of the start is not finite"


class Objective(Protocol):
    """An energy of n unknowns; the value is inf where the state is not admissible.

    gradient, quadratic: energy, gradient (n,) and second-order model. residual_scale: gradient norm that counts as 1,
    at the state evaluated last.
    """

    def value(self, x: Array) -> float: ...
    def gradient(self, x: Array) -> tuple[float, Array]: ...
    def quadratic(self, x: Array) -> tuple[float, Array, QuadraticModel]: ...
    @property
    def residual_scale(self) -> float: ...


@dataclass(frozen=True)
class Reuse:
    """How long a factor is used again, where a factorisation costs many times a gradient.

    steps: at most, after the step of Newton's method. worth: share of the decrease of that step below which a further
    one does not pay.
    """

    steps: int = 5
    worth: float = 0.05


@dataclass(frozen=True, eq=False)
class Solution:
    """Outcome of ``minimise``: the point, its energy and how it was reached."""

    x: Array
    value: float
    gradient: Array
    residual: float
    status: Status
    iterations: int
    factorisations: int
    history: tuple[tuple[float, float], ...]
    """(energy, residual) of every iterate."""
    shift: float = 0.0
    """Regularisation at the end; a later minimisation of a like energy may start with it."""

    @property
    def converged(self) -> bool:
        """Whether the residual is below the tolerance at a minimum, or another step would have gained too little."""
        return self.status is Status.CONVERGED


_WORTH_MORE = 1.1
"""Actual over predicted decrease from which a longer step is tried."""
_LONGEST = 16.0
"""Largest multiple of a step."""
_SHORTEST = 0.1
"""Fraction of a step with an old factor below which the factor is outdated."""
_MOST_ESCAPES = 5
"""Saddles that one minimisation may leave."""

Bound = Callable[[Array, Array], float]
Watch = Callable[[int, float], None]
"""Gets the number of an iteration and its residual, which ends at the tolerance."""


@dataclass(frozen=True)
class NewtonOptions:
    """How a minimisation by Newton's method goes and when it ends.

    tolerance: on |P g| / residual_scale, P the projection on the constraints. enough: a step that foretells a smaller
    decrease of the energy than this, by the Hessian without shift, is the last, and the point it leads to counts as
    converged. reuse: use every factor for further steps. backtracks: halvings of a step before the shift is raised
    instead. check_minimum: accept a point below the tolerance only where the Hessian, restricted by the constraints,
    has no negative eigenvalue; else leave the saddle along it.
    """

    tolerance: float = 1e-6
    enough: float = 0.0
    max_iterations: int = 300
    shift: ShiftRule = field(default_factory=ShiftRule)
    reuse: Reuse | None = None
    backtracks: int = 6
    check_minimum: bool = True


def minimise(
    objective: Objective,
    start: Array,
    options: NewtonOptions = NewtonOptions(),
    *,
    linear: LinearSolver | None = None,
    bound: Bound | None = None,
    after_step: Callable[[Array], object] | None = None,
    watch: Watch | None = None,
) -> Solution:
    """Minimise ``objective`` from ``start`` (n,) under the linear constraints of the linear solver.

    linear: None for no constraints; one of an earlier call goes on with its symbolic analysis while the pattern is the
    same. bound(x, step): largest admissible fraction of a step, in (0, 1]. after_step(x): called after each accepted
    step. watch(iteration, residual): called at every iterate.
    """
    solver = ConstrainedSolver() if linear is None else linear
    return _Newton(objective, options, solver, bound, after_step, watch).run(np.array(start, np.float64))


def invalid_start(x: Array) -> Solution:
    """The outcome where the energy of the start is not finite."""
    return Solution(x, math.inf, np.zeros_like(x), math.inf, Status.INVALID, 0, 0, ())


@dataclass
class Descent:
    """A minimisation under way; arguments as those of ``minimise``."""

    objective: Objective
    options: NewtonOptions
    linear: LinearSolver
    bound: Bound | None
    after_step: Callable[[Array], object] | None
    watch: Watch | None
    history: list[tuple[float, float]] = field(default_factory=list, kw_only=True)

    def project(self, vector: Array) -> Array:
        """Part of a vector that the constraints leave free."""
        constraints = self.linear.constraints
        return vector if constraints is None else constraints.project(vector)

    def residual(self, gradient: Array) -> float:
        """Norm of what is left of a gradient, as ``NewtonOptions.tolerance`` counts it."""
        scale = self.objective.residual_scale
        return float(np.linalg.norm(self.project(gradient))) / (scale if scale > 0 else 1.0)

    def admissible(self, x: Array, step: Array) -> float:
        """Largest admissible fraction of a step, in (0, 1]."""
        return 1.0 if self.bound is None else self.bound(x, step)


@dataclass
class _Newton(Descent):
    shift: float = 0.0
    escapes: int = 0

    def __post_init__(self) -> None:
        self.rule, self.constraints = self.options.shift, self.linear.constraints

    def run(self, x: Array) -> Solution:
        self.shift, before = self.rule.start, self.linear.factorisations
        value, gradient, model = self.objective.quadratic(x)
        if not (math.isfinite(value) and np.isfinite(gradient).all()):
            return invalid_start(x)
        status = Status.ITERATION_LIMIT
        iteration = 0
        while True:
            residual = self.residual(gradient)
            self.history.append((value, residual))
            if self.watch is not None:
                self.watch(iteration, residual)
            if residual <= self.options.tolerance and self._feasible(x):
                minimum, moved = self._leave_saddle(x, value, model) if self.options.check_minimum else (True, None)
                if moved is None:
                    status = Status.CONVERGED if minimum else Status.STALLED
                    break
                x = moved
            elif iteration >= self.options.max_iterations:
                break
            else:
                moved, last = self._advance(x, value, gradient, model, residual)
                if moved is None:
                    status = Status.STALLED
                    break
                if last:
                    status = Status.CONVERGED
                    if moved is not x:
                        x, iteration = moved, iteration + 1
                        value, gradient, residual = self._arrived(x)
                    break
                if (reuse := self.options.reuse) is not None:
                    moved = self._further(x, value, gradient, moved, reuse)
                x = moved
            if self.after_step is not None:
                self.after_step(x)
            value, gradient, model = self.objective.quadratic(x)
            iteration += 1
        return Solution(
            x, value, gradient, residual, status, iteration, self.linear.factorisations - before, tuple(self.history),
            self.shift,
        )  # fmt: skip

    def _arrived(self, x: Array) -> tuple[float, Array, float]:
        """Energy, gradient and residual at the end of the last step."""
        if self.after_step is not None:
            self.after_step(x)
        value, gradient = self.objective.gradient(x)
        residual = self.residual(gradient)
        self.history.append((value, residual))
        return value, gradient, residual

    def _gap(self, x: Array) -> Array | None:
        return None if self.constraints is None else self.constraints.right - self.constraints.matrix @ x

    def _feasible(self, x: Array) -> bool:
        gap = self._gap(x)
        return gap is None or float(np.abs(gap).max(initial=0.0)) <= 1e-9 * (1.0 + float(np.abs(x).max(initial=0.0)))

    def _factorise(self, model: QuadraticModel) -> bool:
        """Factor with the least admissible shift not below the present one; False if none works."""
        for _ in range(40):
            if self.linear.factorise(model, self.shift):
                return True
            if self.shift >= self.rule.highest:
                return False
            self.shift = self.rule.raised(self.shift)
        return False

    def _advance(
        self, x: Array, value: float, gradient: Array, model: QuadraticModel, residual: float
    ) -> tuple[Array | None, bool]:
        """One accepted step from x, None where no step lowers the energy; and whether that was enough."""
        if residual > self.rule.hold_above:
            self.shift = self.rule.start
        before = self.shift
        for attempt in range(8):
            if not self._factorise(model):
                return None, False
            failed = self.shift > before
            step = self.linear.step(-gradient, self._gap(x))
            # After a search that failed, steps are short because the model is wrong, not because the end is near.
            last = attempt == 0 and self._feasible(x) and self._gains_little(gradient, model, step)
            whole = self.admissible(x, step)
            # The whole last step, and no more: by it what all move in common is exact, however soon it ends.
            fraction, ratio = self._search(x, value, gradient, step, whole, residual, lengthen=not last)
            if fraction > 0:
                if not failed and ratio > 0.75:
                    self.shift = self.rule.decayed(self.shift, 0.3 if fraction >= 1.0 else 1.0)
                elif ratio < 0.25:
                    self.shift = self.rule.raised(self.shift)
                return x + fraction * step, last and fraction >= 1.0
            if last:
                return x, True
            if self.shift >= self.rule.highest:
                return None, False
            self.shift = before = self.rule.raised(self.rule.raised(self.shift))
        return None, False

    def _further(self, x: Array, value: float, gradient: Array, moved: Array, reuse: Reuse) -> Array:
        """Where further steps with the present factor lead from ``moved``, the end of the step from x."""
        pairs, gradient = SecantPairs(reuse.steps), self.project(gradient)
        reached, force = self.objective.gradient(moved)
        least = reuse.worth * (value - reached)
        for _ in range(reuse.steps if self._feasible(moved) else 0):
            if not value - reached >= least:
                break
            force = self.project(force)
            pairs.add(moved - x, force - gradient)
            x, value, gradient = moved, reached, force
            step = pairs.direction(gradient, lambda right: self.linear.step(right, None))
            fraction = self.admissible(x, step)
            wanted = 1e-4 * float(gradient @ step)
            while fraction > _SHORTEST:
                moved = x + fraction * step
                reached, force = self.objective.gradient(moved)
                if reached < value + fraction * wanted:
                    break
                fraction *= 0.4
            else:
                return x
        return moved

    def _gains_little(self, gradient: Array, model: QuadraticModel, step: Array) -> bool:
        """Whether the line along a step promises less than ``enough``, whatever shift has shortened the step."""
        slope = -float(self.project(gradient) @ step)
        if not 0.0 <= slope < 2.0 * self.options.enough:
            return False
        if self.shift == 0.0 or slope == 0.0:
            return True
        curvature = float(step @ model.pattern.multiply(model.values(0.0), step))
        return curvature > 0.0 and slope**2 < 2.0 * self.options.enough * curvature

    def _search(
        self, x: Array, value: float, gradient: Array, step: Array, whole: float, residual: float, *, lengthen: bool
    ) -> tuple[float, float]:
        """Accepted fraction of a step (0: none; lengthen: above one, too) and actual over predicted decrease."""
        # Projected: round-off of C p against large constraint forces would drown a small slope.
        slope = float(self.project(gradient) @ step)
        infeasible = not self._feasible(x)
        if slope >= 0 and not infeasible:
            return 0.0, 0.0
        fraction = whole
        for _ in range(self.options.backtracks + 1):
            predicted = -slope * fraction * (1.0 - 0.5 * fraction)
            trial = x + fraction * step
            reached = self.objective.value(trial)
            if math.isfinite(reached):
                decrease = value - reached
                if decrease > 1e-4 * predicted and not infeasible:
                    ratio = decrease / predicted
                    if lengthen and fraction == 1.0 and ratio > _WORTH_MORE:
                        fraction = self._lengthened(x, step, reached)
                    return fraction, ratio
                if infeasible:
                    return fraction, 1.0
                if predicted < 1e-11 * abs(value) and self._calms(trial, residual):
                    # Below the noise of the energy only the gradient can tell.
                    return fraction, 1.0
            fraction *= 0.5
        return 0.0, 0.0

    def _lengthened(self, x: Array, step: Array, reached: float) -> float:
        """Multiple of a step, 1 or more, to which the energy keeps falling: a shifted Hessian makes steps too short."""
        fraction = 1.0
        while fraction < _LONGEST:
            longer = 2.0 * fraction
            if self.admissible(x, longer * step) < 1.0:
                break
            value = self.objective.value(x + longer * step)
            if not value < reached:
                break
            fraction, reached = longer, value
        return fraction

    def _calms(self, trial: Array, residual: float) -> bool:
        value, gradient = self.objective.gradient(trial)
        return math.isfinite(value) and self.residual(gradient) < residual

    def _leave_saddle(self, x: Array, value: float, model: QuadraticModel) -> tuple[bool, Array | None]:
        """Whether a stationary point is a minimum; else a point of lower energy along its falling direction, if any."""
        if self.linear.factorise(model, 0.0 if self.rule.lowest_is_zero else self.rule.lowest):
            return True, None
        shift, self.shift = self.shift, self.rule.least
        if not self._factorise(model):
            self.shift = shift
            return False, None
        pattern, exact = model.pattern, model.values(0.0)
        vector = self.project(np.random.default_rng(0).standard_normal(len(x)))
        for _ in range(12):
            vector = self.linear.step(vector, None)
            vector /= np.linalg.norm(vector)
        curvature = float(vector @ pattern.multiply(exact, vector))
        negligible = 1e-12 if self.constraints is None else 1e-7  # negative only across the constraints
        if curvature > -negligible * float(np.abs(exact[pattern.diagonal]).max()):
            return True, None
        self.escapes += 1
        if self.escapes > _MOST_ESCAPES:
            return False, None
        whole = self.admissible(x, vector)
        # Where contacts just touch, curvature is negative over a short distance only: look close by too.
        for fraction in whole / 4.0 ** np.arange(8):
            for sign in (1.0, -1.0):
                trial = x + sign * fraction * vector
                if self.objective.value(trial) < value:
                    return False, trial
        return False, None
