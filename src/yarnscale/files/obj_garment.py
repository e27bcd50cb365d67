"""Garments from Wavefront OBJ files: positions in space, and where each triangle lies in the fabric.

Two ways are in use: texture coordinates (``vt``) beside the vertices, apart on either side of a seam; or a second file
of the same faces whose vertices are the flat panels (names ending in ``-w`` and ``-m``).
"""

from __future__ import annotations

import os

import numpy as np
from numpy.typing import NDArray

from yarnscale.errors import InputError
from yarnscale.files.obj_surface import ObjSurface, read_obj
from yarnscale.shell.mesh import TriangleMesh

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]


def read_garment(
    path: str | os.PathLike[str],
    *,
    material: str | os.PathLike[str] | None = None,
    scale: float = 1.0,
    material_scale: float = 1.0,
    grain: float = 0.0,
    weld: float = 0.0,
) -> TriangleMesh:
    """A mesh with material points from one OBJ file with texture coordinates, or from two.

    material: file of the flat panels, face by face those of ``path``; without it texture coordinates are taken.
    scale, material_scale: metres per unit of space and of the panels. grain: angle [rad] from the panels' x-axis to
    the fabric's course direction. weld: vertices of different panels within this distance [m] are sewn together.
    A panel drawn with its back up is turned over. Raises InputError with file and line.
    """
    world = read_obj(path)
    if material is None:
        points, corners = _textured(world)
        source = world
    else:
        source = read_obj(material)
        points, corners = _flat(source, world)
    points, corners = _used(material_scale * points, corners)
    positions, triangles = _used(scale * world.vertices, world.triangles)
    if weld > 0:
        positions, triangles = _welded(positions, triangles, weld)
    points, corners = _one_vertex_each(points, corners, triangles)
    points = _face_up(points, corners, source)
    flat = TriangleMesh(points, triangles, 0.0, corners, positions)
    return flat.with_grain(grain) if grain else flat


def _textured(world: ObjSurface) -> tuple[Floats, Integers]:
    bare = np.flatnonzero((world.corners < 0).any(axis=1))
    if len(bare):
        raise InputError(
            "face", where=world.place(int(bare[0])), expected="a texture coordinate at every corner, as in 7/3",
            found="none" if len(world.points) else "none in the whole file",
        )  # fmt: skip
    return world.points, world.corners


def _flat(panels: ObjSurface, world: ObjSurface) -> tuple[Floats, Integers]:
    if len(panels.triangles) != len(world.triangles):
        raise InputError(
            "faces", where=panels.path, expected=f"the {len(world.triangles)} of {world.path.name}",
            found=len(panels.triangles),
        )  # fmt: skip
    heights = panels.vertices[:, 2]
    size = float(np.ptp(panels.vertices[:, :2], axis=0).max())
    if np.ptp(heights) > 1e-6 * size:
        worst = int(np.argmax(np.abs(heights - heights[0])))
        raise InputError(
            f"vertex {worst + 1}",
            where=panels.path,
            expected="flat panels, all of one z",
            found=heights[worst],
        )
    return panels.vertices[:, :2], panels.triangles


def _used(points: Floats, indices: Integers) -> tuple[Floats, Integers]:
    """Only the points that are used, renumbered."""
    used, numbers = np.unique(indices, return_inverse=True)
    return points[used], numbers.reshape(indices.shape).astype(np.int64)


def _welded(positions: Floats, triangles: Integers, distance: float) -> tuple[Floats, Integers]:
    """Vertices within a distance of each other become one."""
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components
    from scipy.spatial import KDTree

    pairs = KDTree(positions).query_pairs(distance, output_type="ndarray").reshape(-1, 2)
    graph = coo_matrix((np.ones(len(pairs)), pairs.T), shape=(len(positions), len(positions)))
    numbers = connected_components(graph, directed=False)[1].astype(np.int64)
    count = np.bincount(numbers)
    joined = np.column_stack([np.bincount(numbers, positions[:, k]) / count for k in range(3)])
    return joined, numbers[triangles]


def _face_up(points: Floats, corners: Integers, source: ObjSurface) -> Floats:
    """Turn over panels whose triangles are all clockwise; an error names the line where one panel is mixed."""
    x = points[corners]
    first, second = x[:, 1] - x[:, 0], x[:, 2] - x[:, 0]
    area = 0.5 * (first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0])
    longest = np.maximum((first**2).sum(axis=1), (second**2).sum(axis=1))
    flat = np.flatnonzero(np.abs(area) <= 1e-9 * longest)
    if len(flat):
        raise InputError(
            "face", where=source.place(int(flat[0])), expected="a triangle with an area in the fabric",
            found=f"area {area[flat[0]]:g} m²",
        )  # fmt: skip
    panel = _connected(corners, len(points))[corners[:, 0]]
    turned = points.copy()
    for number in np.unique(panel):
        mine = np.flatnonzero(panel == number)
        back = area[mine] < 0
        if back.all():
            turned[np.unique(corners[mine]), 0] *= -1.0
        elif back.any():
            odd = mine[back] if back.sum() <= len(mine) / 2 else mine[~back]
            raise InputError(
                "face", where=source.place(int(odd[0])), expected="one orientation in the fabric for a panel",
                found="a triangle turned over",
            )  # fmt: skip
    return turned


def _connected(corners: Integers, count: int) -> Integers:
    """Number of the panel of every point."""
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    pairs = corners[:, [0, 1, 1, 2]].reshape(-1, 2)
    graph = coo_matrix((np.ones(len(pairs)), pairs.T), shape=(count, count))
    return connected_components(graph, directed=False)[1].astype(np.int64)


def _one_vertex_each(points: Floats, corners: Integers, triangles: Integers) -> tuple[Floats, Integers]:
    """Points shared by several vertices (panels that lie on each other in the texture) become several points."""
    both, numbers = np.unique(
        np.column_stack([corners.ravel(), triangles.ravel()]), axis=0, return_inverse=True
    )
    return points[both[:, 0]], numbers.reshape(corners.shape).astype(np.int64)
