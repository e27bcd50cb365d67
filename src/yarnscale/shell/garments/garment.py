"""Garments: panels sewn together along edges and assembled in space."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from yarnscale.arrays import Array, Integers
from yarnscale.errors import InputError
from yarnscale.shell.garments.panels import Panel
from yarnscale.shell.mesh import TriangleMesh
from yarnscale.shell.mesh_arrays import joined

_ROOM = 0.02
"""Distance between panels in the fabric [m]."""


@dataclass(frozen=True)
class Seam:
    """Two edges sewn together: (panel, edge) and (panel, edge), of equal division.

    Seen from the right side one edge runs forwards and the other backwards, so that both panels show the same side.
    rest_angle: fold angle of the seam at rest [rad], positive if the right side is on the outside.
    """

    first: tuple[str, str]
    second: tuple[str, str]
    rest_angle: float = 0.0


@dataclass(frozen=True, eq=False)
class Garment:
    """Sewn panels: the mesh, names of the panels as ``mesh.panel_numbers`` counts them, and vertices of every edge.

    edges: "panel.edge" → vertices along it.
    """

    name: str
    mesh: TriangleMesh
    panels: tuple[str, ...]
    edges: Mapping[str, Integers]


def sew(name: str, panels: Sequence[Panel], seams: Sequence[Seam], positions: Mapping[str, Array]) -> Garment:
    """Join panels along seams.

    positions: initial positions of the points of each panel, panel name → (n, 3) [m]; points joined by a seam start
    at their mean. In material coordinates panels do not overlap. Raises InputError.
    """
    by_name = {panel.name: k for k, panel in enumerate(panels)}
    if len(by_name) < len(panels):
        raise InputError(f"panels of '{name}'", expected="different names", found=[p.name for p in panels])
    starts = np.cumsum([0, *(len(panel.points) for panel in panels)])

    def chain(side: tuple[str, str]) -> Integers:
        if side[0] not in by_name:
            raise InputError(f"panel '{side[0]}' of a seam", expected=" or ".join(by_name), found="no such panel")
        number = by_name[side[0]]
        return panels[number].edge(side[1]) + starts[number]

    pairs = [np.zeros((0, 2), np.int64)]
    for seam in seams:
        one, two = chain(seam.first), chain(seam.second)[::-1]
        if len(one) != len(two):
            raise InputError(
                f"seam of '{'.'.join(seam.first)}' and '{'.'.join(seam.second)}'",
                expected="edges of equal division",
                found=f"{len(one) - 1} and {len(two) - 1} segments",
            )
        pairs.append(np.column_stack([one, two]))
    vertices = joined(np.concatenate(pairs), int(starts[-1]))
    for panel in panels:
        wanted, found = (len(panel.points), 3), np.shape(positions.get(panel.name, ()))
        if found != wanted:
            raise InputError(f"positions of panel '{panel.name}'", expected=f"shape {wanted}", found=found)
    places = np.concatenate([positions[panel.name] for panel in panels])
    count = np.bincount(vertices)
    assembled = np.column_stack([np.bincount(vertices, places[:, k]) / count for k in range(3)])
    corners = np.concatenate([p.triangles + s for p, s in zip(panels, starts, strict=False)])
    grain = np.concatenate([np.full(len(panel.points), panel.grain) for panel in panels])
    folds = _folds(
        vertices[corners],
        [(vertices[pair[:, 0]], seam.rest_angle) for seam, pair in zip(seams, pairs[1:], strict=True)],
    )
    mesh = TriangleMesh(_laid_out(panels), vertices[corners], grain, corners, assembled, folds)
    edges = {
        f"{panel.name}.{edge}": vertices[points + start]
        for panel, start in zip(panels, starts, strict=False)
        for edge, points in panel.edges.items()
    }
    return Garment(name, mesh, tuple(by_name), edges)


def _folds(triangles: Integers, seams: Sequence[tuple[Integers, float]]) -> Array:
    """Angles at rest of all edges of triangles (nt, 3), from vertices along seams and the angles of these."""
    ends = np.sort(np.stack([triangles, np.roll(triangles, -1, axis=1)], axis=-1), axis=-1)
    keys = ends[..., 0] * (int(triangles.max()) + 1) + ends[..., 1]
    folds = np.zeros(triangles.shape)
    for chain, angle in seams:
        sides = np.sort(np.stack([chain[:-1], chain[1:]], axis=-1), axis=-1)
        folds[np.isin(keys, sides[:, 0] * (int(triangles.max()) + 1) + sides[:, 1])] = angle
    return folds


def _laid_out(panels: Sequence[Panel]) -> Array:
    """Material points of all panels (n, 2), each turned by its grain, side by side."""
    parts, right = [], 0.0
    for panel in panels:
        c, s = np.cos(panel.grain), np.sin(panel.grain)
        turned = panel.points @ np.array([[c, -s], [s, c]])
        low = turned.min(axis=0)
        parts.append(turned - low + [right, 0.0])
        right = float(parts[-1][:, 0].max()) + _ROOM
    return np.concatenate(parts)
