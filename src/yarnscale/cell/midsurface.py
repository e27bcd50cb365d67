"""The midsurface of a cell under a macroscopic state, in closed form (theory §2; HYLC20 §4.2).

m(X) = φ(ξ) + h R(ξ) e3 with φ(ξ) = V(w) S ξ, R(ξ) = exp [w]×, w = ξ^α ω_α and S = √I. Exact where det II = 0 (flat and
singly curved states); its first derivatives by II are exact at flat states for every II.
"""

from __future__ import annotations

from functools import cache

import casadi as ca
import numpy as np

from yarnscale.arrays import Array
from yarnscale.kinematics import ShellStrain
from yarnscale.numerics.kernel import Kernel, compile_kernel, run_columns

_SERIES_BELOW = 0.25  # of the squared angle: seven terms are then exact to round-off


def _cross_matrix(w: ca.SX) -> ca.SX:
    return ca.vertcat(ca.horzcat(0, -w[2], w[1]), ca.horzcat(w[2], 0, -w[0]), ca.horzcat(-w[1], w[0], 0))


def _entire(square: ca.SX, first: int, closed: ca.SX) -> ca.SX:
    """Σ_k (−ϑ²)^k / (2k + first)!, by its series near 0 and by ``closed`` elsewhere."""
    coefficients = [(-1.0) ** k / float(np.prod(np.arange(1.0, 2 * k + first + 1))) for k in range(8)]
    series = ca.SX(0)
    for coefficient in reversed(coefficients):
        series = series * square + coefficient
    return ca.if_else(square < _SERIES_BELOW, series, closed)


def midsurface_frames(z: ca.SX) -> tuple[ca.SX, ca.SX]:
    """S (2×2, √I) and [ω_1 ω_2] (3×2) of a state z = (s_x, s_a, s_y, II11, II12, II22), symbolic."""
    a, b = 1 + z[0], 1 + z[2]
    first = ca.vertcat(ca.horzcat(a * a, z[1] * a * b), ca.horzcat(z[1] * a * b, b * b))
    root = ca.sqrt(first[0, 0] * first[1, 1] - first[0, 1] ** 2)
    stretch = (first + root * ca.SX.eye(2)) / ca.sqrt(first[0, 0] + first[1, 1] + 2 * root)
    second = ca.vertcat(ca.horzcat(z[3], z[4]), ca.horzcat(z[4], z[5]))
    # n,α = −II_αβ (I⁻¹)^βγ a_γ lies in the plane, and ω_α = e3 × n,α.
    normal_slope = -stretch @ ca.solve(first, second)
    omega = ca.vertcat(-normal_slope[1, :], normal_slope[0, :], ca.SX.zeros(1, 2))
    return stretch, omega


def midsurface_point(z: ca.SX, reference: ca.SX) -> tuple[ca.SX, ca.SX]:
    """Point m (3) and rotation R (3×3) at reference coordinates X = (ξ1, ξ2, h), symbolic."""
    stretch, omega = midsurface_frames(z)
    w = omega @ reference[0:2]
    square = ca.dot(w, w)
    angle = ca.sqrt(ca.fmax(square, _SERIES_BELOW / 4))
    sine = _entire(square, 1, ca.sin(angle) / angle)
    cosine = _entire(square, 2, (1 - ca.cos(angle)) / angle**2)
    third = _entire(square, 3, (angle - ca.sin(angle)) / angle**3)
    cross = _cross_matrix(w)
    rotation = ca.SX.eye(3) + sine * cross + cosine * (cross @ cross)
    jacobian = ca.SX.eye(3) + cosine * cross + third * (cross @ cross)
    flat = ca.vertcat(stretch @ reference[0:2], 0)
    return jacobian @ flat + reference[2] * rotation[:, 2], rotation


@cache
def _turning() -> ca.Function:
    z = ca.SX.sym("z", 6)
    return ca.Function("turning", [z], [midsurface_frames(z)[1]])


@cache
def _kernel() -> Kernel:
    z, reference = ca.SX.sym("z", 6), ca.SX.sym("X", 3)
    point, rotation = midsurface_point(z, reference)
    outputs = [point, ca.vec(rotation.T)]
    return compile_kernel(ca.Function("midsurface", [z, reference], outputs, {"cse": True}), "midsurface", shared=(0,))


@cache
def _slope_kernel() -> Kernel:
    """Derivatives of m and of the rows of R by the state, (3, 6) and (9, 6)."""
    z, reference = ca.SX.sym("z", 6), ca.SX.sym("X", 3)
    point, rotation = midsurface_point(z, reference)
    outputs = [ca.densify(ca.vec(ca.jacobian(part, z).T)) for part in (point, ca.vec(rotation.T))]
    function = ca.Function("midsurface_slopes", [z, reference], outputs, {"cse": True})
    return compile_kernel(function, "midsurface_slopes", shared=(0,))


@cache
def _second_kernel() -> Kernel:
    """Second derivatives of f·m + Q:R by the state, (6, 6); Q row by row."""
    z, reference, f, q = (ca.SX.sym(name, size) for name, size in (("z", 6), ("X", 3), ("f", 3), ("Q", 9)))
    point, rotation = midsurface_point(z, reference)
    second, _ = ca.hessian(ca.dot(f, point) + ca.dot(q, ca.vec(rotation.T)), z)
    output = ca.densify(ca.vec(second))
    function = ca.Function("midsurface_second", [z, reference, f, q], [output], {"cse": True})
    return compile_kernel(function, "midsurface_second", shared=(0,))


class Midsurface:
    """The surface that realises one macroscopic state, with its co-rotated frames."""

    def __init__(self, strain: ShellStrain, *, length: float = 1.0) -> None:
        """``length``: unit of all coordinates given and returned [m]; curvature is scaled to it."""
        self.strain = strain
        self._scale = np.array([1.0, 1.0, 1.0, length, length, length])
        self._z = strain.vector * self._scale

    def at(self, reference: Array) -> tuple[Array, Array]:
        """Points m (n, 3) and rotations R (n, 3, 3) at reference coordinates (n, 3)."""
        points, rotations = run_columns(_kernel(), self._z[None], reference)
        return points, rotations.reshape(-1, 3, 3)

    def rotation_vectors(self, reference: Array) -> Array:
        """w = ξ^α ω_α at reference coordinates (n, 3), shape (n, 3) [rad]; may exceed a full turn."""
        return reference[:, :2] @ np.array(_turning()(self._z)).T

    def slopes(self, reference: Array) -> tuple[Array, Array]:
        """Derivatives of points (n, 3, 6) and rotations (n, 3, 3, 6) by (s_x, s_a, s_y, II11, II12, II22)."""
        points, rotations = run_columns(_slope_kernel(), self._z[None], reference)
        return points.reshape(-1, 3, 6) * self._scale, rotations.reshape(-1, 3, 3, 6) * self._scale

    def second(self, reference: Array, forces: Array, turns: Array) -> Array:
        """Second derivatives (6, 6) by the state of Σ f·m + Q:R, for forces f (n, 3) and turns Q (n, 3, 3)."""
        (found,) = run_columns(_second_kernel(), self._z[None], reference, forces, turns.reshape(-1, 9))
        return found.sum(axis=0).reshape(6, 6) * self._scale[:, None] * self._scale
