"""An orthotropic material for woven and knitted production fabrics (EST22 §5), in terms of I and II.

Membrane (EST22 eq. 1): ψ = ½ εᵀ K ε + k_n1 (J − 1)² + k_n2 ln² J with ε = (E11, E22, 2 E12), the Green strain
E = ½ (I − 1), and J² = det I.

Bending. EST22 eq. 4 gives edges of a mesh ψ = k_θ κ², with k_θ for the weft, bias and warp directions and
values between them interpolated linearly. For a cylinder, II = κ n nᵀ with n = (cos φ, sin φ), the smooth
quadratic

    ψ = k_weft II11² + k_warp II22² + 2 D12 II11 II22 + 4 D33 II12²
      = κ² (k_weft cos⁴φ + k_warp sin⁴φ + (4 k_bias − k_weft − k_warp) cos²φ sin²φ)

has exactly k_weft κ², k_bias κ² and k_warp κ² in the three directions of curvature, and the same value k κ²
in every direction if the three are equal. Between them it is smooth, unlike linear interpolation in the angle.
Here κ is the curvature of the cylinder. EST22 measures κ = 3θ/H on an edge, H the altitude of
its triangles. On a mesh with rows of edges along the axis, h apart, these edges turn by θ = κ h and the
others do not turn: the measure is 3κ on one edge of every triangle and averages to κ over its three. The
literal sum of edge energies, each times the area of two triangles, is then 9 k_θ κ² per area: multiply
constants estimated with such a mesh by 9.

The cylinder fixes only 2 D12 + 4 D33 = 4 k_bias − k_weft − k_warp =: S. We take D12 = 0 (no coupling of bending
along weft and warp) unless S < 0; then D33 = 0 and D12 = S/2 keep the energy non-negative.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cache
from types import MappingProxyType
from typing import ClassVar

import casadi as ca
import numpy as np

from yarnscale.arrays import Array
from yarnscale.errors import InputError, positive
from yarnscale.shell.materials.material import MaterialKernels, ShellMaterial, compile_material

Energy = Callable[[ca.SX, ca.SX], ca.SX]

BENDING = ("bend_weft", "bend_bias", "bend_warp")
"""Constants of bending [J]."""


@dataclass(frozen=True, kw_only=True)
class DirectionalMaterial(ShellMaterial):
    """A material that bends by direction as the module's text says, with a membrane that its kinds define.

    bend_weft, bend_bias, bend_warp: ψ/κ² of a cylinder curved along that direction [J]. density: mass per area
    [kg/m²]. provenance: its origin, as plain JSON values. Raises InputError if the energy is not bounded below.
    """

    bend_weft: float = 0.0
    bend_bias: float = 0.0
    bend_warp: float = 0.0
    density: float = 0.2
    provenance: Mapping[str, object] = field(default_factory=dict, compare=False)

    MEMBRANE: ClassVar[tuple[str, ...]]
    """Names of the membrane's constants, in the order of the constructor."""
    SIGNED: ClassVar[tuple[str, ...]] = ()
    """Those of them that may be negative."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "provenance", MappingProxyType(dict(self.provenance)))
        for name in self.constants():
            value = float(getattr(self, name))
            if not np.isfinite(value) or (value < 0 and name not in self.SIGNED):
                raise InputError(name, expected="a finite number, not negative", found=value)
            object.__setattr__(self, name, value)
        positive("density", self.density, "a positive number [kg/m²]")
        least = (np.sqrt(self.bend_weft) - np.sqrt(self.bend_warp)) ** 2 / 4
        if self.bend_bias < least * (1 - 1e-12):
            expected = f"at least {least:g} beside the other two"
            raise InputError("bend_bias", expected=expected, found=self.bend_bias)

    @classmethod
    def constants(cls) -> tuple[str, ...]:
        """Names of all constants."""
        return cls.MEMBRANE + BENDING

    @staticmethod
    @abstractmethod
    def membrane_energy(forms: ca.SX, constants: ca.SX) -> ca.SX:
        """ψ [J/m²] of the membrane, of the forms (6) and the constants ``MEMBRANE``."""

    @property
    def bending_coupling(self) -> tuple[float, float]:
        """(D12, D33) of the module's text [J]."""
        surplus = 4 * self.bend_bias - self.bend_weft - self.bend_warp
        return min(surplus, 0.0) / 2, max(surplus, 0.0) / 4

    @property
    def coefficients(self) -> Array:
        """Constants of the membrane and factors of the four terms of bending, (n,)."""
        membrane = [getattr(self, name) for name in self.MEMBRANE]
        return np.array([*membrane, self.bend_weft, self.bend_warp, *self.bending_coupling])

    def derivative(self, constant: str) -> Array:
        """Derivative of ``coefficients`` by one of the constants, (n,)."""
        column = np.zeros(len(self.MEMBRANE) + 4)
        if constant in self.MEMBRANE:
            column[self.MEMBRANE.index(constant)] = 1.0
            return column
        share = {"bend_weft": -1.0, "bend_bias": 4.0, "bend_warp": -1.0}[constant]
        surplus = 4 * self.bend_bias - self.bend_weft - self.bend_warp
        column[-4:-2] = constant == "bend_weft", constant == "bend_warp"
        column[-2:] = (share / 2, 0.0) if surplus < 0 else (0.0, share / 4)
        return column

    def parameters(self, forms: Array) -> Array:
        return self.coefficients[:, None]

    def kernels(self) -> MaterialKernels:
        return _kernels(self.membrane_energy, len(self.MEMBRANE))


@dataclass(frozen=True, eq=False)
class ConstantTerm(ShellMaterial):
    """dψ/d(constant) of a material as an energy density of its own."""

    material: DirectionalMaterial
    constant: str
    density: float = 0.2

    def parameters(self, forms: Array) -> Array:
        return np.append(self.material.coefficients, self.material.derivative(self.constant))[:, None]

    def kernels(self) -> MaterialKernels:
        return _term_kernels(self.material.membrane_energy, len(self.material.MEMBRANE))


@dataclass(frozen=True)
class OrthotropicMaterial(DirectionalMaterial):
    """St. Venant–Kirchhoff cloth with area terms and direction-dependent bending (EST22 eq. 1 and 4).

    stretch_weft (k_xx), stretch_coupling (k_xy), stretch_warp (k_yy), shear (k_ss): entries of K [N/m].
    area (k_n1), log_area (k_n2): stiffness against change of area [N/m]. The rest: ``DirectionalMaterial``.
    """

    stretch_weft: float
    stretch_coupling: float
    stretch_warp: float
    shear: float
    area: float = 0.0
    log_area: float = 0.0

    MEMBRANE = ("stretch_weft", "stretch_coupling", "stretch_warp", "shear", "area", "log_area")
    SIGNED = ("stretch_coupling",)

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.stretch_coupling**2 > self.stretch_weft * self.stretch_warp:
            limit = np.sqrt(self.stretch_weft * self.stretch_warp)
            raise InputError("stretch_coupling", expected=f"at most {limit:g}", found=self.stretch_coupling)

    def __repr__(self) -> str:
        stretch = ", ".join(f"{name}={getattr(self, name):.4g}" for name in ("stretch_weft", "stretch_warp", "shear"))
        return f"OrthotropicMaterial({stretch}, bend_weft={self.bend_weft:.4g}, density={self.density:.4g})"

    @staticmethod
    def membrane_energy(forms: ca.SX, constants: ca.SX) -> ca.SX:
        """EST22 eq. 1."""
        kxx, kxy, kyy, kss, kn1, kn2 = ca.vertsplit(constants)
        exx, eyy, gamma = 0.5 * (forms[0] - 1), 0.5 * (forms[2] - 1), forms[1]
        area, log_area = area_ratio(forms)
        membrane = 0.5 * (kxx * exx * exx + kyy * eyy * eyy + kss * gamma * gamma) + kxy * exx * eyy
        return membrane + kn1 * (area - 1) ** 2 + kn2 * log_area * log_area


def area_ratio(forms: ca.SX) -> tuple[ca.SX, ca.SX]:
    """J and ln J."""
    # A triangle without area gets a very high energy, not NaN.
    guarded = ca.fmax(forms[0] * forms[2] - forms[1] * forms[1], 1e-100)
    return ca.sqrt(guarded), 0.5 * ca.log(guarded)


def _energy(membrane: Energy, count: int) -> Energy:
    """ψ [J/m²] of the forms (6) and of ``coefficients``: the membrane, and bending of four terms."""

    def energy(forms: ca.SX, coefficients: ca.SX) -> ca.SX:
        bend_x, bend_y, d12, d33 = ca.vertsplit(coefficients[count:])
        b11, b12, b22 = ca.vertsplit(forms[3:])
        bending = bend_x * b11 * b11 + bend_y * b22 * b22 + 2 * d12 * b11 * b22 + 4 * d33 * b12 * b12
        return membrane(forms, coefficients[:count]) + bending

    return energy


@cache
def _kernels(membrane: Energy, count: int) -> MaterialKernels:
    return compile_material(_energy(membrane, count), count + 4, f"directional_{count}", shared=True)


@cache
def _term_kernels(membrane: Energy, count: int) -> MaterialKernels:
    """Kernels of the derivative by the coefficients along a direction; parameters are both."""

    def slope(forms: ca.SX, numbers: ca.SX) -> ca.SX:
        at, along = ca.SX.sym("at", count + 4), ca.SX.sym("along", count + 4)
        energy = _energy(membrane, count)(forms, at)
        return ca.substitute(ca.jtimes(energy, at, along), ca.vertcat(at, along), numbers)

    return compile_material(slope, 2 * (count + 4), f"directional_{count}_term", shared=True)


JERSEY = OrthotropicMaterial(
    stretch_weft=60.0,
    stretch_coupling=10.0,
    stretch_warp=90.0,
    shear=20.0,
    area=2.0,
    log_area=2.0,
    bend_weft=2e-6,
    bend_bias=3e-6,
    bend_warp=5e-6,
    density=0.2,
)
"""Something like a light jersey, made up, where no measured material is at hand."""
