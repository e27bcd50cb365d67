"""Minimise an energy by quasi-Newton steps on a factor that is kept for many of them (L-BFGS).

Where a factorisation costs many times a gradient, as for cloth, it pays to keep the factor of the positive model and
to correct it by the last few changes of the gradient, with the factor as the first inverse Hessian. The factor is
renewed after some iterations, while forces are large, and where a step fails.

Convergence is linear: leave the last digits to ``newton.minimise``.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from yarnscale.arrays import Array
from yarnscale.numerics.kkt import ConstrainedSolver
from yarnscale.numerics.linear_solver import LinearSolver
from yarnscale.numerics.newton import Bound, Descent, NewtonOptions, Objective, Solution, Status, invalid_start
from yarnscale.numerics.secant import SecantPairs

_SHIFTS = (1.0, 1.0 + 1e-8, 1.0 + 1e-5, 1.0 + 1e-2, 2.0)
"""Shifts that are tried for a factor: beyond 1, models add what round-off asks for."""


@dataclass(frozen=True)
class KeepRule:
    """How long a factor is kept.

    iterations: at most; while_below: residual above which every iteration has its own factor; memory: number of
    changes of the gradient that correct it; shortest: fraction of a step below which the factor counts as outdated.
    """

    iterations: int = 25
    while_below: float = 10.0
    memory: int = 12
    shortest: float = 0.2


def minimise_keeping_factors(
    objective: Objective,
    start: Array,
    options: NewtonOptions,
    keep: KeepRule = KeepRule(),
    *,
    linear: LinearSolver | None = None,
    bound: Bound | None = None,
    after_step: Callable[[Array], object] | None = None,
) -> Solution:
    """Minimise ``objective`` from ``start`` (n,); arguments as those of ``newton.minimise``, without constraints.

    The positive model, shift 1, must be positive definite up to round-off. options: tolerance and most iterations.
    """
    solver = ConstrainedSolver() if linear is None else linear
    run = _QuasiNewton(objective, options, solver, bound, after_step, None, keep=keep)
    return run.run(np.array(start, dtype=np.float64))


@dataclass
class _QuasiNewton(Descent):
    """changes: of the gradient since the factor was made, ``age`` iterations ago."""

    keep: KeepRule = field(default_factory=KeepRule)
    age: int = 0

    def run(self, x: Array) -> Solution:
        before, self.changes = self.linear.factorisations, SecantPairs(self.keep.memory)
        renewed = self._renew(x)
        if renewed is None:
            return invalid_start(x)
        (value, gradient), status, iterations = renewed, Status.ITERATION_LIMIT, 0
        while True:
            residual = self.residual(gradient)
            self.history.append((value, residual))
            if residual <= self.options.tolerance:
                status = Status.CONVERGED
                break
            if iterations >= self.options.max_iterations:
                break
            moved = self._advance(x, value, gradient, residual)
            if moved is None:
                status = Status.STALLED
                break
            x, value, gradient = moved
            if self.after_step is not None:
                self.after_step(x)
            iterations, self.age = iterations + 1, self.age + 1
        made = self.linear.factorisations - before
        return Solution(x, value, gradient, residual, status, iterations, made, tuple(self.history))

    def _renew(self, x: Array) -> tuple[float, Array] | None:
        """Factor the positive model at x; energy and gradient there, or None where that is impossible."""
        value, gradient, model = self.objective.quadratic(x)
        self.changes.clear()
        self.age = 0
        if not (math.isfinite(value) and np.isfinite(gradient).all()):
            return None
        good = any(self.linear.factorise(model, shift) for shift in _SHIFTS)
        return (value, gradient) if good else None

    def _advance(self, x: Array, value: float, gradient: Array, residual: float) -> tuple[Array, float, Array] | None:
        """A point of lower energy with its energy and gradient, or None where even a new factor finds none."""
        outdated = self.age >= self.keep.iterations or residual > self.keep.while_below
        if self.age > 0 and outdated and self._renew(x) is None:
            return None
        for _ in range(2):
            direction = self.changes.direction(gradient, lambda right: self.linear.step(right, None))
            moved = self._search(x, value, gradient, direction, residual)
            if moved is not None or self.age == 0:
                return moved
            if self._renew(x) is None:
                return None
        return None

    def _search(
        self, x: Array, value: float, gradient: Array, direction: Array, residual: float
    ) -> tuple[Array, float, Array] | None:
        """Backtrack by interpolation until the energy falls enough."""
        slope = float(gradient @ direction)
        if not slope < 0:
            return None
        fraction = self.admissible(x, direction)
        for _ in range(10):
            trial = x + fraction * direction
            reached, force = self.objective.gradient(trial)
            finite = math.isfinite(reached) and bool(np.isfinite(force).all())
            if finite and self._falls(value, reached, fraction * slope, residual, force):
                self.changes.add(trial - x, force - gradient)
                if fraction < self.keep.shortest:
                    self.age = self.keep.iterations
                return trial, reached, force
            shrink = 0.5
            if finite:
                excess = reached - value - fraction * slope
                shrink = min(max(-0.5 * fraction * slope / excess, 0.1), 0.6) if excess > 0 else 0.5
            fraction *= shrink
        return None

    def _falls(self, value: float, reached: float, predicted: float, residual: float, force: Array) -> bool:
        if reached - value <= 1e-4 * predicted:
            return True
        # Below the noise of the energy only the gradient can tell.
        return -predicted < 1e-11 * abs(value) and self.residual(force) < residual
