"""Bridges: yarn vertices between two panels, interpolated from those on either side."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from yarnscale.arrays import Array, Flags, Integers


@dataclass(frozen=True, eq=False)
class Bridges:
    """Vertices (m,) on cubic curves from one yarn end to another, tangent to both.

    anchors: (m, 4) the last two vertices of one end and the first two of the other, in the order of the yarn; share:
    (m,) how far along the curve, in (0, 1).
    """

    vertices: Integers
    anchors: Integers
    share: Array

    def place(self, points: Array) -> None:
        """Set the bridges among the points (n, 3) [m] from their anchors."""
        before, start, end, after = (points[self.anchors[:, k]] for k in range(4))
        gap = np.linalg.norm(end - start, axis=1)[:, None]
        first, last = _direction(start - before) * gap, _direction(after - end) * gap
        t = self.share[:, None]
        points[self.vertices] = (
            (1 + 2 * t) * (1 - t) ** 2 * start
            + t * (1 - t) ** 2 * first
            + t * t * (3 - 2 * t) * end
            - t * t * (1 - t) * last
        )

    def among(self, kept: Flags) -> Bridges:
        """The remaining bridges, renumbered, if whole curves of the vertices (n,) are left out."""
        number = np.cumsum(kept) - 1
        own = kept[self.vertices]
        return Bridges(number[self.vertices[own]], number[self.anchors[own]], self.share[own])


NO_BRIDGES = Bridges(np.zeros(0, np.int64), np.zeros((0, 4), np.int64), np.zeros(0))


def _direction(vectors: Array) -> Array:
    """Unit vectors; zero for zero vectors."""
    return vectors / np.maximum(np.linalg.norm(vectors, axis=1), 1e-300)[:, None]
