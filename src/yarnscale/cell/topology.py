"""Whether yarns passed through each other between two shapes of a cell.

Both shapes are joined by straight motions of all vertices. Two segments cut through each other where the volume of the
tetrahedron of their four ends, a cubic in time, changes its sign while the segments meet; the sign of the change tells
from which side. A straight motion is no record of what happened. Where it has no cut, or only cuts that are taken back
near the same place of the same two yarns, both shapes are the same fabric. Where it has others, they may be: a loop
that swings around another is cut twice on the straight way and not at all on its own. But the cuts of two different
yarns, or of two copies of one, add up to the change of their linking number, which no motion without a cut changes.
"""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numba
import numpy as np
from numpy.typing import NDArray

from yarnscale.cell.midsurface import Midsurface
from yarnscale.cell.poisson import cell_midsurface
from yarnscale.kinematics import ShellStrain
from yarnscale.yarn.neighbours import Images
from yarnscale.yarn.segment_cuts import pair_cuts

if TYPE_CHECKING:
    from yarnscale.cell.energy import CellEnergy

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
_JIT = {"cache": True, "error_model": "numpy"}

UNDO_WITHIN = 4.0
"""Two opposite cuts undo each other when they lie so near along both yarns [r]."""


@dataclass(frozen=True, eq=False)
class Motion:
    """A straight motion of all copies of a cell's vertices.

    before, after: (T·n, 3) positions [r] of the copies in ``images``. turning: rotation vectors of the copies (T·n, 3);
    None: flat.
    """

    energy: CellEnergy
    images: Images
    before: Array
    after: Array
    turning: Array | None = None

    @classmethod
    def between(
        cls, energy: CellEnergy, before: tuple[ShellStrain, Array], after: tuple[ShellStrain, Array]
    ) -> Motion:
        """From one strain and fluctuation (n, 3) [r] to another, with as many copies as can meet on the way."""
        moved = after[1] - before[1]
        images = energy.copies_within(2.0 * float(np.sqrt((moved * moved).sum(axis=1).max())))
        first, second = (_nodes(energy, images, *state) for state in (before, after))
        bent = next((strain for strain, _ in (after, before) if not strain.is_flat), None)
        if bent is None:
            return cls(energy, images, first, second)
        if bent is energy.strain and images is energy.images:
            return cls(energy, images, first, second, energy.turning)
        surface = Midsurface(bent, length=energy.pattern.radius)
        return cls(energy, images, first, second, surface.rotation_vectors(energy.placed(images)))

    def crossings(self) -> Array:
        """Cuts that are not undone, (k, 6).

        Columns: primary segment i, copied segment g (its node), time, places on both segments in [0, 1], and sign of
        the change of the volume.
        """
        found = self._cuts()
        return found[_lasting(self.energy, found, self.images)]

    def changes_links(self) -> bool:
        """Whether linking numbers of yarns, or of copies of one yarn, differ between both ends of the motion."""
        found = self.crossings()
        sums: Counter[tuple[int, ...]] = Counter()
        for pair, sign in zip(_Strands.of(self.energy, found, self.images).pairs(), found[:, 5], strict=True):
            if pair is not None:
                sums[pair] += int(sign)
        return any(sums.values())

    def _cuts(self) -> Array:
        """All cuts; pairs that the contact list leaves out are left out."""
        energy, ends, n = self.energy, self.images.segment_end, self.energy.count
        before, after = np.ascontiguousarray(self.before), np.ascontiguousarray(self.after)
        first, second = _swept_pairs(before, after, ends, n)
        if len(first) == 0:
            return np.empty((0, 6))
        found = pair_cuts(before, after, ends, first, second)
        if len(found) == 0:
            return found
        i, g = found[:, 0].astype(np.int64), found[:, 1].astype(np.int64)
        tile = self.images.tiles[g // n]
        # A segment meets its copies in tiles t and −t alike.
        twice = (i == g % n) & ((tile[:, 0] < 0) | ((tile[:, 0] == 0) & (tile[:, 1] < 0)))
        kept = ~twice & ~_along_yarn(energy, i, g % n, tile)
        if self.turning is not None:
            turned = self.turning[g] - self.turning[i]
            kept &= (turned * turned).sum(axis=1) < math.pi**2
        return found[kept]


def _nodes(energy: CellEnergy, images: Images, strain: ShellStrain, fluctuation: Array) -> Array:
    """Positions (T·n, 3) [r] of copies at a strain and fluctuation (n, 3) [r]."""
    if strain is energy.strain and images is energy.images:
        full = energy.nodes.expand(np.concatenate([fluctuation.ravel(), np.zeros(energy.count)]))
        return full[: 3 * len(energy.nodes.source)].reshape(-1, 3)
    surface = energy.surface if strain is energy.strain else cell_midsurface(energy.pattern, strain)
    points, rotation = surface.at(energy.placed(images))
    return points + np.einsum("nij,nj->ni", rotation, np.tile(fluctuation, (len(images.tiles), 1)))


def crossings(energy: CellEnergy, before: Array, after: Array) -> Array:
    """Lasting cuts of straight motions between two sets of nodes (T·n, 3) [r] of the cell; see ``Motion.crossings``."""
    turning = None if energy.strain.is_flat else energy.turning
    return Motion(energy, energy.images, before, after, turning).crossings()


def from_drawing(energy: CellEnergy, x: Array) -> Motion:
    """The motion to a free vector from the rest shape carried to its state, û = 0, which is entangled as drawn."""
    fluctuation = x[: 3 * energy.count].reshape(-1, 3)
    return Motion.between(energy, (energy.strain, np.zeros_like(fluctuation)), (energy.strain, fluctuation))


def crossed(energy: CellEnergy, x: Array) -> bool:
    """Whether the straight motion from the drawing to a free vector takes yarns through each other.

    If not, both are the same fabric; if so, they may be.
    """
    return len(from_drawing(energy, x).crossings()) > 0


def linked_differently(energy: CellEnergy, x: Array) -> bool:
    """Whether linking numbers of a free vector are not those of the drawing: it is another fabric then."""
    return from_drawing(energy, x).changes_links()


def jump_is_safe(energy: CellEnergy, x: Array, origin: ShellStrain) -> bool:
    """Whether a fluctuation may be taken over from the state ``origin``: no yarn passes another on the way."""
    if np.array_equal(origin.vector, energy.strain.vector):
        return True
    fluctuation = x[: 3 * energy.count].reshape(-1, 3)
    return len(Motion.between(energy, (origin, fluctuation), (energy.strain, fluctuation)).crossings()) == 0


def safe_move(energy: CellEnergy, before: Array, after: Array) -> bool:
    """Whether no yarn passes another on the straight way between two free vectors of one state."""
    ends = ((energy.strain, x[: 3 * energy.count].reshape(-1, 3)) for x in (before, after))
    return len(Motion.between(energy, *ends).crossings()) == 0


def _along_yarn(energy: CellEnergy, i: Indices, j: Indices, tile: Indices) -> NDArray[np.bool_]:
    """Whether segments i and (tile, j) lie so near each other along one yarn that they do not touch."""
    pattern = energy.pattern
    yarn, place, walked = pattern.yarn_of_vertex, pattern.position_along_yarn, pattern.tile_along_yarn
    neighbours = energy.stiffness.rule.neighbours
    near = np.zeros(len(i), bool)
    lengths = np.array([len(chain) for chain in pattern.yarns])[yarn[i]]
    for turn in range(-neighbours - 1, neighbours + 2):
        apart = place[j] + turn * lengths - place[i]
        reached = walked[j] + turn * pattern.yarn_shift[yarn[i]] - walked[i]
        near |= (np.abs(apart) <= neighbours) & (reached == tile).all(axis=1)
    return near & (yarn[i] == yarn[j])


def _lasting(energy: CellEnergy, found: Array, images: Images | None = None) -> Indices:
    """Rows that no opposite cut near them undoes, matched nearest first; images: those of the cell by default."""
    if len(found) < 2:
        return np.arange(len(found))
    strands = _Strands.of(energy, found, images or energy.images)
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
    def of(cls, energy: CellEnergy, found: Array, images: Images) -> _Strands:
        pattern, n = energy.pattern, energy.count
        length = pattern.rest_length / pattern.radius
        start, period = np.empty(n), np.array([length[chain].sum() for chain in pattern.yarns])
        for chain in pattern.yarns:
            start[chain] = np.cumsum(length[chain]) - length[chain]
        nodes = found[:, :2].astype(np.int64)
        vertex, tile = nodes % n, images.tiles[nodes // n]
        place = start[vertex] + found[:, 3:5] * length[vertex]
        lines = tile - pattern.tile_along_yarn[vertex]
        return cls(pattern.yarn_of_vertex[vertex], place, lines, period, pattern.yarn_shift)

    def pairs(self) -> list[tuple[int, ...] | None]:
        """Which two yarns each cut joins and how many tiles apart, the same for all copies; None: one with itself."""
        names: list[tuple[int, ...] | None] = []
        for yarn, tile in zip(self.yarn, self.tile, strict=True):
            (one, two), apart = sorted(yarn), tile[1] - tile[0]
            ways = [apart] if yarn[0] < yarn[1] else [-apart] if yarn[0] > yarn[1] else [apart, -apart]
            reduced = min(_remainder(way, self.shift[one], self.shift[two]) for way in ways)
            names.append(None if one == two and reduced == (0, 0) else (int(one), int(two), *reduced))
        return names

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


def _remainder(tile: Indices, first: Indices, second: Indices) -> tuple[int, int]:
    """The same member of tile + Z first + Z second for every tile of this set."""
    (a, b), (c, d) = (map(int, shift) for shift in (first, second))
    while c:  # Euclid: the second shift ends along y
        a, b, c, d = c, d, a - a // c * c, b - a // c * d
    x, y = map(int, tile)
    if a:
        x, y = x - x // a * a, y - x // a * b
    else:
        d = math.gcd(b, d)
    return x, y % abs(d) if d else y


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
