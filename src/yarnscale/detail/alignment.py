"""Offsets of the pattern on the panels, so that it is continuous across seams.

The pattern can continue across a seam whose two edges are the two sides of one cut: one is the other shifted. The place
in the pattern is u = (ξ − origin)/(stretch·period) on every panel; at such a seam both panels should have the same u up
to whole tiles. If seams close a ring of panels (the second side of a body, the one seam of a tube), the pattern is
stretched slightly to a whole number of tiles around the ring.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from yarnscale.arrays import Array
from yarnscale.detail.tiling import Tilings
from yarnscale.shell.mesh import TriangleMesh

LARGEST_STRETCH = 0.03
"""Largest stretch of a pattern to fit around a ring of panels; if more is needed it is not stretched."""
_OFF_BORDER = 1e-3
"""Shift of the pattern, in tiles, so that for panels of round sizes no yarn vertex is exactly on a seam."""
_PARALLEL = 0.05
"""Largest difference of the two sides of a seam, over its length, that counts as one shifted by the other."""


@dataclass(frozen=True)
class _Shift:
    """A stretch of seam whose sides are shifted: panels, mean place of either side [m], length [m]."""

    panels: tuple[int, int]
    places: tuple[Array, Array]
    length: float


def aligned_tilings(period: Array, mesh: TriangleMesh) -> Tilings:
    """Tilings of the panels of a mesh by a pattern of period (2,) [m], continuous across seams where possible."""
    numbers = mesh.panel_numbers
    count = int(numbers.max()) + 1
    if not mesh.has_seams:
        return Tilings.plain(count)
    shifts = _shifts(mesh, 0.25 * float(period.min()))
    origin, stretch = np.zeros((count, 2)), np.ones((count, 2))
    middle = np.array([mesh.material[numbers == p].mean(axis=0) for p in range(count)])
    for axis in range(2):
        matrix, wanted = _equations(shifts, middle, period, axis, count)
        found = np.linalg.lstsq(matrix, wanted, rcond=None)[0]
        if np.abs(found[count:]).max() > LARGEST_STRETCH:
            rigid = matrix.copy()
            rigid[:, count:] = 0.0
            found = np.linalg.lstsq(rigid, wanted, rcond=None)[0]
        # u = (1 + e)·(ξ − middle)/period + offset
        stretch[:, axis] = 1.0 / (1.0 + found[count:])
        origin[:, axis] = middle[:, axis] - found[:count] * period[axis] * stretch[:, axis]
    return Tilings(origin, stretch)


def _equations(shifts: list[_Shift], middle: Array, period: Array, axis: int, count: int) -> tuple[Array, Array]:
    """Linear equations for the offsets and strains e of all panels (2·count): sides agree, strains are small."""
    unstretched = np.zeros((count, 2 * count))
    unstretched[:, count:] = np.eye(count)
    rows, wanted = [unstretched], [np.zeros(count)]
    # The first panel keeps tile (0, 0) near the origin, as do those that no seam ties to another.
    offset = middle[:, axis] / period[axis] - _OFF_BORDER
    group = np.arange(count)
    agree = []
    for shift in sorted(shifts, key=lambda s: -s.length):
        (a, b), (here, there) = shift.panels, shift.places
        apart = [(place[axis] - middle[p, axis]) / period[axis] for p, place in ((a, here), (b, there))]
        row = np.zeros(2 * count)
        row[a] += 1.0
        row[b] -= 1.0
        row[count + a] += apart[0]
        row[count + b] -= apart[1]
        if group[a] != group[b]:
            offset[group == group[b]] += offset[a] + apart[0] - offset[b] - apart[1]
            group[group == group[b]] = group[a]
        agree.append(row)
    # Whole tiles are counted when every panel has its place.
    for row in agree:
        rows.append(row[None] * _FIRM)
        unstrained = float(row[count:].sum())
        tiles = round(float(row[:count] @ offset) + unstrained)
        wanted.append(np.array([_FIRM * (tiles - unstrained)]))
    held = np.zeros((count, 2 * count))
    held[np.arange(count), np.arange(count)] = _LOOSE
    return np.concatenate([*rows, held]), np.concatenate([*wanted, _LOOSE * offset])


_FIRM, _LOOSE = 1e4, 1e-3
"""Weights of seams and of offsets near those of the unstretched pattern; that of strains is one."""


def _shifts(mesh: TriangleMesh, tolerance: float) -> list[_Shift]:
    """Stretches of seams, each once, whose sides differ by one shift, to a tolerance [m]."""
    edges = mesh.sewn_edges
    points = mesh.material[edges]
    one, two = points[:, 1] - points[:, 0], points[:, 3] - points[:, 2]
    lengths = np.linalg.norm(one, axis=1)
    panels = mesh.panel_numbers[edges[:, [0, 2]]]
    first = (edges[:, 0] < edges[:, 2]) & (np.linalg.norm(one - two, axis=1) < _PARALLEL * lengths)
    waiting = np.flatnonzero(first)
    here, there = points[:, :2].mean(axis=1), points[:, 2:].mean(axis=1)
    found = []
    while len(waiting):
        pair, way = panels[waiting[0]], there[waiting[0]] - here[waiting[0]]
        own = (panels[waiting] == pair).all(axis=1)
        own &= np.linalg.norm(there[waiting] - here[waiting] - way, axis=1) < tolerance
        chosen = waiting[own]
        weight = lengths[chosen]
        places = tuple(np.average(side[chosen], axis=0, weights=weight) for side in (here, there))
        found.append(_Shift((int(pair[0]), int(pair[1])), (places[0], places[1]), float(weight.sum())))
        waiting = waiting[~own]
    return found
