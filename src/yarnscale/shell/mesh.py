"""Triangle meshes of cloth: material points, triangles in space and their six-vertex stencils.

Where panels are sewn together, triangles are neighbours in space while each keeps its own place and direction in the
fabric: the stencil takes vertices of the neighbours, the fundamental forms only the triangle's own material frame.

The builders lay rows of nearly equilateral triangles. On such a mesh the averaged shape operator of
``shell.strain`` is exact for constant curvature and has no preferred diagonal.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike

from yarnscale.arrays import Array, Flags, Integers
from yarnscale.errors import InputError, positive
from yarnscale.shell.mesh_arrays import (
    checked_angles,
    checked_corners,
    checked_material,
    checked_positions,
    checked_triangles,
    joined,
    rest_edges,
    triangle_stencils,
    twin_edges,
    vertices_of_points,
)


@dataclass(frozen=True, eq=False)
class TriangleMesh:
    """Cloth cut into triangles: one flat panel, or panels sewn together.

    material: points in the fabric's frame (course, wale) [m], shape (nm, 2).
    triangles: vertices in space of every triangle, shape (nt, 3), counter-clockwise seen from the fabric's right side.
    grain: angle [rad] from the panel's x-axis to the fabric's course direction, one number or one per material
    point; ``panel`` is the shape as cut.
    corners: material points of the triangles' corners, shape (nt, 3); empty where every vertex has one material
    point of its own number. On a seam a vertex has several: neighbours in space, apart in the fabric.
    assembled: positions of the vertices [m], shape (nv, 3), with the panels sewn and without loads; empty:
    the panel as cut in the plane z = 0.
    rest_angles: fold angles at rest [rad] of edges v0v1, v1v2, v2v0 of every triangle, shape (nt, 3),
    positive if the right side is on the outside; empty: flat everywhere.
    lines: line of each triangle in its file, shape (nt,); empty without a file.

    Derived: ``stencils`` (nt, 6) = (v0, v1, v2, then the vertices opposite to edges v0v1, v1v2, v2v0 in the
    neighbouring triangles, across seams too); ``has_neighbour`` (nt, 3). Without a neighbour the stencil
    holds some vertex that differs from the five others; it must be ignored. ``inverse_rest`` (nt, 2, 2) is the
    inverse of the matrix with columns X1 − X0, X2 − X0 [1/m]; ``areas`` (nt,) [m²]; ``point_vertices`` (nm,) the
    vertex of every material point.

    Raises InputError for meshes other than oriented manifolds of at least six vertices.
    """

    def __repr__(self) -> str:
        size = " × ".join(f"{extent:.3g}" for extent in np.ptp(self.panel, axis=0))
        counts = f"{self.vertex_count} vertices, {len(self.triangles)} triangles"
        return f"TriangleMesh({counts}, {size} m, {self.areas.sum():.3g} m²)"

    material: Array
    triangles: Integers
    grain: float | Array = 0.0
    corners: Integers = field(default_factory=lambda: np.zeros((0, 3), np.int64))
    assembled: Array = field(default_factory=lambda: np.zeros((0, 3)))
    rest_angles: Array = field(default_factory=lambda: np.zeros((0, 3)))
    lines: Integers = field(default_factory=lambda: np.zeros(0, np.int64))
    stencils: Integers = field(init=False, repr=False)
    has_neighbour: Flags = field(init=False, repr=False)
    inverse_rest: Array = field(init=False, repr=False)
    areas: Array = field(init=False, repr=False)
    point_vertices: Integers = field(init=False, repr=False)

    def __post_init__(self) -> None:
        material, grain = checked_material(self.material, self.grain)
        own = len(self.corners) == 0
        corners = checked_corners(self.triangles if own else self.corners, len(material))
        triangles = corners if own else checked_triangles(self.triangles, corners)
        point_vertices = vertices_of_points(triangles, corners, len(material))
        edges, areas = rest_edges(material[corners])
        panel = _turned(material, grain)
        assembled = checked_positions(self.assembled, panel, point_vertices)
        stencils, has_neighbour = triangle_stencils(triangles, len(assembled))
        rest_angles = checked_angles(self.rest_angles, len(triangles))
        derived = {
            "material": material,
            "triangles": triangles,
            "grain": grain,
            "corners": corners,
            "assembled": assembled,
            "rest_angles": rest_angles,
            "stencils": stencils,
            "has_neighbour": has_neighbour,
            "inverse_rest": np.linalg.inv(edges),
            "areas": areas,
            "point_vertices": point_vertices,
        }
        for name, value in derived.items():
            object.__setattr__(self, name, value)

    @property
    def vertex_count(self) -> int:
        """Number of vertices in space."""
        return len(self.assembled)

    @property
    def has_seams(self) -> bool:
        """Whether some vertex has more than one material point."""
        return len(self.material) > self.vertex_count

    @property
    def panel(self) -> Array:
        """Coordinates of the panels as cut [m], shape (nm, 2): the material frame turned by ``grain``."""
        return _turned(self.material, self.grain)

    @property
    def vertex_areas(self) -> Array:
        """A third of the adjoining triangles' area per vertex [m²], shape (nv,)."""
        shares = np.repeat(self.areas / 3.0, 3)
        sums = np.bincount(self.triangles.ravel(), shares, minlength=self.vertex_count)
        return sums.astype(np.float64)

    @property
    def median_edge(self) -> float:
        """Median length of the sides of the triangles in the fabric [m]."""
        sides = self.material[self.corners] - self.material[np.roll(self.corners, 1, axis=1)]
        return float(np.median(np.linalg.norm(sides, axis=2)))

    @property
    def edges(self) -> Integers:
        """Every edge in space once, shape (ne, 2), smaller index first."""
        pairs = np.concatenate([self.triangles[:, [k, (k + 1) % 3]] for k in range(3)])
        return np.unique(np.sort(pairs, axis=1), axis=0)

    @property
    def seams(self) -> Flags:
        """Whether an edge of a triangle is sewn to another part of the fabric, shape (nt, 3), order as stencils."""
        material_neighbour = twin_edges(self.corners, len(self.material)) >= 0
        return self.has_neighbour & ~material_neighbour

    @property
    def sewn_edges(self) -> Integers:
        """Material points of every edge on a seam, from either side, shape (m, 4).

        Start and end with the panel on the left, and the points of the other panel at the same two vertices.
        """
        twins = twin_edges(self.triangles, self.vertex_count).ravel()
        edges = np.flatnonzero(self.seams.ravel())
        tails, heads = self.corners.ravel(), np.roll(self.corners, -1, axis=1).ravel()
        return np.column_stack([tails[edges], heads[edges], heads[twins[edges]], tails[twins[edges]]])

    @property
    def panel_numbers(self) -> Integers:
        """Number of the panel (connected piece of fabric) of every material point, shape (nm,)."""
        return joined(self.corners[:, [0, 1, 1, 2]].reshape(-1, 2), len(self.material))

    def nearest_vertex(self, point: ArrayLike) -> int:
        """The vertex nearest to a point of the panels as cut [m]."""
        nearest = np.argmin(np.linalg.norm(self.panel - np.asarray(point, float), axis=1))
        return int(self.point_vertices[nearest])

    def with_grain(self, angle: float) -> TriangleMesh:
        """The same panels cut with the course direction at ``angle`` [rad] to the panel's x."""
        material = _turned(self.panel, -angle)
        return replace(self, material=material, grain=angle)

    def with_seam_angle(self, angle: float) -> TriangleMesh:
        """The same mesh with all seams folded by an angle [rad] at rest; see ``rest_angles``."""
        return replace(self, rest_angles=np.where(self.seams, angle, self.rest_angles))


def rectangle(
    width: float,
    height: float,
    spacing: float,
    *,
    grain: float = 0.0,
    finer_edges: float = 0.0,
    irregularity: float = 0.0,
    seed: int = 0,
) -> TriangleMesh:
    """Rectangular panel centred on the origin, in rows of nearly equilateral triangles.

    width, height: extents along x and y [m]; spacing: desired edge length [m].
    grain: angle of the fabric's course direction [rad]; finer_edges: how much closer rows and columns are at all
    edges, where knits curl, as a fraction of the spacing (up to 0.7; the middle is coarser by up to 0.57 of that).
    irregularity: random shift of inner vertices as a fraction of the spacing (below 0.3), to test how much a result
    depends on the mesh.

    Raises InputError for sizes that are not positive or too small for the spacing.
    """
    _check_sizes(width=width, height=height, spacing=spacing)
    if not 0 <= irregularity < 0.3:
        raise InputError("irregularity", expected="between 0 and 0.3", found=irregularity)
    if not 0 <= finer_edges <= 0.7:
        raise InputError("finer_edges", expected="between 0 and 0.7", found=finer_edges)
    columns = max(2, round(width / spacing))
    # An even number of rows makes the mesh symmetric about both axes.
    rows = max(2, 2 * round(height / (spacing * math.sqrt(3))))
    step = width / columns
    even = np.arange(columns + 1) * step
    odd = np.concatenate([[0.0], (np.arange(columns) + 0.5) * step, [width]])
    lines, starts, vertices = [], [], 0
    for row in range(rows + 1):
        x = odd if row % 2 else even
        starts.append(vertices)
        vertices += len(x)
        lines.append(np.column_stack([x, np.full(len(x), row * height / rows)]))
    points = np.concatenate(lines) - [width / 2, height / 2]
    triangles = np.concatenate([_row_triangles(row, starts, columns) for row in range(rows)])
    if irregularity:
        inner = (np.abs(points) < np.array([width, height]) / 2 - 1e-9 * spacing).all(axis=1)
        shift = np.random.default_rng(seed).uniform(-1, 1, points.shape) * irregularity * step
        points[inner] += shift[inner]
    if finer_edges:
        # Its derivative by t = point/half falls from 1 + 0.57 finer_edges in the middle to 1 − finer_edges.
        half = np.array([width, height]) / 2
        points = (1 - finer_edges) * points + finer_edges * half * np.sin(0.5 * math.pi * points / half)
    return TriangleMesh(_turned(points, -grain), triangles, grain)


def disk(radius: float, spacing: float, *, grain: float = 0.0) -> TriangleMesh:
    """Round panel centred on the origin: rings of six more vertices each.

    radius, spacing: [m]; grain: angle of the fabric's course direction [rad]. Raises InputError.
    """
    _check_sizes(radius=radius, spacing=spacing)
    rings = max(2, round(radius / spacing))
    points, triangles, start = [np.zeros((1, 2))], [], [0]
    for ring in range(1, rings + 1):
        angle = np.arange(6 * ring) * (2 * math.pi / (6 * ring))
        points.append(radius * ring / rings * np.column_stack([np.cos(angle), np.sin(angle)]))
        start.append(1 + 3 * ring * (ring - 1))
        for sector in range(6):
            for k in range(ring):
                outer = [start[ring] + (sector * ring + k + i) % (6 * ring) for i in (0, 1)]
                inner = [start[ring - 1] + (sector * (ring - 1) + k + i) % max(6 * (ring - 1), 1) for i in (0, 1)]
                triangles.append([inner[0], outer[0], outer[1]])
                if k < ring - 1:
                    triangles.append([inner[0], outer[1], inner[1]])
    coordinates = np.concatenate(points)
    return TriangleMesh(_turned(coordinates, -grain), np.array(triangles), grain)


def _turned(points: Array, angle: float | Array) -> Array:
    """Points (n, 2) turned by an angle or by one angle each [rad]."""
    c, s = np.cos(angle), np.sin(angle)
    x, y = points.T
    return np.column_stack([c * x - s * y, s * x + c * y])


def _check_sizes(**sizes: float) -> None:
    for name, value in sizes.items():
        positive(name, value, "a positive length [m]")
    spacing = sizes["spacing"]
    for name, value in sizes.items():
        if value < spacing:
            raise InputError(name, expected=f"at least the spacing {spacing:g} m", found=value)
        if value > 2000 * spacing:
            raise InputError("spacing", expected=f"at least {name}/2000 = {value / 2000:g} m", found=spacing)


def _row_triangles(row: int, starts: list[int], columns: int) -> Integers:
    """Triangles between lines ``row`` and ``row + 1``; odd lines are shifted by half a spacing."""
    lower, upper = starts[row], starts[row + 1]
    k = np.arange(columns)
    if row % 2 == 0:
        upright = np.column_stack([lower + k, lower + k + 1, upper + k + 1])
        k = np.arange(columns + 1)
        inverted = np.column_stack([lower + k, upper + k + 1, upper + k])
    else:
        inverted = np.column_stack([lower + k + 1, upper + k + 1, upper + k])
        k = np.arange(columns + 1)
        upright = np.column_stack([lower + k, lower + k + 1, upper + k])
    return np.concatenate([upright, inverted])
