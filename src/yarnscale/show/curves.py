"""Yarn centre lines for pictures: copies of a periodic pattern joined into long curves, and smoothed."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy.interpolate import CubicSpline

from yarnscale.arrays import Array, Flags, Integers
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


def pattern_curves(
    pattern: YarnPattern, place: Placement, *, rings: int | tuple[int, int] = 1
) -> list[Curve]:
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
    following = {v: (w, dx, dy) for v, w, dx, dy in edges.tolist()}
    preceding = {w: (v, -dx, -dy) for v, w, dx, dy in edges.tolist()}
    yarn_of = _yarn_numbers(following)
    x, y = (range(-n, n + 1) for n in ((rings, rings) if isinstance(rings, int) else rings))
    waiting = dict.fromkeys((v, a, b) for v in following for a in x for b in y)
    curves = []
    while waiting:
        seed = next(iter(waiting))
        first = _run(seed, preceding, waiting)[-1]
        nodes = _run(first, following, waiting)
        closed = len(nodes) > 2 and _step(nodes[-1], following) == nodes[0]
        for node in nodes:
            del waiting[node]
        table = np.array(nodes, dtype=np.int64)
        vertices, places = table[:, 0], table[:, 1:]
        if len(nodes) > 1:
            yarn = yarn_of[nodes[0][0]]
            curves.append(Curve(place(vertices, places), yarn, closed, (places == 0).all(axis=1)))
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


Node = tuple[int, int, int]
"""A copy of a vertex: its number and its tile (a, b)."""


def _step(node: Node, neighbour: dict[int, Node]) -> Node:
    """The next copy along the yarn."""
    vertex, dx, dy = neighbour[node[0]]
    return vertex, node[1] + dx, node[2] + dy


def _run(start: Node, neighbour: dict[int, Node], window: dict[Node, None]) -> list[Node]:
    """Copies met from ``start`` on, up to the edge of the window or, in a closed loop, once around."""
    nodes = [start]
    while (node := _step(nodes[-1], neighbour)) in window and node != start:
        nodes.append(node)
    return nodes


def _yarn_numbers(following: dict[int, Node]) -> dict[int, int]:
    """Number of the yarn of every vertex, in the order of their first vertices."""
    number: dict[int, int] = {}
    yarns = 0
    for start in following:
        vertex = start
        if vertex in number:
            continue
        while vertex not in number:
            number[vertex] = yarns
            vertex = following[vertex][0]
        yarns += 1
    return number
