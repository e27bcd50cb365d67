"""Crossings of surfaces: triangles and objects, place, number."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numba
import numpy as np

from yarnscale.arrays import Array, Integers
from yarnscale.errors import InputError
from yarnscale.numerics.pair_distance import closest_points
from yarnscale.shell.contact.broad_phase import on_overlaps
from yarnscale.shell.contact.pair_loops import cross

CLOTH = -1
"""Number of the cloth among the objects."""
_TOUCHING = 1e-9
"""Distance that counts as zero, over the size of the whole, or of what is near."""


@dataclass(frozen=True)
class Crossing:
    """Two objects that cross.

    obstacle: number of the obstacle, or ``CLOTH`` if the cloth crosses itself; description: triangles, place and
    number; remedy: advice for the user. triangles: those of the cloth that the description names.
    """

    obstacle: int
    description: str
    remedy: str
    triangles: tuple[int, ...] = ()


def start_that_crosses(found: Sequence[Crossing], lines: Integers) -> InputError:
    """The error of a start with these crossings; lines: of the cloth's triangles in their file, if any."""
    text = "; ".join(c.description + _in_file(lines, c.triangles) for c in found) or "some that do"
    remedies = "; ".join(dict.fromkeys(c.remedy for c in found))
    return InputError(
        "start of the cloth",
        expected="surfaces that do not cross",
        found=f"{text}. {remedies[:1].upper()}{remedies[1:]}" if found else text,
    )


def _in_file(lines: Integers, triangles: Sequence[int]) -> str:
    """Lines of the cloth's file that triangles come from, where there is one."""
    if not (len(lines) and triangles):
        return ""
    return f" (line{'s' * (len(triangles) > 1)} {' and '.join(str(lines[t]) for t in triangles)} of its file)"


def surface_crossings(
    positions: Array, triangles: Integers, owners: Integers, names: Mapping[int, str], *, within_cloth: bool
) -> list[Crossing]:
    """Crossings of triangles (m, 3) of the cloth with each other, if wanted, and with those of obstacles.

    owners: object of each triangle (m,), increasing from ``CLOTH``; names: of the obstacles by their number.
    """
    cloth = int((owners == CLOTH).sum())
    pairs, places = crossing_triangles(positions, triangles, cloth, within_cloth=within_cloth)
    found = []
    for obstacle in np.unique(owners[pairs[:, 1]]).tolist():
        chosen = owners[pairs[:, 1]] == obstacle
        one, two = pairs[chosen][0]
        count, where = int(chosen.sum()), _place(places[chosen][0])
        number = "their only pair" if count == 1 else f"one of {count} pairs"
        if obstacle == CLOTH:
            remedy = "move one of the layers, or set [contact] self_contact = false"
            if _doubled(positions, triangles[pairs[chosen]]):
                remedy = f"sew vertices at the same place (weld), {remedy}"
            text = f"triangles {one} and {two} of the cloth at {where}, {number}"
            found.append(Crossing(obstacle, text, remedy, (int(one), int(two))))
        else:
            two -= int(np.searchsorted(owners, obstacle))
            text = f"triangle {one} of the cloth and triangle {two} of {names[obstacle]} at {where}, {number}"
            found.append(Crossing(obstacle, text, f"move the cloth or {names[obstacle]}", (int(one),)))
    return found


def shape_crossing(obstacle: int, name: str, kind: str, distances: Array, places: Array, count: int) -> Crossing:
    """Crossing of the cloth with a sphere or plane.

    kind: what of the cloth is inside, "triangle" or "vertex"; distances: of those, up to zero [m]; places: their
    nearest points (n, 3) [m]; count: of all triangles or vertices of the cloth.
    """
    deepest, inside = int(distances.argmin()), len(distances)
    many = "triangles" if kind == "triangle" else "vertices"
    side = "inside" if kind == "triangle" else "behind"
    depth, place = -distances[deepest], _place(places[deepest])
    text = f"{inside} of {count} {many} of the cloth at or {side} {name}, by up to {depth:.3g} m at {place}"
    remedy = f"move the cloth or {name}"
    if inside == count:
        remedy += ", or turn the normal to the side of the cloth" if kind == "vertex" else ""
    return Crossing(obstacle, text, remedy)


def _place(point: Array) -> str:
    return "({:.4g}, {:.4g}, {:.4g}) m".format(*(point + 0.0))


def _doubled(positions: Array, pairs: Integers) -> bool:
    """Whether triangles that cross (n, 2, 3) have different vertices at the same place."""
    near = np.linalg.norm(positions[pairs[:, 0, :, None]] - positions[pairs[:, 1, None, :]], axis=3)
    return bool((near <= _TOUCHING * float(np.ptp(positions, axis=0).max())).any())


def crossing_triangles(
    positions: Array, triangles: Integers, cloth: int, *, within_cloth: bool
) -> tuple[Integers, Array]:
    """Pairs of triangles (n, 2) that cross or touch without a common vertex, each once in order, and a place of each.

    triangles: (m, 3), the first ``cloth`` of the cloth; pairs have at least one of these, and that one first.
    """
    corners = positions[triangles]
    boxes = np.concatenate([corners.min(axis=1), -corners.max(axis=1)], axis=1)
    found = on_overlaps(boxes, cloth, lambda near: _crossing(positions, triangles, near), within_cloth=within_cloth)
    pairs, places = (np.concatenate(arrays) for arrays in zip(*found, strict=True))
    pairs = np.where((pairs < cloth).all(axis=1, keepdims=True), np.sort(pairs, axis=1), pairs)
    order = np.lexsort(pairs.T[::-1])
    return pairs[order], places[order]


@numba.njit(cache=True, error_model="numpy", nogil=True)
def _crossing(positions, triangles, near):
    """Those of pairs of triangles (n, 2) of which an edge of one meets the other, and where."""
    chosen, places, count = np.empty_like(near), np.empty((len(near), 3)), 0
    x, c = np.empty((5, 3)), np.empty(4)
    for n in range(len(near)):
        one, two = triangles[near[n, 0]], triangles[near[n, 1]]
        if _share_a_vertex(one, two) or _beside(positions, one, two) or _beside(positions, two, one):
            continue
        for side in range(6):
            edge, face = (one, two) if side < 3 else (two, one)
            x[0], x[1] = positions[edge[side % 3 - 1]], positions[edge[side % 3]]
            for k in range(3):
                x[2 + k] = positions[face[k]]
            share = _meeting(x, c)
            if share >= 0.0:
                chosen[count], places[count] = near[n], x[0] + share * (x[1] - x[0])
                count += 1
                break
    return chosen[:count].copy(), places[:count].copy()


@numba.njit(cache=True, error_model="numpy", nogil=True)
def _share_a_vertex(one, two):
    for i in one:
        for j in two:
            if i == j:
                return True
    return False


@numba.njit(cache=True, error_model="numpy", nogil=True)
def _beside(positions, one, two):
    """Whether a triangle lies on one side of the plane of another, off it."""
    a, b, c = positions[two[0]], positions[two[1]], positions[two[2]]
    u0, u1, u2, v0, v1, v2 = b[0] - a[0], b[1] - a[1], b[2] - a[2], c[0] - a[0], c[1] - a[1], c[2] - a[2]
    n0, n1, n2 = u1 * v2 - u2 * v1, u2 * v0 - u0 * v2, u0 * v1 - u1 * v0
    low, high = math.inf, -math.inf
    for i in one:
        p = positions[i]
        height = n0 * (p[0] - a[0]) + n1 * (p[1] - a[1]) + n2 * (p[2] - a[2])
        low, high = min(low, height), max(high, height)
    off = _TOUCHING * (n0 * n0 + n1 * n1 + n2 * n2) ** 0.75
    return low > off or high < -off


@numba.njit(cache=True, error_model="numpy", nogil=True)
def _meeting(x, c):
    """Share of the distance from x₀ to x₁ where it meets the triangle x₂ x₃ x₄, or −1; c (4,): memory."""
    a, b, normal, across = x[3] - x[2], x[4] - x[2], np.empty(3), np.empty(3)
    cross(a, b, normal)
    start, end = np.dot(normal, x[0] - x[2]), np.dot(normal, x[1] - x[2])
    size = np.dot(normal, normal)
    if max(abs(start), abs(end)) <= _TOUCHING * size**0.75:
        return _meeting_in_plane(x, c)
    if start * end > 0.0:
        return -1.0
    share = start / (start - end)
    place = x[0] + share * (x[1] - x[0]) - x[2]
    cross(place, b, across)
    u = np.dot(across, normal)
    cross(a, place, across)
    v = np.dot(across, normal)
    return share if u >= 0.0 and v >= 0.0 and u + v <= size else -1.0


@numba.njit(cache=True, error_model="numpy", nogil=True)
def _meeting_in_plane(x, c):
    """The same for an edge in the plane of the triangle: where it crosses a side, or its start if that is inside."""
    pair, least = np.empty((4, 3)), _TOUCHING**2 * np.sum((x[1] - x[0]) ** 2)
    pair[0] = x[0]
    pair[1:] = x[2:]
    if closest_points(pair, True, c) <= least:
        return 0.0
    pair[1] = x[1]
    for k in range(3):
        pair[2], pair[3] = x[2 + k], x[2 + (k + 1) % 3]
        if closest_points(pair, False, c) <= least:
            return c[1]
    return -1.0
