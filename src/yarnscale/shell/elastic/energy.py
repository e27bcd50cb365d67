"""Elastic energy of a mesh: E = Σ area·ψ(I, II), its gradient, and two Hessians with one sparsity pattern.

The exact Hessian is rarely positive definite (nearly half of the triangles of a curled knit are not). The
positive model takes the magnitudes of the eigenvalues of the 6×6 moduli and the tensile part of the
membrane's geometric term. Newton's method uses exact + shift·(positive − exact), from shift 1 towards 0.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import pairwise
from typing import Literal, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from yarnscale.numerics.factor import SymmetricPattern
from yarnscale.numerics.kernel import BLOCK, Kernel
from yarnscale.numerics.threads import available_threads, run_parts
from yarnscale.shell.elastic.density_loops import shared_densities, spline_densities
from yarnscale.shell.elastic.element_loops import (
    add_positive_hessian,
    exact_hessian_of_blocks,
    forms_of_blocks,
    gradient_of_blocks,
)
from yarnscale.shell.elastic.elements import FreeEdges, ShellElements, shell_elements
from yarnscale.shell.elastic.moduli import positive_moduli
from yarnscale.shell.elastic.strain import follow_angles, form_kernels
from yarnscale.shell.materials.spline_material import SplineMaterial
from yarnscale.shell.mesh import TriangleMesh

Floats = NDArray[np.float64]


class ElementKernels(Protocol):
    """Compiled energy density: ``value`` → ψ (1), ``second`` → ψ (1), gradient (6), lower second derivative (21)."""

    @property
    def value(self) -> Kernel: ...

    @property
    def second(self) -> Kernel: ...


@runtime_checkable
class ElementMaterial(Protocol):
    """A material as the cloth solver uses it, see ``shell.materials.material``."""

    @property
    def density(self) -> float: ...

    def parameters(self, forms: Floats) -> Floats: ...

    def kernels(self) -> ElementKernels: ...


class ShellEnergy:
    """Elastic energy of a mesh of one material at positions (nv, 3) [m].

    Fold angles are relative to reference angles stored here; call ``follow`` after every accepted step.
    threads: parts of the mesh that are evaluated in parallel, None for the number of processors.
    """

    def __init__(
        self,
        mesh: TriangleMesh,
        material: ElementMaterial,
        *,
        free_edges: FreeEdges = "extrapolate",
        threads: int | None = None,
    ) -> None:
        self.mesh, self.material = mesh, material
        self.elements = shell_elements(mesh, free_edges=free_edges)
        self.pattern, self._slots = _pattern_and_slots(self.elements, mesh.vertex_count)
        blocks = self.elements.blocks
        self._forms, self._densities = np.empty((blocks, 6, BLOCK)), np.empty((blocks, BLOCK))
        self._nothing = np.empty((0, 0, 0))
        count = min(available_threads() if threads is None else threads, max(1, blocks // LEAST_BLOCKS))
        ends = np.linspace(0, blocks, count + 1).round().astype(int)
        self._parts = [slice(begin, end) for begin, end in pairwise(ends)]

    @property
    def masses(self) -> Floats:
        """Lumped mass of every vertex [kg], (nv,)."""
        return self.mesh.vertex_areas * self.material.density

    def follow(self, positions: Floats) -> float:
        """Let the reference angles follow the motion; the largest |fold angle| [rad]."""
        elements = self.elements

        def part(blocks: slice) -> float:
            return follow_angles(positions, elements.stencils[blocks], elements.geometry[blocks])

        return max(run_parts(part, self._parts))

    def value(self, positions: Floats) -> float:
        """Energy [J]; inf for inadmissible states."""
        total = float(np.vdot(self._evaluated(positions), self.elements.areas))
        return total if np.isfinite(total) else np.inf

    def densities(self, positions: Floats) -> Floats:
        """ψ of every element [J/m²], (blocks, BLOCK)."""
        return self._evaluated(positions).copy()

    def _evaluated(self, positions: Floats) -> Floats:
        elements, nothing = self.elements, self._nothing
        address = form_kernels().value.address

        def part(blocks: slice) -> None:
            stencils, geometry = elements.stencils[blocks], elements.geometry[blocks]
            forms_of_blocks(positions, stencils, geometry, address, nothing, self._forms[blocks])
            self._evaluate(self._forms[blocks], self._densities[blocks], nothing, nothing)

        run_parts(part, self._parts)
        return self._densities

    def linearise(self, positions: Floats, into: Linearisation | None = None) -> Linearisation:
        """Energy, gradient and data of the Hessians; ``into`` is overwritten to reuse its memory."""
        elements = self.elements
        result = into if into is not None else Linearisation(self)
        result.positions = np.array(positions, dtype=np.float64)
        address = form_kernels().jacobian.address

        def part(blocks: slice) -> Floats:
            stencils, geometry = elements.stencils[blocks], elements.geometry[blocks]
            jacobian, stress = result.jacobian[blocks], result.stress[blocks]
            forms_of_blocks(result.positions, stencils, geometry, address, jacobian, self._forms[blocks])
            self._evaluate(self._forms[blocks], self._densities[blocks], stress, result.moduli[blocks])
            gradient = np.zeros_like(result.positions)
            gradient_of_blocks(jacobian, stress, elements.areas[blocks], stencils, gradient)
            return gradient

        result.gradient = sum_of(run_parts(part, self._parts))
        total = float(np.vdot(self._densities, elements.areas))
        result.value = total if np.isfinite(total) else np.inf
        return result

    def exact_hessian(self, linear: Linearisation) -> Floats:
        """Entries of the Hessian in ``pattern`` [N/m]."""
        elements = self.elements
        address = form_kernels().curvature.address

        def part(blocks: slice) -> Floats:
            values = np.zeros(self.pattern.entries + 1)  # the last one collects what belongs nowhere
            exact_hessian_of_blocks(
                linear.positions, elements.stencils[blocks], elements.geometry[blocks], elements.areas[blocks],
                linear.jacobian[blocks], linear.stress[blocks], linear.moduli[blocks], address,
                self._slots[blocks], values,
            )  # fmt: skip
            return values

        return sum_of(run_parts(part, self._parts))[:-1]

    def positive_hessian(self, linear: Linearisation) -> tuple[Floats, int]:
        """Entries of the positive model in ``pattern`` [N/m], and how many moduli were indefinite."""
        return self._positive(linear, linear.stress)

    def rate_stiffness(self, linear: Linearisation) -> Floats:
        """Entries of Σ area·Jᵀ|C|J in ``pattern`` [N/m] for viscous damping; zero for rigid motions."""
        return self._positive(linear, np.zeros_like(linear.stress))[0]

    def _positive(self, linear: Linearisation, stress: Floats) -> tuple[Floats, int]:
        elements = self.elements

        def part(blocks: slice) -> tuple[Floats, int]:
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

    def _evaluate(self, forms: Floats, densities: Floats, stress: Floats, moduli: Floats) -> None:
        """Densities of blocks and, if ``moduli`` is not empty, their derivatives."""
        material, kernels = self.material, self.material.kernels()
        kernel = kernels.second if len(moduli) else kernels.value
        if isinstance(material, SplineMaterial):
            spline_densities(
                material.packed, material.parameter_count, kernel.address, forms, densities, stress, moduli
            )
            return
        constants = np.ascontiguousarray(material.parameters(forms[0]))
        shared_densities(constants, kernel.address, forms, densities, stress, moduli)


LEAST_BLOCKS = 4
"""Least number of blocks of elements per thread."""


def sum_of(arrays: list[Floats]) -> Floats:
    """The sum of arrays, in the first of them."""
    total = arrays[0]
    for array in arrays[1:]:
        total += array
    return total


@dataclass(eq=False)
class Linearisation:
    """Energy [J], gradient (nv, 3) [N] and per-element derivatives at one state."""

    energy: ShellEnergy = field(repr=False)
    value: float = field(init=False, default=0.0)
    positions: Floats = field(init=False, repr=False)
    gradient: Floats = field(init=False, repr=False)
    jacobian: Floats = field(init=False, repr=False)
    stress: Floats = field(init=False, repr=False)
    moduli: Floats = field(init=False, repr=False)

    def __post_init__(self) -> None:
        blocks = self.energy.elements.blocks
        self.jacobian = np.empty((blocks, 108, BLOCK))
        self.stress = np.empty((blocks, 6, BLOCK))
        self.moduli = np.empty((blocks, 21, BLOCK))

    def hessian(self, kind: Literal["exact", "positive"] = "exact") -> Floats:
        """Entries of the Hessian in the pattern of the energy [N/m]."""
        return self.energy.exact_hessian(self) if kind == "exact" else self.energy.positive_hessian(self)[0]


def _pattern_and_slots(
    elements: ShellElements, vertex_count: int
) -> tuple[SymmetricPattern, NDArray[np.int32]]:
    """Pattern of the 3nv unknowns, and slots of the 171 entries of each element, (nb, B, 171)."""
    size = 3 * vertex_count
    stencils = elements.stencils.reshape(-1, 6)
    unknowns = (3 * stencils[:, :, None] + np.arange(3)).reshape(-1, 18)
    present = np.repeat(elements.present.reshape(-1, 6), 3, axis=1)
    row, column = np.tril_indices(18)
    first, second = unknowns[:, row], unknowns[:, column]
    keys = np.minimum(first, second) * size + np.maximum(first, second)
    matters = present[:, row] & present[:, column]
    diagonal = np.arange(size) * (size + 1)
    unique = np.unique(np.concatenate([keys[matters], diagonal]))
    slots = np.where(matters, np.searchsorted(unique, keys), len(unique)).astype(np.int32)
    return SymmetricPattern.from_keys(size, unique), slots.reshape(*elements.areas.shape, 171)
