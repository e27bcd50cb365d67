"""Fundamental forms of a triangle and its neighbours (HYLC20 eq. 33–36), symbolically and as kernels.

With F = (x1 − x0, x2 − x0) Dm⁻¹ and the dihedral angles θ_k over the three edges,

    I = FᵀF,   Λ = Σ_k θ_k / (2 A l_k) t_k ⊗ t_k,   II = Fᵀ Λ F,

t_k perpendicular to edge k in the triangle's plane, |t_k| = l_k, everything but Dm in world space. Signs:
z = +x²/2 with normal +z has II11 = +1. θ_k is the fold angle minus its value at rest, which is zero except at seams
with a rest angle.

Two differences from HYLC20: the angle is relative to a reference angle that follows the motion, so that it is
continuous at ±π; and the triangle of I may differ from the triangle of II (``elastic.elements``).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache

import casadi as ca
import numba
import numpy as np
from numpy.typing import NDArray

from yarnscale.numerics.kernel import Kernel, compile_kernel

GEOMETRY = 18
"""Numbers per element: inverse rest matrix of the triangle of II (4, by columns), of that of I (4, by columns),
choice of the triangle of I (0: v0 v1 v2, 1: v0 v1 v3), neighbour flags (3), reference angles (3), fold angles
at rest (3)."""
FLAGS = slice(9, 12)
REFERENCE = slice(12, 15)
REST = slice(15, 18)


def fundamental_forms(positions: ca.SX, geometry: ca.SX) -> ca.SX:
    """Symbolic (I11, I12, I22 [-], II11, II12, II22 [1/m]) of x0..x5 [m] (18,) and ``GEOMETRY`` (18,)."""
    x = [positions[3 * i : 3 * i + 3] for i in range(6)]
    bent_x, bent_y = _columns(x[1] - x[0], x[2] - x[0], geometry[0:4])
    apex = x[2] + geometry[8] * (x[3] - x[2])
    first_x, first_y = _columns(x[1] - x[0], apex - x[0], geometry[4:8])
    double_normal = ca.cross(x[1] - x[0], x[2] - x[0])
    double_area = ca.norm_2(double_normal)
    normal = double_normal / double_area
    second = [ca.SX(0), ca.SX(0), ca.SX(0)]
    for k in range(3):
        tail, head, own = x[k], x[(k + 1) % 3], x[(k + 2) % 3]
        flag, reference, rest = geometry[9 + k], geometry[12 + k], geometry[15 + k]
        # A missing neighbour is replaced by the triangle's own corner: harmless, and cancelled by the flag.
        across = own + flag * (x[3 + k] - own)
        edge = head - tail
        length = ca.norm_2(edge)
        angle = _dihedral(normal, ca.cross(across - tail, edge), edge / length, reference)
        perpendicular = ca.cross(edge, normal)
        weight = -flag * (angle - rest) / (double_area * length)
        u, v = ca.dot(bent_x, perpendicular), ca.dot(bent_y, perpendicular)
        second = [second[0] + weight * u * u, second[1] + weight * u * v, second[2] + weight * v * v]
    first = [ca.dot(first_x, first_x), ca.dot(first_x, first_y), ca.dot(first_y, first_y)]
    return ca.vertcat(*first, *second)


def _columns(a: ca.SX, b: ca.SX, inverse: ca.SX) -> tuple[ca.SX, ca.SX]:
    """Columns of the deformation gradient (a, b) Dm⁻¹."""
    return a * inverse[0] + b * inverse[1], a * inverse[2] + b * inverse[3]


def _dihedral(normal: ca.SX, other: ca.SX, direction: ca.SX, reference: ca.SX) -> ca.SX:
    """Signed angle between two normals about an edge, on the branch next to the reference angle."""
    other = other / ca.norm_2(other)
    sine = ca.dot(ca.cross(normal, other), direction)
    cosine = ca.dot(normal, other)
    c, s = ca.cos(reference), ca.sin(reference)
    return ca.atan2(sine * c - cosine * s, cosine * c + sine * s) + reference


@dataclass(frozen=True)
class FormKernels:
    """Compiled forms.

    value: (positions, geometry) → forms (6).
    jacobian: (positions, geometry) → forms (6), d forms / d positions (108, row by row 6 × 18).
    curvature: (positions, geometry, stress (6)) → Σ stress_k ∇² forms_k (171, lower triangle row by row).
    """

    value: Kernel
    jacobian: Kernel
    curvature: Kernel


@cache
def form_kernels() -> FormKernels:
    """The kernels of the fundamental forms, compiled once (object code is kept on disk)."""
    positions, geometry = ca.SX.sym("positions", 18), ca.SX.sym("geometry", GEOMETRY)
    stress = ca.SX.sym("stress", 6)
    forms = fundamental_forms(positions, geometry)
    rows = ca.densify(ca.jacobian(forms, positions).T)
    hessian, _ = ca.hessian(ca.dot(stress, forms), positions)
    lower = ca.vertcat(*[hessian[i, j] for i in range(18) for j in range(i + 1)])
    cse = {"cse": True}
    return FormKernels(
        value=compile_kernel(ca.Function("forms", [positions, geometry], [forms], cse), "shell_forms"),
        jacobian=compile_kernel(
            ca.Function("jacobian", [positions, geometry], [forms, ca.vec(rows)], cse), "shell_jacobian"
        ),
        curvature=compile_kernel(
            ca.Function("curvature", [positions, geometry, stress], [ca.densify(lower)], cse), "shell_curvature"
        ),
    )


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract", "nsz"})
def follow_angles(positions: NDArray, stencils: NDArray, geometry: NDArray) -> float:
    """Set the reference angles of ``geometry`` (nb, 18, B) to the present fold angles; the largest |angle| [rad].

    positions: (nv, 3) [m]; stencils: (nb, B, 6). Of all branches the one nearest to the old reference is used.
    """
    largest = 0.0
    for block in range(stencils.shape[0]):
        for n in range(stencils.shape[1]):
            x = stencils[block, n]
            normal = _cross(_between(positions, x[0], x[1]), _between(positions, x[0], x[2]))
            for k in range(3):
                if geometry[block, 9 + k, n] == 0.0:
                    continue
                edge = _between(positions, x[k], x[(k + 1) % 3])
                other = _cross(_between(positions, x[k], x[3 + k]), edge)
                turned = _cross(normal, other)
                # Both with the factor |normal|·|other|, which the angle does not see.
                sine = (turned[0] * edge[0] + turned[1] * edge[1] + turned[2] * edge[2]) / math.sqrt(
                    edge[0] ** 2 + edge[1] ** 2 + edge[2] ** 2
                )
                cosine = normal[0] * other[0] + normal[1] * other[1] + normal[2] * other[2]
                change = math.atan2(sine, cosine) - geometry[block, 12 + k, n]
                if abs(change) > math.pi:
                    change -= 2.0 * math.pi * np.round(change / (2.0 * math.pi))
                if change == change:  # no angle where an edge has no length
                    geometry[block, 12 + k, n] += change
                largest = max(largest, abs(geometry[block, 12 + k, n]))
    return largest


@numba.njit(cache=True, inline="always")
def _between(positions: NDArray, i: int, j: int) -> tuple[float, float, float]:
    return (positions[j, 0] - positions[i, 0], positions[j, 1] - positions[i, 1], positions[j, 2] - positions[i, 2])


@numba.njit(cache=True, inline="always")
def _cross(a: tuple[float, float, float], b: tuple[float, float, float]) -> tuple[float, float, float]:
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]
