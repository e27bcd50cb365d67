"""Points of yarns in a homogenized volume: on its mid-surface, with the fluctuations of the cells around them."""

from __future__ import annotations

from functools import cache

import casadi as ca
import numpy as np

from yarnscale.arrays import Array, Integers
from yarnscale.fabric.volume_surface import SurfacePoints
from yarnscale.numerics.kernel import Kernel, compile_kernel, run_columns

_JET = 12


@cache
def _kernels() -> tuple[Kernel, Kernel]:
    """φ φ,x φ,y û (12) → x (3), its Jacobian (3×12); with a force (3) → Σ force ∇²x (12×12)."""
    jet, force = ca.SX.sym("jet", _JET), ca.SX.sym("force", 3)
    tangents = ca.horzcat(jet[3:6], jet[6:9])
    first, normal = tangents.T @ tangents, ca.cross(jet[3:6], jet[6:9])
    root = ca.sqrt(ca.dot(normal, normal))
    # √C of a symmetric 2×2 matrix C is (C + √det C) / √(tr C + 2 √det C); the tangents are R √C.
    stretch = (first + root * ca.SX.eye(2)) / ca.sqrt(ca.trace(first) + 2.0 * root)
    x = jet[:3] + tangents @ ca.inv(stretch) @ jet[9:11] + normal / root * jet[11]
    slope = ca.vec(ca.densify(ca.jacobian(x, jet)).T)
    curve = ca.vec(ca.densify(ca.hessian(ca.dot(force, x), jet)[0]))
    names = ("volume_point", "volume_point_bend")
    functions = [([jet], [x, slope]), ([jet, force], [curve])]
    one, two = (ca.Function(name, *of, {"cse": True}) for name, of in zip(names, functions, strict=True))
    return compile_kernel(one, names[0]), compile_kernel(two, names[1])


class VolumePoints:
    """Points x = φ + R (û + z e3) as a function of a volume's unknowns (m, 3) [m].

    φ and R: the mid-surface and its frame there; û: weighted sum of the fluctuations of cells; z: heights at rest
    (k,) [m]. nodes: (k, b) rows of the unknowns that are behind each point, increasing.
    """

    def __init__(self, surface: SurfacePoints, nodes: Integers, shares: Array, heights: Array) -> None:
        """nodes, shares: of fluctuations (k, 4), which stand behind the mid-surface's control points."""
        on_surface = surface.active.shape[1]
        self.nodes = np.concatenate([surface.active, nodes], axis=1)
        self._weights = np.zeros((len(heights), 4, self.nodes.shape[1]))
        self._weights[:, :3, :on_surface] = surface.jets
        self._weights[:, 3, on_surface:] = shares
        self._heights = heights

    def of(self, places: slice | Integers) -> VolumePoints:
        """Some of the points."""
        part = VolumePoints.__new__(VolumePoints)
        part.nodes, part._weights, part._heights = self.nodes[places], self._weights[places], self._heights[places]
        return part

    def _jets_of(self, x: Array) -> Array:
        return (self._weights @ x.reshape(-1, 3)[self.nodes]).reshape(-1, _JET)

    def _jets_at(self, x: Array) -> Array:
        jets = self._jets_of(x)
        jets[:, -1] += self._heights
        return jets

    def at(self, x: Array) -> Array:
        """Points (k, 3) [m]."""
        return run_columns(_kernels()[0], self._jets_at(x))[0]

    def moves(self, x: Array, step: Array) -> Array:
        """How far the points go (k, 3) when the unknowns begin to go along a step (m, 3)."""
        return np.einsum("kij,kj->ki", self._by_jets(x), self._jets_of(step))

    def slopes(self, x: Array) -> Array:
        """Derivatives of the points (i) by the unknowns (j) behind them (k, b, i, j)."""
        return np.einsum("kinj,knb->kbij", self._by_jets(x).reshape(-1, 3, 4, 3), self._weights, optimize=True)

    def bend(self, x: Array, forces: Array) -> Array:
        """Σ force ∇²x by pairs (b ≥ c) of the unknowns behind the points (p, k, 3, 3), for forces (k, 3).

        Pairs are those of ``np.tril_indices``.
        """
        count, _, width = self._weights.shape
        bends = run_columns(_kernels()[1], self._jets_at(x), forces)[0].reshape(count, 4, 3 * _JET)
        half = (self._weights.swapaxes(1, 2) @ bends).reshape(count, width, 3, 4, 3).swapaxes(3, 4)
        whole = (half.reshape(count, 9 * width, 4) @ self._weights).reshape(count, width, 3, 3, width)
        row, column = np.tril_indices(width)
        return whole[:, row, :, :, column]

    def _by_jets(self, x: Array) -> Array:
        return run_columns(_kernels()[0], self._jets_at(x))[1].reshape(-1, 3, _JET)
