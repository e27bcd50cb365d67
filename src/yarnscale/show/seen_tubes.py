"""Tubes of yarns as fine as a picture shows them, and no finer."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pyvista as pv
from numpy.typing import NDArray

from yarnscale.arrays import Array, Flags, Integers
from yarnscale.files.curve_frames import CurveSet
from yarnscale.files.tube_detail import thinned
from yarnscale.files.tube_sweep import TubeSweep
from yarnscale.show import theme
from yarnscale.show.curves import Curve, smooth_curve

SIDES = 24
"""Corners of a tube's section in pictures of single cells."""
_SIDES = ((0.7, 3), (1.6, 4), (3.0, 6), (6.0, 8), (16.0, 12), (np.inf, 20))
"""Up to a radius [pixels], corners of a tube's section."""
_SMALLEST = 0.25
"""What does not show [pixels]."""


def seen_tubes(curves: CurveSet, points: Array, scale: float) -> tuple[TubeSweep, Integers]:
    """Tubes about curves, and the points (m,) that they need of all, in a picture of a scale [pixels/m].

    points: positions (n, 3) [m] in one frame. Points are left out where nobody sees it, sections have fewer sides.
    """
    radius = scale * float(curves.radii.max())
    sides = next(count for limit, count in _SIDES if radius <= limit)
    few, chosen = thinned(curves, points, _SMALLEST / scale)
    return TubeSweep(few, sides=sides), chosen


def tube_mesh(
    curves: Sequence[Curve], radius: float = np.nan, *, scale: float | None = None, smooth: int = 8
) -> pv.PolyData:
    """Tubes about centre lines with normals, and an RGB colour of the yarn at every point as ``colour``.

    radius: of curves that have none of their own [m]. scale: of the picture [pixels/m], for tubes no finer than it
    shows; None: ``SIDES`` corners at every point. smooth: points of a spline for every segment, 0 for straight ones.
    """
    whole = [np.ones(len(curve.points), bool) if curve.solid is None else curve.solid for curve in curves]
    straight = [(curve.points, solid) for curve, solid in zip(curves, whole, strict=True)]
    lines = [smooth_curve(curve, per_segment=smooth) for curve in curves] if smooth else straight
    points, solid = (np.concatenate(parts) for parts in zip(*lines, strict=True))
    offsets = np.concatenate([[0], np.cumsum([len(line) for line, _ in lines])])
    radii = np.array([radius if curve.radius is None else curve.radius for curve in curves])
    closed = np.array([curve.closed and not smooth for curve in curves])
    every = CurveSet(offsets, radii, closed=closed, yarn=np.array([curve.yarn for curve in curves]))
    sweep, chosen = TubeSweep(every, sides=SIDES), np.arange(len(points))
    if scale is not None:
        sweep, chosen = seen_tubes(every, points, scale)
    vertices, normals = sweep.surface(points[chosen], sweep.curves.radii)
    mesh = pv.PolyData.from_regular_faces(vertices, sweep.triangles)
    mesh.point_data["Normals"] = normals
    mesh.point_data.active_normals_name = "Normals"
    mesh.point_data["colour"] = tube_colours(sweep, solid[chosen])
    return mesh


def tube_colours(sweep: TubeSweep, solid: Flags | None = None) -> NDArray[np.uint8]:
    """Colour of every vertex of tubes by its yarn, (n · sides, 3); faded where points (n,) are not solid."""
    curves = sweep.curves
    palette = np.array([theme.yarn_colour(k) for k in range(len(theme.YARNS))])
    colours = np.repeat(palette[curves.yarn % len(palette)], np.diff(curves.offsets), axis=0)
    if solid is not None:
        colours = np.where(solid[:, None], colours, theme.faded(colours))
    return np.repeat(np.rint(255 * colours).astype(np.uint8), sweep.sides, axis=0)


def add_tubes(plotter: Any, mesh: pv.PolyData, radius: float | None = None) -> None:
    """Put tubes into a picture; radius [m]: darken the places where they meet, so that over and under can be told."""
    plotter.add_mesh(mesh, scalars="colour", rgb=True, interpolation="phong", ambient=0.32, diffuse=0.85, specular=0.12)
    if radius is not None:
        plotter.enable_ssao(radius=4 * radius, bias=0.3 * radius, kernel_size=48, blur=True)
