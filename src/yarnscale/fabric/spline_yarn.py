"""Yarns as continuous cubic splines: stretch and bending along the curve, and their constant mass (LOD03 §2 and §5)."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import casadi as ca
import numpy as np

from yarnscale.arrays import Array, Integers
from yarnscale.fabric.bspline import GAUSS_POINTS, GAUSS_WEIGHTS, ORDER, blending
from yarnscale.numerics.energy import LinearTerms, StencilEnergy, Symbol

_POINTS = len(GAUSS_POINTS)


def _point_energy(weight: float, p: Mapping[str, Symbol], point: int) -> Callable[[Symbol], Symbol]:
    """Energy at one quadrature point as a function of the curve's first and second derivative, (6,)."""

    def energy(derivatives: Symbol) -> Symbol:
        first, second = derivatives[:3], derivatives[3:]
        square = ca.dot(first, first)
        strain = ca.sqrt(square) / p["rest_speed"][point] - 1
        normal = ca.cross(first, second)
        # A straight yarn has κ = 0, where |κ| has no derivative; ``rounding`` is far below any curvature that matters.
        curvature = ca.sqrt(ca.dot(normal, normal) / square**3 + p["rounding"] ** 2)
        bending = (curvature - p["rest_curvature"][point]) ** 2
        density = 0.5 * (p["stretch_stiffness"] * strain**2 + p["bending_stiffness"] * bending)
        return weight * p["rest_speed"][point] * density

    return energy


def _segment(v: Mapping[str, Symbol], p: Mapping[str, Symbol]) -> LinearTerms:
    terms = []
    for point, (u, weight) in enumerate(zip(GAUSS_POINTS, GAUSS_WEIGHTS, strict=True)):
        rows = np.stack([blending(u, 1), blending(u, 2)])
        terms.append((ca.DM(np.kron(rows, np.eye(3))), _point_energy(float(weight), p, point)))
    return LinearTerms(terms)


SPLINE_SEGMENT = StencilEnergy(
    "spline_segment",
    {f"p{i}": 3 for i in range(ORDER)},
    {
        "rest_speed": _POINTS,
        "rest_curvature": _POINTS,
        "stretch_stiffness": 1,
        "bending_stiffness": 1,
        "rounding": 1,
    },
    _segment,
)
"""∫ ½ k_s ε² + ½ k_b (κ − κ̄)² ds over one segment of a spline yarn, s the length at rest.

Four control points [m]; at the Gauss points ``rest_speed`` |r'| [m] and ``rest_curvature`` κ̄ [1/m];
``stretch_stiffness`` k_s [N], ``bending_stiffness`` k_b [N m²]; ``rounding`` [1/m] makes |κ| smooth at 0.
"""


def shape_at_rest(control: Array, segments: Integers) -> tuple[Array, Array]:
    """Speed |r'| [m] and curvature [1/m] at the Gauss points of segments (s, 4) of points (n, 3): (s, 4)."""
    corners = control[segments]
    first = np.einsum("gk,skc->sgc", blending(GAUSS_POINTS, 1), corners)
    second = np.einsum("gk,skc->sgc", blending(GAUSS_POINTS, 2), corners)
    speed = np.linalg.norm(first, axis=2)
    return speed, np.linalg.norm(np.cross(first, second), axis=2) / speed**3


SEGMENT_MASS = np.einsum("g,gi,gj->ij", GAUSS_WEIGHTS, blending(GAUSS_POINTS), blending(GAUSS_POINTS))
"""∫ b bᵀ du over a segment, (4, 4): exact, the integrand has degree 6. Times the segment's mass: its mass matrix."""
