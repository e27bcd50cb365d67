"""Yarn centre lines for pictures: copies of a periodic pattern joined into long curves, and smoothed."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import connected_components

from yarnscale.arrays import Array, Flags, Integers
from yarnscale.detail.tiling import chains
from yarnscale.yarn.pattern import YarnPattern

Placement = Callable[[Integers, Integers], Array]
"""Positions (k, 3) [m] of the copies of vertices (k,) in tiles (k, 2)."""


@dataclass(frozen=True)
class Curve:
    """A yarn centre line to draw.

    points: vertices in order [m], shape (k, 3).
    yarn: number of the yarn, which picks the colour.
    closed: whether the last vertex joins the first.
    solid: per vertex, whether the piece that starts there has its full colour (None: all) or fades
    as a periodic copy does, shape (k,).
    radius: of the yarn [m], None where the picture says it.
    """

    points: Array
    yarn: int = 0
    closed: bool = False
    solid: Flags | None = None
    radius: float | None = None


def rings_for(period: Array, radius: float) -> tuple[int, int]:
    """Rings of copies along x and y around a cell of periods (2,) [m], for a piece that is about square."""
    side = max(3.0 * float(np.max(period)), 32.0 * radius)
    x, y = (int(np.clip(round(0.5 * (side / p - 1.0)), 1, 8)) for p in period)
    return x, y


def pattern_curves(pattern: YarnPattern, place: Placement, *, rings: int | tuple[int, int] = 1) -> list[Curve]:
    """``periodic_curves`` of a pattern: yarns as thick as they are, coloured by kind where there are several kinds."""
    curves = periodic_curves(pattern.edges, place, rings=rings)
    kinds, radii = pattern.yarn_material, pattern.yarn_radius
    if radii is not None:
        curves = [replace(curve, radius=float(radii[curve.yarn])) for curve in curves]
    if kinds is not None and kinds.any():
        curves = [replace(curve, yarn=int(kinds[curve.yarn])) for curve in curves]
    return curves


def periodic_curves(edges: Integers, place: Placement, *, rings: int | tuple[int, int] = 1) -> list[Curve]:
    """Curves of the primary tile and ``rings`` rings of copies around it (along x and y), copies faded.

    edges: (n, 4) rows (v0, v1, dx, dy), one per vertex v0, every yarn a periodic loop: the edge ends at
    the copy of v1 in the tile (dx, dy) further. A yarn is joined through all tiles it passes, so that
    smoothing has no seams.
    """
    _, following, steps = np.split(edges[np.argsort(edges[:, 0])], [1, 2], axis=1)
    following, steps = following[:, 0].copy(), steps.copy()
    inner, margin = np.broadcast_to(rings, 2), np.abs(steps).max(axis=0)
    x, y = (2 * (inner + margin) + 1).tolist()
    copies = np.full((x, y, len(following)), -1)
    copies[margin[0] : x - margin[0], margin[1] : y - margin[1]] = 0
    chain, lengths, closed = chains(copies, following, steps, np.argsort(following))
    *tiles, vertices = np.unravel_index(chain, copies.shape)
    places = np.column_stack(tiles) - inner - margin
    yarns = connected_components(csr_matrix((np.ones(len(following)), following, np.arange(len(following) + 1))))[1]
    curves = []
    for end, length, ring in zip(np.cumsum(lengths), lengths, closed, strict=True):
        own = slice(end - length, end)
        solid, yarn = (places[own] == 0).all(axis=1), int(yarns[vertices[end - 1]])
        if length > 1:
            curves.append(Curve(place(vertices[own], places[own]), yarn, bool(ring and length > 2), solid))
    return curves


def smooth_curve(curve: Curve, *, per_segment: int = 8) -> tuple[Array, Flags]:
    """Points of a C² spline through the vertices, and which of them have full colour: (m, 3) [m], (m,).

    The spline passes through every vertex and leaves a segment of length h by about h²/8 times the curvature:
    a few hundredths of the yarn radius for usual patterns, so that yarns which cross still do.
    """
    points = np.asarray(curve.points, dtype=float)
    solid = np.ones(len(points), bool) if curve.solid is None else np.asarray(curve.solid, bool)
    if curve.closed:
        points, solid = np.vstack([points, points[:1]]), np.append(solid, solid[:1])
    lengths = np.linalg.norm(np.diff(points, axis=0), axis=1)
    keep = np.concatenate([[True], lengths > 1e-9 * max(lengths.sum(), 1e-300)])
    points, solid = points[keep], solid[keep]
    if len(points) < 3:
        return points, solid
    knots = np.concatenate([[0.0], np.cumsum(lengths[keep[1:]])])
    spline = CubicSpline(knots, points, bc_type="periodic" if curve.closed else "not-a-knot")
    fraction = np.arange(per_segment) / per_segment
    places = np.append((knots[:-1, None] + np.diff(knots)[:, None] * fraction).ravel(), knots[-1])
    return spline(places), np.append(np.repeat(solid[:-1], per_segment), solid[-2])
