"""Energy and mass of a fabric of spline yarns (LOD03 §2 and §5)."""

from __future__ import annotations

import numpy as np
from scipy.sparse import csr_array, kron

from yarnscale.arrays import Array, Integers
from yarnscale.fabric.bspline import GAUSS_POINTS, GAUSS_WEIGHTS, blending
from yarnscale.fabric.spline_knit import CurvePoints, SplineFabric
from yarnscale.fabric.spline_yarn import SEGMENT_MASS, SPLINE_SEGMENT, shape_at_rest
from yarnscale.numerics.assembly import StencilSet, position_variables
from yarnscale.numerics.block_pattern import BlockPattern
from yarnscale.numerics.factor import SymmetricPattern
from yarnscale.numerics.regularisation import ShiftedHessian

_ROUNDING = 1e-8
"""Curvature times yarn radius below which |κ| is rounded off."""
_NO_ROTATION = np.empty((0, 3, 3))


class SplineEnergy:
    """Elastic energy [J] of the yarns about their shape at rest, gravity not included; gradients in N, Hessians in N/m.

    Full vectors are the control points one after another, 3 n. ``pattern`` is that of Hessian and mass matrix.
    """

    def __init__(self, fabric: SplineFabric) -> None:
        self.fabric = fabric
        self.size = 3 * fabric.yarn_count * fabric.points_per_yarn
        parameters = spline_parameters(fabric, fabric.control.reshape(-1, 3), fabric.segments)
        unknowns = position_variables(fabric.segments)
        self._stencils = StencilSet(SPLINE_SEGMENT, unknowns, parameters, 4)
        blocks = BlockPattern.of(np.full(self.size // 3, 3), [unknowns])
        self.pattern: SymmetricPattern = blocks.pattern
        self._slots = blocks.slots(unknowns)
        self.lengths = parameters[:, SPLINE_SEGMENT.parameter_rows("rest_speed")] @ GAUSS_WEIGHTS
        """Length of every segment at rest [m]."""
        self.masses = fabric.material.mass_per_length(fabric.radius) * self.lengths
        """Mass of every segment [kg], spread evenly over its parameter."""
        self.mass_entries = self._mass_entries()

    def value(self, x: Array) -> float:
        return self._stencils.value(x)

    def gradient(self, x: Array) -> tuple[float, Array]:
        gradient = np.zeros(self.size)
        return self._stencils.gradient(x, gradient), gradient

    def quadratic(self, x: Array) -> tuple[float, Array, ShiftedHessian]:
        gradient, entries = np.zeros(self.size), np.zeros(self.pattern.entries)
        value = self._stencils.hessian(x, gradient, self._slots, _NO_ROTATION, entries)
        return value, gradient, evenly_shifted(self.pattern, entries)

    def weight(self, acceleration: Array) -> Array:
        """Generalised force of a uniform acceleration (3,) [m/s²] on the control points, (3n,) [N]."""
        shares = GAUSS_WEIGHTS @ blending(GAUSS_POINTS)
        nodal = np.zeros(self.size // 3)
        np.add.at(nodal, self.fabric.segments, self.masses[:, None] * shares)
        return (nodal[:, None] * np.asarray(acceleration)).ravel()

    def mass_matrix(self) -> csr_array:
        """Mass matrix of one component, (n, n) [kg]; the same for x, y and z, and constant."""
        segments, count = self.fabric.segments, self.size // 3
        blocks = self.masses[:, None, None] * SEGMENT_MASS
        rows, columns = np.broadcast_arrays(segments[:, :, None], segments[:, None, :])
        return csr_array((blocks.ravel(), (rows.ravel(), columns.ravel())), shape=(count, count))

    def _mass_entries(self) -> Array:
        rows, columns = self.pattern.rows, self.pattern.columns
        of_points = np.asarray(self.mass_matrix()[rows // 3, columns // 3]).ravel()
        return np.where(rows % 3 == columns % 3, of_points, 0.0)


def evenly_shifted(pattern: SymmetricPattern, entries: Array) -> ShiftedHessian:
    """A Hessian shifted by its mean diagonal, whatever springs much stiffer than yarn are added to it."""
    return ShiftedHessian(pattern, entries, np.full(pattern.size, np.abs(entries[pattern.diagonal]).mean()))


def spline_parameters(fabric: SplineFabric, control: Array, segments: Integers) -> Array:
    """Parameters of ``SPLINE_SEGMENT`` for segments (s, 4) of control points at rest (n, 3) [m]."""
    speed, curvature = shape_at_rest(control, segments)
    material, radius, count = fabric.material, fabric.radius, len(segments)
    return np.column_stack(
        [
            speed, np.hypot(curvature, _ROUNDING / radius), np.full(count, material.stretch_stiffness(radius)),
            np.full(count, material.bending_stiffness(radius)), np.full(count, _ROUNDING / radius),
        ]
    )  # fmt: skip


def point_rows(fabric: SplineFabric, points: CurvePoints) -> csr_array:
    """Matrix (3k, 3n) from control points to positions of points on yarns."""
    index, weights = fabric.rows(points)
    row = np.repeat(np.arange(len(points)), index.shape[1])
    count = fabric.yarn_count * fabric.points_per_yarn
    one = csr_array((weights.ravel(), (row, index.ravel())), shape=(len(points), count))
    return csr_array(kron(one, np.eye(3)))
