"""Triangle meshes of cloth panels: material coordinates, triangles and their six-vertex stencils.

The builders lay rows of nearly equilateral triangles. On such a mesh the averaged shape operator of
``shell.strain`` is exact for constant curvature and has no preferred diagonal.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from yarnscale.errors import InputError

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class TriangleMesh:
    """A flat panel of cloth, cut into triangles.

    material: coordinates in the fabric's frame (course, wale) [m], shape (nv, 2).
    triangles: counter-clockwise vertex indices, shape (nt, 3).
    grain: angle [rad] from the panel's x-axis to the fabric's course direction; ``panel`` is the shape as cut.

    Derived: ``stencils`` (nt, 6) = (v0, v1, v2, then the vertices opposite to edges v0v1, v1v2, v2v0 in the
    neighbouring triangles); ``has_neighbour`` (nt, 3). Where there is no neighbour the stencil still holds a
    vertex that differs from its five others; it must be ignored. ``inverse_rest`` (nt, 2, 2) is the inverse
    of the matrix with columns X1 − X0, X2 − X0 [1/m]; ``areas`` (nt,) [m²].

    Raises InputError on anything that is not an oriented manifold of at least six vertices.
    """

    material: Floats
    triangles: Integers
    grain: float = 0.0
    stencils: Integers = field(init=False, repr=False)
    has_neighbour: NDArray[np.bool_] = field(init=False, repr=False)
    inverse_rest: Floats = field(init=False, repr=False)
    areas: Floats = field(init=False, repr=False)

    def __post_init__(self) -> None:
        material, triangles = _checked_arrays(self.material, self.triangles)
        edges = np.stack(
            [
                material[triangles[:, 1]] - material[triangles[:, 0]],
                material[triangles[:, 2]] - material[triangles[:, 0]],
            ],
            axis=2,
        )
        areas = 0.5 * (edges[:, 0, 0] * edges[:, 1, 1] - edges[:, 0, 1] * edges[:, 1, 0])
        longest = np.abs(edges).max(axis=(1, 2))
        flat = areas <= 1e-9 * longest**2
        if flat.any():
            worst = int(np.flatnonzero(flat)[0])
            raise InputError(
                f"triangle {worst}",
                expected="counter-clockwise vertices and a positive area",
                found=f"area {areas[worst]:g} m²",
            )
        stencils, has_neighbour = _stencils(triangles, len(material))
        derived = {
            "material": material,
            "triangles": triangles,
            "grain": float(self.grain),
            "stencils": stencils,
            "has_neighbour": has_neighbour,
            "inverse_rest": np.linalg.inv(edges),
            "areas": areas,
        }
        for name, value in derived.items():
            object.__setattr__(self, name, value)

    @property
    def vertex_count(self) -> int:
        """Number of vertices."""
        return len(self.material)

    @property
    def panel(self) -> Floats:
        """Coordinates of the panel as cut [m], shape (nv, 2): the material frame turned by ``grain``."""
        return self.material @ _rotation(self.grain).T

    @property
    def vertex_areas(self) -> Floats:
        """A third of the adjoining triangles' area per vertex [m²], shape (nv,)."""
        areas = np.zeros(self.vertex_count)
        np.add.at(areas, self.triangles.ravel(), np.repeat(self.areas / 3, 3))
        return areas

    @property
    def edges(self) -> Integers:
        """Every edge once, shape (ne, 2), smaller index first."""
        pairs = np.concatenate([self.triangles[:, [k, (k + 1) % 3]] for k in range(3)])
        return np.unique(np.sort(pairs, axis=1), axis=0)

    @property
    def boundary_edges(self) -> Integers:
        """Edges of one triangle only, shape (nb, 2), with the panel on their left."""
        pairs = np.stack([self.triangles[:, [k, (k + 1) % 3]] for k in range(3)], axis=1)
        return pairs[~self.has_neighbour]

    def nearest_vertex(self, point: ArrayLike) -> int:
        """Index of the vertex nearest to a point of the panel [m]."""
        return int(np.argmin(np.linalg.norm(self.panel - np.asarray(point, float), axis=1)))

    def with_grain(self, angle: float) -> TriangleMesh:
        """The same panel cut from fabric whose course direction lies at ``angle`` [rad] to the panel's x."""
        return TriangleMesh(self.panel @ _rotation(angle), self.triangles, grain=angle)


def rectangle(
    width: float,
    height: float,
    spacing: float,
    *,
    grain: float = 0.0,
    irregularity: float = 0.0,
    seed: int = 0,
) -> TriangleMesh:
    """Rectangular panel centred on the origin, in rows of nearly equilateral triangles.

    width, height: extents along x and y [m]; spacing: wanted edge length [m].
    grain: angle of the fabric's course direction [rad]; irregularity: random shift of inner vertices as a
    fraction of the spacing (below 0.3), to test how much a result depends on the mesh.

    Raises InputError for sizes that are not positive or too small for the spacing.
    """
    _check_sizes(width=width, height=height, spacing=spacing)
    if not 0 <= irregularity < 0.3:
        raise InputError("irregularity", expected="between 0 and 0.3", found=irregularity)
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
    return TriangleMesh(points @ _rotation(grain), triangles, grain=grain)


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
                inner = [
                    start[ring - 1] + (sector * (ring - 1) + k + i) % max(6 * (ring - 1), 1) for i in (0, 1)
                ]
                triangles.append([inner[0], outer[0], outer[1]])
                if k < ring - 1:
                    triangles.append([inner[0], outer[1], inner[1]])
    coordinates = np.concatenate(points)
    return TriangleMesh(coordinates @ _rotation(grain), np.array(triangles), grain=grain)


def _rotation(angle: float) -> Floats:
    """Matrix with columns = the fabric's course and wale directions in the panel, shape (2, 2)."""
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[c, -s], [s, c]])


def _check_sizes(**sizes: float) -> None:
    for name, value in sizes.items():
        if not (math.isfinite(value) and value > 0):
            raise InputError(name, expected="a positive length [m]", found=value)
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


def _checked_arrays(material: ArrayLike, triangles: ArrayLike) -> tuple[Floats, Integers]:
    points = np.ascontiguousarray(material, dtype=np.float64)
    if points.ndim != 2 or points.shape[1] != 2 or len(points) < 6:
        raise InputError("material coordinates", expected="shape (6 or more, 2)", found=points.shape)
    if not np.isfinite(points).all():
        row = int(np.flatnonzero(~np.isfinite(points).all(axis=1))[0])
        raise InputError(
            "material coordinates", expected="finite numbers", found=f"{points[row]} at vertex {row}"
        )
    corners = np.asarray(triangles)
    if corners.ndim != 2 or corners.shape[1] != 3 or not len(corners):
        raise InputError("triangles", expected="shape (1 or more, 3)", found=corners.shape)
    if not np.issubdtype(corners.dtype, np.integer):
        raise InputError("triangles", expected="integers", found=corners.dtype)
    corners = np.ascontiguousarray(corners, dtype=np.int64)
    bad = (corners < 0) | (corners >= len(points))
    if bad.any():
        row = int(np.flatnonzero(bad.any(axis=1))[0])
        raise InputError(f"triangle {row}", expected=f"vertices 0..{len(points) - 1}", found=corners[row])
    unused = np.flatnonzero(np.bincount(corners.ravel(), minlength=len(points)) == 0)
    if len(unused):
        raise InputError("triangles", expected="every vertex used", found=f"vertex {unused[0]} is not")
    return points, corners


def _stencils(triangles: Integers, vertex_count: int) -> tuple[Integers, NDArray[np.bool_]]:
    """Stencils (nt, 6) and neighbour flags (nt, 3); each directed edge may belong to one triangle."""
    count = len(triangles)
    tail, head = triangles.ravel(), np.roll(triangles, -1, axis=1).ravel()
    opposite = np.roll(triangles, -2, axis=1).ravel()
    key = tail * vertex_count + head
    order = np.argsort(key, kind="stable")
    repeated = np.flatnonzero(np.diff(key[order]) == 0)
    if len(repeated):
        edge = order[repeated[0]]
        raise InputError(
            f"edge {tail[edge]}-{head[edge]}",
            expected="one triangle on each side",
            found="two triangles on the same side (or of opposite orientation)",
        )
    twin = head * vertex_count + tail
    place = np.minimum(np.searchsorted(key[order], twin), len(key) - 1)
    found = key[order][place] == twin
    across = np.where(found, opposite[order[place]], -1).reshape(count, 3)
    stencils = np.concatenate([triangles, across], axis=1)
    for row in np.flatnonzero((across < 0).any(axis=1)):
        # Ignored by every user of the stencil; distinct, so that no block of a matrix is met twice.
        spare = (v for v in range(vertex_count) if v not in stencils[row])
        for k in range(3, 6):
            if stencils[row, k] < 0:
                stencils[row, k] = next(spare)
    return np.ascontiguousarray(stencils), found.reshape(count, 3)
