"""Pairs of segments of a finite fabric that are close, found by a grid of cells.

Segments are numbered by their first vertex; those at the end of an open yarn (``following`` −1) do not exist.
"""

from __future__ import annotations

import numba
import numpy as np
from numpy.typing import NDArray

from yarnscale.yarn.neighbours import segment_gap

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
_JIT = {"cache": True, "error_model": "numpy"}

_MOST_CELLS = 1 << 22
_PAIRS_PER_SEGMENT = 12


def close_pairs(
    positions: Array,
    following: Indices,
    offsets: Indices,
    closed: NDArray[np.bool_],
    reach: float,
    neighbours: int,
    *,
    moves: Array | None = None,
) -> tuple[Indices, Indices]:
    """Pairs of segments nearer than ``reach``, (m,) and (m,), the first number below the second.

    Segments at most ``neighbours`` edges apart along one yarn are no pair. moves: (n, 3) of the vertices; pairs count
    as nearer by as much as they may move towards each other.
    """
    segments = np.flatnonzero(following >= 0)
    ends = following[segments]
    middle = 0.5 * (positions[segments] + positions[ends])
    longest = float(np.linalg.norm(positions[ends] - positions[segments], axis=1).max(initial=0.0))
    size = reach + longest
    pace, spread = np.zeros_like(middle), np.zeros(len(segments))
    if moves is not None and len(segments):
        pace = 0.5 * (moves[segments] + moves[ends])
        spread = 0.5 * np.linalg.norm(moves[ends] - moves[segments], axis=1)
        own = np.linalg.norm(pace - pace.mean(axis=0), axis=1) + spread
        size += 2.0 * float(own.max())
    low = middle.min(axis=0)
    shape = np.floor((middle.max(axis=0) - low) / size).astype(np.int64) + 1
    while float(np.prod(shape.astype(float))) > _MOST_CELLS:  # a few far vertices must not fill the memory
        size *= 1.5
        shape = np.floor((middle.max(axis=0) - low) / size).astype(np.int64) + 1
    cell = np.floor((middle - low) / size).astype(np.int64)
    number = (cell[:, 0] * shape[1] + cell[:, 1]) * shape[2] + cell[:, 2]
    order = np.argsort(number, kind="stable")
    starts = np.searchsorted(number[order], np.arange(int(np.prod(shape)) + 1))
    yarn = np.repeat(np.arange(len(closed)), np.diff(offsets))
    capacity = _PAIRS_PER_SEGMENT * len(segments) + 64
    while True:
        pairs = np.empty((capacity, 2), np.int64)
        found = _search(
            np.ascontiguousarray(positions), following, segments, order, starts, shape, cell, yarn, offsets, closed,
            reach, longest, neighbours, pace, spread, pairs,
        )  # fmt: skip
        if found >= 0:
            return pairs[:found, 0].copy(), pairs[:found, 1].copy()
        capacity *= 2


@numba.njit(**_JIT)
def _search(
    x, following, segments, order, starts, shape, cell, yarn, offsets, closed, reach, longest, neighbours, pace,
    spread, pairs
):  # fmt: skip
    found = 0
    for m in range(segments.shape[0]):
        i = segments[m]
        e = following[i]
        for a in range(max(cell[m, 0] - 1, 0), min(cell[m, 0] + 2, shape[0])):
            for b in range(max(cell[m, 1] - 1, 0), min(cell[m, 1] + 2, shape[1])):
                first = (a * shape[1] + b) * shape[2]
                # Cells along the last axis follow each other.
                begin = starts[first + max(cell[m, 2] - 1, 0)]
                stop = starts[first + min(cell[m, 2] + 2, shape[2])]
                for k in range(begin, stop):
                    g = segments[order[k]]
                    if g <= i:
                        continue
                    f = following[g]
                    away = moved = 0.0
                    for c in range(3):
                        away += (0.5 * (x[g, c] + x[f, c] - x[i, c] - x[e, c])) ** 2
                        moved += (pace[order[k], c] - pace[m, c]) ** 2
                    near = reach + np.sqrt(moved) + spread[m] + spread[order[k]]
                    if away >= (near + longest) ** 2:
                        continue
                    y = yarn[i]
                    if y == yarn[g]:
                        apart = g - i
                        if closed[y]:
                            apart = min(apart, offsets[y + 1] - offsets[y] - apart)
                        if apart <= neighbours:
                            continue
                    gap = segment_gap(
                        x[i, 0], x[i, 1], x[i, 2], x[e, 0], x[e, 1], x[e, 2],
                        x[g, 0], x[g, 1], x[g, 2], x[f, 0], x[f, 1], x[f, 2],
                    )  # fmt: skip
                    if gap < near * near:
                        if found == pairs.shape[0]:
                            return -1
                        pairs[found, 0], pairs[found, 1] = i, g
                        found += 1
    return found
