"""Garments from Wavefront OBJ files: positions in space, and where each polygon lies in the fabric.

Two forms are in use: texture coordinates (``vt``) beside the vertices, apart on either side of a seam; or a second file
of the same faces whose vertices are the flat panels (names ending in ``-w`` and ``-m``).
"""

from __future__ import annotations

import os
from dataclasses import replace

import numpy as np

from yarnscale.arrays import Array, Integers
from yarnscale.errors import InputError, located, notify
from yarnscale.files.garment_units import Areas, Notice, check_ratio, scales
from yarnscale.files.obj_surface import ObjSurface, read_obj
from yarnscale.shell.garments.flips import turned_edges
from yarnscale.shell.garments.polygons import FLAT, areas_of, extent, flatness, in_own_plane, polygon_areas
from yarnscale.shell.garments.weld import Polygons, Weld, continuous, joined, weld
from yarnscale.shell.mesh import TriangleMesh
from yarnscale.shell.mesh_arrays import MeshError


def read_garment(
    path: str | os.PathLike[str],
    *,
    material: str | os.PathLike[str] | None = None,
    unit: str | None = None,
    scale: float | None = None,
    material_scale: float | None = None,
    grain: float = 0.0,
    weld: bool | float | None = None,
    on_notice: Notice = notify,
) -> TriangleMesh:
    """A mesh with material points from one OBJ file with texture coordinates, or from two.

    material: file of the flat panels, face by face those of ``path``; without it texture coordinates are taken.
    unit: of the file's lengths, ``m`` (default), ``cm``, ``mm`` or ``inch``; of those that are not metres already where
    positions and fabric differ. scale, material_scale: metres per unit of space and of the panels instead. grain:
    angle [rad] from the panels' x-axis to the fabric's course direction. weld: True sews coincident
    borders, a number those within this distance [m], False leaves them loose.
    on_notice: called with sentences about what the garment is likely not meant to be.

    A panel drawn with its back up is turned over. Raises InputError with file and line, also for coincident
    borders where ``weld`` is None, and where fabric and cloth differ in size.
    """
    world = read_obj(path)
    if material is None:
        source, points, corners = world, world.points, _textured(world)
    else:
        source = read_obj(material)
        points, corners = _flat(source, world), source.corner_vertices
    cloth = _used(world, points, corners)
    if len(cloth.positions) < 6:
        raise InputError("vertices", where=world.path, expected="6 or more in faces", found=len(cloth.positions))
    flat = in_own_plane(cloth.positions[cloth.vertices], cloth.starts)
    areas = Areas(*(float(np.abs(polygon_areas(x, cloth.starts)).sum()) for x in (flat, points[corners])))
    if not areas.fabric > 0:
        raise InputError("fabric", where=source.path, expected="faces with an area", found="none")
    if not areas.space > FLAT * float((np.ptp(cloth.positions, axis=0) ** 2).sum()):
        raise InputError("cloth in space", where=world.path, expected="faces with an area", found="none")
    with located(path):
        in_space, in_fabric = scales(areas, unit, scale, material_scale)
    cloth = replace(cloth, positions=in_space * cloth.positions, material=in_fabric * cloth.material)
    sizes = f"fabric {extent(cloth.material)}, in space {extent(cloth.positions)}"
    stated = scale is not None and material_scale is not None
    with located(path):
        check_ratio(areas, in_space, in_fabric, sizes, on_notice, stated=stated)
    cloth = _sewn(continuous(_one_vertex_each(cloth)), weld, world, on_notice)
    mesh = _mesh(cloth, world, source, on_notice)
    return mesh.with_grain(grain) if grain else mesh


def _sewn(cloth: Polygons, wanted: bool | float | None, world: ObjSurface, on_notice: Notice) -> Polygons:
    """The cloth with borders sewn as wanted; InputError for coincident borders where nothing is wanted."""
    if wanted is not None and wanted is not False:
        cloth = weld(cloth, None if wanted is True else float(wanted)).cloth
        cloth = continuous(_one_vertex_each(cloth))
    left = weld(cloth)
    if left.closed and wanted is None:
        raise InputError(
            "borders of the cloth", where=world.place(int(cloth.faces[left.place])),
            expected="sewn cloth: weld = true joins them, weld = false leaves them loose",
            found=_described(cloth, left),
        )  # fmt: skip
    if left.closed:
        on_notice(f"borders of the cloth are loose: {_described(cloth, left)}")
    pieces = np.unique(cloth.pieces(), return_counts=True)[1]
    if len(pieces) > 1:
        largest = ", ".join(str(count) for count in np.sort(pieces)[::-1][:5])
        on_notice(
            f"the cloth is {len(pieces)} pieces that nothing joins, of {largest}{' …' * (len(pieces) > 5)} vertices"
        )
    return cloth


def _described(cloth: Polygons, left: Weld) -> str:
    a, b = cloth.vertices[left.place], cloth.vertices[cloth.following[left.place]]
    x, y, z = 0.5 * (cloth.positions[a] + cloth.positions[b])
    pieces = len(np.unique(cloth.pieces()))
    return (
        f"{left.closed} edges that lie on others ({left.split} split vertices, {left.hanging} within an edge), first "
        f"between vertices {cloth.names[a]} and {cloth.names[b]} near ({x:.4g}, {y:.4g}, {z:.4g}) m"
        + (f"; {pieces} loose pieces" if pieces > 1 else "")
    )


def _mesh(cloth: Polygons, world: ObjSurface, source: ObjSurface, on_notice: Notice) -> TriangleMesh:
    """The polygons cut into triangles, in the fabric, where they are what they are."""
    chosen, faces = source.triangulated(cloth.material[cloth.points], cloth.starts)
    corners, triangles = cloth.points[chosen], cloth.vertices[chosen]
    triangles, corners, turned = turned_edges(triangles, corners, cloth.material)
    if turned:
        on_notice(f"{world.path}: {turned} edges were turned where only three triangles met")
    points = _face_up(cloth.material, corners, faces, source)
    try:
        return TriangleMesh(points, triangles, 0.0, corners, cloth.positions, lines=world.lines[faces])
    except MeshError as error:
        what = error.worded(cloth.names) if error.vertices else "face"
        where = world.place(int(faces[error.triangle]))
        raise InputError(what, where=where, expected=error.expected, found=error.found) from None
    except InputError as error:
        raise error.at(world.path) from None


def _textured(world: ObjSurface) -> Integers:
    bare = np.flatnonzero(world.corner_points < 0)
    if len(bare):
        raise InputError(
            "face", where=world.place(int(np.searchsorted(world.starts, bare[0], side="right")) - 1),
            expected="a texture coordinate at every corner, as in 7/3",
            found="none" if len(world.points) else "none in the whole file",
        )  # fmt: skip
    return world.corner_points


def _flat(panels: ObjSurface, world: ObjSurface) -> Array:
    """Vertices of flat panels (n, 2), which have the faces of the cloth in space."""
    counts, wanted = np.diff(panels.starts), np.diff(world.starts)
    if len(counts) != len(wanted):
        raise InputError(
            "faces", where=panels.path, expected=f"the {len(wanted)} of {world.path.name}", found=len(counts)
        )
    if (counts != wanted).any():
        face = int(np.flatnonzero(counts != wanted)[0])
        expected = f"{wanted[face]} corners as in {world.place(face)}"
        raise InputError("face", where=panels.place(face), expected=expected, found=counts[face])
    heights = panels.vertices[:, 2]
    size = float(np.ptp(panels.vertices[:, :2], axis=0).max())
    if np.ptp(heights) > 1e-6 * size:
        worst = int(np.argmax(np.abs(heights - heights[0])))
        raise InputError(
            f"vertex {worst + 1}", where=panels.path, expected="flat panels, all of one z", found=heights[worst]
        )
    return panels.vertices[:, :2]


def _used(world: ObjSurface, points: Array, corners: Integers) -> Polygons:
    """Only the vertices and material points that are used, renumbered."""
    kept, vertices = np.unique(world.corner_vertices, return_inverse=True)
    used, numbers = np.unique(corners, return_inverse=True)
    return Polygons(world.vertices[kept], points[used], world.starts, vertices, numbers, kept + 1)


def _one_vertex_each(cloth: Polygons) -> Polygons:
    """Points shared by several vertices (panels that lie on each other in the texture) become several points."""
    both, numbers = np.unique(np.column_stack([cloth.points, cloth.vertices]), axis=0, return_inverse=True)
    return replace(cloth, material=cloth.material[both[:, 0]], points=numbers.ravel())


def _face_up(points: Array, corners: Integers, faces: Integers, source: ObjSurface) -> Array:
    """Turn over panels whose triangles are all clockwise; an error names the line where one panel is mixed."""
    area = areas_of(points[corners])
    flat = np.flatnonzero(flatness(points[corners]) <= FLAT)
    if len(flat):
        raise InputError(
            "face", where=source.place(int(faces[flat[0]])), expected="a triangle with an area in the fabric",
            found=f"area {area[flat[0]]:g} m²",
        )  # fmt: skip
    panel = joined(corners[:, [0, 1, 1, 2]].reshape(-1, 2), len(points))[corners[:, 0]]
    turned = points.copy()
    for number in np.unique(panel):
        mine = np.flatnonzero(panel == number)
        back = area[mine] < 0
        if back.all():
            turned[np.unique(corners[mine]), 0] *= -1.0
        elif back.any():
            odd = mine[back] if back.sum() <= len(mine) / 2 else mine[~back]
            raise InputError(
                "face", where=source.place(int(faces[odd[0]])),
                expected="one orientation in the fabric for a panel", found="a face turned over",
            )  # fmt: skip
    return turned
