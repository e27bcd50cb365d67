"""Terms of all three in-plane strains, fitted together with the two-dimensional ones (stage 2 of the fit).

Where pairs of strains are not enough, states inside the range say what is missing: their energies and all their
stresses. Also flat states count for bending: their bending stresses are the slopes of the bending terms at λ = 0. The
coupling of both curvatures follows from the moment along the axis of states bent about one: no others are needed.
The other splines vanish where two (g_0) or all but two (the factors of curvature) in-plane strains are alone, so that
axes and planes keep the terms they have in a sum over pairs.
"""

from __future__ import annotations

from itertools import product

import numpy as np
from numpy.typing import NDArray

from yarnscale.homogenize.axis_fit import AxisTerm
from yarnscale.homogenize.observations import SHEAR, FitOptions, Mask, Observations
from yarnscale.homogenize.plane_fit import PlaneFit
from yarnscale.homogenize.splines import LineBasis, knots_for
from yarnscale.shell.materials.inside import COUPLING, SHAPES, SOLIDS, InsideTerms
from yarnscale.shell.materials.tables import CubicSpline

Array = NDArray[np.float64]
Orders = tuple[int, int, int, int, int]

_NOISE = 0.3
"""Stress, as a fraction of the largest of its component, below which its residuals stop being relative."""
_SLOPE_WEIGHT = 1.0
"""Weight of a stress beside an energy."""
_PLANE_KNOTS = 12
"""Most knots of an axis in two-dimensional terms: scattered samples do not say where more of them are worth it."""
_COUPLING_REACH = 2.0
"""Curvature of the coupling, in units of the largest sampled one."""
_STIFFNESS = 1e-5
"""Weight of coefficients themselves: splines of states that nothing was said about stay small."""


class InsideFit(PlaneFit):
    """Normal equations of two-dimensional terms and of terms of three in-plane strains; see ``PlaneFit``."""

    def __init__(
        self, data: Observations, axes: list[AxisTerm], constant: float, sides: Array, options: FitOptions
    ) -> None:
        super().__init__(data, axes, constant, sides, options)
        self.lines = [self._line(k) for k in range(3)]
        self.shapes = [_shapes(data.strains[:, k]) for k in (3, 4)]
        self.curvature = _COUPLING_REACH * float(np.max(np.abs(data.strains[:, 3:]))) or 1.0
        self.chosen = self._chosen()
        self.ends = np.cumsum([0, *(len(columns) for columns in self.chosen)])
        old, size = len(self.unknowns), len(self.unknowns) + int(self.ends[-1])
        matrix, rough, right = np.zeros((size, size)), np.zeros((size, size)), np.zeros(size)
        matrix[:old, :old], rough[:old, :old], right[:old] = self.matrix, self.rough, self.right
        self.old, self.unknowns = old, np.zeros(size)
        for t in range(SOLIDS):
            if len(self.chosen[t]) == 0:
                continue
            where = slice(old + self.ends[t], old + self.ends[t + 1])
            bends = self._solid_bends(t)
            rough[where, where] = bends.T @ bends
            matrix[where, where] = options.smoothing * rough[where, where]
            matrix[where, where] += _STIFFNESS / self._unit(t) ** 2 * np.eye(len(self.chosen[t]))
        self.matrix, self.rough, self.right = matrix, rough, right
        self._add_states_inside()
        super()._add_moduli()
        self.matrix[np.diag_indices(size)] += 1e-13 * np.trace(self.matrix) / size

    def _basis(self, axis: int, inside: Mask, limit: int | None = None) -> LineBasis:
        off = self.data.acting[:, axis] & self.data.off_planes
        return super()._basis(axis, inside | off, limit=min(self.options.plane_knots, _PLANE_KNOTS))

    def _add_states_off_planes(self) -> None:
        """They are added with the terms that can follow them."""

    def _add_moduli(self) -> None:
        """They too."""

    def _line(self, axis: int) -> LineBasis:
        even = axis == SHEAR and self.options.symmetric_shear
        samples = self.data.strains[self.data.inside, axis]
        knots = knots_for(samples, limit=self.options.inside_knots, even=even, grading=0.0, slopes=True)
        return LineBasis(knots, even=even, flat=True)

    def _chosen(self) -> list[NDArray[np.int64]]:
        """For each spline, its columns of the tensor product of (1, basis): three strains act in g_0, two in others."""
        acts = [np.arange(line.count + 1) > 0 for line in self.lines]
        acting = np.stack(np.meshgrid(*acts, indexing="ij")).sum(axis=0).ravel()
        columns = [np.flatnonzero(acting == 3)]
        for axis in (3, 4):
            columns += [np.flatnonzero((acting >= 2) & self.axes[axis].sampled)] * SHAPES
        return [*columns, np.flatnonzero(np.full(acting.shape, self.couples))]

    @property
    def couples(self) -> bool:
        """Whether the states bend about both axes, in turn or at once."""
        return self.axes[3].sampled and self.axes[4].sampled

    def _unit(self, solid: int) -> float:
        """Energy [J/m²] that a coefficient of this spline may well have."""
        if solid == 0:
            return 0.1 * float(np.max(np.abs(self.data.energies - self.constant)))
        family = slice(3, 5) if solid == COUPLING else 3 if solid <= SHAPES else 4
        return max(float(np.nan_to_num(self.sides[family]).max()), 1e-300)

    def _solid_bends(self, solid: int) -> Array:
        """Third differences of coefficients along each strain, relative to the unit of the spline."""
        parts = []
        for along in range(3):
            factors = []
            for k, line in enumerate(self.lines):
                free = np.concatenate([np.ones((line.active, 1)), line.reduction], axis=1)
                factors.append(line.differences(3) @ free if k == along else free)
            rows = np.einsum("ap,bq,cr->abcpqr", *factors, optimize=True)
            parts.append(rows.reshape(-1, np.prod([f.shape[1] for f in factors], dtype=np.int64)))
        return np.concatenate(parts)[:, self.chosen[solid]] / self._unit(solid)

    def inside_rows(self, strains: Array, orders: Orders = (0, 0, 0, 0, 0)) -> Array:
        """Derivatives of the terms of three strains at states (n, 5) by their unknowns."""
        solid = self._solid(strains, orders[:3])
        parts = [solid[:, self.chosen[0]] * (orders[3] == orders[4] == 0)]
        for family in range(2):
            for m, shape in enumerate(self.shapes[family]):
                factor = shape(strains[:, 3 + family], orders[3 + family]) * (orders[4 - family] == 0)
                parts.append(factor[:, None] * solid[:, self.chosen[1 + family * SHAPES + m]])
        factor = _coupling(strains[:, 3:] / self.curvature, orders[3:]) / self.curvature ** sum(orders[3:])
        parts.append(factor[:, None] * solid[:, self.chosen[COUPLING]])
        return np.concatenate(parts, axis=1)

    def _solid(self, strains: Array, orders: tuple[int, int, int]) -> Array:
        """Derivatives of the tensor product of (1, basis) along each in-plane strain, (n, columns)."""
        factors = []
        for k, line in enumerate(self.lines):
            constant = np.full((len(strains), 1), 1.0 if orders[k] == 0 else 0.0)
            factors.append(np.concatenate([constant, line.design(strains[:, k], orders[k])], axis=1))
        return np.einsum("np,nq,nr->npqr", *factors, optimize=True).reshape(len(strains), -1)

    def rows(self, strains: Array, orders: Orders = (0, 0, 0, 0, 0)) -> Array:
        """Derivatives of all terms of stage 2 at states (n, 5) by the unknowns, (n, unknowns)."""
        result = super().rows(strains, orders)
        result[:, self.old :] = self.inside_rows(strains, orders)
        return result

    def twist_rows(self, strains: Array) -> tuple[Array, Array]:
        """∂²ψ/∂II12² at states (n, 5) of diagonal second forms: rows (n, unknowns), and what the f_i add (n,)."""
        rows, part = super().twist_rows(strains)
        where = slice(self.old + self.ends[COUPLING], self.old + self.ends[COUPLING + 1])
        x, y = strains[:, 3:].T / self.curvature
        size = 1 + x * x + y * y
        factor = 2 * (size - 2 * x * y) / size**2 / self.curvature**2
        rows[:, where] = factor[:, None] * self._solid(strains, (0, 0, 0))[:, self.chosen[COUPLING]]
        return rows, part

    def _add_states_inside(self) -> None:
        """Energies and stresses of states off the planes, bending stresses of all flat states."""
        data = self.data
        off = data.off_planes
        total = np.abs(data.energies - self.constant)
        scale = total + self.options.small * np.max(total)
        self._add(off, (0, 0, 0, 0, 0), self.rest, scale)
        for k in range(5):
            orders: Orders = tuple(int(i == k) for i in range(5))  # type: ignore[assignment]
            stress = data.stresses[:, k]
            # Of states bent along the other axis only, this moment is what couples both.
            states = off if k < 3 else off | ~data.acting[:, k]
            states = states & np.isfinite(stress)
            if np.any(states) and self.axes[k].sampled:
                size = np.abs(stress) + _NOISE * np.nanmax(np.abs(stress))
                target = stress - self.axes[k].spline(data.strains[:, k], 1)
                self._add(states, orders, target, size / _SLOPE_WEIGHT)

    def _add(self, states: Mask, orders: Orders, target: Array, scale: Array) -> None:
        weight = (np.sqrt(self.data.weights) / scale)[states]
        rows = weight[:, None] * self.rows(self.data.strains[states], orders)
        self.matrix += rows.T @ rows
        self.right += rows.T @ (weight * target[states])

    def inside(self) -> InsideTerms:
        """The terms of three strains as nodal data."""
        knots = tuple(line.breaks for line in self.lines)
        nodal = np.empty((SOLIDS, 2, 2, 2, *(len(k) for k in knots)))
        counts = [line.count + 1 for line in self.lines]
        for orders in product((0, 1), repeat=3):
            factors = []
            for line, order in zip(self.lines, orders, strict=True):
                constant = np.full((len(line.breaks), 1), 1.0 - order)
                factors.append(np.concatenate([constant, line.design(line.breaks, order)], axis=1))
            for t in range(SOLIDS):
                grid = np.zeros(int(np.prod(counts)))
                grid[self.chosen[t]] = self.unknowns[self.old + self.ends[t] : self.old + self.ends[t + 1]]
                grid = grid.reshape(counts)
                nodal[(t, *orders)] = np.einsum("ip,jq,kr,pqr->ijk", *factors, grid, optimize=True)
        return InsideTerms(knots, nodal, self.shapes[0], self.shapes[1], self.curvature)  # type: ignore[arg-type]


def _coupling(bends: Array, orders: tuple[int, ...]) -> Array:
    """χ of diagonal second forms (n, 2) in units of κ, or a first or second derivative by the two."""
    x, y = bends.T if orders[0] >= orders[1] else bends.T[::-1]
    size = 1 + x * x + y * y
    match max(orders), sum(orders):
        case 0, 0:
            return x * y / size
        case 1, 1:
            return y / size - 2 * x * x * y / size**2
        case 1, 2:
            return 1 / size - 2 * (x * x + y * y) / size**2 + 8 * x * x * y * y / size**3
        case _:
            return -6 * x * y / size**2 + 8 * x**3 * y / size**3


def _shapes(curvatures: Array) -> tuple[CubicSpline, ...]:
    """λ and λ², in units of the largest curvature R, within ±R; constant beyond ±1.6 R, C² everywhere."""
    largest = float(np.max(np.abs(curvatures)))
    if largest == 0.0:
        flat = CubicSpline(np.array([-1.0, 1.0]), np.zeros(2), np.zeros(2))
        return (flat,) * SHAPES
    step = 0.3
    places = np.array([-1 - 2 * step, -1 - step, -1, 1, 1 + step, 1 + 2 * step])
    shapes = []
    for power in range(1, SHAPES + 1):
        # Two cubics from 1 on: curvature q at 1, a at 1 + step, 0 at the end, piecewise linear; slope 0 at the end.
        slope, bend = float(power), power * (power - 1.0)
        a = -slope / step - bend / 2
        middle = slope + (bend + a) / 2 * step
        value = 1 + slope * step + step**2 * (bend / 3 + a / 6)
        end = value + middle * step + step**2 * a / 3
        values, slopes = np.array([1, value, end]), np.array([slope, middle, 0])
        sign = (-1.0) ** power
        shapes.append(
            CubicSpline(
                places * largest,
                np.concatenate([sign * values[::-1], values]),
                np.concatenate([-sign * slopes[::-1], slopes]) / largest,
            )
        )
    return tuple(shapes)
