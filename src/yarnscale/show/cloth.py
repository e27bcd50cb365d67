"""Pictures of cloth as a shaded surface, with obstacles, bars and a scalar field."""

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

    @classmethod
    def sphere(cls, centre: Sequence[float], radius: float, *, colour: str = theme.OBSTACLE) -> Solid:
        """A ball."""
        ball = pv.Sphere(radius=radius, center=centre, theta_resolution=64, phi_resolution=48)
        return cls._from(ball, colour)

    @classmethod
    def bar(
        cls, start: Sequence[float], end: Sequence[float], *, radius: float = 0.003, colour: str = theme.BAR
    ) -> Solid:
        """A round bar from ``start`` to ``end`` (3,) [m]."""
        a, b = np.asarray(start, dtype=float), np.asarray(end, dtype=float)
        length = float(np.linalg.norm(b - a))
        rod: Any = pv.Cylinder(
            center=0.5 * (a + b), direction=(b - a) / length, radius=radius, height=length, resolution=32
        )
        return cls._from(rod, colour)

    @classmethod
    def _from(cls, mesh: pv.PolyData, colour: str) -> Solid:
        whole: Any = mesh.triangulate()
        return cls(np.asarray(whole.points, dtype=float), whole.regular_faces.astype(np.int64), colour)


@dataclass(frozen=True)
class ClothFrame:
    """One moment of a cloth.

    positions: vertices [m], shape (n, 3). values: a number per vertex (n,) or per triangle (m,), or None.
    solids: bodies of this moment. title: a line above the frame.
    """

    positions: NDArray[np.float64]
    values: NDArray[np.float64] | None = None
    solids: Sequence[Solid] = field(default=())
    title: str = ""


def cloth_picture(
    path: str | Path,
    triangles: NDArray[np.int64],
    frame: ClothFrame,
    *,
    label: str = "",
    limits: tuple[float, float] | None = None,
    camera: Camera | Sequence[float] = "oblique",
    wires: bool = False,
    size: tuple[int, int] = theme.PICTURE_SIZE,
) -> None:
    """Draw one moment of a cloth, both sides shaded, and write a PNG file.

    triangles: (m, 3). label: what ``frame.values`` are, with unit, beside their colour bar.
    limits: of the colours; None takes those of the values. wires: draw the edges of the triangles too.

    Raises InputError on positions that are not finite or a file that cannot be written.
    """
    contact_sheet(
        path, triangles, [frame], columns=1, label=label, limits=limits, camera=camera, wires=wires, size=size
    )


def contact_sheet(
    path: str | Path,
    triangles: NDArray[np.int64],
    frames: Sequence[ClothFrame],
    *,
    columns: int | None = None,
    label: str = "",
    limits: tuple[float, float] | None = None,
    camera: Camera | Sequence[float] = "oblique",
    wires: bool = False,
    size: tuple[int, int] | None = None,
) -> None:
    """Draw several moments side by side, all at one scale; arguments as in ``cloth_picture``.

    columns: frames in a row; None makes the sheet about square. size: of the whole sheet [pixels].
    """
    if not frames or not all(np.isfinite(f.positions).all() for f in frames):
        raise InputError("cloth frames", expected="at least one, all finite", found="none or NaN")
    across = columns or ceil(sqrt(len(frames)))
    down = ceil(len(frames) / across)
    size = size or (across * 640, down * 500)
    everything = np.vstack([_extent(f) for f in frames])
    bounds = limits or _limits(frames)
    with canvas(path, size=size, shape=(down, across)) as plotter:
        for k, frame in enumerate(frames):
            plotter.subplot(k // across, k % across)
            plotter.set_background(theme.PAPER)
            light(plotter)
            _add_cloth(plotter, triangles, frame, bounds=bounds, wires=wires)
            for solid in frame.solids:
                _add_solid(plotter, solid)
            _add_text(plotter, frame, bounds, label, last=k == len(frames) - 1)
            aim(plotter, everything, camera=camera, aspect=(size[0] / across) / (size[1] / down), margin=1.12)


def _add_cloth(
    plotter: Any,
    triangles: NDArray[np.int64],
    frame: ClothFrame,
    *,
    bounds: tuple[float, float] | None,
    wires: bool,
) -> None:
    mesh = _surface(frame.positions, triangles)
    look: dict[str, Any] = {
        "smooth_shading": True,
        "ambient": 0.3,
        "diffuse": 0.8,
        "specular": 0.04,
        "show_edges": wires,
        "edge_color": theme.INK,
        "edge_opacity": 0.25,
    }
    if frame.values is None:
        look |= {"color": theme.CLOTH_FRONT, "backface_params": {"color": theme.CLOTH_BACK}}
    else:
        place = mesh.point_data if len(frame.values) == mesh.n_points else mesh.cell_data
        place["values"] = frame.values
        look |= {"scalars": "values", "cmap": theme.SEQUENTIAL, "clim": bounds, "show_scalar_bar": False}
    plotter.add_mesh(mesh, **look)


def _add_solid(plotter: Any, solid: Solid) -> None:
    mesh = _surface(solid.vertices, solid.triangles)
    plotter.add_mesh(
        mesh, color=solid.colour, smooth_shading=True, split_sharp_edges=True, ambient=0.3, specular=0.1
    )


def _add_text(
    plotter: Any, frame: ClothFrame, bounds: tuple[float, float] | None, label: str, *, last: bool
) -> None:
    if frame.title:
        plotter.add_text(frame.title, position="upper_edge", font_size=11, color=theme.INK)
    if last and bounds is not None and frame.values is not None:
        look: dict[str, Any] = {
            "title": label,
            "color": theme.INK,
            "n_labels": 4,
            "fmt": "%.3g",
            "height": 0.085,
            "width": 0.5,
            "position_x": 0.25,
            "position_y": 0.03,
            "title_font_size": 17,
            "label_font_size": 14,
        }
        plotter.add_scalar_bar(**look)


def _surface(points: NDArray[np.float64], triangles: NDArray[np.int64]) -> pv.PolyData:
    return pv.PolyData.from_regular_faces(np.asarray(points, dtype=float), np.asarray(triangles))


def _extent(frame: ClothFrame) -> NDArray[np.float64]:
    """Points that the camera must see, shape (k, 3)."""
    return np.vstack([frame.positions, *(s.vertices for s in frame.solids)])


def _limits(frames: Sequence[ClothFrame]) -> tuple[float, float] | None:
    values = [np.asarray(f.values)[np.isfinite(f.values)] for f in frames if f.values is not None]
    if not values or not sum(v.size for v in values):
        return None
    together = np.concatenate(values)
    return float(together.min()), float(together.max())
