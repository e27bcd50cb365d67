"""Two-dimensional terms: what the one-dimensional ones leave over, on all planes at once (stage 2 of the fit)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve, cholesky, solve_triangular
from scipy.optimize import nnls

from yarnscale.homogenize.axis_fit import AxisTerm
from yarnscale.homogenize.moduli_fit import NOISE, by_twist, known_moduli, orders_of, whitening
from yarnscale.homogenize.observations import IN_STRESS, SHEAR, TWIST, FitOptions, Mask, Observations, of_side
from yarnscale.homogenize.splines import LineBasis, knots_for
from yarnscale.shell.materials.spline_patches import PLANES
from yarnscale.shell.materials.tables import BicubicSpline, CubicSpline

Array = NDArray[np.float64]
Pair = tuple[int, int]
Orders = tuple[int, int, int, int, int]

_MODULUS_WEIGHT, _REST_WEIGHT = 0.01, 1.0
"""Weight of a squared residual of a modulus beside one of an energy; of those at rest."""
_STATES_AT_ONCE = 50
"""States whose moduli are held in memory together."""

_SOFTNESS = 1e-6
"""Compliance of the floor beside the data, so that states it cannot all satisfy do no harm."""

_LIFT_SMOOTHING = 1.0
"""Weight of roughness in what the floor adds, beside relative residuals."""
_NEIGHBOURS = 9
"""Samples whose mean scale measures the roughness around them: one stiff neighbour must not forbid a bend."""


class PlaneFit:
    """Normal equations of all two-dimensional terms, one block of unknowns each.

    data, options: what to fit and how; axes: the one-dimensional terms; constant: ψ0 [J/m²]; sides: (5, 2) from
    ``side_energies``. ``unknowns`` holds the solution after ``solve`` and ``hold_above``.
    """

    def __init__(
        self, data: Observations, axes: list[AxisTerm], constant: float, sides: Array, options: FitOptions
    ) -> None:
        self.data, self.axes, self.constant, self.sides, self.options = data, axes, constant, sides, options
        self.rest = data.energies - self.axis_energy(data.strains)
        self.multipliers = np.zeros(0)
        self._stiff: tuple[Array, bool] | None = None
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
        self.rough = np.zeros((size, size))
        for pair, where in self.slices.items():
            rows, target, bends = self._plane_rows(pair)
            self.rough[where, where] = bends.T @ bends
            self.matrix[where, where] = rows.T @ rows + options.smoothing * self.rough[where, where]
            self.right[where] = rows.T @ target
        self._add_states_off_planes()
        self._add_moduli()
        self.matrix[np.diag_indices(size)] += 1e-13 * np.trace(self.matrix) / max(size, 1)

    def axis_energy(self, strains: Array) -> Array:
        """ψ0 + Σ f_i [J/m²] of states (n, 5)."""
        terms = [axis.spline(x) for axis, x in zip(self.axes, strains.T, strict=True)]
        return self.constant + np.sum(terms, axis=0)

    def _basis(self, axis: int, inside: Mask, limit: int | None = None) -> LineBasis:
        options = self.options
        even = axis == SHEAR and options.symmetric_shear
        knots = knots_for(
            self.data.strains[inside, axis],
            limit=limit or options.plane_knots,
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

    def rows(self, strains: Array, orders: Orders = (0, 0, 0, 0, 0)) -> Array:
        """Derivatives of all terms of stage 2 at states (n, 5) by the unknowns, (n, unknowns).

        λ_x and λ_y act each in its family.
        """
        result = np.zeros((len(strains), len(self.unknowns)))
        for (i, j), where in self.slices.items():
            if sum(orders) == orders[i] + orders[j]:
                first, second = self.bases[i, j]
                left, right = first.design(strains[:, i], orders[i]), second.design(strains[:, j], orders[j])
                result[:, where] = _products(left, right)
        return result

    def _add_moduli(self) -> None:
        """Second derivatives of all states where they are known."""
        data = self.data
        known = known_moduli(data)
        strains = [k for k in range(5) if self.axes[k].sampled]
        if len(known) == 0 or not strains:
            return
        white = whitening(data.moduli[known], strains)
        for begin in range(0, len(known), _STATES_AT_ONCE):
            part = slice(begin, begin + _STATES_AT_ONCE)
            rows, target = self._modulus_equations(known[part], white[part], strains)
            self.matrix += rows.T @ rows
            self.right += rows.T @ target

    def _modulus_equations(
        self, states: NDArray[np.int64], white: Array, acting: list[int]
    ) -> tuple[Array, Array]:
        """Whitened rows and targets of the moduli by some strains, and of II12 twice where curvatures are coupled."""
        data, n, k = self.data, len(states), len(acting)
        strains, seen = data.strains[states], data.moduli[states]
        weights = np.where(data.resting[states], _REST_WEIGHT, _MODULUS_WEIGHT) * data.weights[states]
        strong = np.sqrt(weights)
        rows, target = np.zeros((n, k, k, len(self.unknowns))), np.zeros((n, k, k))
        for a, i in enumerate(acting):
            for b, j in enumerate(acting[: a + 1]):
                if (j, i) == (3, 4) and not self.couples:
                    continue
                orders = orders_of(i, j)
                rows[:, a, b] = rows[:, b, a] = self.rows(strains, orders)
                single = self.axes[i].spline(strains[:, i], 2) if i == j else 0.0
                target[:, a, b] = target[:, b, a] = seen[:, IN_STRESS[i], IN_STRESS[j]] - single
        rows = np.einsum("nai,nijq->najq", white, rows, optimize=True)
        rows = np.einsum("nbj,najq->nabq", white, rows, optimize=True)
        target = np.einsum("nai,nbj,nij->nab", white, white, target, optimize=True)
        lower = np.tril_indices(k)
        twice = strong[:, None] * np.where(lower[0] == lower[1], 1.0, np.sqrt(2.0))
        chosen = twice[:, :, None] * rows[:, lower[0], lower[1]]
        all_rows = [chosen.reshape(n * len(lower[0]), -1)]
        all_targets = [(twice * target[:, lower[0], lower[1]]).ravel()]
        if self.couples:
            twist, single = self.twist_rows(strains)
            size = np.abs(seen[:, TWIST, TWIST])
            weight = strong / (size + NOISE**0.5 * np.median(size))
            all_rows.append(weight[:, None] * twist)
            all_targets.append(weight * (seen[:, TWIST, TWIST] - single))
        return np.concatenate(all_rows), np.concatenate(all_targets)

    @property
    def couples(self) -> bool:
        """Whether there is a term of both curvatures."""
        return False

    def twist_rows(self, strains: Array) -> tuple[Array, Array]:
        """∂²ψ/∂II12² at states (n, 5) of diagonal second forms: rows (n, unknowns), and what the f_i add (n,)."""
        rows, part = np.zeros((len(strains), len(self.unknowns))), np.zeros(len(strains))
        for family in range(2):
            spline, orders = self.axes[3 + family].spline, np.zeros(5, dtype=int)

            def terms(states: Array, order: int, orders: Array = orders, family: int = family) -> Array:
                orders[3 + family] = order
                return self.rows(states, tuple(orders))  # type: ignore[arg-type]

            def single(
                states: Array, order: int, spline: CubicSpline = spline, family: int = family
            ) -> Array:
                return spline(states[:, 3 + family], order)

            rows += by_twist(strains, family, terms)
            part += by_twist(strains, family, single)
        return rows, part

    def solve(self) -> None:
        """Least squares."""
        if len(self.unknowns):
            self.free = self.unknowns = cho_solve(cho_factor(self.matrix), self.right)

    def hold_above(self, strains: Array, floor: Array) -> None:
        """Least change of the free solution that gives ψ ≥ floor (n,) at states (n, 5).

        What is added is kept smoother than the solution, or lifting one state would drop its neighbours. Solved
        through the dual: one of ``multipliers`` ≥ 0 a state, non-negative least squares on the factor.
        """
        if self._stiff is None:
            self._stiff = cho_factor(self.matrix + _LIFT_SMOOTHING * self.rough)
        rows = self.rows(strains)
        spread = cho_solve(self._stiff, rows.T)
        missing = floor - self.axis_energy(strains) - rows @ self.free
        compliance = rows @ spread
        compliance[np.diag_indices(len(compliance))] += _SOFTNESS * np.mean(np.diag(compliance)) + 1e-300
        lower = cholesky(compliance, lower=True)
        reduced = solve_triangular(lower, missing, lower=True)
        self.multipliers = nnls(lower.T, reduced, maxiter=30 * len(rows))[0]
        self.unknowns = self.free + spread @ self.multipliers

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
