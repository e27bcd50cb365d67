"""The midsurface of a cell for every macroscopic state: least squares ∇φ ≈ R S (theory §2; HYLC20 eq. 16–17).

R(ξ) = exp [w]×, w = ξ^α ω_α, has R S as a gradient only where det II = 0. Elsewhere φ solves the Poisson problem
∇²φ = ∇·R S with natural boundary conditions. Coordinates count from the centre of the tile, where R = 1. Here φ is the
closed form V(w) S ξ plus a correction ψ, and the grid carries ψ only:

    ∇²ψ = ∇·T,  T = R S − ∇(V S ξ),  N·∇ψ = N·T on the boundary.

T vanishes where det II = 0, so cylinders are exact and Ψ runs smoothly through them. ψ is linear in T, so its
derivatives by the state are the same solve with ∂T/∂z. Gradients live on the edges of a regular grid (second order);
cosines diagonalise the operator with its natural boundary, so one fast transform replaces the factorisation.

**The domain.** Cloth with Gaussian curvature cannot keep lengths: least squares spreads the misfit, of the order
det II · L² in strain, over its domain of size L, with zero mean there. Were the domain the tile and its ring of copies,
the tile would be left stretched by an amount that depends on the size of the ring (κ²L²/16 at the middle of a dome of
radius L). The element to homogenise is the tile, so the mean of ∇φ over the *tile* is made that of R S (on the
published domain, the element itself, natural boundary conditions imply this); a linear term does it and keeps
∇²φ = ∇·R S. What is left of the choice is of the order det II · p², p the period.

**What energy density then means.** Copies of the tile are not related by an isometry: each has its own small strain.
Ψ is the energy of the yarn of the primary tile in its surroundings, over the tile's area: edges and joints belong to
the tile of their first edge's vertex and of their middle vertex, a contact pair half to each of its two segments. For
flat and singly curved states this is the energy of any tile; else it differs between tiles by O(det II · p²) in
strain, the limit to which a constant second form with Gaussian curvature has a meaning for a cell of that size.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache, cached_property, lru_cache

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike
from scipy.fft import dct, idct
from scipy.interpolate import NdBSpline, make_interp_spline

from yarnscale.arrays import Array
from yarnscale.cell.midsurface import Midsurface, midsurface_frames, midsurface_point
from yarnscale.kinematics import ShellStrain
from yarnscale.numerics.kernel import Kernel, compile_kernel, run_columns
from yarnscale.yarn.pattern import YarnPattern

CELLS = 16
"""Grid cells over one period."""


@cache
def _target_kernel(order: int, axis: int) -> Kernel:
    """Column of T (3×2) of an axis at a point ξ; its derivative by the state, 3×6; second ones of f·T, 6×6."""
    z, xi, f = ca.SX.sym("z", 6), ca.SX.sym("xi", 2), ca.SX.sym("f", 3)
    stretch, _ = midsurface_frames(z)
    point, rotation = midsurface_point(z, ca.vertcat(xi, 0))
    column = (rotation[:, 0:2] @ stretch - ca.jacobian(point, xi))[:, axis]
    output = (lambda: column, lambda: ca.jacobian(column, z).T, lambda: ca.hessian(ca.dot(f, column), z)[0])[order]()
    name, inputs = f"midsurface_misfit_{axis}_{order}", [z, xi, f][: 3 if order == 2 else 2]
    return compile_kernel(ca.Function(name, inputs, [ca.densify(ca.vec(output))], {"cse": True}), name, shared=(0,))


class Grid:
    """Nodes over a tile and a margin around it; the middle of the tile is a node and the origin."""

    def __init__(self, period: ArrayLike, margin: ArrayLike, cells: int) -> None:
        """period: sides of the tile. margin: at least so much around it. cells: over one period, a multiple of four.

        The margin is rounded up to quarters of the period, so that the domain does not depend on the cells.
        """
        if cells < 4 or cells % 4:
            raise ValueError(f"cells must be a multiple of 4, found {cells}")
        self.cells = cells
        self.step = np.asarray(period, float) / cells
        quarters = np.ceil(4 * np.asarray(margin, float) / np.asarray(period, float) - 1e-9)
        self.rim = quarters.astype(int) * (cells // 4)
        self.nodes = [
            step * np.arange(-(cells // 2) - rim, cells // 2 + rim + 1)
            for step, rim in zip(self.step, self.rim, strict=True)
        ]
        self.middle = tuple(cells // 2 + int(rim) for rim in self.rim)
        # Transforms and coefficients of cubic splines are linear in the values: those of unit values, once.
        units = [make_interp_spline(line, np.eye(len(line)), k=3) for line in self.nodes]
        self.knots, self.to_coefficients = tuple(spline.t for spline in units), [spline.c for spline in units]
        self.to_waves, self.from_waves, self.flow_to_waves, sizes = [], [], [], []
        for line, step in zip(self.nodes, self.step, strict=True):
            count = len(line)
            self.to_waves.append(np.asarray(dct(np.eye(count), type=1, axis=0)))
            self.from_waves.append(np.asarray(idct(np.eye(count), type=1, axis=0)))
            sizes.append((2 - 2 * np.cos(np.pi * np.arange(count) / (count - 1))) / step**2)
            self.flow_to_waves.append(self.to_waves[-1] @ _divergence(count) / step)
        self.size = sizes[0][:, None] + sizes[1]
        self.size[0, 0] = np.inf  # the constant is free
        self.tile_share = [self._share_of_tile(axis) for axis in (0, 1)]

    @classmethod
    @lru_cache(maxsize=8)
    def of(cls, period: tuple[float, ...], margin: tuple[float, ...], cells: int) -> Grid:
        """The grid of a pattern, kept for its other states."""
        return cls(period, margin, cells)

    def edge_middles(self, axis: int) -> Array:
        """Midpoints of the edges along an axis (count 1, count 2, 2)."""
        lines = list(self.nodes)
        lines[axis] = 0.5 * (lines[axis][1:] + lines[axis][:-1])
        return np.stack(np.meshgrid(*lines, indexing="ij"), -1)

    def solved(self, gradients: tuple[Array, Array]) -> Array:
        """Fields (…, N1, N2) whose differences along edges are nearest to gradients (…, count 1, count 2).

        A linear field is added, so that the tile has their mean.
        """
        (to_1, to_2), (flow_1, flow_2), (from_1, from_2) = self.to_waves, self.flow_to_waves, self.from_waves
        waves = (flow_1 @ gradients[0] @ to_2.T + to_1 @ gradients[1] @ flow_2.T) / self.size
        field = from_1 @ waves @ from_2.T
        field = field - field[..., self.middle[0], self.middle[1], None, None]
        for axis in (0, 1):
            misfit = gradients[axis] - np.diff(field, axis=axis - 2) / self.step[axis]
            mean = (self.tile_share[axis] * misfit).sum(axis=(-2, -1), keepdims=True)
            field = field + mean * self._line(axis)
        return field

    def solved_back(self, weights: Array) -> tuple[Array, Array]:
        """The transpose of ``solved``: the weights of gradients of which fields have weights (…, N1, N2)."""
        shares = [np.zeros(1), np.zeros(1)]
        for axis in (1, 0):
            mean = (weights * self._line(axis)).sum(axis=(-2, -1), keepdims=True)
            shares[axis] = mean * self.tile_share[axis]
            closed = [(0, 0)] * (weights.ndim - 2) + [(1, 1) if k == axis else (0, 0) for k in (0, 1)]
            weights = weights + np.diff(np.pad(shares[axis], closed), axis=axis - 2) / self.step[axis]
        weights = weights.copy()
        weights[..., self.middle[0], self.middle[1]] -= weights.sum(axis=(-2, -1))
        (to_1, to_2), (flow_1, flow_2), (from_1, from_2) = self.to_waves, self.flow_to_waves, self.from_waves
        waves = (from_1.T @ weights @ from_2) / self.size
        return shares[0] + flow_1.T @ waves @ to_2, shares[1] + to_1.T @ waves @ flow_2

    def _line(self, axis: int) -> Array:
        return self.nodes[axis].reshape((-1, 1) if axis == 0 else (1, -1))

    def _share_of_tile(self, axis: int) -> Array:
        """Weights with which edges along an axis (count 1, count 2) have part in the mean over the tile."""
        parts = []
        for k, (line, rim) in enumerate(zip(self.nodes, self.rim, strict=True)):
            part = np.zeros(len(line) - (k == axis))
            part[rim : rim + self.cells + (k != axis)] = 1.0 / self.cells
            if k != axis:
                part[[rim, rim + self.cells]] *= 0.5
            parts.append(part)
        return np.outer(*parts)

    def interpolant(self, field: Array) -> Callable[[Array], Array]:
        """A field (…, N1, N2) as a function of points (n, 2): its C² cubic spline, beyond the grid its border value."""
        first, second = self.to_coefficients
        surface = NdBSpline(self.knots, np.moveaxis(first @ field @ second.T, (-2, -1), (0, 1)).copy(), 3)
        return lambda points: surface(self._inside(points))

    def interpolant_back(self, points: Array, weights: Array) -> Array:
        """The weights of a field (k, N1, N2) of which its interpolant has weights (n, k) at points (n, 2)."""
        (first, second), sizes = self.to_coefficients, [len(line) for line in self.nodes]
        matrix = NdBSpline.design_matrix(self._inside(points), self.knots, 3)
        matrix.resize(len(points), sizes[0] * sizes[1])  # its last columns may be missing
        return first.T @ (matrix.T @ weights).T.reshape(-1, *sizes) @ second

    def _inside(self, points: Array) -> Array:
        low, high = ([line[end] for line in self.nodes] for end in (0, -1))
        return np.clip(points, low, high)


def _divergence(count: int) -> Array:
    """Minus the divergence at nodes of flows on edges (count, count − 1); half cells at both ends, closed outwards."""
    matrix = np.eye(count, count - 1, -1) - np.eye(count, count - 1)
    matrix[[0, -1]] *= 2
    return matrix


class PoissonMidsurface:
    """The surface that realises one macroscopic state of a tile, doubly curved ones in the least-squares sense.

    Offers what ``Midsurface`` does. Where det II = 0 its points are the closed form (about the tile's centre: moved
    rigidly), and only here are the derivatives right that lead away from such states.
    """

    def __init__(
        self,
        strain: ShellStrain,
        *,
        period: ArrayLike,
        centre: ArrayLike = (0.0, 0.0),
        margin: ArrayLike | None = None,
        length: float = 1.0,
        cells: int = CELLS,
    ) -> None:
        """period, centre (2,): of the tile, reference coordinates in the unit ``length`` [m] of all coordinates.

        margin (2,): distance beyond the tile up to which points are evaluated; one period by default. cells: of the
        grid over one period, a multiple of four.
        """
        self.strain = strain
        self._scale = np.array([1.0, 1.0, 1.0, length, length, length])
        self._z = strain.vector * self._scale
        self._centre = np.array([*np.asarray(centre, float), 0.0])
        sides = tuple(float(v) for v in np.asarray(period, float))
        around = sides if margin is None else tuple(float(v) for v in np.asarray(margin, float))
        self.grid = Grid.of(sides, around, cells)
        self._closed = Midsurface(strain, length=length)
        flat = Midsurface(ShellStrain(strain.s_x, strain.s_a, strain.s_y), length=length)
        self._origin = flat.at(self._centre[None])[0][0]
        self._flat = flat

    def _solved(self, order: int) -> Callable[[Array], Array]:
        """ψ (n, 3), or its derivatives by the scaled state (n, 3, 6), as a function of points (n, 2)."""
        shape = ((3,), (3, 6))[order]
        if self.strain.is_flat:
            return lambda points: np.zeros((len(points), *shape))
        gradients = []
        for axis in (0, 1):
            points = self.grid.edge_middles(axis)
            column = run_columns(_target_kernel(order, axis), self._z[None], points.reshape(-1, 2))[0]
            gradients.append(column.T.reshape(*shape, *points.shape[:2]))
        return self.grid.interpolant(self.grid.solved((gradients[0], gradients[1])))

    @cached_property
    def _correction(self) -> Callable[[Array], Array]:
        return self._solved(0)

    @cached_property
    def _correction_by_state(self) -> Callable[[Array], Array]:
        return self._solved(1)

    def at(self, reference: Array) -> tuple[Array, Array]:
        """Points m (n, 3) and rotations R (n, 3, 3) at reference coordinates (n, 3)."""
        local = reference - self._centre
        points, rotations = self._closed.at(local)
        return points + self._correction(local[:, :2]) + self._origin, rotations

    def rotation_vectors(self, reference: Array) -> Array:
        """w = ξ^α ω_α at reference coordinates (n, 3), counted from the centre, shape (n, 3) [rad]."""
        return self._closed.rotation_vectors(reference - self._centre)

    def slopes(self, reference: Array) -> tuple[Array, Array]:
        """Derivatives of points (n, 3, 6) and rotations (n, 3, 3, 6) by (s_x, s_a, s_y, II11, II12, II22)."""
        local = reference - self._centre
        points, rotations = self._closed.slopes(local)
        points += self._correction_by_state(local[:, :2]) * self._scale
        points[..., :3] += self._flat.slopes(self._centre[None])[0][..., :3]
        return points, rotations

    def second(self, reference: Array, forces: Array, turns: Array) -> Array:
        """Second derivatives (6, 6) by the state of Σ f·m + Q:R, for forces f (n, 3) and turns Q (n, 3, 3)."""
        local, whole = reference - self._centre, forces.sum(axis=0)[None]
        found = self._closed.second(local, forces, turns)
        found[:3, :3] += self._flat.second(self._centre[None], whole, np.zeros((1, 3, 3)))[:3, :3]
        # ψ is linear in T: what T has to give to the forces is known from one solve backwards.
        for axis, weights in enumerate(self.grid.solved_back(self.grid.interpolant_back(local[:, :2], forces))):
            points, weights = self.grid.edge_middles(axis).reshape(-1, 2), weights.reshape(3, -1).T
            (part,) = run_columns(_target_kernel(2, axis), self._z[None], points, weights)
            found += part.sum(axis=0).reshape(6, 6) * self._scale[:, None] * self._scale
        return found


def cell_midsurface(
    pattern: YarnPattern, strain: ShellStrain, *, bending: bool = False
) -> Midsurface | PoissonMidsurface:
    """The midsurface of a pattern's copies, coordinates in yarn radii; centred on the pattern's yarn.

    bending: whether a flat state may bend; its second derivatives are right only then.

    Its domain is as wide as the copies that can touch the tile at rest: given by the pattern, not by the search for
    contacts, so that energy is a smooth function of the state.
    """
    radius = pattern.radius
    if strain.is_flat and not bending:
        return Midsurface(strain, length=radius)
    place = pattern.vertices[:, :2]
    length = np.linalg.norm(pattern.edge_vectors(), axis=1)
    # Weights as drawn, not rest lengths, which then leave the surface alone.
    centre = np.average(place, axis=0, weights=length + length[pattern.previous_vertex])
    reach = 4 * radius + length.max()
    margin = np.abs(place - centre).max(axis=0) + reach - 0.5 * pattern.period
    return PoissonMidsurface(
        strain,
        period=pattern.period / radius,
        centre=centre / radius,
        margin=np.maximum(margin, 0.0) / radius,
        length=radius,
    )
