"""Equilibria of a shell of orthotropic material whose vertices are free or held, and their derivatives.

Held coordinates are eliminated, so the forces that hold them are exact: they are the gradient of the energy there.
At an equilibrium x(p) a measure m(x, p) has the derivative m,p − E,px K⁻¹ m,x (K the Hessian of the free
coordinates): one solve for a measure, whatever the number of constants. E,xp is the gradient of dψ/dp.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from yarnscale.arrays import Array, Flags
from yarnscale.numerics.affine import FreeUnknowns, KeptPull, MappedObjective
from yarnscale.numerics.implicit import ConstrainedInverse
from yarnscale.numerics.kernel import BLOCK
from yarnscale.numerics.kkt import ConstrainedSolver
from yarnscale.numerics.newton import NewtonOptions, Objective, Solution, minimise
from yarnscale.numerics.regularisation import ShiftedHessian, ShiftRule
from yarnscale.numerics.sums import Load, SumOfEnergies
from yarnscale.shell.elastic.element_loops import gradient_of_blocks
from yarnscale.shell.elastic.energy import Linearisation, ShellEnergy, ShellObjective
from yarnscale.shell.materials.material import ShellMaterial
from yarnscale.shell.materials.orthotropic import ConstantTerm, DirectionalMaterial, OrthotropicMaterial
from yarnscale.shell.mesh import TriangleMesh

TOLERANCE = 1e-8
"""Of the residual, relative to the forces that hold the shell."""
EXACT_FIRST = ShiftRule(start=0.0, lowest=1e-6, highest=1.0, growth=2.0, least=0.125, decay=0.2, lowest_is_zero=True)
"""From the exact Hessian (0) towards the positive model (1) only where it is needed: starts are near."""


@dataclass(frozen=True, eq=False)
class HeldEquilibrium:
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

    def __init__(self, mesh: TriangleMesh, free: Flags) -> None:
        self.mesh = mesh
        self.energy = ShellEnergy(mesh, OrthotropicMaterial(1.0, 0.0, 1.0, 1.0))
        self.free = np.flatnonzero(free.ravel())
        self._elastic = ShellObjective(self.energy)
        self._pull = KeptPull(FreeUnknowns(self.free, np.zeros(free.size)))
        self._linear = ConstrainedSolver()

    def solve(
        self, material: ShellMaterial, start: Array, *, gravity: Sequence[float] = (0, 0, 0), iterations: int = 80
    ) -> HeldEquilibrium:
        """Equilibrium from positions (nv, 3) whose held coordinates stay; gravity [m/s²]."""
        self.energy.material = material
        self.energy.follow(start)
        free = FreeUnknowns(self.free, start.ravel().astype(np.float64))
        weight = material.density * self.mesh.vertex_areas[:, None] * np.asarray(gravity, np.float64)
        whole = SumOfEnergies(self._elastic, [Load(weight.ravel(), free.state)])
        solution = minimise(
            _HeldObjective(whole, free, self._pull), free.state[self.free],
            NewtonOptions(TOLERANCE, max_iterations=iterations, shift=EXACT_FIRST), linear=self._linear,
            after_step=lambda x: self.energy.follow(free.expand(x).reshape(-1, 3)),
        )  # fmt: skip
        positions = free.expand(solution.x).reshape(-1, 3)
        exact = self.energy.linearise(positions).hessian("exact") if solution.converged else None
        stable = exact is not None and self._linear.factorise(self._free_part(exact), 0.0)
        return HeldEquilibrium(positions, solution, stable)

    def forces(self, material: ShellMaterial, positions: Array) -> Array:
        """Forces that hold a weightless shell where it is [N], (nv, 3)."""
        self.energy.material = material
        return self.energy.linearise(positions).gradient

    def derivatives(
        self, material: DirectionalMaterial, positions: Array, measures: Sequence[Measure], constants: Sequence[str]
    ) -> Array:
        """d(measure)/d(constant) at an equilibrium, shape (measures, constants)."""
        self.energy.material = material
        linear = self.energy.linearise(positions)
        exact = linear.hessian("exact")
        directions = []
        for measure in measures:
            right = measure.by_positions.ravel().copy()
            if measure.held is not None:
                right += self.energy.pattern.multiply(exact, measure.held.ravel())
            directions.append(right[self.free])
        adjoint = ConstrainedInverse(self._free_part(exact), shift=0.0).apply(np.column_stack(directions))
        mixed = self._gradients_by(material, linear, constants)
        result = -adjoint.T @ mixed[:, self.free].T
        for row, measure in enumerate(measures):
            if measure.held is not None:
                result[row] += mixed @ measure.held.ravel()
        return result

    def derivatives_of(
        self,
        material: DirectionalMaterial,
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

    def _gradients_by(self, material: DirectionalMaterial, linear: Linearisation, constants: Sequence[str]) -> Array:
        """Gradient of dE/d(constant), (constants, 3nv)."""
        elements = self.energy.elements
        forms = elements.forms(linear.positions)
        density = np.empty((1, BLOCK))
        stress = np.empty_like(linear.stress)
        result = np.zeros((len(constants), *linear.positions.shape))
        for row, name in enumerate(constants):
            term = ConstantTerm(material, name)
            kernels, parameters = term.kernels(), term.parameters(forms)
            for block in range(elements.blocks):
                kernels.first(BLOCK, BLOCK, forms[block], parameters, density, stress[block])
            gradient_of_blocks(linear.jacobian, stress, elements.areas, elements.stencils, result[row])
        return result.reshape(len(constants), -1)

    def _free_part(self, entries: Array) -> ShiftedHessian:
        pull = self._pull.of(self.energy.pattern)
        return ShiftedHessian(pull.pattern, pull.entries(entries))


class _HeldObjective(MappedObjective):
    """Energy of the free coordinates; residuals are relative to the forces that hold the others."""

    def __init__(self, whole: Objective, free: FreeUnknowns, pull: KeptPull) -> None:
        super().__init__(whole, free, pull=pull)
        self._holding = 1.0

    @property
    def residual_scale(self) -> float:
        """Norm of the forces that hold the other coordinates [N]."""
        return self._holding

    def _pulled(self, gradient: Array) -> Array:
        free = super()._pulled(gradient)
        self._holding = max(float(np.sqrt(max(gradient @ gradient - free @ free, 0.0))), 1e-12)
        return free
