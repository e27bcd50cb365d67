"""Two-dimensional terms: what the one-dimensional ones leave over, on all planes at once (stage 2 of the fit)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve

from yarnscale.homogenize.axis_fit import AxisTerm
from yarnscale.homogenize.observations import SHEAR, FitOptions, Mask, Observations, of_side
from yarnscale.homogenize.splines import LineBasis, knots_for
from yarnscale.shell.materials.spline_patches import PLANES
from yarnscale.shell.materials.tables import BicubicSpline

Array = NDArray[np.float64]
Pair = tuple[int, int]

_NEIGHBOURS = 9
"""Samples whose mean scale measures the roughness around them: one stiff neighbour must not forbid a bend."""


class PlaneFit:
    """Normal equations of all two-dimensional terms, one block of unknowns each.

    data, options: what to fit and how; axes: the one-dimensional terms; constant: ψ0 [J/m²]; sides: (5, 2) from
    ``side_energies``. ``unknowns`` holds the solution after ``solve``.
    """

    def __init__(
        self, data: Observations, axes: list[AxisTerm], constant: float, sides: Array, options: FitOptions
    ) -> None:
        self.data, self.axes, self.constant, self.sides, self.options = data, axes, constant, sides, options
        self.rest = data.energies - self.axis_energy(data.strains)
        self.bases: dict[Pair, tuple[LineBasis, LineBasis]] = {}
        for pair in PLANES:
            inside = data.on_plane(*pair)
            if np.any(inside):
                self.bases[pair] = (self._basis(pair[0], inside), self._basis(pair[1], inside))
        sizes = [first.count * second.count for first, second in self.bases.values()]
        ends = np.concatenate([[0], np.cumsum(sizes, dtype=np.int64)])
        self.slices = {pair: slice(ends[k], ends[k + 1]) for k, pair in enumerate(self.bases)}
        size = int(ends[-1])
        self.matrix, self.right, self.unknowns = np.zeros((size, size)), np.zeros(size), np.zeros(size)
        for pair, where in self.slices.items():
            rows, target, bends = self._plane_rows(pair)
            self.matrix[where, where] = rows.T @ rows + options.smoothing * (bends.T @ bends)
            self.right[where] = rows.T @ target
        self._add_states_off_planes()
        self.matrix[np.diag_indices(size)] += 1e-13 * np.trace(self.matrix) / max(size, 1)

    def axis_energy(self, strains: Array) -> Array:
        """ψ0 + Σ f_i [J/m²] of states (n, 5)."""
        terms = [axis.spline(x) for axis, x in zip(self.axes, strains.T, strict=True)]
        return self.constant + np.sum(terms, axis=0)

    def _basis(self, axis: int, inside: Mask) -> LineBasis:
        options = self.options
        even = axis == SHEAR and options.symmetric_shear
        knots = knots_for(
            self.data.strains[inside, axis],
            limit=options.plane_knots,
            even=even,
            grading=options.grading if axis > 2 else 0.0,
            slopes=bool(np.any(np.isfinite(self.data.stresses[inside, axis]))),
        )
        return LineBasis(knots, even=even, flat=True)

    def _plane_rows(self, pair: Pair) -> tuple[Array, Array, Array]:
        """Rows and targets of one term (energies and stresses on its plane, cross stresses on its axes); bends."""
        data, (i, j), bases = self.data, pair, self.bases[pair]
        inside, scale = data.on_plane(i, j), self._scale(pair)
        rows, targets = [], []

        def add(states: Mask, orders: Pair, target: Array, length: Array | float) -> None:
            keep = states & np.isfinite(target)
            weight = (np.sqrt(data.weights) * length / scale)[keep]
            x, y = data.strains[keep, i], data.strains[keep, j]
            product = _products(bases[0].design(x, orders[0]), bases[1].design(y, orders[1]))
            rows.append(weight[:, None] * product)
            targets.append(weight * target[keep])

        add(inside, (0, 0), self.rest, 1.0)
        # f_ij(·, 0) = 0, but its slope across the axis is what the other stress says there.
        for axis, other, orders in ((i, j, (1, 0)), (j, i, (0, 1))):
            term, x = self.axes[axis], data.strains[:, axis]
            states = inside | data.on_axis(other)
            add(states, orders, data.stresses[:, axis] - term.spline(x, 1), of_side(term.reach, x))
        bends = self._bends(bases, data.strains[inside][:, [i, j]], scale[inside])
        return np.concatenate(rows), np.concatenate(targets), bends

    def _scale(self, pair: Pair) -> Array:
        """Energy to which residuals are relative: what the second strain adds, and a little for noise, (n,)."""
        total = self.data.energies - self.constant
        least, added = np.full(len(total), np.inf), np.abs(total)
        for axis in pair:
            x = self.data.strains[:, axis]
            if self.axes[axis].sampled:
                least = np.minimum(least, of_side(self.sides[axis], x))
                added = np.minimum(added, np.abs(total - self.axes[axis].spline(x)))
        least = np.where(np.isfinite(least), least, np.max(np.abs(total)))
        return self.options.small * least + added + self.options.noise * np.abs(total)

    def _bends(self, bases: tuple[LineBasis, LineBasis], places: Array, scale: Array) -> Array:
        """Third differences of active coefficients along both strains, relative to the nearest samples."""
        first, second = bases
        span = np.array([np.ptp(basis.knots) for basis in bases])
        centers = np.stack(np.meshgrid(first.centers, second.centers, indexing="ij"), axis=-1)
        gaps = np.linalg.norm((centers[:, :, None] - places) / span, axis=-1)
        nearest = np.argsort(gaps, axis=2)[:, :, :_NEIGHBOURS]
        local = scale[nearest].mean(axis=2)
        bend_u, bend_v = first.differences(3) @ first.reduction, second.differences(3) @ second.reduction
        along_u = np.einsum("ab,cd,ac->acbd", bend_u, second.reduction, 1 / local[1:-2])
        along_v = np.einsum("ab,cd,ac->acbd", first.reduction, bend_v, 1 / local[:, 1:-2])
        count = first.count * second.count
        return np.concatenate([along_u.reshape(-1, count), along_v.reshape(-1, count)])

    def _add_states_off_planes(self) -> None:
        """States of more strains, lightly: pairwise terms can only compromise there."""
        off = self.data.off_planes
        if not np.any(off):
            return
        total = np.abs(self.data.energies[off] - self.constant)
        scale = total + self.options.small * max(np.max(total), np.max(np.nan_to_num(self.sides)))
        weight = np.sqrt(self.data.weights[off]) / scale
        rows = weight[:, None] * self.rows(self.data.strains[off])
        self.matrix += rows.T @ rows
        self.right += rows.T @ (weight * self.rest[off])

    def rows(self, strains: Array) -> Array:
        """All terms of stage 2 at states (n, 5) by the unknowns, (n, unknowns); λ_x and λ_y act each in its family."""
        result = np.zeros((len(strains), len(self.unknowns)))
        for (i, j), where in self.slices.items():
            first, second = self.bases[i, j]
            result[:, where] = _products(first.design(strains[:, i]), second.design(strains[:, j]))
        return result

    def solve(self) -> None:
        """Least squares."""
        if len(self.unknowns):
            self.unknowns = cho_solve(cho_factor(self.matrix), self.right)

    def splines(self) -> dict[Pair, BicubicSpline]:
        """The terms as nodal data."""
        result = {}
        for pair, where in self.slices.items():
            first, second = self.bases[pair]
            grid = self.unknowns[where].reshape(first.count, second.count)
            left, right = (
                [basis.design(basis.breaks, order) for order in (0, 1)] for basis in (first, second)
            )
            nodal = [left[a] @ grid @ right[b].T for a, b in ((0, 0), (1, 0), (0, 1), (1, 1))]
            result[pair] = BicubicSpline(first.breaks, second.breaks, *nodal)
        return result


def _products(first: Array, second: Array) -> Array:
    """Row-wise Kronecker products."""
    return (first[:, :, None] * second[:, None, :]).reshape(len(first), first.shape[1] * second.shape[1])
