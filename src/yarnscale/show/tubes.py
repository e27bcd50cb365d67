"""Pictures of yarns as round tubes, with their periodic copies and midsurface."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyvista as pv
from numpy.typing import NDArray

from yarnscale.errors import InputError
from yarnscale.show import theme
from yarnscale.show.canvas import Camera, aim, canvas, light
from yarnscale.show.curves import Curve, smooth_curve

SIDES = 24
"""Corners of a tube's cross section."""


def yarn_picture(
    path: str | Path,
    curves: Sequence[Curve],
    radius: float,
    *,
    surface: NDArray[np.float64] | None = None,
    camera: Camera | Sequence[float] = "oblique",
    size: tuple[int, int] = theme.PICTURE_SIZE,
    room: Sequence[float] | None = None,
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
        plotter.add_mesh(
            tube_mesh(curves, radius),
            scalars="colour",
            rgb=True,
            smooth_shading=True,
            ambient=0.32,
            diffuse=0.85,
            specular=0.12,
            specular_power=12,
        )
        if surface is not None:
            _add_surface(plotter, surface)
        _add_depth(plotter, radius)
        framed = [_framed(c, radius) for c in curves]
        if surface is not None:
            framed.append(np.asarray(surface, dtype=float).reshape(-1, 3))
        if room is not None:
            framed.append(_box(np.vstack(framed), np.asarray(room, dtype=float)))
        aim(plotter, np.vstack(framed), camera=camera)


def tube_mesh(curves: Sequence[Curve], radius: float) -> pv.PolyData:
    """Tubes around smoothed centre lines, with an RGB colour at every point as ``colour``.

    radius: of curves that have none of their own [m].
    """
    radii = [radius if curve.radius is None else curve.radius for curve in curves]
    tubes = [
        _tubes([curve for curve, own in zip(curves, radii, strict=True) if own == one], one)
        for one in dict.fromkeys(radii)
    ]
    return tubes[0] if len(tubes) == 1 else pv.merge(tubes)  # type: ignore[return-value]


def _tubes(curves: Sequence[Curve], radius: float) -> pv.PolyData:
    """Tubes of one radius."""
    blocks = [smooth_curve(curve) for curve in curves]
    points = np.vstack([b[0] for b in blocks])
    colours = np.empty((len(points), 3))
    cells, start = [], 0
    for curve, (line, solid) in zip(curves, blocks, strict=True):
        stop = start + len(line)
        colour = theme.yarn_colour(curve.yarn)
        colours[start:stop] = np.where(solid[:, None], colour, theme.faded(colour))
        cells.append(np.concatenate([[len(line)], np.arange(start, stop)]))
        start = stop
    lines: Any = pv.PolyData(points, lines=np.concatenate(cells))
    lines["colour"] = np.rint(255 * colours).astype(np.uint8)
    return lines.tube(radius=radius, n_sides=SIDES, capping=True)


def _framed(curve: Curve, radius: float) -> NDArray[np.float64]:
    """Corners that enclose a tube, for the camera, shape (2 k, 3)."""
    return np.vstack([curve.points - radius, curve.points + radius])


def _box(points: NDArray[np.float64], room: NDArray[np.float64]) -> NDArray[np.float64]:
    """Two corners of a box of this size around the middle of points (n, 3)."""
    middle = 0.5 * (points.min(axis=0) + points.max(axis=0))
    return np.stack([middle - 0.5 * room, middle + 0.5 * room])


def _add_surface(plotter: Any, surface: NDArray[np.float64]) -> None:
    """A translucent sheet with its grid lines."""
    grid: Any = pv.StructuredGrid(*np.moveaxis(np.asarray(surface, dtype=float)[None], -1, 0))
    sheet = grid.extract_surface(algorithm="dataset_surface")
    plotter.add_mesh(sheet, color=theme.SURFACE, opacity=0.35, smooth_shading=True, specular=0.0)
    plotter.add_mesh(
        sheet.extract_all_edges(), color=theme.MUTED, opacity=0.5, line_width=1.5, lighting=False
    )


def _add_depth(plotter: Any, radius: float) -> None:
    """Darken the places where yarns meet, so that over and under can be told apart."""
    plotter.enable_ssao(radius=4 * radius, bias=0.3 * radius, kernel_size=48, blur=True)
