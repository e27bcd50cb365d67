"""A homogenized material as a sum of splines of one and two strains (HYLC20 eq. 31–32).

ψ(s, II) = f(s) + [f_x(s, II)]₁₁ + [f_y(s, II)]₂₂ with f of the in-plane strains s and two bending families
f_x = f₃(λ) + Σ_j f_j3(s_j, λ), f_y = f₄(λ) + Σ_j f_j4(s_j, λ) applied to the matrix II. This is eq. 32
without eigenvectors: c² f_x(λ1) + (1 − c²) f_x(λ2) is entry 11 of the matrix function f_x(II).

Where both eigenvalues lie in one spline piece with polynomial q, f(II) = q(II) is a polynomial in the entries
of II: smooth, also where the eigenvalues coincide. Where λ1 > λ2 lie in pieces with polynomials p and q,

    f(II) = q(II) + d(λ1) v1 v1ᵀ,    d = p − q,    [v1 v1ᵀ]₁₁ = c² = ½ (1 + (II11 − II22)/(2ρ)),

and d is small (second order at a shared knot), so nothing is lost when λ1 and λ2 meet at the knot. The gather
decides which pieces; the symbolic energy only sees q and d (d = 0 within one piece).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cache, cached_property
from types import MappingProxyType
from typing import NamedTuple

import casadi as ca
import numba
import numpy as np
from numpy.typing import NDArray

from yarnscale.errors import InputError
from yarnscale.numerics.kernel import LANES
from yarnscale.shell.inside import SHAPES, SOLIDS, InsideTerms
from yarnscale.shell.material import MaterialKernels, ShellMaterial, compile_material
from yarnscale.shell.tables import (
    BicubicSpline,
    CubicSpline,
    checked_values,
    find_interval,
    origins,
    padded_knots,
    union_knots,
)

Array = NDArray[np.float64]

AXES = ("s_x", "s_a", "s_y", "lambda_x", "lambda_y")
"""Names of the five strains the terms depend on, in the order of their indices."""
PLANES = ((0, 1), (0, 2), (1, 2), (0, 3), (1, 3), (2, 3), (0, 4), (1, 4), (2, 4))
"""Axes of the nine two-dimensional terms; there is no lambda_x–lambda_y term."""

# Rows of an element's parameters: origins of s_x, s_a, s_y; origin of q and knot of d for both families; a
# guard that keeps ρ away from zero where d = 0; three in-plane patches; for each family three patches of q
# and three of d.
_ORIGIN_S, _ORIGIN_X, _ORIGIN_Y, _GUARD, _PLANE, _FAMILY_X, _FAMILY_Y = 0, 3, 5, 7, 8, 56, 152
PARAMETER_COUNT = 248
# More rows where three in-plane strains act together: origins, coefficients of the splines of three strains, and
# for each family the coefficients of its shapes in q and in d.
_ORIGIN_INSIDE, _SOLIDS = 248, 251
_SHAPES_X = _SOLIDS + 64 * SOLIDS
_SHAPES_Y = _SHAPES_X + 8 * SHAPES
INSIDE_PARAMETER_COUNT = _SHAPES_Y + 8 * SHAPES

# Below this fraction of the knots' span, eigenvalues count as equal (the difference to the exact function is
# of second order in it, and zero away from knots).
MEETING = 1e-8


@dataclass(frozen=True, eq=False)
class SplineMaterial(ShellMaterial):
    """Energy density from 5 one-dimensional and 9 two-dimensional splines.

    constant: ψ of the undeformed state [J/m²], apart from what the terms add there. axes: f_i of s_x, s_a,
    s_y [-], lambda_x, lambda_y [1/m]. planes: f_ij by pair of axes, of which ``PLANES`` are possible; missing
    ones are zero. density: mass per area [kg/m²]. range: sampled box, (5, 2) lowest and highest of each axis
    (default: ends of the knots of the one-dimensional terms). provenance: where it comes from, as plain JSON
    values. inside: terms of all three in-plane strains, if any. Raises InputError on a wrong number of terms,
    unknown planes or values that are not finite.
    """

    constant: float
    axes: tuple[CubicSpline, ...]
    planes: Mapping[tuple[int, int], BicubicSpline]
    density: float
    range: Array = None  # type: ignore[assignment]
    provenance: Mapping[str, object] = field(default_factory=dict)
    inside: InsideTerms | None = None

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

    @property
    def parameter_count(self) -> int:
        return PARAMETER_COUNT if self.inside is None else INSIDE_PARAMETER_COUNT

    def gather(self, forms: Array, count: int, parameters: Array) -> None:
        _gather(self.packed, forms, count, parameters)

    def kernels(self) -> MaterialKernels:
        return _kernels() if self.inside is None else _inside_kernels()

    @cached_property
    def packed(self) -> PackedSplines:
        """All terms on shared knots, as the gather reads them; an argument for ``gather_parameters``."""
        return _pack(self)


class PackedSplines(NamedTuple):
    """Spline patches of a material on shared knots; ``knots`` are padded, ``origins`` are those of the
    intervals.

    Two-dimensional tables have shape (intervals, intervals, 16); one-dimensional terms are folded into them.
    Where there are terms of three strains, they have knots of their own, solids (intervals, intervals, intervals,
    SOLIDS · 64), and shapes (intervals, SHAPES · 4) on the shared bending knots.
    """

    knots_x: Array
    knots_a: Array
    knots_y: Array
    knots_bend_x: Array
    knots_bend_y: Array
    origins_x: Array
    origins_a: Array
    origins_y: Array
    origins_bend_x: Array
    origins_bend_y: Array
    plane_xa: Array
    plane_xy: Array
    plane_ay: Array
    bend_xx: Array
    bend_ax: Array
    bend_yx: Array
    bend_xy: Array
    bend_ay: Array
    bend_yy: Array
    has_inside: bool
    inside_knots_x: Array
    inside_knots_a: Array
    inside_knots_y: Array
    inside_origins_x: Array
    inside_origins_a: Array
    inside_origins_y: Array
    solids: Array
    shapes_x: Array
    shapes_y: Array


def _pack(material: SplineMaterial) -> PackedSplines:
    knots, inside = [], material.inside
    shapes = ((), (), (), inside.shapes_x, inside.shapes_y) if inside is not None else ((),) * 5
    for axis in range(5):
        found = [material.axes[axis].knots, *(shape.knots for shape in shapes[axis])]
        found += [term.knots_u for (u, _), term in material.planes.items() if u == axis]
        found += [term.knots_v for (_, v), term in material.planes.items() if v == axis]
        knots.append(union_knots(*found))
    single = [f.refined_table(k) for f, k in zip(material.axes, knots, strict=True)]
    tables = []
    for u, v in PLANES:
        term = material.planes.get((u, v))
        shape = (len(knots[u]) + 1, len(knots[v]) + 1, 4, 4)
        table = np.zeros(shape) if term is None else term.refined_table(knots[u], knots[v])
        if (u, v) == (0, 1):
            table[..., 0, 0] += material.constant
            table[..., :, 0] += single[0][:, None]
            table[..., 0, :] += single[1][None]
        elif (u, v) in ((0, 2), (0, 3), (0, 4)):
            table[..., 0, :] += single[v][None]
        tables.append(np.ascontiguousarray(table.reshape(*shape[:2], 16)))
    own, solids = (np.zeros(1),) * 3, np.zeros((1, 1, 1, 64 * SOLIDS))
    bending = [np.zeros((1, 4 * SHAPES))] * 2
    if inside is not None:
        own, solids = inside.knots, inside.table.reshape(*inside.table.shape[:3], -1)
        bending = [
            np.ascontiguousarray(
                np.concatenate([shape.refined_table(knots[k]) for shape in shapes[k]], axis=1)
            )
            for k in (3, 4)
        ]
    return PackedSplines._make(
        (
            *(padded_knots(k) for k in knots), *(origins(k) for k in knots), *tables, inside is not None,
            *(padded_knots(k) for k in own), *(origins(k) for k in own), solids, *bending,
        )
    )  # fmt: skip


def spline_energy(forms: ca.SX, parameters: ca.SX) -> ca.SX:
    """ψ [J/m²] of the forms (6) with the polynomial patches of one element as parameters (eq. 31–32)."""
    root_x, root_y = ca.sqrt(forms[0]), ca.sqrt(forms[2])
    strains = ca.vertcat(root_x - 1, forms[1] / (root_x * root_y), root_y - 1, forms[3:])
    return energy_of_strains(strains, parameters)


def energy_of_strains(strains: ca.SX, parameters: ca.SX) -> ca.SX:
    """ψ [J/m²] of the six strains with the polynomial patches of one element as parameters.

    Parameters beyond ``PARAMETER_COUNT`` are those of the terms of three in-plane strains.
    """
    u = [strain - parameters[_ORIGIN_S + k] for k, strain in enumerate(ca.vertsplit(strains[:3]))]
    energy = ca.SX(0)
    for k, (i, j) in enumerate(PLANES[:3]):
        patch = _by_first(parameters[_PLANE + 16 * k : _PLANE + 16 * (k + 1)], u[i])
        energy += _horner(patch, u[j])
    products = [[], []]
    if parameters.numel() > PARAMETER_COUNT:
        u3 = [strains[k] - parameters[_ORIGIN_INSIDE + k] for k in range(3)]
        solids = [_solid(parameters[_SOLIDS + 64 * k : _SOLIDS + 64 * (k + 1)], u3) for k in range(SOLIDS)]
        energy += solids[0]
        for family in range(2):
            products[family] = solids[1 + family * SHAPES : 1 + (family + 1) * SHAPES]
    b11, b12, b22 = strains[3], strains[4], strains[5]
    half = 0.5 * (b11 - b22)
    radius = ca.sqrt(half * half + b12 * b12 + parameters[_GUARD])
    largest = 0.5 * (b11 + b22) + radius
    share = 0.5 * (1 + half / radius)  # c², entry 11 of the projector onto the first eigenvector
    for family, origin, shapes, factors, diagonal, part in (
        (_FAMILY_X, _ORIGIN_X, _SHAPES_X, products[0], (b11, b12, b22), share),
        (_FAMILY_Y, _ORIGIN_Y, _SHAPES_Y, products[1], (b22, b12, b11), 1 - share),
    ):
        base = _family(parameters[family : family + 48], u)
        difference = _family(parameters[family + 48 : family + 96], u)
        for m, factor in enumerate(factors):
            for b in range(4):
                base[b] += factor * parameters[shapes + 4 * m + b]
                difference[b] += factor * parameters[shapes + 4 * (SHAPES + m) + b]
        energy += _first_entry(base, diagonal, parameters[origin])
        energy += part * _horner(difference, largest - parameters[origin + 1])
    return energy


def _family(patches: ca.SX, u: list[ca.SX]) -> list[ca.SX]:
    """Coefficients by power of λ of a bending family at in-plane strains u (about their origins)."""
    rows = [_by_first(patches[16 * j : 16 * (j + 1)], u[j]) for j in range(3)]
    return [rows[0][b] + rows[1][b] + rows[2][b] for b in range(4)]


def _solid(coefficients: ca.SX, u: list[ca.SX]) -> ca.SX:
    """Value of a tricubic patch (64, powers of the last strain fastest)."""
    rows = [_horner([coefficients[4 * k + c] for c in range(4)], u[2]) for k in range(16)]
    return _horner([_horner(rows[4 * a : 4 * a + 4], u[1]) for a in range(4)], u[0])


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


@cache
def _inside_kernels() -> MaterialKernels:
    return compile_material(spline_energy, INSIDE_PARAMETER_COUNT, "inside_material")


@numba.njit(cache=True, fastmath={"contract"}, error_model="numpy")
def gather_parameters(packed, forms, count, parameters):
    """Fill parameters (P, stride) for ``count`` columns of forms (6, stride); callable inside ``@njit``.

    Works on LANES elements at a time so that every row of ``parameters`` is written by whole cache lines.
    """
    place = np.empty((7, LANES), np.int64)  # intervals: s_x, s_a, s_y; of λ1 and λ2 on both bending axes
    for start in range(0, count, LANES):
        for lane in range(LANES):
            n = start + lane
            root_x, root_y = np.sqrt(forms[0, n]), np.sqrt(forms[2, n])
            place[0, lane] = find_interval(packed.knots_x, root_x - 1.0)
            place[1, lane] = find_interval(packed.knots_a, forms[1, n] / (root_x * root_y))
            place[2, lane] = find_interval(packed.knots_y, root_y - 1.0)
            middle, half = 0.5 * (forms[3, n] + forms[5, n]), 0.5 * (forms[3, n] - forms[5, n])
            radius = np.sqrt(half * half + forms[4, n] * forms[4, n])
            meet = radius < MEETING * (packed.origins_bend_x[-1] - packed.origins_bend_x[0])
            reach = 0.0 if meet else radius
            place[3, lane] = find_interval(packed.knots_bend_x, middle + reach)
            place[4, lane] = find_interval(packed.knots_bend_x, middle - reach)
            place[5, lane] = find_interval(packed.knots_bend_y, middle + reach)
            place[6, lane] = find_interval(packed.knots_bend_y, middle - reach)
            one_piece = place[3, lane] == place[4, lane] and place[5, lane] == place[6, lane]
            parameters[_GUARD, n] = 1.0 if one_piece else 0.0
            parameters[_ORIGIN_S, n] = packed.origins_x[place[0, lane]]
            parameters[_ORIGIN_S + 1, n] = packed.origins_a[place[1, lane]]
            parameters[_ORIGIN_S + 2, n] = packed.origins_y[place[2, lane]]
            parameters[_ORIGIN_X, n] = packed.origins_bend_x[place[4, lane]]
            parameters[_ORIGIN_X + 1, n] = packed.origins_bend_x[place[3, lane]]
            parameters[_ORIGIN_Y, n] = packed.origins_bend_y[place[6, lane]]
            parameters[_ORIGIN_Y + 1, n] = packed.origins_bend_y[place[5, lane]]
        _copy_patches(packed.plane_xa, place[0], place[1], parameters, _PLANE, start)
        _copy_patches(packed.plane_xy, place[0], place[2], parameters, _PLANE + 16, start)
        _copy_patches(packed.plane_ay, place[1], place[2], parameters, _PLANE + 32, start)
        family = (packed.bend_xx, packed.bend_ax, packed.bend_yx)
        _copy_family(family, place, 3, packed.origins_bend_x, parameters, _FAMILY_X, start)
        family = (packed.bend_xy, packed.bend_ay, packed.bend_yy)
        _copy_family(family, place, 5, packed.origins_bend_y, parameters, _FAMILY_Y, start)
        if packed.has_inside:
            _copy_inside(packed, forms, place, parameters, start)


@numba.njit(cache=True)
def _copy_inside(packed, forms, place, parameters, start):
    """Origins, patches and shapes of the terms of three strains."""
    cell = np.empty(LANES, np.int64)
    solids = packed.solids.reshape(-1, 64 * SOLIDS)
    for lane in range(LANES):
        n = start + lane
        root_x, root_y = np.sqrt(forms[0, n]), np.sqrt(forms[2, n])
        i = find_interval(packed.inside_knots_x, root_x - 1.0)
        j = find_interval(packed.inside_knots_a, forms[1, n] / (root_x * root_y))
        k = find_interval(packed.inside_knots_y, root_y - 1.0)
        parameters[_ORIGIN_INSIDE, n] = packed.inside_origins_x[i]
        parameters[_ORIGIN_INSIDE + 1, n] = packed.inside_origins_a[j]
        parameters[_ORIGIN_INSIDE + 2, n] = packed.inside_origins_y[k]
        cell[lane] = (i * packed.solids.shape[1] + j) * packed.solids.shape[2] + k
    for c in range(64 * SOLIDS):  # a row of lanes at a time: whole cache lines are written
        for lane in range(LANES):
            parameters[_SOLIDS + c, start + lane] = solids[cell[lane], c]
    _copy_shapes(packed.shapes_x, place, 3, packed.origins_bend_x, parameters, _SHAPES_X, start)
    _copy_shapes(packed.shapes_y, place, 5, packed.origins_bend_y, parameters, _SHAPES_Y, start)


@numba.njit(cache=True)
def _copy_shapes(table, place, axis, origin, parameters, row, start):
    for lane in range(LANES):
        upper, lower, n = place[axis, lane], place[axis + 1, lane], start + lane
        for c in range(4 * SHAPES):
            parameters[row + c, n] = table[lower, c]
            parameters[row + 4 * SHAPES + c, n] = 0.0
        if upper != lower:
            offset = origin[upper] - origin[lower]
            far = upper > lower + 1
            for c in range(0, 4 * SHAPES, 4):
                p, q = table[upper, c : c + 4], table[lower, c : c + 4]
                _difference(p, q, offset, far, parameters, row + 4 * SHAPES + c, n)


@numba.njit(cache=True, inline="always")
def _difference(p, q, offset, far, parameters, row, n):
    """Cubic p less cubic q, about the left knot of p; values and slopes agree at a shared knot unless ``far``."""
    parameters[row, n] = 0.0
    parameters[row + 1, n] = 0.0
    if far:
        parameters[row, n] = p[0] - (q[0] + offset * (q[1] + offset * (q[2] + offset * q[3])))
        parameters[row + 1, n] = p[1] - (q[1] + offset * (2.0 * q[2] + 3.0 * offset * q[3]))
    parameters[row + 2, n] = p[2] - (q[2] + 3.0 * offset * q[3])
    parameters[row + 3, n] = p[3] - q[3]


@numba.njit(cache=True, inline="always")
def _copy_family(tables, place, axis, origin, parameters, row, start):
    _copy_patches(tables[0], place[0], place[axis + 1], parameters, row, start)
    _copy_patches(tables[1], place[1], place[axis + 1], parameters, row + 16, start)
    _copy_patches(tables[2], place[2], place[axis + 1], parameters, row + 32, start)
    upper, lower = place[axis], place[axis + 1]
    _copy_differences(tables[0], place[0], upper, lower, origin, parameters, row + 48, start)
    _copy_differences(tables[1], place[1], upper, lower, origin, parameters, row + 64, start)
    _copy_differences(tables[2], place[2], upper, lower, origin, parameters, row + 80, start)


@numba.njit(cache=True)
def _copy_patches(table, first, second, parameters, row, start):
    for lane in range(LANES):
        patch = table[first[lane], second[lane]]
        for k in range(16):
            parameters[row + k, start + lane] = patch[k]


@numba.njit(cache=True)
def _copy_differences(table, first, upper, lower, origin, parameters, row, start):
    """Patch of λ1 less patch of λ2, both about the left knot of λ1's interval."""
    for lane in range(LANES):
        n = start + lane
        if upper[lane] == lower[lane]:
            for k in range(16):
                parameters[row + k, n] = 0.0
            continue
        offset = origin[upper[lane]] - origin[lower[lane]]
        p, q = table[first[lane], upper[lane]], table[first[lane], lower[lane]]
        for k in range(0, 16, 4):
            parameters[row + k, n] = 0.0
            parameters[row + k + 1, n] = 0.0
            if upper[lane] > lower[lane] + 1:  # else values and slopes agree at the shared knot
                moved = q[k] + offset * (q[k + 1] + offset * (q[k + 2] + offset * q[k + 3]))
                parameters[row + k, n] = p[k] - moved
                moved = q[k + 1] + offset * (2.0 * q[k + 2] + 3.0 * offset * q[k + 3])
                parameters[row + k + 1, n] = p[k + 1] - moved
            parameters[row + k + 2, n] = p[k + 2] - (q[k + 2] + 3.0 * offset * q[k + 3])
            parameters[row + k + 3, n] = p[k + 3] - q[k + 3]


def _gather(packed: PackedSplines, forms: Array, count: int, parameters: Array) -> None:
    size = INSIDE_PARAMETER_COUNT if packed.has_inside else PARAMETER_COUNT
    if count % LANES or count > forms.shape[1] or parameters.shape != (size, forms.shape[1]):
        raise ValueError(f"gather: count {count}, forms {forms.shape}, parameters {parameters.shape}")
    gather_parameters(packed, forms, count, parameters)
