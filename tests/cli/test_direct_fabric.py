"""The command ``fabric --method direct``."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from yarnscale.cli import main
from yarnscale.files.curve_frames import read_curve_frames

SMALL = ["fabric", "plain", "--rows", "2", "--columns", "2", "--method", "direct", "--json"]


def _numbers(capsys: pytest.CaptureFixture[str], *options: str) -> dict[str, object]:
    assert main([*SMALL, *options]) == 0
    return json.loads(capsys.readouterr().out)


def test_count_simulates_nothing(capsys: pytest.CaptureFixture[str]) -> None:
    counts = _numbers(capsys, "--count")
    # 2 × 2 periods of two ends and two picks, 8 vertices each: an open yarn of n vertices has n − 1 twists.
    assert counts["vertices"] == 128 and counts["yarns"] == 8
    assert counts["dofs"] == counts["unknowns"] == 3 * 128 + 128 - 8


@pytest.mark.parametrize("scene", ["hang", "stretch", "drape"])
def test_a_scene_writes_its_frames_and_numbers(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, scene: str
) -> None:
    options = ("--scene", scene, "--duration", "0.0666", "--time-step", "0.0333", "--out", str(tmp_path))
    numbers = _numbers(capsys, *options)
    assert numbers["steps"] == 2 and numbers["passages"] == 0
    assert numbers["simulated_seconds"] == pytest.approx(0.0666)
    assert 0 <= float(str(numbers["penetration"])) < 0.6 and 0 <= float(str(numbers["extension"])) < 0.5
    assert ("force" in numbers) == (scene == "stretch")
    frames = read_curve_frames(tmp_path)
    assert len(frames.paths) == 3 and len(frames.curves) == 8
    last, radii = frames.points(2)
    assert np.isfinite(last).all() and (radii == 1e-3).all()


def test_a_knitted_piece_is_one_yarn(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    piece = [
        "fabric",
        "stockinette",
        "--rows",
        "2",
        "--columns",
        "3",
        "--method",
        "direct",
        "--border",
        "knitted",
    ]
    options = [
        "--scene",
        "stretch",
        "--direction",
        "wale",
        "--stretch",
        "0.05",
        "--json",
        "--out",
        str(tmp_path),
    ]
    assert main([*piece, *options, "--duration", "0.0666", "--time-step", "0.0333"]) == 0
    numbers = json.loads(capsys.readouterr().out)
    assert numbers["yarns"] == 1 and numbers["passages"] == 0
    assert float(str(numbers["penetration"])) < 0.3
    assert main(["fabric", "plain", *piece[2:], "--count"]) == 2
    assert "knit and purl" in capsys.readouterr().err


def test_what_makes_no_sense_is_said_in_one_line(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    assert main([*SMALL, "--scene", "hang"]) == 2
    assert "--out" in capsys.readouterr().err
    assert main([*SMALL, "--scene", "stretch", "--stretch", "nan", "--out", str(tmp_path)]) == 2
    assert "stretch" in capsys.readouterr().err
    assert main(["fabric", "jersey", "--rows", "4", "--columns", "4", "--scene", "drape", "--count"]) == 2
    assert "--scene" in capsys.readouterr().err
