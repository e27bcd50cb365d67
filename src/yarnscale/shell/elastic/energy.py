"""Elastic energy of a mesh: E = Σ area·ψ(I, II), its gradient, and two Hessians with one sparsity pattern.

The exact Hessian is rarely positive definite (nearly half of the triangles of a curled knit are not). The
positive model takes the magnitudes of the eigenvalues of the 6×6 moduli and the tensile part of the
membrane's geometric term. Newton's method uses exact + shift·(positive − exact), from shift 1 towards 0.
"""

from __future__ import annotations

from functools import cache
from itertools import pairwise
from typing import Literal

import numpy as np

from yarnscale.arrays import Array
from yarnscale.numerics.block_pattern import SKIPPED, BlockPattern
from yarnscale.numerics.kernel import BLOCK
from yarnscale.numerics.threads import available_threads, run_parts
from yarnscale.shell.elastic.density_loops import shared_densities, spline_densities
from yarnscale.shell.elastic.element_loops import (
    add_positive_hessian,
    exact_hessian_of_blocks,
    forms_of_blocks,
    gradient_of_blocks,
)
from yarnscale.shell.elastic.elements import FreeEdges, shell_elements
from yarnscale.shell.elastic.moduli import positive_moduli
from yarnscale.shell.elastic.strain import follow_angles, form_kernels
from yarnscale.shell.materials.history import ElementFriction
from yarnscale.shell.materials.material import ShellMaterial
from yarnscale.shell.mesh import TriangleMesh


class ShellEnergy:
    """Elastic energy of a mesh of one material at positions (nv, 3) [m].

    Fold angles are relative to reference angles stored here; call ``follow`` after every accepted step. Of a material
    with friction it is the energy of the next step, whose beginning ``begin_step`` sets; until then without friction.
    threads: parts of the mesh that are evaluated in parallel, None for the number of processors.
    """

    def __init__(
        self,
        mesh: TriangleMesh,
        material: ShellMaterial,
        *,
        free_edges: FreeEdges = "extrapolate",
        threads: int | None = None,
    ) -> None:
        self.mesh, self.material = mesh, material
        self.elements = shell_elements(mesh, free_edges=free_edges)
        unknowns = np.where(
            np.repeat(self.elements.present, 3, axis=2),
            (3 * self.elements.stencils[..., None] + np.arange(3)).reshape(-1, BLOCK, 18),
            SKIPPED,
        ).reshape(-1, 18)
        blocks = BlockPattern.of(np.full(mesh.vertex_count, 3), [unknowns])
        self.pattern = blocks.pattern
        self._slots = np.ascontiguousarray(blocks.slots(unknowns).transpose(0, 2, 1))
        count = self.elements.blocks
        self.friction = ElementFriction.of(material)
        # Sliders without limits, until a step begins: the energy without friction.
        self.memory = np.zeros((count, 0 if self.friction is None else self.friction.size, BLOCK))
        self._forms, self._densities = np.empty((count, 6, BLOCK)), np.empty((count, BLOCK))
        self._nothing = np.empty((0, 0, 0))
        parts = min(available_threads() if threads is None else threads, max(1, count // LEAST_BLOCKS))
        ends = np.linspace(0, count, parts + 1).round().astype(int)
        self._parts = [slice(begin, end) for begin, end in pairwise(ends)]

    @property
    def masses(self) -> Array:
        """Lumped mass of every vertex [kg], (nv,)."""
        return self.mesh.vertex_areas * self.material.density

    def follow(self, positions: Array) -> float:
        """Update the reference angles to positions (nv, 3); the largest |fold angle| [rad]."""
        elements = self.elements

        def part(blocks: slice) -> float:
            return follow_angles(positions, elements.stencils[blocks], elements.geometry[blocks])

        return max(run_parts(part, self._parts))

    def begin_step(self, positions: Array, memory: Array | None) -> None:
        """Set the memory of friction with which the next step begins; None: slack springs at positions (nv, 3)."""
        if self.friction is not None:
            if memory is None:
                memory = self.friction.slack(self.elements.forms(positions))
            self.memory = np.ascontiguousarray(memory)

    def remembered(self, positions: Array) -> Array | None:
        """Memory of friction (blocks, M, BLOCK) after the step to positions (nv, 3); None without friction."""
        return None if self.friction is None else self.friction.after(self.elements.forms(positions), self.memory)[0]

    def value(self, positions: Array) -> float:
        """Energy [J]; inf for inadmissible states."""
        total = float(np.vdot(self._evaluated(positions), self.elements.areas))
        return total if np.isfinite(total) else np.inf

    def stored(self, positions: Array) -> float:
        """Energy [J] of ψ and of the springs of friction, with the memory of the step's beginning.

        ``value`` is less by the energy of springs beyond their new limits, and includes that of sliding in the step.
        """
        if self.friction is None:
            return self.value(positions)
        memory, self.memory = self.memory, self.friction.unlimited(self.memory)
        found, self.memory = self.value(positions), memory
        return found

    def densities(self, positions: Array) -> Array:
        """ψ of every element [J/m²], (blocks, BLOCK)."""
        return self._evaluated(positions).copy()

    def _evaluated(self, positions: Array) -> Array:
        elements, nothing = self.elements, self._nothing
        address = form_kernels().value.address

        def part(blocks: slice) -> None:
            stencils, geometry = elements.stencils[blocks], elements.geometry[blocks]
            forms_of_blocks(positions, stencils, geometry, address, nothing, self._forms[blocks])
            self._evaluate(blocks, self._densities[blocks], nothing, nothing)

        run_parts(part, self._parts)
        return self._densities

    def linearise(self, positions: Array, into: Linearisation | None = None, *, moduli: bool = True) -> Linearisation:
        """Energy, gradient and data of the Hessians, if wanted; ``into`` is overwritten to reuse its memory."""
        elements = self.elements
        result = into if into is not None else Linearisation(self)
        result.positions = np.array(positions, dtype=np.float64)
        address = form_kernels().jacobian.address

        def part(blocks: slice) -> Array:
            stencils, geometry = elements.stencils[blocks], elements.geometry[blocks]
            jacobian, stress = result.jacobian[blocks], result.stress[blocks]
            forms_of_blocks(result.positions, stencils, geometry, address, jacobian, self._forms[blocks])
            second = result.moduli[blocks] if moduli else self._nothing
            self._evaluate(blocks, self._densities[blocks], stress, second)
            gradient = np.zeros_like(result.positions)
            gradient_of_blocks(jacobian, stress, elements.areas[blocks], stencils, gradient)
            return gradient

        result.gradient = sum_of(run_parts(part, self._parts))
        total = float(np.vdot(self._densities, elements.areas))
        result.value = total if np.isfinite(total) else np.inf
        return result

    def exact_hessian(self, linear: Linearisation) -> Array:
        """Entries of the Hessian in ``pattern`` [N/m]."""
        elements = self.elements
        address = form_kernels().curvature.address

        def part(blocks: slice) -> Array:
            values = np.zeros(self.pattern.entries + 1)  # the last one, at −1, collects what is skipped
            exact_hessian_of_blocks(
                linear.positions, elements.stencils[blocks], elements.geometry[blocks], elements.areas[blocks],
                linear.jacobian[blocks], linear.stress[blocks], linear.moduli[blocks], address,
                self._slots[blocks], values,
            )  # fmt: skip
            return values

        return sum_of(run_parts(part, self._parts))[:-1]

    def positive_hessian(self, linear: Linearisation, *, geometric: bool = True) -> tuple[Array, int]:
        """Entries of the positive model in ``pattern`` [N/m], and how many moduli were indefinite.

        geometric: without, Σ area·Jᵀ|C|J, which viscous damping takes: zero for rigid motions.
        """
        elements, stress = self.elements, linear.stress if geometric else np.zeros_like(linear.stress)

        def part(blocks: slice) -> tuple[Array, int]:
            values = np.zeros(self.pattern.entries + 1)
            positive, indefinite = np.empty((36, BLOCK)), 0
            # Two calls a block: compiled as one, the eigenvalues take four times longer.
            for b in range(blocks.start, blocks.stop):
                indefinite += positive_moduli(linear.moduli[b], positive)
                add_positive_hessian(
                    elements.geometry[b], elements.areas[b], linear.jacobian[b], stress[b], positive,
                    self._slots[b], values,
                )  # fmt: skip
            return values, indefinite

        found = run_parts(part, self._parts)
        return sum_of([values for values, _ in found])[:-1], sum(count for _, count in found)

    def _evaluate(self, blocks: slice, densities: Array, stress: Array, moduli: Array) -> None:
        """Densities of blocks and, where there is room for them, their derivatives."""
        material, forms = self.material, self._forms[blocks]
        kernels = material.kernels() if self.friction is None else self.friction.kernels.step
        kernel = kernels.second if len(moduli) else kernels.first if len(stress) else kernels.value
        if material.packed is not None:
            return spline_densities(material.packed, kernel.address, forms, densities, stress, moduli)
        constants = material.parameters(forms[0]) if self.friction is None else self.friction.parameters
        shared_densities(
            np.ascontiguousarray(constants), self.memory[blocks], kernel.address, forms, densities, stress, moduli
        )


LEAST_BLOCKS = 4
"""Least number of blocks of elements per thread."""


def sum_of(arrays: list[Array]) -> Array:
    """The sum of arrays, in the first of them."""
    total = arrays[0]
    for array in arrays[1:]:
        total += array
    return total


class Linearisation:
    """Energy [J], gradient (nv, 3) [N] and per-element derivatives at one state."""

    positions: Array
    gradient: Array
    value: float

    def __init__(self, energy: ShellEnergy) -> None:
        shapes = ((energy.elements.blocks, count, BLOCK) for count in (108, 6, 21))
        self.energy = energy
        self.jacobian, self.stress, self.moduli = map(np.empty, shapes)

    def hessian(self, kind: Literal["exact", "positive"] = "exact") -> Array:
        """Entries of the Hessian in the pattern of the energy [N/m]."""
        return self.energy.exact_hessian(self) if kind == "exact" else self.energy.positive_hessian(self)[0]


class ShellObjective:
    """An elastic energy [J] as one of the coordinates of its vertices, for sums of energies; a model is valid until the
    next one is made.

    guests: points after those of the cloth that have no elastic energy. softness: share of the largest diagonal entry
    that is added to all of them: flat cloth at rest has no stiffness across its plane.
    """

    def __init__(self, energy: ShellEnergy, *, guests: int = 0, softness: float = 0.0) -> None:
        self._energy, self._guests, self.softness = energy, 3 * guests, softness
        self._size = energy.pattern.size
        self.pattern = energy.pattern.widened(3 * guests) if guests else energy.pattern
        self.entries = np.empty(self.pattern.entries)
        self._model: Linearisation | None = None
        self._trial: Linearisation | None = None

    def value(self, x: Array) -> float:
        return self._energy.value(x[: self._size].reshape(-1, 3))

    def gradient(self, x: Array) -> tuple[float, Array]:
        # Its own memory: a model made by ``quadratic`` may still be in use.
        self._trial = self._energy.linearise(x[: self._size].reshape(-1, 3), self._trial, moduli=False)
        return self._trial.value, self._padded(self._trial.gradient)

    def quadratic(self, x: Array) -> tuple[float, Array, ShellModel]:
        self._model = self._energy.linearise(x[: self._size].reshape(-1, 3), self._model)
        return self._model.value, self._padded(self._model.gradient), ShellModel(self, self._model)

    def _padded(self, gradient: Array) -> Array:
        return np.concatenate([gradient.ravel(), np.zeros(self._guests)])


class ShellModel:
    """Hessian H + shift·(P − H), P the positive model, each made when it is needed; shift from 0, 1 and more alike."""

    def __init__(self, objective: ShellObjective, linear: Linearisation) -> None:
        self.pattern, self._softness = objective.pattern, objective.softness
        self.entries = objective.entries
        self.entries.fill(0.0)
        self._hessian = cache(linear.hessian)

    def values(self, shift: float) -> Array:
        share, values = min(max(shift, 0.0), 1.0), self.entries.copy()
        if share in (0.0, 1.0):
            elastic = self._hessian("positive" if share else "exact")
        else:
            elastic = (1.0 - share) * self._hessian("exact") + share * self._hessian("positive")
        values[: len(elastic)] += elastic
        if self._softness:
            diagonal = self.pattern.diagonal
            values[diagonal] += self._softness * float(np.abs(elastic[diagonal[diagonal < len(elastic)]]).max())
        return values
