"""Pictures of cloth as a shaded surface, with obstacles."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from math import ceil, sqrt
from pathlib import Path
from typing import Any

import numpy as np
import pyvista as pv
from numpy.typing import NDArray

from yarnscale.errors import InputError
from yarnscale.show import theme
from yarnscale.show.canvas import Camera, aim, canvas, light


@dataclass(frozen=True)
class Solid:
    """A body beside the cloth: ``vertices`` (n, 3) [m], ``triangles`` (m, 3), ``colour`` #rrggbb."""

    vertices: NDArray[np.float64]
    triangles: NDArray[np.int64]
    colour: str = theme.OBSTACLE


@dataclass(frozen=True)
class ClothFrame:
    """One moment of a cloth.

    positions: vertices [m], shape (n, 3). solids: bodies of this moment. title: a line above the frame.
    """

    positions: NDArray[np.float64]
    solids: Sequence[Solid] = field(default=())
    title: str = ""


def contact_sheet(
    path: str | Path,
    triangles: NDArray[np.int64],
    frames: Sequence[ClothFrame],
    *,
    columns: int | None = None,
    camera: Camera | Sequence[float] = "oblique",
    size: tuple[int, int] | None = None,
) -> None:
    """Draw moments of a cloth side by side, all at one scale, both sides shaded, and write a PNG file.

    triangles: (m, 3). columns: frames in a row; None makes the sheet about square. size: of the whole sheet [pixels].

    Raises InputError on positions that are not finite or a file that cannot be written.
    """
    if not frames or not all(np.isfinite(f.positions).all() for f in frames):
        raise InputError("cloth frames", expected="at least one, all finite", found="none or NaN")
    across = columns or ceil(sqrt(len(frames)))
    down = ceil(len(frames) / across)
    size = size or (across * 640, down * 500)
    everything = np.vstack([_extent(f) for f in frames])
    with canvas(path, size=size, shape=(down, across)) as plotter:
        for k, frame in enumerate(frames):
            plotter.subplot(k // across, k % across)
            plotter.set_background(theme.PAPER)
            light(plotter)
            _add_cloth(plotter, _surface(frame.positions, triangles))
            for solid in frame.solids:
                add_solid(plotter, solid)
            if frame.title:
                plotter.add_text(frame.title, position="upper_edge", font_size=11, color=theme.INK)
            aim(plotter, everything, camera=camera, aspect=(size[0] / across) / (size[1] / down), margin=1.12)


def _add_cloth(plotter: Any, mesh: pv.PolyData) -> None:
    plotter.add_mesh(
        mesh, color=theme.CLOTH_FRONT, backface_params={"color": theme.CLOTH_BACK}, smooth_shading=True,
        ambient=0.3, diffuse=0.8, specular=0.04,
    )  # fmt: skip


def add_solid(plotter: Any, solid: Solid) -> None:
    """Put a body into a picture."""
    mesh = _surface(solid.vertices, solid.triangles)
    plotter.add_mesh(
        mesh, color=solid.colour, smooth_shading=True, split_sharp_edges=True, ambient=0.3, specular=0.1
    )


def _surface(points: NDArray[np.float64], triangles: NDArray[np.int64]) -> pv.PolyData:
    return pv.PolyData.from_regular_faces(np.asarray(points, dtype=float), np.asarray(triangles))


def _extent(frame: ClothFrame) -> NDArray[np.float64]:
    """Points that the camera must see, shape (k, 3)."""
    return np.vstack([frame.positions, *(s.vertices for s in frame.solids)])
