"""Derivatives of a constrained minimum by linear solves, never through iterations.

At a minimum x*(p) of E(x, p) under linear constraints, dx*/dp = −K⁺ E,xp and
d²E*/dp² = E,pp − E,px K⁺ E,xp, with K⁺ the inverse of the Hessian on the constraints' null space.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from yarnscale.numerics.kkt import QuadraticModel
from yarnscale.numerics.newton import Constraints, linear_solver

Array = NDArray[np.float64]


class ConstrainedInverse:
    """K⁺ of a quadratic model at a minimum: one factorisation, then one refined solve per right-hand side."""

    def __init__(
        self,
        model: QuadraticModel,
        constraints: Constraints | None = None,
        *,
        shift: float = 1e-8,
        backend: str | None = None,
    ) -> None:
        """shift: smallest regularisation; raised until the factorisation succeeds, and undone by refinement."""
        self._model, self._constraints = model, constraints
        self._solver = linear_solver(constraints, backend)
        self._exact = model.values(0.0)
        while not self._solver.factorise(model, shift):
            shift = max(10.0 * shift, 1e-12)
            if shift > 1e3:
                raise ArithmeticError("the Hessian cannot be factored with any reasonable shift")

    def _project(self, columns: Array) -> Array:
        return columns if self._constraints is None else self._constraints.project(columns)

    def apply(self, right: Array, *, tolerance: float = 1e-10, max_iterations: int = 200) -> Array:
        """K⁺ right for columns (n, k), by conjugate gradients preconditioned with the shifted factor."""
        return np.column_stack([self._solve(c, tolerance, max_iterations) for c in np.atleast_2d(right.T)])

    def _solve(self, right: Array, tolerance: float, max_iterations: int) -> Array:
        residual = self._project(right)
        goal = tolerance * float(np.linalg.norm(residual))
        x = np.zeros_like(residual)
        if goal == 0.0:
            return x
        direction, rho = np.zeros_like(residual), 1.0
        for iteration in range(max_iterations):
            if float(np.linalg.norm(residual)) <= goal:
                return x
            preconditioned = self._solver.step(residual, None)
            previous, rho = rho, float(residual @ preconditioned)
            direction = preconditioned + (rho / previous if iteration else 0.0) * direction
            image = self._project(self._model.pattern.multiply(self._exact, direction))
            curvature = float(direction @ image)
            if curvature <= 0:
                raise ArithmeticError("the Hessian is not positive definite on the constraints: no minimum")
            x = x + rho / curvature * direction
            residual = residual - rho / curvature * image
        if float(np.linalg.norm(residual)) > 1e3 * goal:
            raise ArithmeticError(
                f"the solve stopped short of its tolerance after {max_iterations} iterations"
            )
        return x
