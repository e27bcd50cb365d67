"""Whether yarns passed through each other between two shapes of a cell.

Both shapes are joined by straight motions of all vertices. Two segments cut through each other where the volume of the
tetrahedron of their four ends, a cubic in time, changes its sign while the segments meet; the sign of the change tells
from which side. The motion is no record of what happened, so a cut that is taken back near the same place of the same
two yarns counts for nothing: what is left tells that no motion joins the shapes without a cut.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numba
import numpy as np
from numpy.typing import NDArray

from yarnscale.cell.poisson import cell_midsurface
from yarnscale.kinematics import ShellStrain
from yarnscale.yarn.segment_cuts import pair_cuts

if TYPE_CHECKING:
    from yarnscale.cell.energy import CellEnergy

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
_JIT = {"cache": True, "error_model": "numpy"}

UNDO_WITHIN = 4.0
"""Two opposite cuts undo each other when they lie so near along both yarns [r]."""


def crossings(energy: CellEnergy, before: Array, after: Array) -> Array:
    """Cuts of straight motions between two sets of nodes, (k, 6), those that are undone left out.

    before, after: (T·n, 3) positions of all copies [r]. Columns: primary segment i, copied segment g (its node), time,
    places on both segments in [0, 1], and sign of the change of the volume.
    """
    found = _cuts(energy, before, after)
    return found[_lasting(energy, found)]


def crossed(energy: CellEnergy, x: Array) -> bool:
    """Whether yarns of a free vector have passed through each other since the rest shape.

    The rest shape carried to the macroscopic state, û = 0, has the topology of the drawing.
    """
    return len(crossings(energy, energy.nodes.offset, _node_positions(energy, x))) > 0


def jump_is_safe(energy: CellEnergy, x: Array, origin: ShellStrain) -> bool:
    """Whether a fluctuation may be taken over from the state ``origin``: no yarn passes another on the way."""
    if np.array_equal(origin.vector, energy.strain.vector):
        return True
    points, rotation = cell_midsurface(energy.pattern, origin).at(energy.reference)
    fluctuation = x[: 3 * energy.count].reshape(-1, 3)[energy.nodes.source]
    before = points + np.einsum("nij,nj->ni", rotation, fluctuation)
    return len(crossings(energy, before, _node_positions(energy, x))) == 0


def safe_move(energy: CellEnergy, before: Array, after: Array) -> bool:
    """Whether no yarn passes another on the straight way between two free vectors of one state."""
    return len(crossings(energy, _node_positions(energy, before), _node_positions(energy, after))) == 0


def _node_positions(energy: CellEnergy, x: Array) -> Array:
    return energy.nodes.expand(x)[: 3 * len(energy.nodes.source)].reshape(-1, 3)


def _cuts(energy: CellEnergy, before: Array, after: Array) -> Array:
    """All cuts in the columns of ``crossings``; pairs that the contact list leaves out are left out."""
    ends = energy.images.segment_end
    first, second = _swept_pairs(
        np.ascontiguousarray(before), np.ascontiguousarray(after), ends, energy.count
    )
    if len(first) == 0:
        return np.empty((0, 6))
    found = pair_cuts(before, after, ends, first, second)
    if len(found) == 0:
        return found
    i, g = found[:, 0].astype(np.int64), found[:, 1].astype(np.int64)
    kept = ~_along_yarn(energy, i, g)
    if not energy.strain.is_flat:
        turned = energy.turning[g] - energy.turning[i]
        kept &= (turned * turned).sum(axis=1) < math.pi**2
    return found[kept]


def _along_yarn(energy: CellEnergy, i: Indices, g: Indices) -> NDArray[np.bool_]:
    """Whether segments lie so near each other along one yarn that they do not touch."""
    pattern, n = energy.pattern, energy.count
    j, tile = g % n, energy.images.tiles[g // n]
    yarn, place, walked = pattern.yarn_of_vertex, pattern.position_along_yarn, pattern.tile_along_yarn
    neighbours = energy.stiffness.rule.neighbours
    near = np.zeros(len(i), bool)
    lengths = np.array([len(chain) for chain in pattern.yarns])[yarn[i]]
    for turn in range(-neighbours - 1, neighbours + 2):
        apart = place[j] + turn * lengths - place[i]
        reached = walked[j] + turn * pattern.yarn_shift[yarn[i]] - walked[i]
        near |= (np.abs(apart) <= neighbours) & (reached == tile).all(axis=1)
    return near & (yarn[i] == yarn[j])


def _lasting(energy: CellEnergy, found: Array) -> Indices:
    """Rows that no opposite cut near them undoes, matched nearest first."""
    if len(found) < 2:
        return np.arange(len(found))
    strands = _Strands.of(energy, found)
    opposite = np.argwhere(np.triu(found[:, 5][:, None] * found[:, 5] < 0))
    near = sorted((strands.apart(int(a), int(b)), int(a), int(b)) for a, b in opposite)
    left = np.ones(len(found), bool)
    for apart, a, b in near:
        if apart < UNDO_WITHIN and left[a] and left[b]:
            left[a] = left[b] = False
    return np.flatnonzero(left)


@dataclass(frozen=True, eq=False)
class _Strands:
    """Which copies of which yarns each cut joins, and where along them.

    yarn, place [r]: (k, 2). tile: (k, 2, 2), of the copy of the yarn. period [r], shift: of every yarn.
    """

    yarn: Indices
    place: Array
    tile: Indices
    period: Array
    shift: Indices

    @classmethod
    def of(cls, energy: CellEnergy, found: Array) -> _Strands:
        pattern, n = energy.pattern, energy.count
        length = pattern.rest_length / pattern.radius
        start, period = np.empty(n), np.array([length[chain].sum() for chain in pattern.yarns])
        for chain in pattern.yarns:
            start[chain] = np.cumsum(length[chain]) - length[chain]
        nodes = found[:, :2].astype(np.int64)
        vertex, tile = nodes % n, energy.images.tiles[nodes // n]
        place = start[vertex] + found[:, 3:5] * length[vertex]
        lines = tile - pattern.tile_along_yarn[vertex]
        return cls(pattern.yarn_of_vertex[vertex], place, lines, period, pattern.yarn_shift)

    def apart(self, a: int, b: int) -> float:
        """How far two cuts lie apart along their yarns [r]; inf where they are cuts of other yarns.

        A cut of two yarns is one of all their copies: that of b is moved by whole tiles until its first yarn is a's,
        as drawn or a period earlier or later; then the second ones must agree, whatever period.
        """
        best = math.inf
        for p, q in ((0, 1), (1, 0)):  # either yarn of b may be the first one of a
            one, two = self.yarn[a]
            if self.yarn[b, p] != one or self.yarn[b, q] != two:
                continue
            for turn in (-1, 0, 1):
                move = self.tile[a, 0] - self.tile[b, p] - turn * self.shift[one]
                gap = self.tile[b, q] + move - self.tile[a, 1]
                size = int(self.shift[two] @ self.shift[two])
                turns = round(float(gap @ self.shift[two]) / size) if size else 0
                if not np.array_equal(turns * self.shift[two], gap):
                    continue
                along_one = self.place[b, p] - turn * self.period[one] - self.place[a, 0]
                along_two = self.place[b, q] + turns * self.period[two] - self.place[a, 1]
                best = min(best, max(abs(along_one), abs(along_two)))
        return best


@numba.njit(**_JIT)
def _swept_pairs(before, after, ends, n):
    """Pairs (primary i, copy g > i in the order of the contact list) whose swept boxes meet."""
    segments = ends.shape[0]
    low, high = np.empty((segments, 3)), np.empty((segments, 3))
    for k in range(segments):
        e = ends[k]
        for c in range(3):
            low[k, c] = min(before[k, c], before[e, c], after[k, c], after[e, c])
            high[k, c] = max(before[k, c], before[e, c], after[k, c], after[e, c])
    bottom, top = np.full(3, np.inf), np.full(3, -np.inf)
    for k in range(n):
        for c in range(3):
            bottom[c], top[c] = min(bottom[c], low[k, c]), max(top[c], high[k, c])
    near = np.empty(segments, np.int64)
    count = 0
    for k in range(segments):
        inside = True
        for c in range(3):
            inside = inside and low[k, c] <= top[c] and high[k, c] >= bottom[c]
        if inside:
            near[count] = k
            count += 1
    axis = 0 if top[0] - bottom[0] > top[1] - bottom[1] else 1
    keys = np.empty(count)
    widest = 0.0
    for m in range(count):
        keys[m] = low[near[m], axis]
        widest = max(widest, high[near[m], axis] - keys[m])
    order = np.argsort(keys)
    keys = keys[order]
    first, second = np.empty(256, np.int64), np.empty(256, np.int64)
    found = 0
    for i in range(n):
        for m in range(np.searchsorted(keys, low[i, axis] - widest), count):
            if keys[m] > high[i, axis]:
                break
            g = near[order[m]]
            j = g % n
            if j < i or (j == i and g // n == 0):
                continue
            meets = True
            for c in range(3):
                meets = meets and low[g, c] <= high[i, c] and high[g, c] >= low[i, c]
            if not meets:
                continue
            if found == first.shape[0]:
                first = np.concatenate((first, np.empty(found, np.int64)))
                second = np.concatenate((second, np.empty(found, np.int64)))
            first[found], second[found] = i, g
            found += 1
    return first[:found], second[:found]
