"""Pictures of yarns as round tubes, with their periodic copies and midsurface."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyvista as pv

from yarnscale.arrays import Array
from yarnscale.errors import InputError
from yarnscale.show import theme
from yarnscale.show.canvas import Camera, aim, canvas, light
from yarnscale.show.curves import Curve
from yarnscale.show.seen_tubes import add_tubes, tube_mesh


def yarn_picture(
    path: str | Path,
    curves: Sequence[Curve],
    radius: float,
    *,
    surface: Array | None = None,
    camera: Camera | Sequence[float] = "oblique",
    size: tuple[int, int] = theme.PICTURE_SIZE,
    room: Array | None = None,
) -> None:
    """Draw yarns as round tubes and write a PNG file.

    curves: centre lines [m] (``periodic_curves`` makes them from a pattern). radius: of the yarn [m].
    surface: points of a midsurface on a grid [m], shape (rows, columns, 3), drawn translucent.
    camera: "top" (course to the right, wale up), "oblique", "side", or a direction to the eye (3,).
    room: least size of what the picture holds [m], (3,), for a series on one scale.

    Raises InputError on points that are not finite or a file that cannot be written, and
    PicturesUnavailable where the machine has no OpenGL.
    """
    if not (np.isfinite(radius) and radius > 0):
        raise InputError("yarn radius", expected="a positive number", found=radius)
    if not curves or not all(np.isfinite(c.points).all() for c in curves):
        raise InputError("yarn centre lines", expected="at least one, all finite", found="none or NaN")
    with canvas(path, size=size) as plotter:
        light(plotter)
        # Ends are flat, with an edge.
        tubes = tube_mesh(curves, radius).compute_normals(cell_normals=False, split_vertices=True)
        assert isinstance(tubes, pv.PolyData)
        add_tubes(plotter, tubes, radius)
        if surface is not None:
            _add_surface(plotter, surface)
        framed = [c.points + side for c in curves for side in (-radius, radius)]
        if surface is not None:
            framed.append(np.asarray(surface, dtype=float).reshape(-1, 3))
        if room is not None:
            framed.append(_box(np.vstack(framed), np.asarray(room, dtype=float)))
        aim(plotter, np.vstack(framed), camera=camera)


def room_of(series: Sequence[Sequence[Curve]], radius: float) -> Array:
    """Least size (3,) [m] that holds every picture of a series."""
    sizes = [np.ptp(np.vstack([curve.points for curve in curves]), axis=0) for curves in series]
    return np.max(sizes, axis=0) + 2 * radius


def _box(points: Array, room: Array) -> Array:
    """Two corners of a box of this size around the middle of points (n, 3)."""
    middle = 0.5 * (points.min(axis=0) + points.max(axis=0))
    return np.stack([middle - 0.5 * room, middle + 0.5 * room])


def _add_surface(plotter: Any, surface: Array) -> None:
    """A translucent sheet with its grid lines."""
    grid: Any = pv.StructuredGrid(*np.moveaxis(np.asarray(surface, dtype=float)[None], -1, 0))
    sheet = grid.extract_surface(algorithm="dataset_surface")
    plotter.add_mesh(sheet, color=theme.SURFACE, opacity=0.35, smooth_shading=True, specular=0.0)
    plotter.add_mesh(sheet.extract_all_edges(), color=theme.MUTED, opacity=0.5, line_width=1.5, lighting=False)
