"""A machine that cannot draw says so in one line instead of crashing."""

from __future__ import annotations

import subprocess
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from yarnscale.errors import InputError
from yarnscale.show import canvas
from yarnscale.show.curves import Curve
from yarnscale.show.tubes import yarn_picture


def test_crash_of_the_renderer_becomes_one_line(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    canvas.require_renderer.cache_clear()
    monkeypatch.setattr(subprocess, "run", lambda *a, **k: SimpleNamespace(returncode=-11))
    line = Curve(np.arange(12.0).reshape(4, 3))
    with pytest.raises(canvas.PicturesUnavailable, match="OpenGL") as caught:
        yarn_picture(tmp_path / "a.png", [line], 0.1)
    assert "\n" not in str(caught.value)
    assert not list(tmp_path.iterdir())
    canvas.require_renderer.cache_clear()


@pytest.mark.parametrize("camera", ["top", "oblique", "side", (0.0, 0.0, -1.0), (1.0, 0.0, 0.0)])
def test_everything_is_in_view(camera: str | tuple[float, float, float]) -> None:
    plotter = SimpleNamespace(
        window_size=(400, 300), camera=SimpleNamespace(), reset_camera_clipping_range=lambda: None
    )
    points = np.random.default_rng(0).uniform(-1, 1, (200, 3)) * [0.3, 0.1, 0.02]
    canvas.aim(plotter, points, camera=camera)  # type: ignore[arg-type]
    view = plotter.camera
    back = np.subtract(view.position, view.focal_point)
    back /= np.linalg.norm(back)
    right = np.cross(view.up, back)
    high = np.abs((points - view.focal_point) @ np.asarray(view.up)).max()
    wide = np.abs((points - view.focal_point) @ right).max()
    assert high <= view.parallel_scale
    assert wide <= view.parallel_scale * 4 / 3
    assert max(high, wide * 3 / 4) >= 0.9 * view.parallel_scale


def test_unknown_camera_is_named() -> None:
    with pytest.raises(InputError, match="expected top or oblique or side; found bottom"):
        canvas.aim(SimpleNamespace(window_size=(4, 3)), np.eye(3), camera="bottom")  # type: ignore[arg-type]
