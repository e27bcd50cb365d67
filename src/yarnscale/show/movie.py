"""Moving pictures of a run: one camera and one scale of colours for all frames, as MP4 or as PNG files."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from fractions import Fraction
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pyvista as pv
from numpy.typing import NDArray

from yarnscale.arrays import Array, Integers
from yarnscale.errors import InputError
from yarnscale.files.animation import Animation, Moment, Surface, vertex_normals
from yarnscale.files.atomic import replacement
from yarnscale.files.curve_frames import CurveSet
from yarnscale.show import theme
from yarnscale.show.canvas import Camera, aim, light, screen, view_axes, write_png
from yarnscale.show.seen_tubes import add_tubes, seen_tubes, tube_colours

Pixels = NDArray[np.uint8]

MOVIE_SIZE = (1280, 960)
_BAR = {
    "color": theme.INK,
    "n_labels": 2,
    "fmt": "%.3f",
    "height": 0.1,
    "width": 0.5,
    "position_x": 0.25,
    "position_y": 0.03,
    "title_font_size": 20,
    "label_font_size": 17,
}
_LIMITS = (1.0, 99.0)
"""Percentiles of the stretch over a run between which its colours run."""


def write_movie(
    path: str | os.PathLike[str],
    animation: Animation,
    *,
    fps: float = 30.0,
    speed: float = 1.0,
    on_frame: Callable[[int], None] | None = None,
    **look: Any,
) -> None:
    """Write an MP4 file (H.264).

    Time runs ``speed`` times as fast as in the run; at every moment the frame nearest in time is shown, none is made
    up. look: as of ``Film``. on_frame: called with the number of frames drawn. Interrupted, it closes the film with
    what was drawn and goes on with a KeyboardInterrupt that says so. Raises InputError without the extra ``export``,
    where the machine cannot draw, or where the file cannot be written.
    """
    try:
        import av
        from av.error import FFmpegError
    except ImportError:
        raise InputError(
            "movies need the package av", expected="pip install 'yarnscale[export]'", found="none"
        ) from None
    order, unfinished = playing_order(animation.times, fps=fps, speed=speed), None
    with replacement(path) as temporary, Film(animation, **look) as film:
        try:
            with av.open(str(temporary), "w", format="mp4") as container:
                rate = Fraction(fps).limit_denominator(1001)
                stream: Any = container.add_stream("libx264", rate=rate, options={"crf": "18"})
                stream.width, stream.height = film.size
                stream.pix_fmt = "yuv420p"
                shown, pixels = -1, None
                try:
                    for index in order:
                        if pixels is None or index != shown:
                            pixels, shown = film.pixels(index), index
                            if on_frame is not None:
                                on_frame(index + 1)
                        container.mux(stream.encode(av.VideoFrame.from_ndarray(pixels, format="rgb24")))
                except KeyboardInterrupt:
                    if pixels is None:
                        raise
                    unfinished = f"{path} holds {shown + 1} of {len(animation)} frames"
                container.mux(stream.encode())
        except FFmpegError as error:
            raise InputError("output cannot be written", where=path, found=error.strerror) from None
    if unfinished is not None:
        raise KeyboardInterrupt(unfinished)


def write_stills(
    folder: str | os.PathLike[str], animation: Animation, *, on_frame: Callable[[int], None] | None = None, **look: Any
) -> None:
    """Write ``frame_0000.png`` and so on into a folder that exists; arguments and errors as of ``write_movie``."""
    with Film(animation, **look) as film:
        for index, number in enumerate(animation.numbers):
            write_png(Path(folder) / f"frame_{number:04d}.png", film.pixels(index))
            if on_frame is not None:
                on_frame(index + 1)


def playing_order(times: Array, *, fps: float, speed: float = 1.0) -> list[int]:
    """For every picture of a movie the frame nearest to its time; the first and the last frame are shown."""
    if not (np.isfinite(fps) and 0 < fps <= 1000 and np.isfinite(speed) and speed > 0):
        raise InputError("fps and speed", expected="positive numbers, fps up to 1000", found=f"{fps}, {speed}")
    count = round((times[-1] - times[0]) * fps / speed) + 1
    moments = times[0] + np.arange(count) * speed / fps
    if len(times) == 1:
        return [0]
    middles = 0.5 * (times[1:] + times[:-1])
    order = np.searchsorted(middles, moments, side="right")
    order[-1] = len(times) - 1
    return order.tolist()


class Film:
    """Pictures of an animation, one by one; a context manager.

    Cloth shows its right side in one colour and its wrong side in another, or its stretch; where there are yarns they
    are drawn instead of it. The camera sees all frames and does not move.

    colour: "sides" or "stretch", the larger principal stretch. camera: as of ``yarn_picture``. size:
    width and height [pixels], made even. wires: draw the edges of triangles too. titles: of the frames, by default
    their times. Raises InputError where there is
    nothing to draw, the cloth has no material coordinates for its stretch, or the machine cannot draw.
    """

    def __init__(
        self,
        animation: Animation,
        *,
        colour: Literal["sides", "stretch"] = "sides",
        camera: Camera | tuple[float, float, float] = "oblique",
        size: tuple[int, int] = MOVIE_SIZE,
        wires: bool = False,
        titles: Sequence[str] = (),
    ) -> None:
        self.animation, self._titles = animation, titles
        self.size = (size[0] // 2 * 2, size[1] // 2 * 2)
        self._cloth = animation.cloth if animation.yarns is None else None
        self._stretch = self._cloth if colour == "stretch" else None
        if self._stretch is not None and self._stretch.material is None:
            raise InputError("colour by stretch", expected="material coordinates", found="none")
        self._camera: Camera | tuple[float, float, float] = camera
        self._wires = wires
        self._outermost, self._limits = self._survey()
        self._parts: list[tuple[pv.PolyData, Callable[[Moment], tuple[Array, Array]]]] = []
        self._open = ExitStack()

    def __enter__(self) -> Film:
        with ExitStack() as opening:
            self._plotter: Any = opening.enter_context(screen(self.size))
            self._furnish()
            self._open = opening.pop_all()
        return self

    def __exit__(self, *error: Any) -> None:
        self._open.close()

    def pixels(self, index: int) -> Pixels:
        """Picture of a frame, (height, width, 3)."""
        moment = self.animation.moment(index)
        for mesh, shape in self._parts:
            points, normals = shape(moment)
            mesh.points = points.astype(np.float32)
            mesh.point_data["Normals"] = normals.astype(np.float32)
        if self._stretch is not None and moment.cloth is not None:
            stretch = vertex_stretch(self._stretch, moment.cloth)
            np.copyto(np.asarray(self._parts[0][0].point_data["stretch"]), stretch)
            self._parts[0][0].GetPointData().GetArray("stretch").Modified()
        self._caption.SetInput(self._titles[index] if self._titles else f"{moment.time:.2f} s")
        self._plotter.render()
        return self._plotter.screenshot(return_img=True)

    def _furnish(self) -> None:
        """Put everything on the stage as it is in the first frame."""
        light(self._plotter)
        animation, first = self.animation, self.animation.moment(0)
        aspect = self.size[0] / self.size[1]
        scale = aim(self._plotter, self._outermost, camera=self._camera, aspect=aspect, margin=1.12)
        if self._cloth is not None:
            self._add_cloth(self._cloth, first, self._limits)
        if animation.bodies is not None:
            self._add_bodies(animation.bodies, first)
        if animation.yarns is not None:
            self._add_yarns(animation.yarns, first, scale)
        self._caption = self._plotter.add_text(
            "0 s", position=(0.025, 0.935), viewport=True, font_size=13, color=theme.INK
        )
        self._plotter.reset_camera_clipping_range()

    def _survey(self) -> tuple[Array, tuple[float, float] | None]:
        """Points of all frames that lie outermost in the view, and the limits of the stretch."""
        axes, outermost = view_axes(self._camera), []
        limits = []
        for moment in self.animation:
            drawn = moment.yarns if self._cloth is None else moment.cloth
            for points in (drawn, moment.bodies):
                if points is not None and len(points):
                    seen = points @ axes.T
                    outermost.append(points[np.concatenate([seen.argmin(axis=0), seen.argmax(axis=0)])])
            if self._stretch is not None and moment.cloth is not None:
                limits.append(np.percentile(vertex_stretch(self._stretch, moment.cloth), _LIMITS))
        if not outermost:
            raise InputError("animation", expected="something to draw", found="nothing")
        if not limits:
            return np.concatenate(outermost), None
        # A range of a thousandth at least, or noise would be drawn as colour.
        least, most = float(np.min(limits)), float(np.max(limits))
        return np.concatenate(outermost), (least, max(most, least + 1e-3))

    def _add_cloth(self, cloth: Surface, first: Moment, limits: tuple[float, float] | None) -> None:
        mesh = self._surface_part("cloth", cloth, first)
        look: dict[str, Any] = {"ambient": 0.3, "diffuse": 0.8, "specular": 0.04}
        if self._wires:
            look |= {"show_edges": True, "edge_color": theme.INK, "edge_opacity": 0.25}
        if limits is None:
            look |= {"color": theme.CLOTH_FRONT, "backface_params": {"color": theme.CLOTH_BACK}}
        else:
            assert first.cloth is not None
            mesh.point_data["stretch"] = vertex_stretch(cloth, first.cloth)
            bar = _BAR | {"title": "larger principal stretch"}
            look |= {"scalars": "stretch", "cmap": theme.SEQUENTIAL, "clim": limits, "scalar_bar_args": bar}
        self._plotter.add_mesh(mesh, interpolation="phong", **look)

    def _add_bodies(self, bodies: Surface, first: Moment) -> None:
        mesh = self._surface_part("bodies", bodies, first)
        self._plotter.add_mesh(mesh, color=theme.OBSTACLE, interpolation="phong", ambient=0.3, specular=0.1)

    def _add_yarns(self, curves: CurveSet, first: Moment, scale: float) -> None:
        assert first.yarns is not None
        sweep, chosen = seen_tubes(curves, first.yarns, scale)

        def shape(moment: Moment) -> tuple[Array, Array]:
            assert moment.yarns is not None and moment.radii is not None
            return sweep.surface(moment.yarns[chosen], moment.radii[chosen])

        mesh = self._part(sweep.triangles, shape, first)
        mesh.point_data["colour"] = tube_colours(sweep)
        add_tubes(self._plotter, mesh)

    def _surface_part(self, name: str, surface: Surface, first: Moment) -> pv.PolyData:
        def shape(moment: Moment) -> tuple[Array, Array]:
            points = getattr(moment, name)
            return points, vertex_normals(points, surface.triangles)

        return self._part(surface.triangles, shape, first)

    def _part(self, triangles: Integers, shape: Callable[[Moment], tuple[Array, Array]], first: Moment) -> pv.PolyData:
        points, normals = shape(first)
        # Single precision, as the renderer has it: half the memory, and nothing to convert.
        points, normals = points.astype(np.float32), normals.astype(np.float32)
        mesh = pv.PolyData.from_regular_faces(points, triangles)
        mesh.point_data["Normals"] = normals
        mesh.point_data.active_normals_name = "Normals"
        self._parts.append((mesh, shape))
        return mesh


def largest_stretch(cloth: Surface, positions: Array) -> Array:
    """Larger principal stretch of every triangle, (nt,): the larger singular value of ∂x/∂X."""
    assert cloth.material is not None
    rest = cloth.material[cloth.triangles if cloth.corners is None else cloth.corners]
    now = positions[cloth.triangles]
    rest_edges = np.stack([rest[:, 1] - rest[:, 0], rest[:, 2] - rest[:, 0]], axis=2)
    edges = np.stack([now[:, 1] - now[:, 0], now[:, 2] - now[:, 0]], axis=2)
    gradient = edges @ np.linalg.inv(rest_edges)
    metric = gradient.transpose(0, 2, 1) @ gradient
    mean, half = 0.5 * (metric[:, 0, 0] + metric[:, 1, 1]), 0.5 * (metric[:, 0, 0] - metric[:, 1, 1])
    return np.sqrt(mean + np.hypot(half, metric[:, 0, 1]))


def vertex_stretch(cloth: Surface, positions: Array) -> Array:
    """Mean of the larger principal stretch over the triangles of every vertex, (nv,)."""
    corners, values = cloth.triangles.ravel(), np.repeat(largest_stretch(cloth, positions), 3)
    shares = np.bincount(corners, minlength=len(positions))
    return np.bincount(corners, values, len(positions)) / np.maximum(shares, 1)
