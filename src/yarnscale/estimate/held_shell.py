"""Equilibria of a shell of orthotropic material whose vertices are free or held, and their derivatives.

Held coordinates are eliminated, so the forces that hold them are exact: they are the gradient of the energy there.
At an equilibrium x(p) a measure m(x, p) has the derivative m,p − E,px K⁻¹ m,x (K the Hessian of the free
coordinates): one solve for a measure, whatever the number of constants. The energy is linear in the
constants of the material, so E,xp is its gradient with other coefficients.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from yarnscale.numerics.factor import SymmetricPattern, factorisation
from yarnscale.numerics.implicit import ConstrainedInverse
from yarnscale.numerics.kernel import BLOCK
from yarnscale.numerics.newton import ShiftRule, Solution, minimise
from yarnscale.shell.elastic.element_loops import gradient_of_blocks
from yarnscale.shell.elastic.energy import Linearisation, ShellEnergy
from yarnscale.shell.materials.material import ShellMaterial
from yarnscale.shell.materials.orthotropic import OrthotropicMaterial
from yarnscale.shell.mesh import TriangleMesh

Array = NDArray[np.float64]

TOLERANCE = 1e-8
"""Of the residual, relative to the forces that hold the shell."""
EXACT_FIRST = ShiftRule(
    start=0.0, lowest=1e-6, highest=1.0, growth=2.0, least=0.125, decay=0.2, lowest_is_zero=True
)
"""From the exact Hessian (0) towards the positive model (1) only where it is needed: starts are near."""


@dataclass(frozen=True, eq=False)
class Equilibrium:
    """Positions at rest (nv, 3) [m] and how they were found.

    stable: whether the energy is convex there; soft cloth in compression may buckle within its plane, element by
    element, which no fit should follow.
    """

    positions: Array
    solution: Solution
    stable: bool

    @property
    def converged(self) -> bool:
        """Whether the residual is below the tolerance at a minimum."""
        return self.solution.converged and self.stable


@dataclass(frozen=True, eq=False)
class Measure:
    """A scalar measured on a state: its value, its derivative by the positions (nv, 3) and by the forces that hold.

    held: weights of the gradient of the energy, (nv, 3), zero where coordinates are free; None for measures of
    shape alone.
    """

    value: float
    by_positions: Array
    held: Array | None = None


class HeldShell:
    """A panel with free and held coordinates; ``free`` is a mask (nv, 3)."""

    def __init__(self, mesh: TriangleMesh, free: NDArray[np.bool_]) -> None:
        self.mesh = mesh
        self.energy = ShellEnergy(mesh, OrthotropicMaterial(1.0, 0.0, 1.0, 1.0))
        self.free = np.flatnonzero(free.ravel())
        self.pattern, self._chosen = _restricted(self.energy.pattern, self.free)
        self._factor = factorisation(self.pattern)

    def solve(
        self,
        material: ShellMaterial,
        start: Array,
        *,
        gravity: Sequence[float] = (0, 0, 0),
        iterations: int = 80,
    ) -> Equilibrium:
        """Equilibrium from positions (nv, 3) whose held coordinates stay; gravity [m/s²]."""
        self.energy.material = material
        self.energy.follow(start)
        objective = _HeldObjective(self, np.array(start, np.float64), self._load(material, gravity))
        solution = minimise(
            objective, start.ravel()[self.free], after_step=lambda x: self._follow(objective.full(x)),
            tolerance=TOLERANCE, max_iterations=iterations, shift=EXACT_FIRST,
        )  # fmt: skip
        positions = objective.full(solution.x)
        stable = solution.converged and self._is_minimum(positions)
        return Equilibrium(positions, solution, stable)

    def forces(self, material: ShellMaterial, positions: Array) -> Array:
        """Forces that hold a weightless shell where it is [N], (nv, 3)."""
        self.energy.material = material
        return self.energy.linearise(positions).gradient

    def derivatives(
        self,
        material: OrthotropicMaterial,
        positions: Array,
        measures: Sequence[Measure],
        constants: Sequence[str],
    ) -> Array:
        """d(measure)/d(constant) at an equilibrium, shape (measures, constants)."""
        self.energy.material = material
        linear = self.energy.linearise(positions)
        model = _HeldModel(self, linear)
        exact = linear.hessian("exact")
        directions = []
        for measure in measures:
            right = measure.by_positions.ravel().copy()
            if measure.held is not None:
                right += self.energy.pattern.multiply(exact, measure.held.ravel())
            directions.append(right[self.free])
        adjoint = ConstrainedInverse(model, shift=0.0).apply(np.column_stack(directions))
        mixed = self._gradients_by(material, linear, constants)
        result = -adjoint.T @ mixed[:, self.free].T
        for row, measure in enumerate(measures):
            if measure.held is not None:
                result[row] += mixed @ measure.held.ravel()
        return result

    def derivatives_of(
        self,
        material: OrthotropicMaterial,
        states: Iterable[tuple[Array, bool]],
        measures: Callable[[Array], Sequence[Measure]],
        constants: Sequence[str],
    ) -> Array:
        """``derivatives`` of what is measured at positions, (states, measures, constants); NaN without equilibrium.

        states: positions (nv, 3) and whether they are an equilibrium.
        """
        found = []
        for positions, converged in states:
            measured = measures(positions)
            none = np.full((len(measured), len(constants)), np.nan)
            found.append(self.derivatives(material, positions, measured, constants) if converged else none)
        return np.array(found)

    def _gradients_by(
        self, material: OrthotropicMaterial, linear: Linearisation, constants: Sequence[str]
    ) -> Array:
        """Gradient of dE/d(constant), (constants, 3nv)."""
        elements, kernels = self.energy.elements, material.kernels()
        forms = elements.forms(linear.positions)
        density, moduli = np.empty((1, BLOCK)), np.empty((21, BLOCK))
        stress = np.empty_like(linear.stress)
        result = np.zeros((len(constants), *linear.positions.shape))
        for row, name in enumerate(constants):
            factors = material.derivative(name)[:, None]
            for block in range(elements.blocks):
                kernels.second(BLOCK, BLOCK, forms[block], factors, density, stress[block], moduli)
            gradient_of_blocks(linear.jacobian, stress, elements.areas, elements.stencils, result[row])
        return result.reshape(len(constants), -1)

    def _is_minimum(self, positions: Array) -> bool:
        return self._factor.factor(_HeldModel(self, self.energy.linearise(positions)).values(0.0))

    def _follow(self, positions: Array) -> None:
        self.energy.follow(positions)

    def _load(self, material: ShellMaterial, gravity: Sequence[float]) -> Array:
        return material.density * self.mesh.vertex_areas[:, None] * np.asarray(gravity, np.float64)


@dataclass(eq=False)
class _HeldObjective:
    """Energy of the free coordinates; residuals are relative to the forces that hold the others."""

    shell: HeldShell
    positions: Array
    load: Array
    residual_scale: float = 1.0

    def full(self, x: Array) -> Array:
        positions = self.positions.copy().ravel()
        positions[self.shell.free] = x
        return positions.reshape(-1, 3)

    def value(self, x: Array) -> float:
        positions = self.full(x)
        return self.shell.energy.value(positions) - float(np.vdot(self.load, positions - self.positions))

    def gradient(self, x: Array) -> tuple[float, Array]:
        return self._linearise(x)[:2]

    def quadratic(self, x: Array) -> tuple[float, Array, _HeldModel]:
        value, gradient, linear = self._linearise(x)
        return value, gradient, _HeldModel(self.shell, linear)

    def _linearise(self, x: Array) -> tuple[float, Array, Linearisation]:
        positions = self.full(x)
        linear = self.shell.energy.linearise(positions)
        gradient = (linear.gradient - self.load).ravel()
        free = gradient[self.shell.free]
        self.residual_scale = max(float(np.sqrt(max(gradient @ gradient - free @ free, 0.0))), 1e-12)
        value = linear.value - float(np.vdot(self.load, positions - self.positions))
        return value, free, linear


@dataclass(eq=False)
class _HeldModel:
    """Hessian of the free coordinates, exact + shift·(positive − exact)."""

    shell: HeldShell
    linear: Linearisation

    @property
    def pattern(self) -> SymmetricPattern:
        return self.shell.pattern

    @cached_property
    def exact(self) -> Array:
        return self.linear.hessian("exact")[self.shell._chosen]

    @cached_property
    def positive(self) -> Array:
        return self.linear.hessian("positive")[self.shell._chosen]

    def values(self, shift: float) -> Array:
        share = min(max(shift, 0.0), 1.0)
        return self.exact.copy() if share == 0.0 else (1.0 - share) * self.exact + share * self.positive


def _restricted(
    pattern: SymmetricPattern, free: NDArray[np.int64]
) -> tuple[SymmetricPattern, NDArray[np.int64]]:
    """Pattern of the rows and columns ``free``, and which entries of the whole it keeps."""
    number = np.full(pattern.size, -1)
    number[free] = np.arange(len(free))
    columns = number[np.repeat(np.arange(pattern.size), np.diff(pattern.starts))]
    rows = number[pattern.rows]
    chosen = np.flatnonzero((columns >= 0) & (rows >= 0))
    keys = columns[chosen] * len(free) + rows[chosen]
    return SymmetricPattern.from_keys(len(free), keys), chosen
