"""Ways on which no yarn passes another, and a count of those that did."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from yarnscale.fabric.direct_energy import FabricEnergy
from yarnscale.fabric.direct_neighbours import close_pairs
from yarnscale.yarn.segment_cuts import pair_cuts

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

_MOST_PIECES = 400
_ROUNDING = 1e-6
"""Distance at which yarns count as touching [r]."""
_UNDO_WITHIN = 4
"""Opposite cuts of the same two yarns undo each other so many vertices apart."""


def safe_way(energy: FabricEnergy, start: Array, goal: Array, count: PassageCount | None = None) -> Array:
    """The farthest state on the straight way to ``goal`` (4n,) that is reached without yarns passing each other."""
    x = start
    for _ in range(_MOST_PIECES):
        step = goal - x
        if not step.any():
            break
        fraction = energy.bound(x, step)
        x = goal if fraction >= 1.0 else x + fraction * step
        energy.anchor(x)
        if count is not None:
            count.follow(x)
        if fraction < 1e-3:
            break
    return x


class PassageCount:
    """How often a yarn passed through another on the way of a fabric, piece by piece.

    Yarns are linked after the way as they were before it exactly where no cut is left. ``follow`` takes the states in
    order; between two of them all vertices move straight, as they do in a Newton step.
    """

    def __init__(self, energy: FabricEnergy, start: Array) -> None:
        self._energy = energy
        self.begin(start, no_cuts())

    def begin(self, x: Array, found: Array) -> None:
        """Go on from a state (4n,) with the cuts (m, 6) found before it."""
        self._last, self.found = x.copy(), found

    def follow(self, x: Array) -> None:
        """The next state (4n,)."""
        new = cuts(self._energy, self._last, x)
        if len(new):
            self.found = np.concatenate([self.found, new])
        self._last = x.copy()

    def jump(self, x: Array) -> None:
        """Another state that is not looked at."""
        self._last = x.copy()

    @property
    def passages(self) -> int:
        """Cuts that no opposite one near the same place undid."""
        return len(_lasting(self._energy.sheet.yarn_of_vertex, self.found))


def no_cuts() -> Array:
    """Cuts of yarns that do not meet."""
    return np.empty((0, 6))


def cuts(energy: FabricEnergy, before: Array, after: Array) -> Array:
    """Cuts of yarns by each other on straight ways of all vertices between two states, (m, 6) as ``pair_cuts``."""
    sheet = energy.sheet
    first = np.ascontiguousarray(energy.positions(before))
    second = np.ascontiguousarray(energy.positions(after))
    neighbours = energy.stiffness.rule.neighbours
    pairs = close_pairs(
        first, sheet.following, sheet.offsets, sheet.closed, _ROUNDING, neighbours, moves=second - first
    )
    return pair_cuts(first, second, sheet.following, *pairs) if len(pairs[0]) else no_cuts()


def _lasting(yarn: Indices, found: Array) -> Indices:
    left = np.ones(len(found), bool)
    for a in range(len(found)):
        for b in range(a + 1, len(found)):
            if not (left[a] and left[b]) or found[a, 5] * found[b, 5] > 0:
                continue
            (i, g), (j, h) = found[a, :2].astype(int), found[b, :2].astype(int)
            for p, q in ((j, h), (h, j)):
                same = yarn[i] == yarn[p] and yarn[g] == yarn[q]
                if same and max(abs(i - p), abs(g - q)) <= _UNDO_WITHIN:
                    left[a] = left[b] = False
                    break
    return np.flatnonzero(left)
