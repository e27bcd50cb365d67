"""Pieces of a finite fabric, and the rigid motion that is nearest to what the yarns of each do."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array, diags_array
from scipy.spatial import KDTree

from yarnscale.arrays import Array, Integers
from yarnscale.fabric.sheet import YarnSheet


@dataclass(frozen=True, eq=False)
class Patches:
    """Pieces of a fabric that lie in cubes of space at the start. own: the number of each vertex's (n,). sums: (p, n),
    1 for vertices that count. shares: (n, p) of the pieces around each vertex, 1 in sum.

    A vertex may count in its own piece alone, or in adjacent ones too. Layers of a fabric that start nearer to each
    other than the side of the cubes are one piece.
    """

    own: Integers
    sums: csr_array
    shares: csr_array

    @property
    def count(self) -> int:
        """Patches p."""
        return int(self.own.max()) + 1

    @classmethod
    def cubes(cls, sheet: YarnSheet, side: float, *, adjacent: bool = False) -> Patches:
        """Cubes of about a side [r] that fill the sheet; adjacent: what lies in those around each counts too."""
        places = sheet.vertices - sheet.vertices.min(axis=0)
        extent = places.max(axis=0) / sheet.radius
        across = np.maximum(1, extent // side)
        places *= across / np.maximum(extent, 1e-300) / sheet.radius
        cubes = np.minimum(np.floor(places), across - 1).astype(np.int64)
        cubes, own = np.unique(cubes, axis=0, return_inverse=True)
        own, count, vertices = own.reshape(-1).astype(np.int64), len(cubes), np.arange(len(own))
        sums = csr_array((np.ones(len(own)), (own, vertices)), (count, len(own)))
        if adjacent:
            one, other = KDTree(cubes).query_pairs(1.5, p=np.inf, output_type="ndarray").T
            every = np.arange(count)
            rows, columns = np.concatenate([one, other, every]), np.concatenate([other, one, every])
            sums = csr_array((np.ones(len(rows)), (rows, columns)), (count, count)) @ sums
        # Linear between the centres of cubes; the share of empty ones goes to the others.
        near = KDTree(cubes + 0.5).query_ball_point(places, 1.0, p=np.inf)
        rows, columns = np.repeat(vertices, [len(found) for found in near]), np.concatenate(near).astype(np.int64)
        weights = np.prod(1.0 - np.abs(places[rows] - cubes[columns] - 0.5), axis=1) + 1e-12
        shares = csr_array((weights, (rows, columns)), (len(own), count))
        return cls(own, sums, csr_array(diags_array(1.0 / shares.sum(axis=1)) @ shares))

    def rates(self, positions: Array, moves: Array, mass: Array, *, thin: float = 0.0) -> tuple[Array, Array, Array]:
        """Centre of mass, mean of moves, and rotation of each patch, all (p, 3); arguments (n, 3), mass (n,).

        The rigid motion has the momentum and angular momentum of the moves. thin: no patch turns about an axis about
        which its radius of gyration is less than this, in the units of positions.
        """
        square = np.einsum("ni,ni->n", positions, positions)
        outer = positions[:, :, None] * positions[:, None, :]
        columns = [np.ones((len(mass), 1)), positions, moves, np.cross(positions, moves), outer.reshape(-1, 9)]
        total = self.sums @ (mass[:, None] * np.concatenate([*columns, square[:, None]], axis=1))
        weight = total[:, :1]
        centre, mean, spin, outer, square = np.split(total[:, 1:] / weight, [3, 6, 9, 18], axis=1)
        spin = spin - np.cross(centre, mean)
        outer = outer.reshape(-1, 3, 3) - centre[:, :, None] * centre[:, None, :]
        tensor = np.trace(outer, axis1=1, axis2=2)[:, None, None] * np.eye(3) - outer
        inertia, axes = np.linalg.eigh(tensor)
        inertia[inertia <= np.maximum(1e-9 * inertia[:, -1:], thin**2)] = np.inf
        return centre, mean, np.einsum("pik,pk,pjk,pj->pi", axes, 1.0 / inertia, axes, spin)

    def rigid(self, positions: Array, moves: Array, mass: Array) -> Array:
        """Moves (n, 3) of vertices with their own patch."""
        centre, mean, rate = (values[self.own] for values in self.rates(positions, moves, mass))
        return mean + np.cross(rate, positions - centre)
