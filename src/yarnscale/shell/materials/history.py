"""A shell material with friction along a path: the energy of its next step, and its memory after that."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from yarnscale.arrays import Array
from yarnscale.errors import InputError
from yarnscale.numerics.kernel import LANES, Kernel, compile_kernel
from yarnscale.shell.materials.compact import (
    CompactMaterial,
    compact_energy,
    images_of,
    network_of,
    shapes_of,
    step,
)
from yarnscale.shell.materials.friction import Sliding, limits, sliding, unpacked
from yarnscale.shell.materials.material import (
    MaterialKernels,
    ShellMaterial,
    compile_material,
    forms_of_strains,
    strains_of_forms,
)

_UNLIMITED = 1e9
"""Limit of springs that hold any extension."""


class FrictionKernels(NamedTuple):
    """Compiled energy of a step over (forms (6), parameters (P, all elements share them), memory (M)).

    step: ψ + w and its derivatives. after: → memory after the step (M), energy of springs [J/m²].
    """

    step: MaterialKernels
    after: Kernel


@dataclass(frozen=True, eq=False)
class ElementFriction:
    """A material with friction as elements use it: compiled kernels and their parameters (P, 1).

    The memory (..., M, n) of n elements holds the places of all sliders, then their limits on either side; all once
    more for the mirror image, where the material has one (images: 2). size: M.
    """

    kernels: FrictionKernels
    parameters: Array
    size: int
    images: int

    @classmethod
    def of(cls, material: object) -> ElementFriction | None:
        """Of a shell material; None where it has no friction."""
        if not isinstance(material, CompactMaterial) or material.sliders is None:
            return None
        sliders, mirrored = material.sliders, bool(material.mirrored)
        images = len(images_of(mirrored))
        kernels = _kernels(*material.springs.counts, mirrored, sliders.count)
        parameters = np.concatenate([material.constants, sliders.numbers[:, None]])
        return cls(kernels, parameters, 3 * sliders.count * images, images)

    def slack(self, forms: Array) -> Array:
        """Memory of elements with forms (blocks, 6, n) whose springs are slack; n a multiple of LANES."""
        # Springs without limits follow their sliders at once.
        return self.after(forms, np.zeros((len(forms), self.size, forms.shape[2])))[0]

    def unlimited(self, memory: Array) -> Array:
        """The memory of springs that hold any extension: with it ψ + w is the energy that is stored."""
        sliders = memory.shape[-2] // 3 // self.images
        parts = memory.reshape(*memory.shape[:-2], self.images, 3, sliders, memory.shape[-1]).copy()
        parts[..., 1:, :, :] = _UNLIMITED
        return parts.reshape(memory.shape)

    def after(self, forms: Array, memory: Array) -> tuple[Array, Array]:
        """Memory after a step to forms (blocks, 6, n) that began with one (blocks, M, n); energy of springs [J/m²]."""
        new, stored, count = np.empty_like(memory), np.empty((len(forms), 1, forms.shape[2])), forms.shape[2]
        for b in range(len(forms)):
            self.kernels.after(count, count, forms[b], self.parameters, memory[b], new[b], stored[b])
        return new, stored


@cache
def _kernels(steps: int, springs: int, walls: int, mirrored: bool, count: int) -> FrictionKernels:
    shapes, images = shapes_of(steps, springs, walls), images_of(mirrored)
    elastic = 7 + sum(int(np.prod(shape)) for shape in shapes)
    size = elastic + (20 + steps) * count

    def slid(strains: ca.SX, numbers: ca.SX, memory: ca.SX) -> tuple[Any, list[Sliding]]:
        """The sliders, and how they slide in each image of the strains."""
        network = network_of(numbers[:elastic], shapes)[2]
        sliders, x = unpacked(numbers[elastic:], count, steps), numbers[1:7] * strains
        return sliders, [
            _image(ca.DM(sign) * x, network, sliders, part)
            for sign, part in zip(images, ca.vertsplit(memory, 3 * count), strict=True)
        ]

    def energy(forms: ca.SX, numbers: ca.SX, memory: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX]:
        strains, scale = strains_of_forms(forms), numbers[1:7]
        psi, stress, moduli = compact_energy(strains, numbers[:elastic], shapes, mirrored=mirrored)
        for sign, part in zip(images, slid(strains, numbers, memory)[1], strict=True):
            signed = sign * scale / len(images)
            psi += part.energy / len(images)
            stress += signed * part.gradient
            moduli += part.hessian * (signed @ signed.T) * len(images)
        return psi, stress, moduli

    name = f"friction_{steps}_{springs}_{count}"
    memory = ca.SX.sym("memory", 3 * count * len(images))
    forms, numbers = ca.SX.sym("forms", 6), ca.SX.sym("numbers", size)
    strains = strains_of_forms(forms)
    stress = compact_energy(strains, numbers[:elastic], shapes, mirrored=mirrored)[1] / numbers[1:7]
    sliders, parts = slid(strains, numbers, memory)
    # The memory of an image holds limits by the stress of that image.
    new = [entry for sign, part in zip(images, parts, strict=True)
           for entry in (part.places, limits(ca.DM(sign) * stress, sliders))]  # fmt: skip
    outputs = [ca.vertcat(*new), sum(part.stored for part in parts) / len(images)]
    after = ca.Function(f"{name}_after", [forms, numbers, memory], outputs, {"cse": True})
    step_kernels = compile_material(energy, size, name, shared=True, memory_count=memory.numel())
    return FrictionKernels(step_kernels, compile_kernel(after, after.name(), shared=(1,)))


def _image(x: ca.SX, network: Any, sliders: Any, memory: ca.SX) -> Sliding:
    return sliding(x, step(network.step_offsets + network.steps @ x), network.steps, sliders, memory)


@dataclass(frozen=True, eq=False)
class MaterialHistory(ShellMaterial):
    """A material with friction after some path, as the material of the next step: ψ + w and its derivatives.

    memory: (M, 1). strain: (6,) at the end of the path, force: the stress there (6,). stored: energy of ψ and the
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
        return self.material.density

    @property
    def strain_scale(self) -> Array:
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
