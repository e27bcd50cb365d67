"""Edge flips so that at least four triangles meet at every inner vertex, as bending of triangles requires."""

from __future__ import annotations

import numpy as np

from yarnscale.arrays import Array, Flags, Integers
from yarnscale.shell.garments.polygons import areas_of, flatness

_SLIVER = 0.02
"""Least area over the square of the longest edge of a flipped triangle."""


def turned_edges(triangles: Integers, corners: Integers, material: Array) -> tuple[Integers, Integers, int]:
    """The triangles (nt, 3), their corners in the fabric (nt, 3), and the number of flipped edges.

    An edge opposite to a vertex with three triangles is flipped to end there if both of its triangles are one piece
    of fabric and stay well shaped, and its ends keep at least four. ``material``: points of the fabric (n, 2).
    Vertices without such an edge are not changed.
    """
    inner, count = _inner(triangles), np.bincount(triangles.ravel())
    threes = np.flatnonzero(inner & (count == 3))
    if not len(threes):
        return triangles, corners, 0
    triangles, corners = triangles.copy(), corners.copy()
    rows = {
        (int(vertices[k]), int(vertices[(k + 1) % 3])): row for row, vertices in enumerate(triangles) for k in range(3)
    }
    around = {int(v): np.flatnonzero((triangles == v).any(axis=1)) for v in threes}
    turned = 0
    for vertex, near in around.items():
        if count[vertex] != 3:
            continue
        best: tuple[float, int, int, Integers, Integers] | None = None
        for row in near[(triangles[near] == vertex).any(axis=1)]:
            k = int(np.flatnonzero(triangles[row] == vertex)[0])
            v, x, y = (int(n) for n in np.roll(triangles[row], -k))
            other = rows.get((y, x))
            if other is None or any(inner[end] and count[end] < 5 for end in (x, y)):
                continue
            m = int(np.flatnonzero(triangles[other] == y)[0])
            w = int(triangles[other, (m + 2) % 3])
            one, two = np.roll(corners[row], -k), np.roll(corners[other], -m)
            if (one[1], one[2]) != (two[1], two[0]) or (v, w) in rows or (w, v) in rows:
                continue
            points = np.array([[one[0], one[1], two[2]], [one[0], two[2], one[2]]])
            signed = areas_of(material[points]) * np.sign(areas_of(material[one]))
            shape = float(flatness(material[points]).min()) if (signed > 0).all() else 0.0
            if shape > (_SLIVER if best is None else best[0]):
                best = shape, int(row), other, np.array([[v, x, w], [v, w, y]]), points
        if best is None:
            continue
        _, row, other, vertices, points = best
        (v, x, w), y = (int(n) for n in vertices[0]), int(vertices[1, 2])
        triangles[[row, other]], corners[[row, other]] = vertices, points
        del rows[x, y], rows[y, x]
        rows |= {(v, x): row, (x, w): row, (w, v): row, (v, w): other, (w, y): other, (y, v): other}
        count[[v, w]] += 1
        count[[x, y]] -= 1
        turned += 1
    return triangles, corners, turned


def _inner(triangles: Integers) -> Flags:
    """Whether a vertex is inside, not on a border, (nv,)."""
    edges = np.sort(np.concatenate([triangles[:, [k, (k + 1) % 3]] for k in range(3)]), axis=1)
    distinct, count = np.unique(edges, axis=0, return_counts=True)
    inner = np.ones(int(triangles.max()) + 1, bool)
    inner[distinct[count == 1]] = False
    return inner
