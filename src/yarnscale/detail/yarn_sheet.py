"""Yarns laid on a mesh with material coordinates, as a sheet that can be simulated yarn by yarn.

``YarnDetail`` places the vertices; frames rotate with the surface, by the rotation nearest to its gradient.
Yarns keep the rest lengths of the pattern, so that a stretched mesh stretches them.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial import KDTree

from yarnscale.arrays import Array
from yarnscale.cell.equilibrium import Equilibrium
from yarnscale.cell.periodic import PeriodicCell
from yarnscale.detail.fluctuations import FluctuationTable
from yarnscale.detail.tiling import YarnLayout
from yarnscale.detail.yarns import YarnDetail
from yarnscale.errors import InputError
from yarnscale.fabric.boundary import SEWN, SEWN_WIDTH, glue
from yarnscale.fabric.rod_fabric import RodFabric
from yarnscale.fabric.sheet import LARGEST_SHEET, YarnSheet
from yarnscale.shell.mesh import TriangleMesh
from yarnscale.yarn.frames import unit
from yarnscale.yarn.pattern import YarnPattern
from yarnscale.yarn.stiffness import Materials, materials_of


@dataclass(frozen=True, eq=False)
class SheetOnMesh:
    """A sheet, the mesh's normal at each of its vertices (n, 3), and their distance from a border or seam (n,) [m]."""

    sheet: YarnSheet
    normals: Array
    border_distance: Array


def sheet_on_mesh(
    pattern: YarnPattern, mesh: TriangleMesh, *, state: Equilibrium | None = None, positions: Array | None = None
) -> SheetOnMesh:
    """The pattern over every panel of a mesh, its loops as in a cell's equilibrium without strain (default: as drawn).

    positions: of the mesh's vertices (nv, 3) [m], by default as assembled. Raises InputError if no yarn fits or the
    cloth is too large for its yarns.
    """
    detail = YarnDetail.of(_one_state(pattern, state), mesh, seams="cut")
    layout, vertex = detail.layout, detail.layout.vertex
    if layout.vertex_count > LARGEST_SHEET:
        raise InputError("yarns on the mesh", expected=f"at most {LARGEST_SHEET} vertices", found=layout.vertex_count)
    positions = mesh.assembled if positions is None else np.asarray(positions, np.float64)
    places = detail.curves(positions)
    tile = np.round((layout.material - pattern.vertices[vertex, :2]) / pattern.period).astype(np.int64)
    sheet = replace(
        YarnSheet.of_vertices(pattern, vertex, tile, layout.offsets, layout.closed),
        area=float(mesh.areas.sum()),
        name=f"{pattern.name} on a mesh",
    )
    rotations = _rotations(detail, positions)
    tangents = unit(pattern.edge_vectors()[vertex])
    twist = None if state is None else state.twist[vertex]
    laid = sheet.moved(places, twist=twist, rotations=rotations, tangents=tangents)
    return SheetOnMesh(laid, rotations[:, :, 2], _border_distance(mesh, layout, pattern.radius))


def rods_on_mesh(pattern: YarnPattern, material: Materials, mesh: TriangleMesh, *, relax: bool = True) -> RodFabric:
    """``sheet_on_mesh`` with its borders and seams glued firmly.

    relax: loops have the shape of the relaxed periodic cell, else that of the pattern. Raises InputError.
    """
    state = PeriodicCell(pattern, material).relax() if relax else None
    laid = sheet_on_mesh(pattern, mesh, state=state)
    springs = glue(
        laid.sheet, materials_of(pattern, material)[0], width=SEWN_WIDTH * pattern.radius, stiffness=SEWN,
        distance=laid.border_distance, normals=laid.normals,
    )  # fmt: skip
    return RodFabric(laid.sheet, material, springs)


def _one_state(pattern: YarnPattern, state: Equilibrium | None) -> FluctuationTable:
    """A table with one shape of the pattern."""
    zero = np.zeros(1)
    values = np.zeros((1, 1, 1, 3, len(pattern.edges), 3))
    if state is not None:
        values[0, 0, 0, 0] = state.fluctuation
    return FluctuationTable(pattern, (zero, zero, zero, zero, zero), values)


def _rotations(detail: YarnDetail, positions: Array) -> Array:
    """Rotation of the surface at every yarn vertex (n, 3, 3), nearest to its gradient; the last column: normal."""
    layout = detail.layout
    gradient = detail.surface.forms(positions)[0]
    corners = gradient[detail.mesh.corners[layout.triangle]]
    slopes = np.einsum("nk,nkai->nia", layout.place, corners)
    left, _, right = np.linalg.svd(slopes, full_matrices=False)
    plane = left @ right
    return np.concatenate([plane, np.cross(plane[:, :, 0], plane[:, :, 1])[:, :, None]], axis=2)


def _border_distance(mesh: TriangleMesh, layout: YarnLayout, spacing: float) -> Array:
    """Distance of every yarn vertex from the nearest edge of its panel, in the fabric (n,) [m]."""
    open_edges = ~mesh.has_neighbour | mesh.seams
    tails, heads = mesh.corners[open_edges], np.roll(mesh.corners, -1, axis=1)[open_edges]
    panels = mesh.panel_numbers[tails]
    distance = np.full(layout.vertex_count, np.inf)
    for panel in np.unique(panels):
        here = panels == panel
        start, end = mesh.material[tails[here]], mesh.material[heads[here]]
        pieces = max(1, int(np.ceil(float(np.linalg.norm(end - start, axis=1).max()) / spacing)))
        along = np.linspace(0.0, 1.0, pieces + 1)[:, None, None]
        points = (start + along * (end - start)).reshape(-1, 2)
        chosen = layout.panel == panel
        distance[chosen] = KDTree(points).query(layout.material[chosen])[0]
    return distance
