"""Which solver of linear systems suits which constraints."""

from __future__ import annotations

from yarnscale.numerics.kkt import ConstrainedSolver, LinearConstraints
from yarnscale.numerics.null_space import ChainConstraints, NullSpaceSolver
from yarnscale.numerics.saddle import SaddleSolver, SparseConstraints

Constraints = LinearConstraints | SparseConstraints | ChainConstraints
LinearSolver = ConstrainedSolver | SaddleSolver | NullSpaceSolver


def linear_solver(constraints: Constraints | None) -> LinearSolver:
    """The solver of KKT systems that suits the constraints."""
    if isinstance(constraints, SparseConstraints):
        return SaddleSolver(constraints)
    if isinstance(constraints, ChainConstraints):
        return NullSpaceSolver(constraints)
    return ConstrainedSolver(constraints)
