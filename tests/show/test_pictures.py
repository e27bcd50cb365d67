"""Pictures are written, show what they should, and fail with one line."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from matplotlib.image import imread

from yarnscale.errors import InputError
from yarnscale.files.animation import Animation, Moment, Surface
from yarnscale.files.body_surface import ball
from yarnscale.show.canvas import PicturesUnavailable, require_renderer
from yarnscale.show.curves import Curve
from yarnscale.show.run_page import frames_picture
from yarnscale.show.seen_tubes import SIDES, tube_mesh
from yarnscale.show.tubes import yarn_picture


@pytest.fixture(scope="module")
def renderer() -> None:
    try:
        require_renderer()
    except PicturesUnavailable as missing:
        pytest.skip(str(missing))


def wave(height: float, *, yarn: int = 0) -> Curve:
    x = np.linspace(-1, 1, 17)
    return Curve(np.stack([x, 0 * x + 0.5 * height, height * np.cos(3 * x)], axis=1), yarn)


def sheet() -> tuple[np.ndarray, np.ndarray]:
    x, y = np.meshgrid(np.linspace(-1, 1, 9), np.linspace(-1, 1, 9))
    n = np.arange(81).reshape(9, 9)
    corners = [n[:-1, :-1], n[:-1, 1:], n[1:, 1:], n[:-1, :-1], n[1:, 1:], n[1:, :-1]]
    triangles = np.concatenate([np.stack(corners[k : k + 3], axis=-1).reshape(-1, 3) for k in (0, 3)])
    return np.stack([x.ravel(), y.ravel(), 0.2 * x.ravel() ** 2], axis=1), triangles


def ink(path: Path) -> float:
    """Share of pixels that are not paper."""
    return float((imread(path)[..., :3].min(axis=-1) < 0.97).mean())


def test_tubes_are_round_and_on_average_as_wide_as_the_yarn() -> None:
    radius = 0.05
    tube = tube_mesh([wave(0.0)], radius)
    distance = np.linalg.norm(np.asarray(tube.points)[:, 1:], axis=1)
    assert distance == pytest.approx(radius * np.pi / (SIDES * np.sin(np.pi / SIDES)), rel=1e-5)


def test_yarn_picture(renderer: None, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    grid = np.stack([*np.meshgrid(np.linspace(-1, 1, 5), np.linspace(-1, 1, 5)), np.zeros((5, 5))], axis=-1)
    for camera in ("top", "oblique", "side"):
        path = tmp_path / f"{camera}.png"
        yarn_picture(path, [wave(0.2), wave(-0.2, yarn=1)], 0.08, surface=grid, camera=camera, size=(240, 180))
        assert imread(path).shape[:2] == (180, 240)
        assert 0.05 < ink(path) < 0.98
    assert capfd.readouterr() == ("", "")


def test_frames_side_by_side(renderer: None, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    positions, triangles = sheet()
    vertices, faces = ball()
    moment = Moment(0.0, cloth=positions, bodies=0.3 * vertices - [0, 0, 0.5])
    one = Animation(np.zeros(1), lambda _: moment, Surface(triangles), bodies=Surface(faces))
    frames_picture(tmp_path / "one.png", one, size=(240, 180), titles=["end"])
    frames_picture(tmp_path / "all.png", replace(one, times=np.arange(3.0), numbers=()), columns=2, size=(200, 150))
    assert ink(tmp_path / "one.png") > 0.1
    assert imread(tmp_path / "all.png").shape[:2] == (300, 400)
    assert capfd.readouterr() == ("", "")


def test_bad_input_is_one_line(tmp_path: Path) -> None:
    broken = Curve(np.full((4, 3), np.nan))
    with pytest.raises(InputError, match="finite"):
        yarn_picture(tmp_path / "a.png", [broken], 0.1)
    with pytest.raises(InputError, match="radius"):
        yarn_picture(tmp_path / "a.png", [wave(0.1)], -1.0)
    assert list(tmp_path.iterdir()) == []


def test_unwritable_picture(renderer: None, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="cannot be written"):
        yarn_picture(tmp_path / "missing" / "a.png", [wave(0.1)], 0.1, size=(80, 60))
