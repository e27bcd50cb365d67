"""The mid-surface of a bounding volume at given points, and its derivatives."""

from __future__ import annotations

import numpy as np
from scipy.interpolate import BSpline
from scipy.sparse import csr_array

from yarnscale.arrays import Array
from yarnscale.fabric.volume import DEGREE, BoundingVolume

_ACROSS = 4
"""Control points that act on a point, in each direction."""
_ORDERS = ((0, 0), (1, 0), (0, 1), (2, 0), (1, 1), (0, 2))


class SurfacePoints:
    """Points of the mid-surface φ = Σ N_i α_i with the parameters x, y (k,) [m]; α: (n1·n2, 3) [m]."""

    def __init__(self, volume: BoundingVolume, x: Array, y: Array) -> None:
        self._count = volume.count // 2
        first, values = [], []
        for knots, places in ((volume.x_knots, x), (volume.y_knots, y)):
            last = len(knots) - 2 * DEGREE - 2
            first.append(np.clip(np.searchsorted(knots, places, side="right") - 1 - DEGREE, 0, last))
            spline = BSpline(knots, np.eye(len(knots) - DEGREE - 1), DEGREE)
            near = first[-1][:, None] + np.arange(_ACROSS)
            values.append([np.take_along_axis(spline(places, order), near, axis=1) for order in range(3)])
        four, width = np.arange(_ACROSS), volume.shape[1]
        active = (first[0][:, None, None] + four[:, None]) * width + first[1][:, None, None] + four
        self.active = active.reshape(len(x), -1)
        """Control points that act on each point (k, 16)."""
        rows = [np.einsum("ka,kb->kab", values[0][p], values[1][q]) for p, q in _ORDERS]
        self._rows = np.stack(rows, axis=1).reshape(len(x), len(_ORDERS), -1)
        self.local = np.einsum("kdi,cv->kdciv", self._rows[:, 1:], np.eye(3)).reshape(len(x), 15, -1)
        """Derivatives by the coordinates of those control points (k, 15, 48)."""

    @property
    def jets(self) -> Array:
        """Weights of those control points in φ, φ,x and φ,y (k, 3, 16)."""
        return self._rows[:, :3]

    def weights(self) -> csr_array:
        """The matrix (k, n1·n2) from control points to points."""
        count, width = self.active.shape
        begin = np.arange(0, count * width + 1, width)
        return csr_array((self._rows[:, 0].ravel(), self.active.ravel(), begin), shape=(count, self._count))

    def derivatives(self, control: Array) -> Array:
        """φ,x φ,y φ,xx φ,xy φ,yy (k, 15)."""
        return (self._rows[:, 1:] @ control[self.active]).reshape(len(self.active), -1)

    def pulled(self, forces: Array) -> Array:
        """Forces on control points (n1·n2, 3) from those on the derivatives (k, 15)."""
        shares = self._rows[:, 1:].transpose(0, 2, 1) @ forces.reshape(len(forces), -1, 3)
        total = np.zeros((self._count, 3))
        np.add.at(total, self.active, shares)
        return total
