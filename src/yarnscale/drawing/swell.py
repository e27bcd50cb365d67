"""Relax schematic lines to yarns of their full radius without letting them pass through each other.

A damped motion (FIRE: Bitzek et al., Structural relaxation made simple, 2006) of springs along each yarn, a little
bending stiffness, and a repulsion ``ln`` of the distance between segments whose range grows to the diameter. A step
reduces the distance of a pair of segments by a bounded part only, so that the topology is preserved.
Lengths are in yarn radii. This prepares drawings and is not mechanics; ``cell`` computes equilibria.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numba
import numpy as np

from yarnscale.arrays import Array, Integers
from yarnscale.drawing.curves import PeriodicCurve, pattern_from_curves
from yarnscale.yarn.close_pairs import close_pairs, nearest_places, safe_fraction
from yarnscale.yarn.strands import Neighbours, Strands

_JIT = {"cache": True, "error_model": "numpy"}

FIRST_DIAMETER = 0.25
"""Distance at which yarns repel at the beginning [r]."""
STRETCH, BEND, REPULSION = 4.0, 0.5, 3.0
"""Stiffness of edges, of joints, and strength of the repulsion."""
SKIN = 0.5
STEP_LIMIT = 0.1
"""Largest move of a vertex in one step [r]."""
GAP_SHARE = 0.4
AT_REST = 1e-3
"""Largest force at which the motion ends."""


@dataclass(frozen=True)
class Stage:
    """Edges of `edge` [r], repulsion up to `diameter` [r], at most `steps` steps."""

    edge: float
    diameter: float
    steps: int


STAGES = (Stage(0.5, 0.8, 60), Stage(0.6, 1.5, 100), Stage(0.85, 2.0, 150), Stage(1.05, 2.03, 700))


def swollen(
    curves: Sequence[PeriodicCurve],
    period: Array,
    *,
    tightness: float = 1.0,
    counts: Sequence[int] | None = None,
    finest: float = np.inf,
    radii: Array | None = None,
    stages: Sequence[Stage] = STAGES,
) -> list[PeriodicCurve]:
    """The curves (lengths in radii), rounded and apart, with the same topology.

    period: (px, py) [r]. tightness: target length of a yarn over its drawn length.
    counts: vertices of each curve at the end; by default edges of the last stage's length.
    radii: of each yarn, 1 by default.
    finest: largest edge at the beginning [r], for bends sharper than yarns can have.
    """
    curves = list(curves)
    radii = np.ones(len(curves)) if radii is None else radii
    wanted = [tightness * curve.length(period) for curve in curves]
    reached = FIRST_DIAMETER
    for number, stage in enumerate(stages):
        edge = min(stage.edge, finest) if number == 0 else stage.edge
        sizes = [
            max(3, round(curve.length(period) / (edge * min(radius, 1.0))))
            for curve, radius in zip(curves, radii, strict=True)
        ]
        if counts is not None and number == len(stages) - 1:
            # Where yarns are cut more coarsely than that, corners need the room.
            sizes = [min(size, count) for size, count in zip(sizes, counts, strict=True)]
        curves = [curve.resampled(size, period) for curve, size in zip(curves, sizes, strict=True)]
        curves = _stage(curves, period, wanted, reached, stage, radii)
        reached = stage.diameter
    if counts is None:
        return curves
    return [
        curve if len(curve.points) == count else curve.smooth(period).vertices(count, period)
        for curve, count in zip(curves, counts, strict=True)
    ]


def _stage(
    curves: list[PeriodicCurve], period: Array, wanted: list[float], reached: float, stage: Stage, radii: Array
) -> list[PeriodicCurve]:
    """Run one stage; the diameter grows from `reached` at its beginning."""
    pattern = pattern_from_curves(curves, period, float(radii.max()), yarn_radius=radii)
    sizes = np.array([len(curve.points) for curve in curves])
    rest = np.repeat(np.array(wanted) / sizes, sizes)
    n, share = len(pattern.edges), np.repeat(radii, sizes)
    reach = stage.diameter * float(radii.max()) + SKIN
    strands = Strands.around(pattern, reach + 2.0 * float(rest.max()))
    offset = strands.copies(np.zeros((1, 3)), period)
    neighbours = Neighbours.by_length(strands, rest, stage.diameter * share)
    edge_end, tile = pattern.edges[:, 1], np.zeros((n, 3))
    tile[:, :2] = pattern.edges[:, 2:] * period

    x, v, force = pattern.vertices.copy(), np.zeros((n, 3)), np.zeros((n, 3))
    nobody = np.empty(0, np.int64)
    listed_at, near = x, _Near.of(x, offset, strands, (nobody, nobody))
    dt, mixing, uphill_free = 0.1, 0.1, 0
    for step in range(stage.steps):
        # In a hundred steps at most: the rest of the last, long stage is for rounding.
        grown = min(1.0, (step + 1) / min(0.5 * stage.steps, 100.0))
        diameter = reached + grown * (stage.diameter - reached)
        if step == 0 or np.abs(x - listed_at).max() > 0.25 * SKIN:
            listed_at = x.copy()
            pairs = close_pairs(strands, strands.copies(x, period), reach, neighbours=neighbours)
            near = _Near.of(x, offset, strands, pairs)
        copies = x[near.source] + near.offset
        _forces(
            x, edge_end, tile, rest, copies, near.source, near.end, near.first, near.second, diameter * share, force
        )
        if grown == 1.0 and np.abs(force).max() < AT_REST:
            break
        power = float((force * v).sum())
        if power > 0.0:
            uphill_free += 1
            size = np.linalg.norm(v) / max(float(np.linalg.norm(force)), 1e-300)
            v = (1.0 - mixing) * v + mixing * size * force
            if uphill_free > 5:
                dt, mixing = min(1.1 * dt, 0.3), 0.99 * mixing
        else:
            v[:] = 0.0
            dt, mixing, uphill_free = max(0.5 * dt, 0.01), 0.1, 0
        v += dt * force
        move = dt * v
        longest = float(np.sqrt((move * move).sum(axis=1).max()))
        if longest > STEP_LIMIT:
            move *= STEP_LIMIT / longest
            v *= STEP_LIMIT / longest
        x = x + move * safe_fraction(copies, move[near.source], near.end, near.first, near.second, GAP_SHARE)
    starts = np.concatenate([[0], np.cumsum(sizes)])
    return [PeriodicCurve(x[a:b], curve.shift) for a, b, curve in zip(starts, starts[1:], curves, strict=False)]


@dataclass(frozen=True, eq=False)
class _Near:
    """Pairs of close segments, and the copies of vertices at their ends alone.

    source, offset: vertex behind each copy (k,), and how far it is moved (k, 3). end: copy at the end of the segment
    that begins at a copy (k,). first, second: copies at which the segments of each pair begin (m,).
    """

    source: Integers
    offset: Array
    end: Integers
    first: Integers
    second: Integers

    @classmethod
    def of(cls, x: Array, offset: Array, strands: Strands, pairs: tuple[Integers, Integers]) -> _Near:
        begins = np.unique(np.concatenate(pairs))
        nodes = np.unique(np.concatenate([begins, strands.ends[begins]]))
        end = np.full(len(nodes), -1)
        end[np.searchsorted(nodes, begins)] = np.searchsorted(nodes, strands.ends[begins])
        first, second = (np.searchsorted(nodes, segments) for segments in pairs)
        return cls(nodes % len(x), offset[nodes // len(x)], end, first, second)


@numba.njit(**_JIT)
def _forces(x, end, tile, rest, copies, source, ends, first, second, diameter, force):
    """Forces of springs, joints and repulsion on the vertices of the primary tile."""
    force[:] = 0.0
    n = len(x)
    edge = np.empty((n, 3))
    for i in range(n):
        size = 0.0
        for c in range(3):
            edge[i, c] = x[end[i], c] + tile[i, c] - x[i, c]
            size += edge[i, c] ** 2
        size = np.sqrt(size)
        pull = STRETCH * (size / rest[i] - 1.0) / size
        for c in range(3):
            force[i, c] += pull * edge[i, c]
            force[end[i], c] -= pull * edge[i, c]
    for i in range(n):
        j = end[i]
        stiffness = BEND / rest[i] ** 3
        # A joint's share is bounded, so that short edges do not make the motion stiff.
        stiffness = min(stiffness, 2.0)
        for c in range(3):
            bend = stiffness * (edge[j, c] - edge[i, c])
            force[j, c] += 2.0 * bend
            force[i, c] -= bend
            force[end[j], c] -= bend
    for m in range(first.shape[0]):
        e, g = first[m], second[m]
        a, b, h, k = source[e], source[ends[e]], source[g], source[ends[g]]
        p, q, o, w = copies[e], copies[ends[e]], copies[g], copies[ends[g]]
        s, t, gap = nearest_places(copies, e, ends[e], g, ends[g])
        gap = np.sqrt(gap)
        touch = 0.5 * (diameter[a] + diameter[h])
        if gap >= touch:
            continue
        push = REPULSION * np.sqrt(((q - p) ** 2).sum() * ((w - o) ** 2).sum()) * (touch / gap - 1.0) / gap
        for c in range(3):
            d = (1.0 - s) * p[c] + s * q[c]
            d -= (1.0 - t) * o[c] + t * w[c]
            force[a, c] += push * (1.0 - s) * d
            force[b, c] += push * s * d
            force[h, c] -= push * (1.0 - t) * d
            force[k, c] -= push * t * d
