"""What a knit does away from its edges: strain, stress and yarn of its stitches, to compare with a periodic cell.

Part of ``direct_stretch.py``.

Yarns slide through a knit, so that a vertex does not identify its stitch. Stitches are found by the
legs of their loops, which run up and down the wale; from the middle between the legs of one loop to that of the next is
one stitch. Its middle is the mean of its yarn, as the middle surface of a cell; its stress the virial of the forces in
it (what crosses a cut through it).

Yarn of a stitch is counted as the cell means it, from one interlacing of two courses to the next up the wale: the head
that a course forms there and the feet of the course above. Where heads shorten from course to course, while every
course keeps its yarn, interlacings gain what they lose: without friction, loops pull yarn through each other so.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from yarnscale.arrays import Array, Flags, Integers
from yarnscale.drawing.loop_paths import line_crossings
from yarnscale.errors import InputError
from yarnscale.fabric.direct_energy import FabricEnergy
from yarnscale.fabric.sheet import YarnSheet
from yarnscale.kinematics import ShellStrain
from yarnscale.yarn.pattern import YarnPattern

FEWEST = 9
"""Stitches that a fit of strain and curvature needs."""


@dataclass(frozen=True, eq=False)
class Interior:
    """Mean state of the stitches inside a fabric.

    strain: of the surface through their middles. stress: (2,) along course and wale, ∂ψ/∂s_x and ∂ψ/∂s_y [N/m].
    yarn: rest length of yarn of an interlacing over that of the pattern's. slid: the part of it that heads leave to the
    course above them. energy: [J/m²]. stitches: how many.
    """

    strain: ShellStrain
    stress: Array
    yarn: float
    slid: float
    energy: float
    stitches: int


def interior(pattern: YarnPattern, energy: FabricEnergy, x: Array, *, share: float = 0.4) -> Interior:
    """State (4n,) of those stitches that lie in the middle ``share`` of the fabric, by width and by height.

    pattern: of the sheet, one stitch a period. Raises InputError for another pattern and where the share holds too few.
    """
    if len(pattern.yarns) != 1 or (pattern.yarn_shift[0] != (1, 0)).any():
        raise InputError("pattern of a fabric's interior", expected="one stitch a period", found=pattern.name)
    sheet = energy.sheet
    positions = energy.positions(x) * sheet.radius
    chain = pattern.yarns[0]
    head = int(chain[np.argmax(pattern.vertices[chain, 1])])
    first, last, tile = _stitches(sheet, positions, head, share, len(chain))
    if len(first) < FEWEST:
        raise InputError("stitches inside a fabric", expected=f"{FEWEST} or more; a larger share", found=len(first))
    energies, virials = energy.vertex_shares(x)
    weight = sheet.voronoi_length
    length = _between(weight, first, last)
    middle = _between(weight[:, None] * positions, first, last) / length[:, None]
    reference = (tile - tile.mean(axis=0)) * pattern.period
    gradient, second = _fit(reference, middle)
    slopes = gradient + np.einsum("abi,nb->nai", second, reference)
    unit = slopes / np.linalg.norm(slopes, axis=2)[:, :, None]
    normal = np.cross(gradient[0], gradient[1])
    normal /= np.linalg.norm(normal)
    strain = ShellStrain.from_forms(gradient @ gradient.T, second @ normal)
    plane = np.stack([unit.mean(axis=0)[0], np.cross(normal, unit.mean(axis=0)[0])], axis=1)
    slid = _slid(sheet, positions @ plane, head, share, len(chain)) / float(pattern.rest_length.sum())
    # Across courses and wales, which where these are sheared is not along the others.
    cosine = (unit[:, 0] * unit[:, 1]).sum(axis=1)[:, None, None]
    across = (unit - cosine * unit[:, ::-1]) / (1.0 - cosine**2)
    pull = np.einsum("nai,nij,naj->na", unit, _between(virials, first, last), across).mean(axis=0)
    return Interior(
        strain,
        pull / pattern.area / (1.0 + np.array([strain.s_x, strain.s_y])),
        float(length.mean() / pattern.rest_length.sum()) + slid,
        slid,
        float(_between(energies, first, last).mean() / pattern.area),
        len(first),
    )


def _stitches(
    sheet: YarnSheet, positions: Array, head: int, share: float, around: int
) -> tuple[Array, Array, Integers]:
    """Where along the numbered vertices stitches begin and end (s,), with fractions; their tiles (s, 2)."""
    found: dict[tuple[int, int], float] = {}
    heads = np.flatnonzero(sheet.source == head)
    heads = heads[_inner(sheet.tile[heads], share)]
    if len(heads) < FEWEST:
        raise InputError("stitches inside a fabric", expected=f"{FEWEST} or more; a larger share", found=len(heads))
    # Along the wales in their present direction.
    reference = sheet.tile[heads] - sheet.tile[heads].mean(axis=0)
    gradient, second = _fit(reference, positions[heads])
    upward = gradient[1] + np.einsum("bi,nb->ni", second[1], reference)
    for vertex, up in zip(heads, upward, strict=True):
        reach = around // 2
        low = max(vertex - reach, int(sheet.offsets[sheet.yarn_of_vertex[vertex]]) + 1)
        high = min(vertex + reach + 1, int(sheet.offsets[sheet.yarn_of_vertex[vertex] + 1]) - 1)
        place = _loop(positions[low:high] @ up)
        if place is not None:
            found[int(sheet.tile[vertex, 0]), int(sheet.tile[vertex, 1])] = low + place
    first, last, tile = [], [], []
    for (a, b), begin in found.items():
        if (a + 1, b) in found:
            ends = sorted((begin, found[a + 1, b]))
            first.append(ends[0])
            last.append(ends[1])
            tile.append((a, b))
    return np.array(first), np.array(last), np.array(tile, np.int64).reshape(-1, 2)


def _inner(tiles: Integers, share: float) -> Flags:
    """Which of a fabric's tiles (n, 2) lie in its middle share, by width and by height."""
    low, high = tiles.min(axis=0), tiles.max(axis=0)
    return (np.abs(tiles - 0.5 * (low + high)) <= 0.5 * share * (high - low + 1) + 1e-9).all(axis=1)


def _slid(sheet: YarnSheet, plan: Array, head: int, share: float, around: int) -> float:
    """How much shorter heads become from one course to the next [m], from places in plan (n, 2)."""
    vertices = np.flatnonzero(sheet.source == head)
    heads = {tuple(sheet.tile[v].tolist()): int(v) for v in vertices}
    courses, arcs = [], []
    for vertex in vertices[_inner(sheet.tile[vertices], share)].tolist():
        a, b = sheet.tile[vertex].tolist()
        above = heads.get((a, b + 1))
        if above is None:
            continue
        first, own = _stretch_of_yarn(sheet, vertex, around // 2)
        _, other = _stretch_of_yarn(sheet, above, 3 * around // 2)
        met = np.sort(line_crossings(plan[own], plan[other])[0])
        if len(met) == 4:  # both legs, each over or under the foot and the leg that it holds
            ends = first + 0.5 * (met[:1] + met[1:2]), first + 0.5 * (met[2:3] + met[3:])
            courses.append(b)
            arcs.append(float(_between(sheet.voronoi_length, *ends)[0]))
    if len(set(courses)) < 2:
        return 0.0
    return -float(np.polyfit(courses, arcs, 1)[0])


def _stretch_of_yarn(sheet: YarnSheet, vertex: int, reach: int) -> tuple[int, slice]:
    """The vertices of a yarn within ``reach`` of one of them: the first, and all."""
    yarn = sheet.yarn_of_vertex[vertex]
    low, high = (
        max(vertex - reach, int(sheet.offsets[yarn])),
        min(vertex + reach + 1, int(sheet.offsets[yarn + 1])),
    )
    return low, slice(low, high)


def _loop(height: Array) -> float | None:
    """Place of a loop: between those where its legs pass half its height, which are steep; None where they do not."""
    level, top = 0.5 * (height.max() + height.min()), int(np.argmax(height))
    below = height < level
    before, after = np.flatnonzero(below[:top]), top + np.flatnonzero(below[top:])
    if not (len(before) and len(after)):
        return None
    rise, fall = int(before[-1]), int(after[0]) - 1
    up = rise + (level - height[rise]) / (height[rise + 1] - height[rise])
    down = fall + (level - height[fall]) / (height[fall + 1] - height[fall])
    return float(0.5 * (up + down))


def _between(values: Array, first: Array, last: Array) -> Array:
    """Sums of per-vertex values (n, ...) from places to places (s,) along the numbered vertices."""
    total = np.concatenate([np.zeros_like(values[:1]), np.cumsum(values, axis=0)])

    def until(place: Array) -> Array:
        # Vertex k represents the yarn between k − ½ and k + ½.
        k = np.floor(place + 0.5).astype(np.int64)
        rest = (place + 0.5 - k).reshape(-1, *[1] * (values.ndim - 1))
        return total[k] + rest * values[k]

    return until(last) - until(first)


def _fit(reference: Array, middle: Array) -> tuple[Array, Array]:
    """Gradient (2, 3) and second derivatives (2, 2, 3) [1/m] of the surface through points, least squares."""
    u, v = reference.T
    rows = np.stack([np.ones(len(u)), u, v, 0.5 * u * u, u * v, 0.5 * v * v], axis=1)
    scale = np.abs(rows).max(axis=0)
    found = np.linalg.lstsq(rows / scale, middle, rcond=None)[0] / scale[:, None]
    return found[1:3], np.array([[found[3], found[4]], [found[4], found[5]]])
