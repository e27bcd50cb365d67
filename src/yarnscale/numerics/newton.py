"""Minimise an energy under linear constraints: regularised Newton with a step bound and a line search.

Each step solves the KKT system of HYLC20 eq. 29, ``(H + shift·M) p + Cᵀ λ = −g, C p = d − C x``, with the few
constraints eliminated by a Schur complement. The shift grows when the matrix is not positive definite or a step
disappoints, and decays otherwise; exact Hessians with a small shift converge where projected ones do not.
"""

from __future__ import annotations

import enum
import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from yarnscale.numerics.factor import Factorisation, SymmetricPattern, factorisation

Array = NDArray[np.float64]


class Status(enum.Enum):
    """How a minimisation ended; the value is the message."""

    CONVERGED = "converged"
    STALLED = "stalled: no step lowers the energy"
    ITERATION_LIMIT = "stopped at the iteration limit"
    INVALID = "invalid: the energy of the start is not finite"


class QuadraticModel(Protocol):
    """Second-order model of an objective at a point."""

    @property
    def pattern(self) -> SymmetricPattern:
        """Pattern of the Hessian; the same object as long as it did not change."""
        ...

    def values(self, shift: float) -> Array:
        """Entries of H + shift·M, with M positive (a diagonal, or positive model − exact Hessian)."""
        ...


class Objective(Protocol):
    """An energy of n unknowns; the value is inf where the state is not admissible."""

    def value(self, x: Array) -> float:
        """Energy."""
        ...

    def gradient(self, x: Array) -> tuple[float, Array]:
        """Energy and gradient (n,)."""
        ...

    def quadratic(self, x: Array) -> tuple[float, Array, QuadraticModel]:
        """Energy, gradient (n,) and second-order model."""
        ...

    @property
    def residual_scale(self) -> float:
        """Gradient norm that counts as 1, at the state evaluated last."""
        ...


@dataclass(frozen=True, eq=False)
class LinearConstraints:
    """``matrix @ x = right`` with few rows: matrix (m, n), right (m,)."""

    matrix: Array
    right: Array
    _basis: Array = field(init=False, repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "_basis", np.linalg.qr(self.matrix.T)[0])

    def project(self, vector: Array) -> Array:
        """Part of a gradient that the constraints leave free, (n,)."""
        return vector - self._basis @ (self._basis.T @ vector)


@dataclass(frozen=True)
class ShiftRule:
    """How the regularisation moves: ``H + shift·M``.

    start, lowest, highest: its first value and bounds. A shift below ``lowest`` becomes 0 if ``lowest_is_zero``.
    growth: factor when a factorisation fails or a step disappoints; least: smallest value after growth.
    decay: factor after a step that did as predicted. hold_above: residual above which the shift stays at ``start``.
    """

    start: float = 1e-2
    lowest: float = 1e-9
    highest: float = math.inf
    growth: float = 5.0
    least: float = 1e-6
    decay: float = 0.2
    lowest_is_zero: bool = False
    hold_above: float = math.inf

    def raised(self, shift: float) -> float:
        """Next larger shift."""
        return min(max(shift * self.growth, self.least), self.highest)

    def decayed(self, shift: float, factor: float = 1.0) -> float:
        """Next smaller shift."""
        lower = shift * self.decay * factor
        if lower < self.lowest:
            return 0.0 if self.lowest_is_zero else self.lowest
        return lower


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

    @property
    def converged(self) -> bool:
        """Whether the residual is below the tolerance at a minimum."""
        return self.status is Status.CONVERGED


@dataclass
class _Linear:
    """Factor and constraint elimination; the symbolic analysis lives as long as the pattern."""

    constraints: LinearConstraints | None
    backend: str | None
    pattern: SymmetricPattern | None = None
    factor: Factorisation | None = None
    count: int = 0

    def factorise(self, model: QuadraticModel, shift: float) -> bool:
        if self.factor is None or model.pattern is not self.pattern:
            self.pattern = model.pattern
            self.factor = factorisation(model.pattern, self.backend)
        self.count += 1
        return self.factor.factor(model.values(shift))

    def step(self, right: Array, gap: Array | None) -> Array:
        """Solve K p + Cᵀ λ = right, C p = gap (None: 0)."""
        assert self.factor is not None
        if self.constraints is None:
            return self.factor.solve(right)
        matrix = self.constraints.matrix
        solved = self.factor.solve(np.column_stack([right, matrix.T]))
        free, columns = solved[:, 0], solved[:, 1:]
        excess = matrix @ free - (0.0 if gap is None else gap)
        return free - columns @ np.linalg.solve(matrix @ columns, excess)


Bound = Callable[[Array, Array], float]


def minimise(
    objective: Objective,
    start: Array,
    *,
    constraints: LinearConstraints | None = None,
    bound: Bound | None = None,
    after_step: Callable[[Array], None] | None = None,
    tolerance: float = 1e-6,
    max_iterations: int = 300,
    shift: ShiftRule | None = None,
    backtracks: int = 6,
    check_minimum: bool = True,
    backend: str | None = None,
) -> Solution:
    """Minimise ``objective`` from ``start`` (n,) under linear constraints.

    bound(x, step): largest admissible fraction of a step, in (0, 1]. after_step(x): called after each accepted step.
    tolerance: on |P g| / residual_scale, P the projection on the constraints. check_minimum: accept a point below the
    tolerance only where the Hessian, restricted by the constraints, has no negative eigenvalue; else leave the saddle
    along it. backtracks: halvings of a step before the shift is raised instead.
    """
    return _Minimisation(
        objective, constraints, bound, after_step, tolerance, max_iterations, shift or ShiftRule(), backtracks,
        check_minimum, _Linear(constraints, backend),
    ).run(np.array(start, dtype=np.float64))  # fmt: skip


@dataclass
class _Minimisation:
    objective: Objective
    constraints: LinearConstraints | None
    bound: Bound | None
    after_step: Callable[[Array], None] | None
    tolerance: float
    max_iterations: int
    rule: ShiftRule
    backtracks: int
    check_minimum: bool
    linear: _Linear
    shift: float = 0.0
    history: list[tuple[float, float]] = field(default_factory=list)
    escapes: int = 0

    def run(self, x: Array) -> Solution:
        self.shift = self.rule.start
        value, gradient, model = self.objective.quadratic(x)
        if not (math.isfinite(value) and np.isfinite(gradient).all()):
            return Solution(x, math.inf, np.zeros_like(x), math.inf, Status.INVALID, 0, 0, ())
        status = Status.ITERATION_LIMIT
        iteration = 0
        while True:
            residual = self._residual(gradient)
            self.history.append((value, residual))
            feasible = self._infeasibility(x) <= 1e-9 * (1.0 + float(np.abs(x).max(initial=0.0)))
            if residual <= self.tolerance and feasible:
                moved = self._leave_saddle(x, value, model) if self.check_minimum else None
                if moved is None:
                    status = Status.CONVERGED
                    break
                x = moved
            elif iteration >= self.max_iterations:
                break
            else:
                moved = self._advance(x, value, gradient, model, residual)
                if moved is None:
                    status = Status.STALLED
                    break
                x = moved
            if self.after_step is not None:
                self.after_step(x)
            value, gradient, model = self.objective.quadratic(x)
            iteration += 1
        return Solution(
            x, value, gradient, residual, status, iteration, self.linear.count, tuple(self.history)
        )  # fmt: skip

    def _project(self, vector: Array) -> Array:
        return vector if self.constraints is None else self.constraints.project(vector)

    def _residual(self, gradient: Array) -> float:
        scale = self.objective.residual_scale
        return float(np.linalg.norm(self._project(gradient))) / (scale if scale > 0 else 1.0)

    def _gap(self, x: Array) -> Array | None:
        return None if self.constraints is None else self.constraints.right - self.constraints.matrix @ x

    def _infeasibility(self, x: Array) -> float:
        gap = self._gap(x)
        return 0.0 if gap is None else float(np.abs(gap).max(initial=0.0))

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
    ) -> Array | None:
        """One accepted step from x, or None where none lowers the energy."""
        if residual > self.rule.hold_above:
            self.shift = self.rule.start
        before = self.shift
        for _ in range(8):
            if not self._factorise(model):
                return None
            failed = self.shift > before
            step = self.linear.step(-gradient, self._gap(x))
            whole = 1.0 if self.bound is None else self.bound(x, step)
            fraction, ratio = self._search(x, value, gradient, step, whole, residual)
            if fraction > 0:
                if not failed and ratio > 0.75:
                    self.shift = self.rule.decayed(self.shift, 0.3 if fraction == 1.0 else 1.0)
                elif ratio < 0.25:
                    self.shift = self.rule.raised(self.shift)
                return x + fraction * step
            if self.shift >= self.rule.highest:
                return None
            self.shift = before = self.rule.raised(self.rule.raised(self.shift))
        return None

    def _search(
        self, x: Array, value: float, gradient: Array, step: Array, whole: float, residual: float
    ) -> tuple[float, float]:
        """Fraction of the step that is accepted (0: none) and actual over predicted decrease."""
        # Projected: round-off of C p against large constraint forces would drown a small slope.
        slope = float(self._project(gradient) @ step)
        infeasible = self._infeasibility(x) > 1e-9
        if slope >= 0 and not infeasible:
            return 0.0, 0.0
        fraction = whole
        for _ in range(self.backtracks + 1):
            predicted = -slope * fraction * (1.0 - 0.5 * fraction)
            trial = x + fraction * step
            reached = self.objective.value(trial)
            if math.isfinite(reached):
                decrease = value - reached
                if decrease > 1e-4 * predicted and not infeasible:
                    return fraction, decrease / predicted
                if infeasible:
                    return fraction, 1.0
                if predicted < 1e-11 * abs(value) and self._calms(trial, residual):
                    # Below the noise of the energy only the gradient can tell.
                    return fraction, 1.0
            fraction *= 0.5
        return 0.0, 0.0

    def _calms(self, trial: Array, residual: float) -> bool:
        value, gradient = self.objective.gradient(trial)
        return math.isfinite(value) and self._residual(gradient) < residual

    def _leave_saddle(self, x: Array, value: float, model: QuadraticModel) -> Array | None:
        """None at a minimum; at a saddle a point of lower energy along the most negative eigenvector."""
        if self.linear.factorise(model, self.rule.lowest) or self.escapes >= 5:
            return None
        shift, self.shift = self.shift, self.rule.least
        if not self._factorise(model):
            self.shift = shift
            return None
        pattern, exact = model.pattern, model.values(0.0)
        rng = np.random.default_rng(0)
        vector = self._project(rng.standard_normal(len(x)))
        for _ in range(12):
            vector = self.linear.step(vector, None)
            vector /= np.linalg.norm(vector)
        curvature = float(vector @ pattern.multiply(exact, vector))
        scale = float(np.abs(exact[pattern.diagonal]).max())
        if curvature > -1e-7 * scale:
            return None  # negative only across the constraints
        self.escapes += 1
        whole = self.bound(x, vector) if self.bound is not None else 1.0
        for fraction in (whole, whole / 4, whole / 16, whole / 64):
            for sign in (1.0, -1.0):
                trial = x + sign * fraction * vector
                if self.objective.value(trial) < value:
                    return trial
        return None
