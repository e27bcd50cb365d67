"""Crossings of surfaces: triangles and objects, place, number."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import ipctk
import numpy as np
from numpy.typing import NDArray

from yarnscale.errors import InputError

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

CLOTH = -1
"""Number of the cloth among the objects."""
_TOUCHING = 1e-9
"""Distance between vertices that counts as zero, over the size of the whole."""


@dataclass(frozen=True)
class Crossing:
    """Two objects that cross.

    body: number of the obstacle, or ``CLOTH`` if the cloth crosses itself; description: triangles, place and
    number; remedy: advice for the user. triangles: those of the cloth that the description names.
    """

    body: int
    description: str
    remedy: str
    triangles: tuple[int, ...] = ()


def start_that_crosses(found: Sequence[Crossing], lines: Integers) -> InputError:
    """The error of a start with these crossings; lines: of the cloth's triangles in their file, if any."""
    told = "; ".join(c.description + _in_file(lines, c.triangles) for c in found) or "some that do"
    remedies = "; ".join(dict.fromkeys(c.remedy for c in found))
    return InputError(
        "start of the cloth",
        expected="surfaces that do not cross",
        found=f"{told}. {remedies[:1].upper()}{remedies[1:]}" if found else told,
    )


def _in_file(lines: Integers, triangles: Sequence[int]) -> str:
    """Lines of the cloth's file that triangles come from, where there is one."""
    if not (len(lines) and triangles):
        return ""
    return f" (line{'s' * (len(triangles) > 1)} {' and '.join(str(lines[t]) for t in triangles)} of its file)"


def surface_crossings(
    positions: Floats, triangles: Integers, owners: Integers, names: Sequence[str], *, within_cloth: bool
) -> list[Crossing]:
    """Crossings of triangles (m, 3) of the cloth with each other, if wanted, and with those of bodies.

    owners: object of each triangle (m,), increasing from ``CLOTH``; names: of the bodies.
    """
    pairs, places = _crossing_triangles(positions, triangles, owners, within_cloth=within_cloth)
    found = []
    for body in np.unique(owners[pairs[:, 1]]).tolist():
        chosen = owners[pairs[:, 1]] == body
        one, two = pairs[chosen][0]
        count, where = int(chosen.sum()), _place(places[chosen][0])
        number = "their only pair" if count == 1 else f"one of {count} pairs"
        if body == CLOTH:
            remedy = "move one of the layers, or set [contact] self_contact = false"
            if _doubled(positions, triangles[pairs[chosen]]):
                remedy = f"sew vertices at the same place (weld), {remedy}"
            text = f"triangles {one} and {two} of the cloth at {where}, {number}"
            found.append(Crossing(body, text, remedy, (int(one), int(two))))
        else:
            two -= int(np.searchsorted(owners, body))
            text = f"triangle {one} of the cloth and triangle {two} of {names[body]} at {where}, {number}"
            found.append(Crossing(body, text, f"move the cloth or {names[body]}", (int(one),)))
    return found


def shape_crossing(
    body: int, name: str, kind: str, distances: Floats, places: Floats, count: int
) -> Crossing:
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
    return Crossing(body, text, remedy)


def _place(point: Floats) -> str:
    return "({:.4g}, {:.4g}, {:.4g}) m".format(*(point + 0.0))


def _doubled(positions: Floats, pairs: Integers) -> bool:
    """Whether triangles that cross (n, 2, 3) have different vertices at the same place."""
    near = np.linalg.norm(positions[pairs[:, 0, :, None]] - positions[pairs[:, 1, None, :]], axis=3)
    return bool((near <= _TOUCHING * float(np.ptp(positions, axis=0).max())).any())


def _crossing_triangles(
    positions: Floats, triangles: Integers, owners: Integers, *, within_cloth: bool
) -> tuple[Integers, Floats]:
    """Pairs of triangles (n, 2) that cross, the cloth's first, each once, and a place of each (n, 3)."""
    faces = np.asfortranarray(triangles.astype(np.int32))
    edges = ipctk.edges(faces)
    search = ipctk.LBVH()
    search.build(np.asfortranarray(positions), edges, faces)
    around = _triangles_of_edges(triangles, edges)
    found: dict[tuple[int, int], Floats] = {}
    for near in search.detect_edge_face_candidates():
        edge, face = edges[near.edge_id], triangles[near.face_id]
        one, two = around[near.edge_id][0], near.face_id
        kinds = sorted((owners[one], owners[two]))
        if kinds[0] != CLOTH or (kinds[1] == CLOTH and not within_cloth) or np.isin(edge, face).any():
            continue
        ends = positions[edge]
        crosses, _, _, along = ipctk.edge_triangle_intersection(*ends, *positions[face])
        if crosses:
            share = along if np.isfinite(along) else 0.5
            for one in around[near.edge_id]:
                pair = (one, two) if (owners[one], one) < (owners[two], two) else (two, one)
                found.setdefault(pair, ends[0] + share * (ends[1] - ends[0]))
    pairs = sorted(found)
    return np.array(pairs, np.int64).reshape(-1, 2), np.array([found[p] for p in pairs]).reshape(-1, 3)


def _triangles_of_edges(triangles: Integers, edges: NDArray[np.int32]) -> list[list[int]]:
    """Triangles at each edge."""
    number = {tuple(sorted(edge)): k for k, edge in enumerate(edges.tolist())}
    around: list[list[int]] = [[] for _ in edges]
    for k, (a, b, c) in enumerate(triangles.tolist()):
        for pair in ((a, b), (b, c), (a, c)):
            around[number[(min(pair), max(pair))]].append(k)
    return around
