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

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cache
from types import MappingProxyType

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from yarnscale.errors import InputError
from yarnscale.shell.materials.material import MaterialKernels, ShellMaterial, compile_material

Array = NDArray[np.float64]

PARAMETER_COUNT = 10


@dataclass(frozen=True)
class OrthotropicMaterial(ShellMaterial):
    """St. Venant–Kirchhoff cloth with area terms and direction-dependent bending (EST22 eq. 1 and 4).

    stretch_weft (k_xx), stretch_coupling (k_xy), stretch_warp (k_yy), shear (k_ss): entries of K [N/m].
    area (k_n1), log_area (k_n2): stiffness against change of area [N/m].
    bend_weft, bend_bias, bend_warp: ψ/κ² of a cylinder curved along that direction [J].
    density: mass per area [kg/m²]. provenance: its origin, as plain JSON values.
    Raises InputError if the energy is not bounded below.
    """

    stretch_weft: float
    stretch_coupling: float
    stretch_warp: float
    shear: float
    area: float = 0.0
    log_area: float = 0.0
    bend_weft: float = 0.0
    bend_bias: float = 0.0
    bend_warp: float = 0.0
    density: float = 0.2
    provenance: Mapping[str, object] = field(default_factory=dict, compare=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "provenance", MappingProxyType(dict(self.provenance)))
        for name in CONSTANTS:
            value = float(getattr(self, name))
            if not np.isfinite(value) or (value < 0 and name != "stretch_coupling"):
                raise InputError(name, expected="a finite number, not negative", found=value)
            object.__setattr__(self, name, value)
        if not (np.isfinite(self.density) and self.density > 0):
            raise InputError("density", expected="a positive number [kg/m²]", found=self.density)
        if self.stretch_coupling**2 > self.stretch_weft * self.stretch_warp:
            limit = np.sqrt(self.stretch_weft * self.stretch_warp)
            raise InputError("stretch_coupling", expected=f"at most {limit:g}", found=self.stretch_coupling)
        least = (np.sqrt(self.bend_weft) - np.sqrt(self.bend_warp)) ** 2 / 4
        if self.bend_bias < least * (1 - 1e-12):
            expected = f"at least {least:g} beside the other two"
            raise InputError("bend_bias", expected=expected, found=self.bend_bias)

    def __repr__(self) -> str:
        stretch = ", ".join(
            f"{name}={getattr(self, name):.4g}" for name in ("stretch_weft", "stretch_warp", "shear")
        )
        return f"OrthotropicMaterial({stretch}, bend_weft={self.bend_weft:.4g}, density={self.density:.4g})"

    @property
    def bending_coupling(self) -> tuple[float, float]:
        """(D12, D33) of the module's text [J]."""
        surplus = 4 * self.bend_bias - self.bend_weft - self.bend_warp
        return min(surplus, 0.0) / 2, max(surplus, 0.0) / 4

    @property
    def coefficients(self) -> Array:
        """Factors of the ten terms of which ψ is the sum, (10,)."""
        membrane = [self.stretch_weft, self.stretch_coupling, self.stretch_warp, self.shear]
        bending = [self.bend_weft, self.bend_warp, *self.bending_coupling]
        return np.array([*membrane, self.area, self.log_area, *bending])

    def derivative(self, constant: str) -> Array:
        """Derivative of ``coefficients`` by one of ``CONSTANTS``, (10,), the factors of ``OrthotropicTerm``."""
        column = np.zeros(PARAMETER_COUNT)
        index = CONSTANTS.index(constant)
        if index < 6:
            column[index] = 1.0
            return column
        share = {"bend_weft": -1.0, "bend_bias": 4.0, "bend_warp": -1.0}[constant]
        surplus = 4 * self.bend_bias - self.bend_weft - self.bend_warp
        column[6:8] = constant == "bend_weft", constant == "bend_warp"
        column[8:] = (share / 2, 0.0) if surplus < 0 else (0.0, share / 4)
        return column

    def parameters(self, forms: Array) -> Array:
        return self.coefficients[:, None]

    def kernels(self) -> MaterialKernels:
        return _kernels()


@dataclass(frozen=True, eq=False)
class OrthotropicTerm(ShellMaterial):
    """dψ/d(constant) of an orthotropic material as an energy density of its own, since ψ is linear in most constants.

    coefficients: factors of the ten terms, (10,), from ``OrthotropicMaterial.derivative``.
    """

    coefficients: Array
    density: float = 0.2

    def parameters(self, forms: Array) -> Array:
        return self.coefficients[:, None]

    def kernels(self) -> MaterialKernels:
        return _kernels()


CONSTANTS = (
    "stretch_weft",
    "stretch_coupling",
    "stretch_warp",
    "shear",
    "area",
    "log_area",
    "bend_weft",
    "bend_bias",
    "bend_warp",
)
"""Names of the material constants, in the order of the constructor."""


def orthotropic_energy(forms: ca.SX, parameters: ca.SX) -> ca.SX:
    """ψ [J/m²] of the forms (6) with the constants of the material as parameters (10)."""
    kxx, kxy, kyy, kss, kn1, kn2, bend_x, bend_y, d12, d33 = ca.vertsplit(parameters)
    i11, i12, i22, b11, b12, b22 = ca.vertsplit(forms)
    exx, eyy, gamma = 0.5 * (i11 - 1), 0.5 * (i22 - 1), i12
    determinant = i11 * i22 - i12 * i12
    # A triangle without area gets a very high energy, not NaN.
    guarded = ca.fmax(determinant, 1e-100)
    area, log_area = ca.sqrt(guarded), 0.5 * ca.log(guarded)
    membrane = 0.5 * (kxx * exx * exx + kyy * eyy * eyy + kss * gamma * gamma) + kxy * exx * eyy
    area_terms = kn1 * (area - 1) ** 2 + kn2 * log_area * log_area
    bending = bend_x * b11 * b11 + bend_y * b22 * b22 + 2 * d12 * b11 * b22 + 4 * d33 * b12 * b12
    return membrane + area_terms + bending


@cache
def _kernels() -> MaterialKernels:
    return compile_material(orthotropic_energy, PARAMETER_COUNT, "orthotropic_material", shared=True)


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
