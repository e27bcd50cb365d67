"""An off-screen plotter that stays silent, and says why where the machine cannot draw."""

from __future__ import annotations

import io
import os
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pyvista as pv
from matplotlib.image import imsave
from numpy.typing import NDArray
from vtkmodules.vtkCommonCore import vtkLogger, vtkObject

from yarnscale.arrays import Array
from yarnscale.errors import InputError
from yarnscale.files.atomic import write_bytes
from yarnscale.show import theme

Camera = Literal["top", "oblique", "side"]
CAMERAS: dict[str, tuple[tuple[float, float, float], tuple[float, float, float]]] = {
    "top": ((0.0, 0.0, 1.0), (0.0, 1.0, 0.0)),
    "oblique": ((0.45, -0.95, 0.9), (0.0, 0.0, 1.0)),
    "side": ((0.0, -1.0, 0.12), (0.0, 0.0, 1.0)),
}
"""Direction from the object to the eye, and the direction that is up."""

_PROBE = """
import vtkmodules.vtkRenderingOpenGL2
from vtkmodules.vtkRenderingCore import vtkRenderWindow
window = vtkRenderWindow()
window.SetOffScreenRendering(1)
window.SetSize(8, 8)
window.Render()
"""


class PicturesUnavailable(InputError):
    """The machine has no OpenGL that works without a display."""


@cache
def require_renderer() -> None:
    """Raise PicturesUnavailable where drawing fails; tried in a process of its own, for it may crash."""
    if sys.platform.startswith("linux") and not os.environ.get("DISPLAY"):
        # Without this VTK asks for an X server first and complains when there is none.
        os.environ.setdefault("VTK_DEFAULT_OPENGL_WINDOW", "vtkEGLRenderWindow")
    probe = subprocess.run([sys.executable, "-c", _PROBE], capture_output=True, timeout=120, check=False)
    if probe.returncode != 0:
        raise PicturesUnavailable(
            "cannot draw pictures", expected="an OpenGL that needs no display (EGL or OSMesa of Mesa)", found="none"
        )
    vtkObject.GlobalWarningDisplayOff()
    vtkLogger.SetStderrVerbosity(vtkLogger.VERBOSITY_OFF)


@contextmanager
def canvas(path: str | Path, *, size: tuple[int, int] = theme.PICTURE_SIZE) -> Iterator[Any]:
    """A plotter whose picture is written to ``path`` (PNG) at the end; nothing is written on an error.

    It is a ``pyvista.Plotter``, given as Any because type checkers do not see through its decorators.
    Raises PicturesUnavailable, and InputError when the file cannot be written.
    """
    with screen(size) as plotter:
        yield plotter
        write_png(path, plotter.screenshot(return_img=True))


@contextmanager
def screen(size: tuple[int, int]) -> Iterator[Any]:
    """A plotter that is asked for screenshots as often as one likes; as ``canvas`` otherwise."""
    require_renderer()
    plotter: Any = pv.Plotter(off_screen=True, window_size=list(size), border=False)
    try:
        plotter.set_background(theme.PAPER)
        plotter.enable_anti_aliasing("ssaa")
        yield plotter
    finally:
        plotter.close()


def write_png(path: str | Path, pixels: NDArray[np.uint8]) -> None:
    """Write an image (height, width, 3) as a PNG file in one go."""
    content = io.BytesIO()
    imsave(content, pixels, format="png")
    write_bytes(path, content.getvalue())


def aim(
    plotter: Any,
    points: Array,
    *,
    camera: Camera | Sequence[float] = "oblique",
    margin: float = 1.06,
    aspect: float | None = None,
) -> float:
    """Point the camera, in parallel projection, so that ``points`` (n, 3) [m] just fill the picture.

    Returns the scale of the picture [pixels/m].

    camera: a name of ``CAMERAS`` or the direction from the object to the eye (3,).
    aspect: width by height of the picture; None takes that of the window.
    """
    frame = view_axes(camera)
    seen = np.asarray(points) @ frame.T
    low, high = seen.min(axis=0), seen.max(axis=0)
    extent = np.maximum(high - low, 1e-9)
    ratio = aspect or plotter.window_size[0] / plotter.window_size[1]
    focus = frame.T @ (0.5 * (low + high))
    distance = float(np.linalg.norm(extent)) * 4
    view: Any = plotter.camera
    view.position = tuple(focus + distance * frame[2])
    view.focal_point = tuple(focus)
    view.up = tuple(frame[1])
    view.parallel_projection = True
    view.parallel_scale = 0.5 * margin * max(extent[1], extent[0] / ratio)
    plotter.reset_camera_clipping_range()
    return plotter.window_size[1] / (2.0 * view.parallel_scale)


def view_axes(camera: Camera | Sequence[float]) -> Array:
    """Unit vectors to the right, up and towards the eye, rows of (3, 3)."""
    eye, up = _view(camera)
    back = eye / np.linalg.norm(eye)
    right = np.cross(up, back)
    right /= np.linalg.norm(right)
    return np.stack([right, np.cross(back, right), back])


def _view(camera: Camera | Sequence[float]) -> tuple[Array, Array]:
    if not isinstance(camera, str):
        eye = np.asarray(camera, dtype=float)
        level = np.array([0.0, 0.0, 1.0])
        steep = abs(eye[2]) > 0.999 * np.linalg.norm(eye)
        return eye, np.array([0.0, 1.0, 0.0]) if steep else level
    if camera not in CAMERAS:
        raise InputError("camera", expected=" or ".join(CAMERAS), found=camera)
    eye, up = CAMERAS[camera]
    return np.array(eye), np.array(up)


def light(plotter: Any) -> None:
    """Three soft lights that follow the camera, so that tubes look round from every side."""
    plotter.remove_all_lights()
    for position, intensity in (((-1.0, 1.4, 1.8), 0.72), ((1.8, 0.3, 1.0), 0.28), ((0.0, -1.5, 1.0), 0.18)):
        lamp: Any = pv.Light(light_type="camera light", intensity=intensity)
        lamp.position = position
        plotter.add_light(lamp)
