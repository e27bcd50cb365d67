"""Arrays of a triangle mesh, their checks, and neighbours of triangles."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from yarnscale.arrays import Array, Flags, Integers
from yarnscale.errors import InputError


class MeshError(InputError):
    """A triangle mesh that is no oriented manifold.

    kind, vertices: the faulty part, as "edge" and its two vertices; triangle: number of the triangle there.
    """

    def __init__(
        self, kind: str, *, triangle: int, vertices: tuple[int, ...] = (), expected: object, found: object
    ) -> None:
        self.kind, self.triangle, self.vertices = kind, triangle, vertices
        names = "-".join(map(str, vertices or (triangle,)))
        super().__init__(f"{kind} {names}", expected=expected, found=found)

    def worded(self, names: Integers) -> str:
        """The message with other names (nv,) of the vertices."""
        return f"{self.kind} {'-'.join(str(names[v]) for v in self.vertices)}"


def checked_material(material: ArrayLike, grain: float | Array) -> tuple[Array, float | Array]:
    """Points (n, 2) [m] and the angle of the grain, of all or of each (n,) [rad]."""
    points = np.ascontiguousarray(material, dtype=np.float64)
    if points.ndim != 2 or points.shape[1] != 2 or len(points) < 6:
        raise InputError("material coordinates", expected="shape (6 or more, 2)", found=points.shape)
    if not np.isfinite(points).all():
        row = int(np.flatnonzero(~np.isfinite(points).all(axis=1))[0])
        raise InputError("material coordinates", expected="finite numbers", found=f"{points[row]} at vertex {row}")
    angles = np.asarray(grain, dtype=np.float64)
    if angles.shape not in ((), (len(points),)) or not np.isfinite(angles).all():
        raise InputError("grain", expected=f"a finite angle [rad] or {len(points)} of them", found=angles.shape)
    return points, float(angles) if angles.ndim == 0 else angles


def checked_corners(corners: ArrayLike, count: int) -> Integers:
    """Triangles as indices of ``count`` points, each used."""
    array = np.asarray(corners)
    if array.ndim != 2 or array.shape[1] != 3 or not len(array):
        raise InputError("triangles", expected="shape (1 or more, 3)", found=array.shape)
    if not np.issubdtype(array.dtype, np.integer):
        raise InputError("triangles", expected="integers", found=array.dtype)
    array = np.ascontiguousarray(array, dtype=np.int64)
    bad = (array < 0) | (array >= count)
    if bad.any():
        row = int(np.flatnonzero(bad.any(axis=1))[0])
        raise InputError(f"triangle {row}", expected=f"vertices 0..{count - 1}", found=array[row])
    unused = np.flatnonzero(np.bincount(array.ravel(), minlength=count) == 0)
    if len(unused):
        raise InputError("triangles", expected="every vertex used", found=f"vertex {unused[0]} is not")
    return array


def checked_triangles(triangles: ArrayLike, corners: Integers) -> Integers:
    """Vertices in space of every corner."""
    array = np.asarray(triangles)
    if array.shape != corners.shape:
        raise InputError("corners", expected=f"one per corner, shape {array.shape}", found=corners.shape)
    return checked_corners(array, int(array.max()) + 1 if array.size else 0)


def vertices_of_points(triangles: Integers, corners: Integers, count: int) -> Integers:
    """The vertex in space of each of ``count`` material points, (count,)."""
    vertices = np.empty(count, np.int64)
    vertices[corners] = triangles
    torn = vertices[corners] != triangles
    if torn.any():
        row, k = np.argwhere(torn)[0]
        raise InputError(
            f"material point {corners[row, k]}",
            expected="one vertex in space",
            found=f"vertices {vertices[corners[row, k]]} and {triangles[row, k]}",
        )
    return vertices


def rest_edges(points: Array) -> tuple[Array, Array]:
    """Matrices (nt, 2, 2) with columns X1 − X0, X2 − X0 and areas (nt,) of triangles (nt, 3, 2)."""
    edges = np.stack([points[:, 1] - points[:, 0], points[:, 2] - points[:, 0]], axis=2)
    areas = 0.5 * (edges[:, 0, 0] * edges[:, 1, 1] - edges[:, 0, 1] * edges[:, 1, 0])
    flat = areas <= 1e-9 * np.abs(edges).max(axis=(1, 2)) ** 2
    if flat.any():
        worst = int(np.flatnonzero(flat)[0])
        raise InputError(
            f"triangle {worst}",
            expected="counter-clockwise vertices and a positive area",
            found=f"area {areas[worst]:g} m²",
        )
    return edges, areas


def checked_positions(assembled: ArrayLike, panel: Array, point_vertices: Integers) -> Array:
    """Positions in space, (nv, 3); default: those of the flat panel."""
    count = int(point_vertices.max()) + 1
    positions = np.ascontiguousarray(assembled, dtype=np.float64)
    if len(positions) == 0:
        if len(panel) > count:
            raise InputError("assembled positions", expected="given with seams", found="none")
        positions = np.zeros((count, 3))
        positions[point_vertices, :2] = panel
    if positions.shape != (count, 3) or not np.isfinite(positions).all():
        raise InputError("assembled positions", expected=f"finite, shape ({count}, 3)", found=positions.shape)
    return positions


def checked_angles(angles: ArrayLike, count: int) -> Array:
    """Fold angles at rest, (nt, 3), zero where none are given."""
    array = np.ascontiguousarray(angles, dtype=np.float64)
    if len(array) == 0:
        return np.zeros((count, 3))
    if array.shape != (count, 3):
        raise InputError("fold angles at rest", expected=f"shape ({count}, 3)", found=array.shape)
    wrong = array[~(np.abs(array) < math.pi)]
    if len(wrong):
        raise InputError("fold angles at rest", expected="between -pi and pi [rad]", found=float(wrong[0]))
    return array


def joined(pairs: Integers, count: int) -> Integers:
    """Group (count,) of each of ``count`` things when the two of every pair (n, 2) are in one."""
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    graph = coo_matrix((np.ones(len(pairs)), pairs.T), shape=(count, count))
    return connected_components(graph, directed=False)[1].astype(np.int64)


def twin_edges(triangles: Integers, vertex_count: int) -> Integers:
    """The opposite of every directed edge 3·triangle + k, −1 if there is none, (nt, 3)."""
    tail, head = triangles.ravel(), np.roll(triangles, -1, axis=1).ravel()
    key = tail * vertex_count + head
    order = np.argsort(key, kind="stable")
    repeated = np.flatnonzero(np.diff(key[order]) == 0)
    if len(repeated):
        edge = int(order[repeated[0] + 1])
        raise MeshError(
            "edge", triangle=edge // 3, vertices=(int(tail[edge]), int(head[edge])),
            expected="one triangle on each side",
            found="two triangles on the same side (or of opposite orientation)",
        )  # fmt: skip
    twin = head * vertex_count + tail
    place = np.minimum(np.searchsorted(key[order], twin), len(key) - 1)
    return np.where(key[order][place] == twin, order[place], -1).reshape(-1, 3)


def triangle_stencils(triangles: Integers, vertex_count: int) -> tuple[Integers, Flags]:
    """Stencils (nt, 6) and neighbour flags (nt, 3); each directed edge may belong to one triangle."""
    twins = twin_edges(triangles, vertex_count)
    opposite = np.roll(triangles, -2, axis=1).ravel()
    found = twins >= 0
    across = np.where(found, opposite[twins], -1)
    _check_distinct(triangles, across)
    stencils = np.concatenate([triangles, across], axis=1)
    for row in np.flatnonzero((across < 0).any(axis=1)):
        # Ignored by every user of the stencil; distinct, so that no block of a matrix is met twice.
        spare = (v for v in range(vertex_count) if v not in stencils[row])
        for k in range(3, 6):
            if stencils[row, k] < 0:
                stencils[row, k] = next(spare)
    return np.ascontiguousarray(stencils), found


def _check_distinct(triangles: Integers, across: Integers) -> None:
    """InputError if a stencil contains a vertex twice."""
    for k in range(3):
        same = (across[:, k] >= 0) & (across[:, k] == across[:, (k + 1) % 3])
        if same.any():
            row = int(np.flatnonzero(same)[0])
            raise MeshError(
                "vertex", triangle=row, vertices=(int(triangles[row, (k + 1) % 3]),),
                expected="a free edge or four and more triangles around it",
                found="fewer (flip or split an edge there)",
            )  # fmt: skip
        folded = (across[:, k] >= 0) & (across[:, k] == triangles[:, (k + 2) % 3])
        if folded.any():
            row = int(np.flatnonzero(folded)[0])
            raise MeshError(
                "triangle", triangle=row, expected="no other of the same vertices", found="one sewn onto it"
            )
