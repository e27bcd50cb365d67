"""A shell material with friction along a path: the energy of its next step, and what it remembers after that."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache
from typing import NamedTuple

import casadi as ca
import numpy as np

from yarnscale.arrays import Array
from yarnscale.errors import InputError
from yarnscale.numerics.kernel import LANES, Kernel, compile_kernel
from yarnscale.shell.materials.compact import CompactMaterial, compact_energy, shapes_of
from yarnscale.shell.materials.friction import limits, sliding
from yarnscale.shell.materials.material import (
    MaterialKernels,
    ShellMaterial,
    compile_material,
    forms_of_strains,
    strains_of_forms,
)


class FrictionKernels(NamedTuple):
    """Compiled energy of a step over (forms (6), parameters (P, all elements share them), memory (2K)).

    step: ψ + w and its derivatives. after: → memory after the step (2K), energy of springs [J/m²].
    """

    step: MaterialKernels
    after: Kernel


@dataclass(frozen=True, eq=False)
class ElementFriction:
    """A material with friction as elements use it: compiled kernels and their parameters (P, 1).

    The memory (..., M, n) of n elements holds the places of all sliders, then their limits.
    """

    kernels: FrictionKernels
    parameters: Array
    directions: Array

    @classmethod
    def of(cls, material: object) -> ElementFriction | None:
        """Of a shell material; None where it has no friction."""
        if not isinstance(material, CompactMaterial) or material.sliders is None:
            return None
        sliders = material.sliders
        steps, springs, walls = (len(getattr(material.springs, n)) for n in ("steps", "springs", "walls"))
        kernels = _kernels(steps, springs, walls, bool(material.mirrored), sliders.count)
        parameters = np.concatenate([material.constants, sliders.numbers[:, None]])
        return cls(kernels, parameters, sliders.directions / material.scale)

    @property
    def size(self) -> int:
        """Numbers M that an element remembers."""
        return 2 * len(self.directions)

    def slack(self, forms: Array) -> Array:
        """Memory of elements with forms (blocks, 6, n) whose springs are slack; n a multiple of LANES."""
        memory, _ = self.after(forms, np.zeros((len(forms), self.size, forms.shape[2])))
        a, b = np.sqrt(forms[:, 0]), np.sqrt(forms[:, 2])
        strains = np.concatenate([np.stack([a - 1, forms[:, 1] / (a * b), b - 1], axis=1), forms[:, 3:]], axis=1)
        memory[:, : len(self.directions)] = self.directions @ strains
        return memory

    def after(self, forms: Array, memory: Array) -> tuple[Array, Array]:
        """Memory after a step to forms (blocks, 6, n) that began with one (blocks, M, n); energy of springs [J/m²]."""
        new, stored, count = np.empty_like(memory), np.empty((len(forms), 1, forms.shape[2])), forms.shape[2]
        for b in range(len(forms)):
            self.kernels.after(count, count, forms[b], self.parameters, memory[b], new[b], stored[b])
        return new, stored


@cache
def _kernels(steps: int, springs: int, walls: int, mirrored: bool, count: int) -> FrictionKernels:
    shapes = shapes_of(steps, springs, walls)
    elastic = 7 + sum(int(np.prod(shape)) for shape in shapes)
    size = elastic + 13 * count

    def energy(forms: ca.SX, numbers: ca.SX, memory: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX]:
        strains, scale = strains_of_forms(forms), numbers[1:7]
        psi, stress, moduli = compact_energy(strains, numbers[:elastic], shapes, mirrored=mirrored)
        slid = sliding(scale * strains, numbers[elastic:], memory)
        return psi + slid.energy, stress + scale * slid.gradient, moduli + slid.hessian * (scale @ scale.T)

    name = f"friction_{steps}_{springs}_{count}"
    forms, numbers, memory = (ca.SX.sym(n, k) for n, k in (("forms", 6), ("numbers", size), ("memory", 2 * count)))
    strains, scale = strains_of_forms(forms), numbers[1:7]
    stress = compact_energy(strains, numbers[:elastic], shapes, mirrored=mirrored)[1] / scale
    slid = sliding(scale * strains, numbers[elastic:], memory)
    outputs = [ca.vertcat(slid.places, limits(stress, numbers[elastic:])), slid.stored]
    after = ca.Function(f"{name}_after", [forms, numbers, memory], outputs, {"cse": True})
    step = compile_material(energy, size, name, shared=True, memory_count=2 * count)
    return FrictionKernels(step, compile_kernel(after, after.name(), shared=(1,)))


@dataclass(frozen=True, eq=False)
class MaterialHistory(ShellMaterial):
    """A material with friction after some path, as the material of the next step: ψ + w and its derivatives.

    memory: (2K, 1). strain: (6,) at the end of the path, force: the stress there (6,). stored: energy of ψ and the
    springs there [J/m²]; dissipated: by friction in the last step, never negative [J/m²].
    """

    material: ShellMaterial
    friction: ElementFriction
    memory: Array
    strain: Array
    force: Array
    stored: float
    dissipated: float = 0.0

    @classmethod
    def begin(cls, material: ShellMaterial, strain: Array) -> MaterialHistory:
        """A path that begins at a strain (6,) with slack springs. Raises InputError for a material without friction."""
        friction, strain = ElementFriction.of(material), np.array(strain, np.float64)
        if friction is None:
            raise InputError("friction", expected="a shell material with friction", found=type(material).__name__)
        memory, stored = friction.slack(_eight(strain))[0, :, :1], float(material.energy_density(strain))
        return cls(material, friction, memory, strain, material.stress(strain), stored)

    @property
    def density(self) -> float:  # type: ignore[override]
        """Mass per area [kg/m²]."""
        return self.material.density

    @property
    def strain_scale(self) -> Array:
        """That of the material."""
        return self.material.strain_scale

    def parameters(self, forms: Array) -> Array:
        return self.friction.parameters

    def kernels(self) -> MaterialKernels:
        return self.friction.kernels.step

    def remembered(self, count: int) -> tuple[Array, ...]:
        """The memory of so many elements."""
        return (np.repeat(self.memory, count, axis=1),)

    def after(self, strain: Array) -> MaterialHistory:
        """The history after a step to a strain (6,)."""
        strain = np.array(strain, np.float64)
        memory, stored = self.friction.after(_eight(strain), self.remembered(LANES)[0][None])
        before, after = self.energy_density(np.stack([self.strain, strain])).tolist()
        new = float(self.material.energy_density(strain)) + float(stored[0, 0, 0])
        lost = (self.stored - before) + (after - new)
        return replace(
            self, memory=memory[0, :, :1], strain=strain, force=self.stress(strain), stored=new, dissipated=lost
        )  # fmt: skip

    def step(self, solve: Callable[[MaterialHistory, Array], Array | None]) -> MaterialHistory | None:
        """The history at the strain (6,) that a solve finds from here; None where it finds none."""
        strain = solve(self, self.strain)
        return None if strain is None else self.after(strain)


def _eight(strain: Array) -> Array:
    """Forms (1, 6, LANES) of a strain (6,)."""
    return np.repeat(forms_of_strains(strain[None]).T[None], LANES, axis=2)
