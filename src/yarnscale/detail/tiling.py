"""A pattern laid over the panels of a cloth: long yarns, cut at the panels' borders, and where each vertex lies."""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np
from numpy.typing import NDArray

from yarnscale.errors import InputError
from yarnscale.shell.mesh import TriangleMesh
from yarnscale.yarn.pattern import YarnPattern

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

SHORTEST = 12.0
"""Pieces of yarn shorter than so many radii, less than a stitch cut off at a free border, are left out."""
LARGEST_TILING = 200_000_000
"""Most copies of vertices in the boxes around the panels."""
_ON_EDGE = -1e-9


@dataclass(frozen=True, eq=False)
class YarnLayout:
    """Yarn vertices on a cloth, curve after curve; what deformation never changes.

    vertex: (n,) of the pattern. triangle: (n,) that holds its reference coordinates ξ; place: (n, 3) barycentric
    coordinates there. material: ξ, (n, 2) [m]. offsets: (c + 1,) where each curve begins and the last one ends.
    yarn: (c,) number of each curve's yarn in the pattern. panel: (c,). closed: (c,) whether the last vertex joins the
    first one.
    """

    vertex: Integers
    triangle: Integers
    place: Floats
    material: Floats
    offsets: Integers
    yarn: Integers
    panel: Integers
    closed: NDArray[np.bool_]

    @classmethod
    def of(cls, pattern: YarnPattern, mesh: TriangleMesh) -> YarnLayout:
        """Repeat ``pattern`` over the material coordinates of every panel, tile (0, 0) at their origin.

        A yarn ends at the last vertex whose reference coordinates lie in the panel. Raises InputError where no yarn
        fits on any panel, or where the pattern is far too fine for the cloth.
        """
        numbers = mesh.panel_numbers[mesh.corners[:, 0]]
        parts = [_panel_layout(pattern, mesh, np.flatnonzero(numbers == p)) for p in range(numbers.max() + 1)]
        vertex, triangle, place, lengths, closed = (np.concatenate(c) for c in zip(*parts, strict=True))
        if len(lengths) == 0:
            raise InputError(
                "yarns on the cloth", expected="panels larger than the pattern", found="none fits"
            )
        offsets = np.concatenate([[0], np.cumsum(lengths)]).astype(np.int64)
        material = np.einsum("nk,nkc->nc", place, mesh.material[mesh.corners[triangle]])
        yarn = pattern.yarn_of_vertex[vertex[offsets[:-1]]]
        panel = np.repeat(np.arange(len(parts)), [len(part[3]) for part in parts])
        return cls(vertex, triangle, place, material, offsets, yarn, panel, closed)

    @property
    def vertex_count(self) -> int:
        """Number of yarn vertices on the cloth."""
        return len(self.vertex)


def _panel_layout(
    pattern: YarnPattern, mesh: TriangleMesh, own: Integers
) -> tuple[Integers, Integers, Floats, Integers, NDArray[np.bool_]]:
    """Vertex, triangle and place of all yarn vertices on triangles ``own``; length of each curve, whether closed."""
    corners = mesh.material[mesh.corners[own]]
    points = corners.reshape(-1, 2)
    rest = pattern.vertices[:, :2]
    # A margin of the longest step of an edge, so that every neighbour of a vertex inside has a place in the box.
    margin = np.abs(pattern.edges[:, 2:]).max(axis=0)
    low = np.floor((points.min(axis=0) - rest.max(axis=0)) / pattern.period).astype(np.int64) - margin
    high = np.ceil((points.max(axis=0) - rest.min(axis=0)) / pattern.period).astype(np.int64) + margin
    shape = high - low + 1
    if int(shape[0]) * int(shape[1]) * len(rest) > LARGEST_TILING:
        raise InputError(
            "pattern on the cloth",
            expected=f"at most {LARGEST_TILING} copies of vertices",
            found=f"{shape[0]} × {shape[1]} tiles of {len(rest)}",
        )
    owner, place = _locate(corners, rest, pattern.period, low, shape)
    chain, lengths, closed = _chains(
        owner, pattern.next_vertex, pattern.edges[:, 2:].copy(), pattern.previous_vertex
    )
    if len(lengths):
        at_seam = np.asarray(mesh.seams[own].any(axis=1))[owner.ravel()[chain]]
        kept = _worth_keeping(pattern, chain % len(rest), at_seam, lengths, closed)
        chain, lengths, closed = chain[np.repeat(kept, lengths)], lengths[kept], closed[kept]
    return chain % len(rest), own[owner.ravel()[chain]], place.reshape(-1, 3)[chain], lengths, closed


def _worth_keeping(
    pattern: YarnPattern,
    vertex: Integers,
    at_seam: NDArray[np.bool_],
    lengths: Integers,
    closed: NDArray[np.bool_],
) -> NDArray[np.bool_]:
    """Which pieces are long enough to be yarns; at a seam, where short ones fill the fabric up to it, all are."""
    ends = np.cumsum(lengths)
    rest = pattern.rest_length[vertex]
    walked = np.concatenate([[0.0], np.cumsum(rest)])
    whole = walked[ends] - walked[ends - lengths]
    length = np.where(closed, whole, whole - rest[ends - 1])
    sewn = np.logical_or.reduceat(at_seam, ends - lengths)
    return ((length >= SHORTEST * pattern.radius) | sewn) & (lengths > 2)


@numba.njit(cache=True, error_model="numpy")
def _locate(corners, rest, period, low, shape):
    """Triangle (−1: none) and barycentric coordinates of every copy (a, b, i) of the pattern's vertices in the box."""
    n = len(rest)
    owner = np.full((shape[0], shape[1], n), -1, np.int64)
    place = np.empty((shape[0], shape[1], n, 3))
    for t in range(len(corners)):
        c = corners[t]
        x0, y0 = c[0, 0], c[0, 1]
        ux, uy, vx, vy = c[1, 0] - x0, c[1, 1] - y0, c[2, 0] - x0, c[2, 1] - y0
        inverse = 1.0 / (ux * vy - uy * vx)
        left, right = min(x0, x0 + ux, x0 + vx), max(x0, x0 + ux, x0 + vx)
        bottom, top = min(y0, y0 + uy, y0 + vy), max(y0, y0 + uy, y0 + vy)
        for i in range(n):
            a_first = int(np.ceil((left - rest[i, 0]) / period[0] - 1e-9)) - low[0]
            a_last = int(np.floor((right - rest[i, 0]) / period[0] + 1e-9)) - low[0]
            b_first = int(np.ceil((bottom - rest[i, 1]) / period[1] - 1e-9)) - low[1]
            b_last = int(np.floor((top - rest[i, 1]) / period[1] + 1e-9)) - low[1]
            for a in range(a_first, a_last + 1):
                for b in range(b_first, b_last + 1):
                    if owner[a, b, i] >= 0:
                        continue
                    x = rest[i, 0] + (a + low[0]) * period[0] - x0
                    y = rest[i, 1] + (b + low[1]) * period[1] - y0
                    second, third = (x * vy - y * vx) * inverse, (ux * y - uy * x) * inverse
                    first = 1.0 - second - third
                    if min(first, second, third) >= _ON_EDGE:
                        owner[a, b, i] = t
                        place[a, b, i, 0], place[a, b, i, 1], place[a, b, i, 2] = first, second, third
    return owner, place


@numba.njit(cache=True)
def _chains(owner, following, steps, preceding):
    """Flat indices of copies inside, in order along each yarn; of each piece its number of vertices, whether closed."""
    across, along, n = owner.shape
    used = np.zeros(owner.shape, np.bool_)
    chain = np.empty(owner.size, np.int64)
    lengths, rings = np.empty(owner.size, np.int64), np.empty(owner.size, np.bool_)
    filled, pieces = 0, 0
    for closed in range(2):
        for i0 in range(n):
            for b0 in range(along):
                for a0 in range(across):
                    if owner[a0, b0, i0] < 0 or used[a0, b0, i0]:
                        continue
                    before = preceding[i0]
                    a, b = a0 - steps[before, 0], b0 - steps[before, 1]
                    # In the first round, begin where a yarn comes in from outside; what is left then are rings.
                    if closed == 0 and owner[a, b, before] >= 0:
                        continue
                    begin = filled
                    a, b, i = a0, b0, i0
                    while owner[a, b, i] >= 0 and not used[a, b, i]:
                        used[a, b, i] = True
                        chain[filled] = (a * along + b) * n + i
                        filled += 1
                        a, b, i = a + steps[i, 0], b + steps[i, 1], following[i]
                    lengths[pieces], rings[pieces] = filled - begin, closed == 1
                    pieces += 1
    return chain[:filled], lengths[:pieces], rings[:pieces]
