"""The command ``fabric --method direct``."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

import yarnscale
from yarnscale.cli import main
from yarnscale.files.curve_frames import read_curve_frames
from yarnscale.shell.mesh import rectangle

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
def test_a_scene_writes_its_frames_and_numbers(capsys: pytest.CaptureFixture[str], tmp_path: Path, scene: str) -> None:
    options = ("--scene", scene, "--duration", "0.0666", "--time-step", "0.0333", "--out", str(tmp_path))
    numbers = _numbers(capsys, *options)
    assert numbers["steps"] == 2 and numbers["passages"] == 0
    assert numbers["simulated_seconds"] == pytest.approx(0.0666)
    assert 0 <= float(str(numbers["penetration"])) < 0.6 and 0 <= float(str(numbers["extension"])) < 0.5
    assert ("force" in numbers) == (scene == "stretch") == (numbers["centre_drop"] is None)
    assert ("centre_drop" in (tmp_path / "index.html").read_text()) == (scene != "stretch")
    frames = read_curve_frames(tmp_path)
    assert len(frames.paths) == 3 and len(frames.curves) == 8
    last, radii = frames.points(2)
    assert np.isfinite(last).all() and (radii == 1e-3).all()


def test_a_drawing_comes_to_rest_before_it_is_cut(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    """Plain weave as drawn is 5 % wider than it is at rest."""
    widths = []
    for k, extra in enumerate(((), ("--as-drawn",))):
        out = tmp_path / str(k)
        step = ("--duration", "0.001", "--time-step", "0.001", "--out", str(out))
        assert main([*SMALL, *extra, *step]) == 0
        captured = capsys.readouterr()
        assert ("settling plain" in captured.err) == (not extra)
        first, _ = read_curve_frames(out).points(0)
        widths.append(float(np.ptp(first[:, 0])))
    assert widths[0] < 0.98 * widths[1], widths


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
        "--amount",
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


def test_yarns_on_a_mesh_and_in_a_tube(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    """A bent strip of 60 × 32 mm: its yarns lie on the mesh at first."""
    mesh = rectangle(0.06, 0.032, 0.004)
    angle = mesh.material[:, 0] / 0.05
    bent = np.stack([0.05 * np.sin(angle), mesh.material[:, 1], 0.05 * np.cos(angle)], axis=1)
    lines = [f"v {x:.9f} {y:.9f} {z:.9f}" for x, y, z in bent]
    lines += [f"vt {x:.9f} {y:.9f}" for x, y in mesh.material]
    lines += ["f " + " ".join(f"{v + 1}/{v + 1}" for v in corner) for corner in mesh.triangles]
    path = tmp_path / "strip.obj"
    path.write_text("\n".join(lines))
    base = [
        "fabric",
        "stockinette",
        "--method",
        "direct",
        "--duration",
        "0.0333",
        "--time-step",
        "0.0333",
        "--json",
    ]
    assert main([*base, "--on", str(path), "--out", str(tmp_path / "on")]) == 0
    numbers = json.loads(capsys.readouterr().out)
    assert numbers["passages"] == 0 and float(str(numbers["penetration"])) < 0.3
    first, _ = read_curve_frames(tmp_path / "on").points(0)
    out = np.hypot(first[:, 0], first[:, 2])
    assert np.abs(out - 0.05).max() < 2.5e-3
    assert main([*base, "--tube", "--rows", "2", "--columns", "12", "--out", str(tmp_path / "tube")]) == 0
    numbers = json.loads(capsys.readouterr().out)
    assert numbers["yarns"] == 2 and numbers["passages"] == 0
    assert main([*base, "--out", str(tmp_path / "none")]) == 2
    assert "--rows" in capsys.readouterr().err


@pytest.mark.parametrize(("step", "said"), [("0.0041667", False), ("0.0166667", True)])
def test_steps_too_long_for_light_fabric_are_said(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, step: str, said: bool
) -> None:
    run = [*SMALL, "--scene", "hang", "--duration", step, "--time-step", step, "--out", str(tmp_path)]
    assert main(run) == 0
    assert ("falls too slowly" in capsys.readouterr().err) == said
    assert ("falls too slowly" in (tmp_path / "index.html").read_text()) == said


def test_what_makes_no_sense_is_said_in_one_line(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    assert main([*SMALL, "--scene", "hang"]) == 2
    assert "--out" in capsys.readouterr().err
    assert main([*SMALL, "--scene", "stretch", "--amount", "9", "--out", str(tmp_path)]) == 2
    assert "stretch" in capsys.readouterr().err
    splines = ["fabric", "jersey", "--rows", "4", "--columns", "4", "--count"]
    for option in ("--friction", "--ball-friction"):
        assert main([*splines, option, "0.3"]) == 2
        assert option in capsys.readouterr().err
    for option, value in (("--amount", "0.1"), ("--direction", "wale"), ("--ball-friction", "0.3")):
        assert main([*SMALL, "--scene", "hang", option, value, "--out", str(tmp_path)]) == 2
        assert option in capsys.readouterr().err


@pytest.mark.parametrize(
    ("option", "value"),
    [
        ("--friction", "-1"),
        ("--duration", "nan"),
        ("--time-step", "0"),
        ("--damping", "inf"),
        ("--amount", "much"),
    ],
)
def test_numbers_out_of_range_are_told_before_anything_runs(
    capsys: pytest.CaptureFixture[str], option: str, value: str
) -> None:
    with pytest.raises(SystemExit) as ended:
        main([*SMALL, "--scene", "hang", option, value])
    assert ended.value.code == 2
    assert option in capsys.readouterr().err


def test_rods_move_in_a_volume(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    """The same scene with few unknowns; yarns stay between the control points' hulls, and grips pull harder."""
    run = ("--scene", "stretch", "--amount", "0.1", "--duration", "0.0666", "--time-step", "0.0333")
    whole = _numbers(capsys, *run, "--out", str(tmp_path / "whole"))
    within = ("--method", "volume", "--volume", "4,4,2")
    assert _numbers(capsys, *within, "--count")["reduced_unknowns"] == 96
    held = _numbers(capsys, *run, *within, "--out", str(tmp_path / "held"))
    assert held["steps"] == 2 and held["loose_steps"] == 0 and held["passages"] == 0
    assert float(str(held["force"])) > float(str(whole["force"])) > 0
    for refused in ("--explicit", "--adaptive"):
        assert main([*SMALL, *run, *within, refused, "--out", str(tmp_path / "none")]) == 2
        assert refused in capsys.readouterr().err


def test_explicit_steps_take_friction(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    run = ("--scene", "stretch", "--amount", "0.3", "--duration", "0.004", "--explicit")
    runs = [_numbers(capsys, *run, "--friction", mu, "--out", str(tmp_path / mu)) for mu in ("0", "0.5")]
    assert all(numbers["status"] == "converged" and numbers["passages"] == 0 for numbers in runs)
    assert runs[0]["extension"] != runs[1]["extension"]
    assert all(float(str(numbers["force"])) > 0.0 for numbers in runs)


def test_options_that_exclude_each_other_are_told(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    assert main([*SMALL, "--scene", "hang", "--on", "mesh.obj", "--out", str(tmp_path)]) == 2
    assert "--rows" in capsys.readouterr().err


def test_a_piece_of_tucks_and_two_beds_is_one_yarn_too(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    options = [
        "--rows",
        "2",
        "--columns",
        "2",
        "--method",
        "direct",
        "--border",
        "knitted",
        "--count",
        "--json",
    ]
    assert main(["fabric", "half-cardigan", *options]) == 0
    assert json.loads(capsys.readouterr().out)["yarns"] == 1
    striped = tmp_path / "stripes.chart"
    striped.write_text("kind = knit\nrows:\nkk : b\nkt : b\nkk : a\ntk : a\n", encoding="utf-8")
    assert main(["fabric", str(striped), *options]) == 0
    assert json.loads(capsys.readouterr().out)["yarns"] == 2
    assert main(["fabric", "plain", *options]) == 2
    assert "knitted piece" in capsys.readouterr().err


RESUMED = [
    "--as-drawn",
    "--scene",
    "stretch",
    "--amount",
    "0.3",
    "--duration",
    "0.2",
    "--time-step",
    "0.0333",
]


def test_a_killed_run_goes_on_and_ends_bit_by_bit_like_one_that_was_not(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    whole, broken = tmp_path / "whole", tmp_path / "Stoff mit Leerzeichen ü"
    first = _numbers(capsys, *RESUMED, "--out", str(whole))
    source = str(Path(yarnscale.__file__).parents[1])
    process = subprocess.Popen(
        [sys.executable, "-m", "yarnscale", *SMALL, *RESUMED, "--out", str(broken)],
        stderr=subprocess.PIPE, stdout=subprocess.DEVNULL, env=os.environ | {"PYTHONPATH": source},
    )  # fmt: skip
    while not (broken / "frame_0001.npz").exists() and process.poll() is None:
        time.sleep(0.002)
    process.send_signal(signal.SIGKILL)
    assert process.wait(60) == -signal.SIGKILL
    before = {path.name: path.stat().st_mtime_ns for path in broken.glob("frame_*.npz")}
    assert 2 <= len(before) < 7, "the run was to be killed in the middle"
    again = _numbers(capsys, *RESUMED, "--out", str(broken), "--resume")
    for name in first:
        if name != "seconds":
            assert again[name] == first[name], name
    same, other = read_curve_frames(whole), read_curve_frames(broken)
    np.testing.assert_array_equal(other.times, same.times)
    for number in same.paths:
        np.testing.assert_array_equal(other.points(number)[0], same.points(number)[0], err_msg=f"{number}")
    # Frames up to the checkpoint stayed as they were: at most the last one was written again.
    assert sum((broken / name).stat().st_mtime_ns != written for name, written in before.items()) <= 1


def test_resume_refuses_other_settings_and_folders_without_a_run(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    out, short = tmp_path / "run", ["--duration", "0.01", "--time-step", "0.01"]
    assert main([*SMALL, *short, "--out", str(out), "--resume"]) == 2
    said = capsys.readouterr().err
    assert "nothing to resume" in said and not out.exists()
    _numbers(capsys, *short, "--out", str(out))
    kept = {path: path.stat().st_mtime_ns for path in out.iterdir()}
    for other, named in (
        (["--damping", "2"], "another --damping"),
        (["--radius", "2e-3"], "another pattern"),
        (["--material", "acrylic"], "another yarn"),
        (["--method", "volume", "--scene", "stretch"], "another --method, another --scene"),
    ):
        assert main([*SMALL, *short, *other, "--out", str(out), "--resume"]) == 2
        (line,) = [line for line in capsys.readouterr().err.splitlines() if "error" in line]
        assert line.endswith(f"expected the settings that it began with; found {named}")
    assert {path: path.stat().st_mtime_ns for path in out.iterdir()} == kept
    assert main([*SMALL, *short, "--out", str(out)]) == 2
    assert "or --overwrite or --resume" in capsys.readouterr().err
    # A run that is over stays as it is.
    assert _numbers(capsys, *short, "--out", str(out), "--resume")["steps"] == 1


def test_a_scene_file_pulls_and_pushes_and_frames_hold_bodies_where_they_are(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    scene = tmp_path / "push.toml"
    scene.write_text(
        "gravity = [0, 0, 0]\n[schedule]\nduration = 0.0666\ntime_step = 0.0333\n"
        '[[handles]]\nname = "left"\nbox = [[-1, -1], [-0.003, 1]]\n'
        '[[handles]]\nname = "right"\nbox = [[0.003, -1], [1, 1]]\ndisplacement = [0.0005, 0, 0]\n'
        "duration = 0.05\nease = false\n"
        '[[obstacles]]\nshape = "sphere"\ncentre = [0, 0, 0.011]\nradius = 0.009\n'
        "displacement = [0, 0, -0.001]\nduration = 0.0666\nease = false\n"
    )
    out = tmp_path / "run"
    numbers = _numbers(capsys, "--as-drawn", "--scene", str(scene), "--out", str(out))
    assert numbers["steps"] == 2 and numbers["unfulfilled"] == [] and numbers["passages"] == 0
    frames = read_curve_frames(out)
    tops = []
    for number in frames.paths:
        bodies = frames.bodies(number)
        assert bodies is not None
        tops.append(bodies[:, 2].max() - 0.02)
    np.testing.assert_allclose(tops, [0.0, -0.0005, -0.001], atol=2e-6)
    first, last = frames.points(0)[0], frames.points(2)[0]
    assert np.ptp(last[:, 0]) - np.ptp(first[:, 0]) == pytest.approx(0.0005, abs=5e-5)
    assert last[:, 2].min() < first[:, 2].min() - 1e-4, "the ball pushes the middle down"
    for option, value in (("--damping", "2"), ("--duration", "1")):
        refused = ("--scene", str(scene), option, value, "--out", str(tmp_path / "none"))
        assert main([*SMALL, *refused]) == 2
        assert f"{option}; expected it in the scene file" in capsys.readouterr().err
    assert main([*SMALL, "--scene", "no.toml", "--out", str(tmp_path / "none")]) == 2
    assert "a scene file or hang, stretch, drape" in capsys.readouterr().err
