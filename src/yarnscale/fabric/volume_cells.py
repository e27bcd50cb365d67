"""The homogenized elasticity of a fabric of spline yarns in a volume: a periodic cell at every Gauss point.

The volume's mid-surface φ(X, Y) = Σ N_i(X, Y) α_i is a bicubic B-spline surface. Its fundamental forms (I, II) at a
Gauss point are the macroscopic state of one period of the stitches, whose control points are

    x = m(X; I, II) + R(X; I, II) û

with the same û for every copy (theory §2). The energy is that of the yarns of all cells and of their contact
(``CellTouch``), weighted by the area that each represents; stiff springs keep the stitches (LOD03 §2). It is minimised
in α and all û together, so that each cell is in equilibrium under the forms of the surface; û has no mass. The sparse
factorisation eliminates û cell by cell, and what is left for α is a Kirchhoff–Love shell with the homogenized energy of
the stitches.
"""

from __future__ import annotations

import math
from functools import cache
from typing import Literal, NamedTuple

import casadi as ca
import numpy as np
from scipy.sparse import csr_array, kron

from yarnscale.arrays import Array, Integers
from yarnscale.cell.midsurface import midsurface_point
from yarnscale.errors import InputError
from yarnscale.fabric.cell_touch import CellTouch
from yarnscale.fabric.spline_contacts import StitchSprings, stitch_stiffness
from yarnscale.fabric.spline_knit import SplineFabric
from yarnscale.fabric.spline_model import SplineEnergy, evenly_shifted, spline_parameters
from yarnscale.fabric.spline_period import SplinePeriod
from yarnscale.fabric.spline_yarn import SPLINE_SEGMENT
from yarnscale.fabric.volume import DEGREE, BoundingVolume
from yarnscale.fabric.volume_points import VolumePoints
from yarnscale.fabric.volume_surface import SurfacePoints
from yarnscale.numerics.assembly import StencilSet, position_variables
from yarnscale.numerics.block_pattern import BlockPattern
from yarnscale.numerics.kernel import Kernel, compile_kernel, run_columns
from yarnscale.numerics.regularisation import ShiftedHessian

_GAUSS = 3
"""Gauss points of a patch in each direction."""
_FORMS, _DERIVATIVES = 6, 15

Reduction = Literal["published", "homogenized"]
"""What a volume's elasticity is: that of the yarns fixed in it (LOD03), or that of periodic cells (``VolumeCells``)."""


@cache
def _forms_kernels() -> tuple[Kernel, Kernel]:
    """φ,x φ,y φ,xx φ,xy φ,yy (15) → forms (6), their Jacobian (6×15); with a stress (6) → Σ stress ∇² forms (15×15)."""
    d, stress = ca.SX.sym("d", _DERIVATIVES), ca.SX.sym("stress", _FORMS)
    a, b, bent = d[:3], d[3:6], (d[6:9], d[9:12], d[12:])
    normal = ca.cross(a, b)
    normal /= ca.sqrt(ca.dot(normal, normal))
    forms = ca.vertcat(ca.dot(a, a), ca.dot(a, b), ca.dot(b, b), *[ca.dot(normal, k) for k in bent])
    slope = ca.vec(ca.densify(ca.jacobian(forms, d)).T)
    curve = ca.vec(ca.densify(ca.hessian(ca.dot(stress, forms), d)[0]))
    return _compiled("surface_forms", [d], [forms, slope]), _compiled("surface_bend", [d, stress], [curve])


@cache
def _node_kernels() -> tuple[Kernel, Kernel]:
    """forms, X, û → x (3), ∂x/∂(û, forms) (3×9); with a force (3) → Σ force ∇²x by the same (9×9)."""
    forms, place, u, force = (ca.SX.sym(name, n) for name, n in (("forms", 6), ("X", 3), ("u", 3), ("force", 3)))
    a, b = ca.sqrt(forms[0]), ca.sqrt(forms[2])
    point, rotation = midsurface_point(ca.vertcat(a - 1, forms[1] / (a * b), b - 1, forms[3:]), place)
    x, by = point + rotation @ u, ca.vertcat(u, forms)
    slope = ca.vec(ca.densify(ca.jacobian(x, by)).T)
    curve = ca.vec(ca.densify(ca.hessian(ca.dot(force, x), by)[0]))
    given = [forms, place, u]
    return _compiled("cell_node", given, [x, slope]), _compiled("cell_node_bend", [*given, force], [curve])


def _compiled(name: str, inputs: list[ca.SX], outputs: list[ca.SX]) -> Kernel:
    return compile_kernel(ca.Function(name, inputs, outputs, {"cse": True}), name)


class _Placed(NamedTuple):
    """Cells at a state: derivatives of the surface (g, 15), slopes of the forms (g, 6, 15), nodes (g·m, 3) [m], their
    Jacobian by fluctuation and forms (g, m, 3, 9), and what the kernels of nodes were given."""

    derivatives: Array
    slopes: Array
    points: Array
    jacobian: Array
    given: tuple[Array, Array, Array]


class VolumeCells:
    """Energy [J], its derivatives [N, N/m] and mass of a fabric of spline yarns in a volume, for ``SplineMotion``.

    Full vectors: control points of the mid-surface (c, 3), then the fluctuations of every cell (g·n, 3), all [m].
    Mass and weight are those of the yarns' control points on the mid-surface, as in LOD03 §5.
    """

    def __init__(self, yarns: SplineEnergy, volume: BoundingVolume) -> None:
        self._yarns, fabric, area = yarns, yarns.fabric, period_of(yarns.fabric).area
        self._grid = _gauss_points(fabric, volume)
        (x, wide), (y, tall) = self._grid
        self._surface = SurfacePoints(volume, np.repeat(x, len(y)), np.tile(y, len(x)))
        shares = (wide[:, None] * tall).ravel() / area
        self.touch = CellTouch(fabric, shares)
        self._period = period = self.touch.period
        self._cells, self._nodes = len(shares), len(period.source)
        self._controls = volume.count // 2
        self.size = 3 * (self._controls + self._cells * period.count)
        rest = fabric.control.reshape(-1, 3)
        surface = SurfacePoints(volume, rest[:, 0], rest[:, 1])
        self._weights = surface.weights()
        between = [_between(*pair) for pair in ((x, rest[:, 0]), (y, rest[:, 1]))]
        sources = period.sources(fabric.yarn_count, fabric.points_per_yarn, fabric.first_course)
        around, shares_of = _around(between, len(y))
        nodes = self._controls + around * period.count + sources[:, None]
        self.points = VolumePoints(surface, nodes, shares_of, rest[:, 2])
        """All control points of the yarns."""
        control = volume.control_at_rest[::2] * [1.0, 1.0, 0.0]
        self.at_rest = np.concatenate([control, np.zeros((self._cells * period.count, 3))])
        self._make_energies(fabric, shares)
        self._make_pattern()

    def _make_energies(self, fabric: SplineFabric, shares: Array) -> None:
        period, cells = self._period, self._cells
        parameters = np.tile(spline_parameters(fabric, period.reference, period.segments), (cells, 1))
        for name in ("stretch_stiffness", "bending_stiffness"):
            parameters[:, SPLINE_SEGMENT.parameter_rows(name)] *= np.repeat(shares, period.count)[:, None]
        begin = self._nodes * np.arange(cells)[:, None, None]
        segments = (begin + period.segments).reshape(-1, 4)
        self._segments = StencilSet(SPLINE_SEGMENT, position_variables(segments), parameters, 4)
        self._anchors = stitch_stiffness(fabric) * shares
        along = period.stitches, period.weights, period.slopes
        self._stitches = StitchSprings(*along, period.reference, self._anchors)
        self._reference = np.tile(period.reference, (cells, 1))

    def _make_pattern(self) -> None:
        first = 3 * self._controls
        inner = first + np.arange(self.size - first).reshape(self._cells, -1)
        unknowns = np.concatenate([inner, position_variables(self._surface.active)], axis=1)
        everything = [unknowns, np.arange(first)[None]]
        blocks = BlockPattern.of(np.full(self.size // 3, 3), everything)
        self.pattern = blocks.pattern
        self._lower = np.tril_indices(unknowns.shape[1])
        slots = blocks.slots(unknowns).transpose(0, 2, 1).reshape(-1, len(self._lower[0]))
        self._slots = slots[: self._cells].ravel()
        columns, rows = self.pattern.columns, self.pattern.rows
        kept = np.flatnonzero((rows < first) & (rows % 3 == columns % 3))
        self.mass_entries = np.zeros(self.pattern.entries)
        self.mass_entries[kept] = self.mass_matrix().toarray()[rows[kept] // 3, columns[kept] // 3]

    def mass_matrix(self) -> csr_array:
        """Mass matrix of one component of the mid-surface's control points, (c, c) [kg]: Γᵀ M Γ."""
        return csr_array(self._weights.T @ self._yarns.mass_matrix() @ self._weights)

    def weight(self, acceleration: Array) -> Array:
        """Force of a uniform acceleration (3,) [m/s²] on the mid-surface's control points, (3c,) [N]."""
        return (self._weights.T @ self._yarns.weight(acceleration).reshape(-1, 3)).ravel()

    def rows(self, points: csr_array) -> csr_array:
        """Matrix (3k, size) to points of yarns, taken as on the mid-surface; points: from the yarns' control points."""
        one = points[::3, ::3] @ self._weights
        wide = csr_array((one.data, one.indices, one.indptr), shape=(one.shape[0], self.size // 3))  # type: ignore[index]
        return csr_array(kron(wide, np.eye(3)))

    def yarns(self, positions: Array, velocities: Array) -> tuple[Array, Array]:
        """Control points of the yarns (n, 3) [m] with fluctuations, and velocities of the mid-surface there [m/s]."""
        return self.points.at(positions), np.asarray(self._weights @ velocities[: self._controls])

    def value(self, x: Array) -> float:
        """Energy [J]; inf where the surface has no area."""
        points = self._placed(x).points
        if not np.isfinite(points).all():
            return math.inf
        nodes = self._of_cells(points)
        energy = self._segments.value(points.ravel()) + self._stitches.value(nodes) + self.touch.value(nodes)
        return energy + self._anchored(x)[0]

    def gradient(self, x: Array) -> tuple[float, Array]:
        return self._forces(x, self._placed(x))[:2]

    def quadratic(self, x: Array) -> tuple[float, Array, ShiftedHessian]:
        placed = self._placed(x)
        value, gradient, force, stress = self._forces(x, placed)
        cells, count = self._cells, self._period.count
        inner = 3 * count
        local = np.zeros((cells, (inner + _FORMS) ** 2))
        hessians = self._segments.elements(placed.points.ravel())[2]
        self._add(local, self._every(self._period.segments), placed.jacobian, hessians, None)
        hessians, ties = self._stitches.hessians(self._of_cells(placed.points)), self._stitches.ties
        self._add(local, self._every(self._stitches.nodes), placed.jacobian, hessians, np.tile(ties, (cells, 1, 1)))
        cell, nodes, ties, touching = self.touch.hessians(self._of_cells(placed.points))
        self._add(local, (cell, nodes), placed.jacobian, touching, ties)
        cell, nodes = np.nonzero(force.any(axis=2))
        pulled = cell * self._nodes + nodes
        given = (values[pulled] for values in placed.given)
        (bends,) = run_columns(_node_kernels()[1], *given, force[cell, nodes])
        _scatter(local, cell, self._places(nodes[:, None]), bends.reshape(-1, 9, 9))
        local = local.reshape(cells, inner + _FORMS, -1)
        for k in range(3):
            local[:, k:inner:3, k:inner:3] += self._anchors[:, None, None] / count**2
        surface = self._surface.local
        to_forms = placed.slopes @ surface
        (bend,) = run_columns(_forms_kernels()[1], placed.derivatives, stress)
        bend = bend.reshape(cells, _DERIVATIVES, _DERIVATIVES)
        back, rows = to_forms.transpose(0, 2, 1), inner + to_forms.shape[2]
        whole = np.zeros((cells, rows, rows))
        whole[:, :inner, :inner] = local[:, :inner, :inner]
        whole[:, inner:, :inner] = back @ local[:, inner:, :inner]
        whole[:, inner:, inner:] = back @ local[:, inner:, inner:] @ to_forms
        whole[:, inner:, inner:] += surface.transpose(0, 2, 1) @ bend @ surface
        lower = whole[:, self._lower[0], self._lower[1]].ravel()
        entries = np.bincount(self._slots, weights=lower, minlength=self.pattern.entries)
        return value, gradient, evenly_shifted(self.pattern, entries.astype(np.float64, copy=False))

    def _placed(self, x: Array) -> _Placed:
        first = 3 * self._controls
        derivatives = self._surface.derivatives(x[:first].reshape(-1, 3))
        forms, slopes = run_columns(_forms_kernels()[0], derivatives)
        moved = x[first:].reshape(self._cells, -1, 3)[:, self._period.source].reshape(-1, 3)
        given = np.repeat(forms, self._nodes, axis=0), self._reference, moved
        points, jacobian = run_columns(_node_kernels()[0], *given)
        return _Placed(
            derivatives, slopes.reshape(-1, _FORMS, _DERIVATIVES), points,
            jacobian.reshape(self._cells, self._nodes, 3, 9), given,
        )  # fmt: skip

    def _anchored(self, x: Array) -> tuple[float, Array]:
        """Energy of springs on the mean fluctuation of every cell, as stiff as those of stitches, and its gradient."""
        mean = x[3 * self._controls :].reshape(self._cells, -1, 3).mean(axis=1)
        pull = self._anchors[:, None] * mean
        gradient = np.repeat(pull[:, None] / self._period.count, self._period.count, axis=1)
        return 0.5 * float((pull * mean).sum()), gradient

    def _forces(self, x: Array, placed: _Placed) -> tuple[float, Array, Array, Array]:
        """Energy, its gradient, and its derivatives by nodes (g, m, 3) and by forms (g, 6)."""
        flat = np.zeros(placed.points.size)
        value = self._segments.gradient(placed.points.ravel(), flat)
        force = flat.reshape(self._cells, self._nodes, 3)
        value += self._stitches.gradient(self._of_cells(placed.points), force)
        pressed, push = self.touch.gradient(self._of_cells(placed.points))
        force += push
        moved = np.einsum("gmc,gmcv->gmv", force, placed.jacobian)
        anchor, inner = self._anchored(x)
        np.add.at(inner.transpose(1, 0, 2), self._period.source, moved[:, :, :3].transpose(1, 0, 2))
        stress = moved[:, :, 3:].sum(axis=1)
        outer = self._surface.pulled(np.einsum("gk,gkd->gd", stress, placed.slopes))
        gradient = np.concatenate([outer.ravel(), inner.ravel()])
        return value + pressed + anchor, gradient, force, stress

    def _places(self, nodes: Integers) -> Integers:
        """Unknowns of a cell (e, 3k + 6) that elements with nodes (e, k) depend on: fluctuations, then forms."""
        forms = np.broadcast_to(3 * self._period.count + np.arange(_FORMS), (len(nodes), _FORMS))
        return np.concatenate([position_variables(self._period.source[nodes]), forms], axis=1)

    def _every(self, nodes: Integers) -> tuple[Integers, Integers]:
        """Elements with the same nodes (e, k) in all cells: the cell of each (g·e,), and its nodes (g·e, k)."""
        return np.repeat(np.arange(self._cells), len(nodes)), np.tile(nodes, (self._cells, 1))

    def _add(
        self, local: Array, elements: tuple[Integers, Integers], jacobian: Array, hessians: Array, ties: Array | None
    ) -> None:
        """Add the Hessians of elements, cells (e,) and nodes (e, k), by the unknowns of the cell.

        hessians: by the nodes' positions, or by what ``ties`` (e, i, k) makes of them.
        """
        cell, nodes = elements
        e, k = nodes.shape
        by = jacobian[cell[:, None], nodes]
        wide = np.zeros((e, k, 3, 3 * k + _FORMS))
        for node in range(k):
            wide[:, node, :, 3 * node : 3 * node + 3] = by[:, node, :, :3]
        wide[..., 3 * k :] = by[..., 3:]
        if ties is not None:
            wide = np.einsum("eij,ejcv->eicv", ties, wide)
        flat = wide.reshape(e, 3 * wide.shape[1], wide.shape[3])
        _scatter(local, cell, self._places(nodes), flat.transpose(0, 2, 1) @ (hessians @ flat))

    def bound(self, x: Array, step: Array) -> float:
        """Fraction of a step (n,) [m] in which no yarns of a cell meet, but for what surfaces turn in it."""
        placed, cells = self._placed(x), self._cells
        first = 3 * self._controls
        derivatives = self._surface.derivatives(step[:first].reshape(-1, 3))
        forms = np.einsum("gfd,gd->gf", placed.slopes, derivatives)
        moved = step[first:].reshape(cells, -1, 3)[:, self._period.source]
        by = np.concatenate([moved, np.broadcast_to(forms[:, None], (cells, self._nodes, _FORMS))], axis=2)
        return self.touch.bound(self._of_cells(placed.points), np.einsum("gmcv,gmv->gmc", placed.jacobian, by))

    def forget(self) -> None:
        """List contacts anew."""
        self.touch.forget()

    def _of_cells(self, points: Array) -> Array:
        return points.reshape(self._cells, self._nodes, 3)


def period_of(fabric: SplineFabric) -> SplinePeriod:
    """The fabric's period. Raises InputError where it has none."""
    if fabric.period is None:
        raise InputError("yarns in a homogenized volume", expected="a fabric with a period", found="single yarns")
    return fabric.period


def cell_unknowns(fabric: SplineFabric, volume: BoundingVolume) -> int:
    """Unknowns of all cells."""
    (x, _), (y, _) = _gauss_points(fabric, volume)
    return 3 * len(x) * len(y) * period_of(fabric).count


def _gauss_points(fabric: SplineFabric, volume: BoundingVolume) -> list[tuple[Array, Array]]:
    """Gauss points [m] and weights [m] along x and along y, of the area that the fabric's stitches take up."""
    period, (yarns, points, _) = period_of(fabric), fabric.control.shape
    wide = (points - 3) * period.courses / period.count * period.width
    tall = yarns / period.courses * period.height
    middle = 0.5 * (fabric.control[:, :, 1].min() + fabric.control[:, :, 1].max())
    pairs = (volume.x_knots, 0.0, wide), (volume.y_knots, middle, tall)
    return [_gauss(knots, centre - 0.5 * size, centre + 0.5 * size) for knots, centre, size in pairs]


def _gauss(knots: Array, low: float, high: float) -> tuple[Array, Array]:
    """Gauss points and weights of the parts of patches that lie between two borders."""
    ends = np.clip(knots[DEGREE : len(knots) - DEGREE], low, high)
    size = np.diff(ends)
    kept = size > 1e-9 * (high - low)
    nodes, weights = np.polynomial.legendre.leggauss(_GAUSS)
    points = ends[:-1][kept, None] + 0.5 * size[kept, None] * (nodes + 1.0)
    return points.ravel(), (0.5 * size[kept, None] * weights).ravel()


def _between(points: Array, places: Array) -> tuple[Integers, Array]:
    """The point before each place, and the share of the way to the next, for linear interpolation within the ends."""
    before = np.clip(np.searchsorted(points, places) - 1, 0, len(points) - 2)
    share = (places - points[before]) / (points[before + 1] - points[before])
    return before, np.clip(share, 0.0, 1.0)


def _around(between: list[tuple[Integers, Array]], width: int) -> tuple[Integers, Array]:
    """The four cells around points (k, 4) and their shares in a bilinear interpolation.

    between: of ``_between`` along x and y; width: cells along y.
    """
    (low, right), (below, up) = between
    cells = [(low + i) * width + below + j for i in (0, 1) for j in (0, 1)]
    shares = [across * along for across in (1.0 - right, right) for along in (1.0 - up, up)]
    return np.stack(cells, axis=1), np.stack(shares, axis=1)


def _scatter(local: Array, cell: Integers, places: Integers, blocks: Array) -> None:
    """Add blocks (e, k, k) at places (e, k) of the square matrices of cells (e,), each a row of ``local``."""
    size = local.shape[1]
    index = (cell * size)[:, None, None] + places[:, :, None] * math.isqrt(size) + places[:, None, :]
    local += np.bincount(index.ravel(), weights=blocks.ravel(), minlength=local.size).reshape(local.shape)
