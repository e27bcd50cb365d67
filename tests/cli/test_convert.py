"""The command ``convert``: which frames, how large, and what an interruption leaves."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from yarnscale.cli.values import frames
from yarnscale.errors import InputError
from yarnscale.files.animation import read_animation
from yarnscale.files.curve_frames import CurveFolder, CurveSet
from yarnscale.motion.obstacles import MeshObstacle


@pytest.fixture
def run_of_yarns(tmp_path: Path) -> Path:
    """Frames 3 to 9 of a yarn that rises, beside a body that stands still."""
    points = np.column_stack([np.linspace(0, 0.1, 40), np.zeros(40), np.zeros(40)])
    body = np.eye(3) * 0.01, np.array([[0, 1, 2]])
    folder = CurveFolder(tmp_path / "run", CurveSet([0, 40], 1e-3), obstacles=[MeshObstacle(*body)])
    for number in range(3, 10):
        folder.write(number, points + np.array([0, 0, 0.01 * number]), 0.1 * number)
    return tmp_path / "run"


@pytest.mark.parametrize(
    ("text", "chosen"),
    [
        ("4:6", [4, 5, 6]), ("3:9:3", [3, 6, 9]), (":4", [3, 4]), ("8:", [8, 9]), ("::4", [3, 7]), ("5", [5]),
        ("-1", [9]), ("-3:-2", [7, 8]), ("0:100:2", [4, 6, 8]),
    ],
)  # fmt: skip
def test_frames_are_chosen_by_their_numbers(text: str, chosen: list[int]) -> None:
    assert frames(text).of(range(3, 10)) == chosen


def test_what_is_no_choice_of_frames_is_refused() -> None:
    for text in ("", "a", "1:2:0", "1:2:-1", "1:2:3:4", "1.5"):
        with pytest.raises(argparse.ArgumentTypeError):
            frames(text)
    with pytest.raises(InputError, match="expected some of 3 to 9; found 12 to 20"):
        frames("12:20").of(range(3, 10))


def test_files_bear_the_numbers_of_their_frames(run: Callable, run_of_yarns: Path, tmp_path: Path) -> None:
    out = tmp_path / "obj"
    assert run("convert", run_of_yarns, "--format", "obj", "--out", out, "--frames", "5:9:2").status == 0
    assert sorted(path.name for path in out.glob("frame_*")) == [f"frame_{n:04d}.obj" for n in (5, 7, 9)]
    text = (out / "frame_0007.obj").read_text()
    assert "o bodies" in text and "0.07" in text


def test_tubes_of_one_frame_fit_into_their_size(
    run: Callable, refused: Callable[..., str], run_of_yarns: Path, tmp_path: Path
) -> None:
    call = ("convert", run_of_yarns, "--format", "gltf", "--out", tmp_path / "a.glb")
    outcome = run(*call)
    assert "frame 9 of 3 to 9; --frames" in outcome.err and "MB: tubes of 8 sides" in outcome.err
    assert "1 frame," in outcome.out
    fine = (tmp_path / "a.glb").stat().st_size
    run(*call, "--megabytes", 0.005)
    assert (tmp_path / "a.glb").stat().st_size < 0.8 * fine
    assert "tubes of these yarns are larger than asked" in run(*call, "--megabytes", 1e-5).err
    assert "7 frames" in run(*call, "--yarns-as", "lines").out


def test_an_interruption_says_what_is_left(
    run: Callable, run_of_yarns: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("yarnscale.files.gltf._Gltf.write", _interrupt)
    outcome = run("convert", run_of_yarns, "--format", "gltf", "--out", tmp_path / "a.glb")
    assert outcome.status == 130 and "nothing is kept of" in outcome.err
    assert not list(tmp_path.glob("*.glb"))


def _interrupt(*_: object) -> None:
    raise KeyboardInterrupt


def test_bodies_beside_yarns_stand_still(run_of_yarns: Path) -> None:
    animation = read_animation(run_of_yarns).among([4, 6])
    assert animation.bodies is not None and list(animation.numbers) == [4, 6]
    np.testing.assert_allclose(animation.times, [0.4, 0.6])
    for moment in animation:
        np.testing.assert_array_equal(moment.bodies, np.eye(3) * 0.01)
