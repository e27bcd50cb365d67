"""Derivatives of a constrained minimum by linear solves, never through iterations.

At a minimum x*(p) of E(x, p) under linear constraints, dx*/dp = −K⁺ E,xp and
d²E*/dp² = E,pp − E,px K⁺ E,xp, with K⁺ the inverse of the Hessian on the constraints' null space.
"""

from __future__ import annotations

import numpy as np
from scipy.sparse.linalg import LinearOperator, cg

from yarnscale.arrays import Array
from yarnscale.numerics.kkt import QuadraticModel
from yarnscale.numerics.linear_solver import Constraints, linear_solver

_TOLERANCE, _ITERATIONS = 1e-10, 200
"""Of the conjugate gradients of every column."""


class ConstrainedInverse:
    """K⁺ of a quadratic model at a minimum: one factorisation, then one refined solve per right-hand side."""

    def __init__(self, model: QuadraticModel, constraints: Constraints | None = None, *, shift: float = 1e-8) -> None:
        """shift: smallest regularisation; raised until the factorisation succeeds, and undone by refinement."""
        self._model, self._constraints = model, constraints
        self._solver = linear_solver(constraints)
        self._exact = model.values(0.0)
        while not self._solver.factorise(model, shift):
            shift = max(10.0 * shift, 1e-12)
            if shift > 1e3:
                raise ArithmeticError("the Hessian cannot be factored with any reasonable shift")

    def _project(self, columns: Array) -> Array:
        return columns if self._constraints is None else self._constraints.project(columns)

    def apply(self, right: Array) -> Array:
        """K⁺ right for columns (n, k), by conjugate gradients preconditioned with the shifted factor."""
        return np.column_stack([self._solve(column) for column in np.atleast_2d(right.T)])

    def _solve(self, right: Array) -> Array:
        right, shape = self._project(right), (len(right), len(right))

        def times(direction: Array) -> Array:
            image = self._project(self._model.pattern.multiply(self._exact, direction))
            if not direction @ image > 0:
                raise ArithmeticError("the Hessian is not positive definite on the constraints: no minimum")
            return image

        matrix = LinearOperator(shape, matvec=times, dtype=np.float64)  # type: ignore[call-arg]

        def precondition(residual: Array) -> Array:
            return self._solver.step(residual, None)

        inverse = LinearOperator(shape, matvec=precondition, dtype=np.float64)  # type: ignore[call-arg]
        x, short = cg(matrix, right, rtol=_TOLERANCE, atol=0.0, maxiter=_ITERATIONS, M=inverse)
        if short and np.linalg.norm(right - times(x)) > 1e3 * _TOLERANCE * np.linalg.norm(right):
            raise ArithmeticError(f"the solve stopped short of its tolerance after {_ITERATIONS} iterations")
        return x
