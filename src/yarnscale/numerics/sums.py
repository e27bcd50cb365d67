"""Sums of energies: what a cell, a step of cloth, of rods or of splines minimises.

    E(x) + Σ ½ (x − c)ᵀ W (x − c) − load·x + …

E is an energy of stencils with a sparse Hessian. The other terms (inertia, springs, loads, contact with bodies) are
cheap; their Hessians have a place in the pattern of that of E. Newton's method asks for H + shift·M.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

from yarnscale.arrays import Array
from yarnscale.numerics.factor import SymmetricPattern
from yarnscale.numerics.kkt import QuadraticModel


class SummedModel(QuadraticModel, Protocol):
    """A second-order model that further terms can be added to."""

    entries: Array
    """Entries in ``pattern`` of what every shift has in common."""


class Energy(Protocol):
    """An energy of n unknowns with a sparse Hessian; inf where the state is not admissible.

    gradient, quadratic: energy, gradient (n,) and second-order model, both the caller's.
    """

    def value(self, x: Array) -> float: ...
    def gradient(self, x: Array) -> tuple[float, Array]: ...
    def quadratic(self, x: Array) -> tuple[float, Array, SummedModel]: ...


class Term(Protocol):
    """An energy whose Hessian has a place in the pattern of another.

    gradient: the energy; adds the gradient to ``gradient``. hessian: adds the Hessian too, or a positive model of it,
    to the entries of a matrix.
    """

    def value(self, x: Array) -> float: ...
    def gradient(self, x: Array, gradient: Array) -> float: ...
    def hessian(self, x: Array, gradient: Array, pattern: SymmetricPattern, entries: Array) -> float: ...


@dataclass(frozen=True, eq=False)
class Springs:
    """½ (x − centre)ᵀ W (x − centre) of the first k unknowns, centre (k,): springs, or masses in an implicit step.

    weight: (k,) of a diagonal W; else the entries of W in a pattern that the pattern of the sum begins with, and
    times: the product of W with a vector (k,).
    """

    weight: Array
    centre: Array
    times: Callable[[Array], Array] | None = None

    def _pulled(self, x: Array) -> tuple[Array, Array]:
        away = x[: len(self.centre)] - self.centre
        return away, self.weight * away if self.times is None else self.times(away)

    def value(self, x: Array) -> float:
        away, pull = self._pulled(x)
        return 0.5 * float(pull @ away)

    def gradient(self, x: Array, gradient: Array) -> float:
        away, pull = self._pulled(x)
        gradient[: len(pull)] += pull
        return 0.5 * float(pull @ away)

    def hessian(self, x: Array, gradient: Array, pattern: SymmetricPattern, entries: Array) -> float:
        count = len(self.weight)
        entries[pattern.diagonal[:count] if self.times is None else slice(count)] += self.weight
        return self.gradient(x, gradient)


@dataclass(frozen=True, eq=False)
class Load:
    """Energy −force·(x − origin) of constant forces on the first k unknowns (k,)."""

    force: Array
    origin: Array | float = 0.0

    def value(self, x: Array) -> float:
        return -float(self.force @ (x[: len(self.force)] - self.origin))

    def gradient(self, x: Array, gradient: Array) -> float:
        gradient[: len(self.force)] -= self.force
        return self.value(x)

    def hessian(self, x: Array, gradient: Array, pattern: SymmetricPattern, entries: Array) -> float:
        return self.gradient(x, gradient)


class SumOfEnergies:
    """An energy and further terms; an objective for ``newton.minimise``. residual_scale: gradient norm that is 1."""

    def __init__(self, energy: Energy, terms: Sequence[Term], residual_scale: float = 1.0) -> None:
        self.energy, self.terms, self._scale = energy, terms, residual_scale

    @property
    def residual_scale(self) -> float:
        return self._scale

    def value(self, x: Array) -> float:
        total = sum(term.value(x) for term in self.terms)
        return total + self.energy.value(x) if math.isfinite(total) else math.inf

    def gradient(self, x: Array) -> tuple[float, Array]:
        value, gradient = self.energy.gradient(x)
        return value + sum(term.gradient(x, gradient) for term in self.terms), gradient

    def quadratic(self, x: Array) -> tuple[float, Array, QuadraticModel]:
        value, gradient, model = self.energy.quadratic(x)
        value += sum(term.hessian(x, gradient, model.pattern, model.entries) for term in self.terms)
        return value, gradient, model


def add_diagonal_blocks(pattern: SymmetricPattern, entries: Array, blocks: Array) -> None:
    """Add symmetric blocks (k, 3, 3) on the diagonal of the first 3k unknowns.

    Unknowns that meet come in threes: below the diagonal of a column come first the other rows of its block.
    """
    diagonal = pattern.diagonal[: 3 * len(blocks)].reshape(-1, 3)
    for column in range(3):
        for row in range(column, 3):
            entries[diagonal[:, column] + row - column] += blocks[:, row, column]
