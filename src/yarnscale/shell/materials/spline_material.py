"""A homogenized material as a sum of splines of one and two strains (HYLC20 eq. 31–32).

ψ(s, II) = f(s) + [f_x(s, II)]₁₁ + [f_y(s, II)]₂₂ with f of the in-plane strains s and two bending families
f_x = f₃(λ) + Σ_j f_j3(s_j, λ), f_y = f₄(λ) + Σ_j f_j4(s_j, λ) applied to the matrix II. This is eq. 32
without eigenvectors: c² f_x(λ1) + (1 − c²) f_x(λ2) is entry 11 of the matrix function f_x(II).

Where both eigenvalues lie in one spline piece with polynomial q, f(II) = q(II) is a polynomial in the entries
of II: smooth, also where the eigenvalues coincide. Where λ1 > λ2 lie in pieces with polynomials p and q,

    f(II) = q(II) + d(λ1) v1 v1ᵀ,    d = p − q,    [v1 v1ᵀ]₁₁ = c² = ½ (1 + (II11 − II22)/(2ρ)),

and d is small (second order at a shared knot), so rounding is harmless when λ1 and λ2 meet at the knot. The gather
selects the pieces; the symbolic energy contains only q and d (d = 0 within one piece).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cache, cached_property
from types import MappingProxyType

import casadi as ca
import numpy as np

from yarnscale.arrays import Array
from yarnscale.errors import InputError
from yarnscale.shell.materials.material import (
    MaterialKernels,
    ShellMaterial,
    compile_material,
    strains_of_forms,
)
from yarnscale.shell.materials.spline_patches import (
    AXES,
    FAMILY_X,
    FAMILY_Y,
    GUARD,
    ORIGIN_S,
    ORIGIN_X,
    ORIGIN_Y,
    PARAMETER_COUNT,
    PLANE_ROWS,
    PLANES,
    PackedSplines,
    gather_parameters,
    pack_splines,
)
from yarnscale.shell.materials.tables import BicubicSpline, CubicSpline, checked_values


@dataclass(frozen=True, eq=False)
class SplineMaterial(ShellMaterial):
    """Energy density from 5 one-dimensional and 9 two-dimensional splines.

    constant: ψ of the undeformed state [J/m²] without the terms. axes: f_i of s_x, s_a,
    s_y [-], lambda_x, lambda_y [1/m]. planes: f_ij by pair of axes, of which ``PLANES`` are possible; missing
    ones are zero. density: mass per area [kg/m²]. range: sampled box, (5, 2) lowest and highest of each axis
    (default: ends of the knots of the one-dimensional terms). provenance: its origin, as plain JSON
    values. Raises InputError on a wrong number of terms, unknown planes or values that are not finite.
    """

    constant: float
    axes: tuple[CubicSpline, ...]
    planes: Mapping[tuple[int, int], BicubicSpline]
    density: float
    range: Array = None  # type: ignore[assignment]
    provenance: Mapping[str, object] = field(default_factory=dict)

    def __post_init__(self) -> None:
        object.__setattr__(self, "axes", tuple(self.axes))
        if len(self.axes) != len(AXES):
            raise InputError("one-dimensional terms", expected=f"{len(AXES)}", found=len(self.axes))
        unknown = [pair for pair in self.planes if tuple(pair) not in PLANES]
        if unknown:
            raise InputError("two-dimensional terms", expected=f"pairs among {PLANES}", found=unknown)
        object.__setattr__(self, "planes", MappingProxyType(dict(self.planes)))
        object.__setattr__(self, "provenance", MappingProxyType(dict(self.provenance)))
        box = [(f.knots[0], f.knots[-1]) for f in self.axes] if self.range is None else self.range
        box = checked_values(box, (len(AXES), 2), "range")
        if not np.all(box[:, 0] < box[:, 1]):
            raise InputError("range", expected="lowest below highest on every axis", found=box.tolist())
        object.__setattr__(self, "range", box)
        object.__setattr__(self, "constant", float(checked_values(self.constant, (), "constant")))
        object.__setattr__(self, "density", float(checked_values(self.density, (), "density")))
        if self.density <= 0:
            raise InputError("density", expected="a positive number", found=self.density)

    def __repr__(self) -> str:
        box = ", ".join(f"{name} {low:.3g} to {high:.3g}" for name, (low, high) in zip(AXES, self.range, strict=True))
        return f"SplineMaterial({len(self.planes)} planes; {box}; {self.density:.3g} kg/m²)"

    def parameters(self, forms: Array) -> Array:
        parameters = np.zeros((PARAMETER_COUNT, forms.shape[1]))
        gather_parameters(self.packed, forms, forms.shape[1], parameters)
        return parameters

    def kernels(self) -> MaterialKernels:
        return _kernels()

    @cached_property
    def packed(self) -> PackedSplines:
        """All terms on shared knots, as the gather reads them; an argument for ``gather_parameters``."""
        return pack_splines(self.constant, self.axes, self.planes)


def spline_energy(forms: ca.SX, parameters: ca.SX) -> ca.SX:
    """ψ [J/m²] of the forms (6) with the polynomial patches of one element as parameters (eq. 31–32)."""
    strains = strains_of_forms(forms)
    u = [strain - parameters[ORIGIN_S + k] for k, strain in enumerate(ca.vertsplit(strains[:3]))]
    energy = ca.SX(0)
    for k, (i, j) in enumerate(PLANES[:3]):
        patch = _by_first(parameters[PLANE_ROWS + 16 * k : PLANE_ROWS + 16 * (k + 1)], u[i])
        energy += _horner(patch, u[j])
    b11, b12, b22 = strains[3], strains[4], strains[5]
    half = 0.5 * (b11 - b22)
    radius = ca.sqrt(half * half + b12 * b12 + parameters[GUARD])
    largest = 0.5 * (b11 + b22) + radius
    share = 0.5 * (1 + half / radius)  # c², entry 11 of the projector onto the first eigenvector
    for family, origin, diagonal, part in (
        (FAMILY_X, ORIGIN_X, (b11, b12, b22), share),
        (FAMILY_Y, ORIGIN_Y, (b22, b12, b11), 1 - share),
    ):
        base = _family(parameters[family : family + 48], u)
        difference = _family(parameters[family + 48 : family + 96], u)
        energy += _first_entry(base, diagonal, parameters[origin])
        energy += part * _horner(difference, largest - parameters[origin + 1])
    return energy


def _family(patches: ca.SX, u: list[ca.SX]) -> list[ca.SX]:
    """Coefficients by power of λ of a bending family at in-plane strains u (about their origins)."""
    rows = [_by_first(patches[16 * j : 16 * (j + 1)], u[j]) for j in range(3)]
    return [rows[0][b] + rows[1][b] + rows[2][b] for b in range(4)]


def _by_first(patch: ca.SX, u: ca.SX) -> list[ca.SX]:
    """Coefficients in the second variable of a bicubic patch at a value of the first."""
    return [_horner([patch[4 * a + b] for a in range(4)], u) for b in range(4)]


def _horner(c: list[ca.SX], x: ca.SX) -> ca.SX:
    return c[0] + x * (c[1] + x * (c[2] + x * c[3]))


def _first_entry(c: list[ca.SX], matrix: tuple[ca.SX, ca.SX, ca.SX], origin: ca.SX) -> ca.SX:
    """Entry 11 of the cubic Σ c_k X^k of the symmetric matrix X = (m11, m12, m22) − origin·1."""
    x, y, z = matrix[0] - origin, matrix[1], matrix[2] - origin
    square, off = x * x + y * y, y * y
    return c[0] + c[1] * x + c[2] * square + c[3] * (x * square + off * (x + z))


@cache
def _kernels() -> MaterialKernels:
    return compile_material(spline_energy, PARAMETER_COUNT, "spline_material")
