"""Pictures of cloth with its yarns: the whole of it, or a near view of a part."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pyvista as pv

from yarnscale.arrays import Array, Integers
from yarnscale.errors import InputError
from yarnscale.files.curve_frames import CurveSet
from yarnscale.show import theme
from yarnscale.show.canvas import Camera, aim, canvas, light
from yarnscale.show.curves import Curve
from yarnscale.show.seen_tubes import add_tubes, tube_mesh

NEAR_POINTS = 60_000
"""With fewer points in view, yarns are drawn smooth."""
_SHADED = 2.0
"""Radius [pixels] from which yarns shade each other."""


@dataclass(frozen=True)
class Solid:
    """A body beside the cloth: ``vertices`` (n, 3) [m], ``triangles`` (m, 3), ``colour`` #rrggbb."""

    vertices: Array
    triangles: Integers
    colour: str = theme.OBSTACLE


def yarn_cloth_picture(
    path: str | Path,
    curves: CurveSet,
    positions: Array,
    *,
    about: Sequence[float] | None = None,
    width: float | None = None,
    solids: Sequence[Solid] = (),
    camera: Camera | Sequence[float] = "oblique",
    size: tuple[int, int] = theme.PICTURE_SIZE,
) -> None:
    """Draw the yarns of a cloth and write a PNG file.

    positions: points of the curves [m], (n, 3). about, width: draw only what lies in a cube of this width [m] around a
    point (3,) [m]; None draws everything. solids: bodies beside the cloth.

    Raises InputError on positions that are not finite, a view without yarns or a file that cannot be written.
    """
    positions = np.asarray(positions, dtype=float)
    if positions.shape != (curves.point_count, 3) or not np.isfinite(positions).all():
        raise InputError("points of the yarns", expected=f"finite, ({curves.point_count}, 3)", found=positions.shape)
    middle, reach = None, np.inf
    if about is not None and width is not None:
        middle, reach = np.asarray(about, dtype=float), 0.5 * width
    pieces = _pieces(curves, positions, middle, reach)
    if not pieces:
        raise InputError("near view of yarns", expected="yarns around its point", found="none")
    near = sum(len(piece.points) for piece in pieces) < NEAR_POINTS
    radius = float(curves.radii.max())
    drawn = solids if middle is None else ()
    seen = np.vstack([piece.points for piece in pieces] + [solid.vertices for solid in drawn])
    with canvas(path, size=size) as plotter:
        light(plotter)
        scale = aim(plotter, seen, camera=camera, margin=1.04 if middle is None else 0.9)
        # The renderer keeps depths in half precision: below a few pixels what lies deeper would be noise.
        mesh = tube_mesh(pieces, scale=scale, smooth=4 if near else 0)
        add_tubes(plotter, mesh, radius if scale * radius > _SHADED else None)
        for solid in drawn:
            body = pv.PolyData.from_regular_faces(solid.vertices, solid.triangles)
            look = {"smooth_shading": True, "split_sharp_edges": True, "ambient": 0.3, "specular": 0.1}
            plotter.add_mesh(body, color=solid.colour, **look)
        plotter.reset_camera_clipping_range()


def _pieces(curves: CurveSet, positions: Array, middle: Array | None, reach: float) -> list[Curve]:
    """The parts of curves within ``reach`` of the middle, in a cube."""
    pieces = []
    for k, yarn in enumerate(curves.yarn.tolist()):
        points = positions[curves.offsets[k] : curves.offsets[k + 1]]
        radius = float(curves.radii[curves.offsets[k]])
        if middle is None:
            pieces.append(Curve(points, yarn, bool(curves.closed[k]), radius=radius))
            continue
        inside = (np.abs(points - middle) < reach).all(axis=1)
        cuts = np.flatnonzero(np.diff(np.concatenate([[False], inside, [False]]).astype(np.int8)))
        pieces += [Curve(points[a:b], yarn, radius=radius) for a, b in cuts.reshape(-1, 2) if b - a > 2]
    return pieces
