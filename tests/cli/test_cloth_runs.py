"""Runs of scenes from the command line: killed and resumed, refused, converted."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import pyvista as pv

from yarnscale.cli import main
from yarnscale.files.cloth_frames import read_cloth_frames
from yarnscale.files.curve_frames import CurveFolder, CurveSet
from yarnscale.files.material_json import write_material
from yarnscale.shell.materials.orthotropic import OrthotropicMaterial
from yarnscale.show.canvas import PicturesUnavailable, require_renderer

SCENE = """
name = "flag"
material = "Stoff ü.json"
[mesh]
width = 0.1
height = 0.1
spacing = 0.0125
[schedule]
duration = {duration}
time_step = 0.01
frame_interval = 0.04
tolerance = 1e-6
[[handles]]
vertex = [-0.05, 0.05]
[[handles]]
vertex = [-0.05, -0.05]
[[obstacles]]
shape = "sphere"
centre = [0.0, 0.0, -0.03]
radius = 0.02
"""

PIN = """name = "driven"
vertex = [-0.05, 0.05]
displacement = [0.0, 0.0, -0.02]
duration = 0.02"""
PLANE = """[[obstacles]]
shape = "plane"
point = [0.0, 0.0, -0.005]
"""


@pytest.fixture(autouse=True, scope="module")
def renderer() -> None:
    try:
        require_renderer()
    except PicturesUnavailable as error:
        pytest.skip(str(error))


def written(folder: Path, duration: float, *, stretch: float = 60.0) -> Path:
    folder.mkdir(exist_ok=True)
    material = OrthotropicMaterial(
        stretch_weft=stretch,
        stretch_coupling=5.0,
        stretch_warp=90.0,
        shear=20.0,
        area=0.0,
        log_area=0.0,
        bend_weft=2e-5,
        bend_bias=1e-5,
        bend_warp=2e-5,
        density=0.2,
    )
    write_material(folder / "Stoff ü.json", material)
    path = folder / "flag.toml"
    path.write_text(SCENE.format(duration=duration), encoding="utf-8")
    return path


def test_a_killed_run_goes_on_and_ends_like_one_that_was_not(tmp_path: Path) -> None:
    scene = written(tmp_path / "Szene mit Leerzeichen ü", 0.24)
    whole, broken = tmp_path / "whole", tmp_path / "broken"
    assert main(["simulate", str(scene), "--out", str(whole)]) == 0
    command = [sys.executable, "-m", "yarnscale", "simulate", str(scene), "--out", str(broken)]
    process = subprocess.Popen(
        command, stderr=subprocess.PIPE, stdout=subprocess.DEVNULL, env=os.environ | {"PYTHONPATH": _source()}
    )
    while not (broken / "frames" / "frame_0002.npz").exists() and process.poll() is None:
        time.sleep(0.005)
    process.send_signal(signal.SIGKILL)
    _, said = process.communicate(timeout=60)
    assert process.returncode == -signal.SIGKILL, said.decode()
    before = {p.name: p.stat().st_mtime_ns for p in (broken / "frames").glob("frame_*.npz")}
    assert 3 <= len(before) < 7, "the run was to be killed in the middle"
    assert main(["simulate", str(scene), "--out", str(broken), "--resume"]) == 0
    same, other = read_cloth_frames(whole / "frames"), read_cloth_frames(broken / "frames")
    np.testing.assert_array_equal(other.times, same.times)
    for number in same.paths:
        np.testing.assert_allclose(
            other.state(number).positions, same.state(number).positions, atol=1e-6, err_msg=f"frame {number}"
        )
    # Frames up to the checkpoint stayed as they were: at most the last one was written again.
    after = {name: (broken / "frames" / name).stat().st_mtime_ns for name in before}
    assert sum(after[name] != before[name] for name in before) <= 1


def _source() -> str:
    import yarnscale

    return str(Path(yarnscale.__file__).parents[1])


def test_another_scene_is_not_resumed(tmp_path: Path, capsys) -> None:
    short = written(tmp_path / "scene", 0.05)
    out = tmp_path / "run"
    assert main(["simulate", str(short), "--out", str(out), "--json"]) == 0
    first = json.loads(capsys.readouterr().out)
    assert main(["convert", str(out), "--format", "gltf", "--out", str(out / "later.glb"), "--json"]) == 0
    capsys.readouterr()
    assert main(["simulate", str(short), "--out", str(out), "--resume", "--json"]) == 0
    assert (out / "later.glb").exists(), "nothing was added to the run"
    again = json.loads(capsys.readouterr().out)
    assert again["steps"] == first["steps"] and again["newton_iterations"] == first["newton_iterations"]
    written(short.parent, 0.05, stretch=61.0)
    frames = sorted((out / "frames").iterdir())
    assert main(["simulate", str(short), "--out", str(out), "--resume"]) == 2
    assert "another cloth" in capsys.readouterr().err
    assert sorted((out / "frames").iterdir()) == frames
    assert main(["simulate", str(short), "--out", str(out)]) == 2
    assert "expected a new folder, or --overwrite or --resume" in capsys.readouterr().err
    assert sorted((out / "frames").iterdir()) == frames


def test_a_run_owns_its_folder(tmp_path: Path, capsys) -> None:
    """A shorter run over a longer one leaves no frame, export or sequence of that, and all of the user's files."""
    scene, out = written(tmp_path / "scene", 0.08), tmp_path / "run"
    (scene.parent / "index.html").write_text("mine")
    assert main(["simulate", str(scene), "--out", str(scene.parent)]) == 2
    assert "index.html: output exists; expected a new folder, or --overwrite" in capsys.readouterr().err
    assert (scene.parent / "index.html").read_text() == "mine" and not (scene.parent / "frames").exists()
    exports = ["--format", "obj", "--format", "gltf", "--format", "vtk"]
    assert main(["simulate", str(scene), "--out", str(out), *exports]) == 0
    assert main(["convert", str(out), "--format", "gltf", "--out", str(out / "later.glb")]) == 0
    assert main(["convert", str(out), "--format", "obj", "--out", str(out / "sequence")]) == 0
    mine = {"notes.txt", "cloth.blend", "obj/mine.obj"}
    for name in mine:
        (out / name).write_text("mine")
    written(scene.parent, 0.04)
    assert main(["simulate", str(scene), "--out", str(out), "--overwrite"]) == 0
    left = {p.relative_to(out).as_posix() for p in out.rglob("*") if p.is_file() and p.name[0] != "."}
    frames = {"frames/frame_0000.npz", "frames/frame_0001.npz", "frames/mesh.npz", "frames/bodies.npz"}
    pictures = {"frames.png", "last.png", "index.html"}
    assert left == mine | frames | pictures | {"checkpoint.npz", "cloth_material.json", "last.obj"}


def test_a_pin_that_a_floor_stops_is_told(tmp_path: Path, capsys) -> None:
    scene = written(tmp_path / "scene", 0.03)
    text = scene.read_text(encoding="utf-8").replace("vertex = [-0.05, 0.05]", PIN)
    scene.write_text(text + PLANE, encoding="utf-8")
    assert main(["simulate", str(scene), "--out", str(tmp_path / "a"), "--json"]) == 1
    (found,) = json.loads(capsys.readouterr().out)["unfulfilled"]
    assert found["what"] == "handle 'driven'" and found["distance"] == pytest.approx(0.015, abs=1e-4)
    page = (tmp_path / "a" / "index.html").read_text(encoding="utf-8")
    assert "handle &#39;driven&#39; is off its prescribed place" in page
    scene.write_text("may_give_way = true" + scene.read_text(encoding="utf-8"), encoding="utf-8")
    assert main(["simulate", str(scene), "--out", str(tmp_path / "b")]) == 0
    assert "not carried out: handle 'driven' is off" in capsys.readouterr().out


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("run")
    out, scene = folder / "Lauf ü", written(folder / "scene", 0.08)
    assert main(["simulate", str(scene), "--out", str(out)]) == 0
    return out


# VTK counts groups of faces only, and then wonders about the lines.
@pytest.mark.filterwarnings("ignore:PolyData mesh is not valid")
def test_every_format_of_a_run(run: Path, tmp_path: Path) -> None:
    names = {
        "obj": "obj", "gltf": "a.glb", "usd": "a.usda", "vtk": "a.pvd", "mp4": "a.mp4", "png": "png", "bcc": "bcc"
    }  # fmt: skip
    frames = read_cloth_frames(run / "frames")
    yarns = CurveFolder(tmp_path / "yarns", CurveSet([0, 4], 1e-3))
    for number, moment in enumerate(frames.times):
        yarns.write(number, np.arange(12.0).reshape(4, 3), moment)
    for kind, name in names.items():
        if kind in ("usd", "mp4"):
            pytest.importorskip({"usd": "pxr", "mp4": "av"}[kind], reason="extra 'export'")
        out = ["--out", str(tmp_path / name), "--yarns", str(tmp_path / "yarns")]
        assert main(["convert", str(run), "--format", kind, *out]) == 0
    last = frames.state(2).positions
    obj: Any = pv.read(str(tmp_path / "obj" / "frame_0002.obj"))
    np.testing.assert_allclose(obj.points[: len(last)], last, atol=1e-6)
    assert len(list((tmp_path / "bcc").glob("*.bcc"))) == len(list((tmp_path / "png").glob("*.png"))) == 3


def test_a_movie_has_the_frames_of_its_time(run: Path, tmp_path: Path) -> None:
    av: Any = pytest.importorskip("av", reason="extra 'export'")
    path = tmp_path / "slow.mp4"
    arguments = ["--format", "mp4", "--fps", "25", "--speed", "0.25", "--colour", "stretch"]
    assert main(["convert", str(run / "frames"), *arguments, "--out", str(path)]) == 0
    with av.open(str(path)) as container:
        stream = container.streams.video[0]
        pictures = [frame.to_ndarray(format="rgb24") for frame in container.decode(stream)]
        assert stream.average_rate == 25
    # 0.08 s a quarter as fast, 25 pictures a second, both ends included.
    assert len(pictures) == 9
    changes = [np.abs(a.astype(int) - b).mean() > 0.1 for a, b in zip(pictures[1:], pictures[:-1], strict=True)]
    assert sum(changes) == 2, "three frames were simulated"


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["nowhere", "--format", "obj", "--out", "x"], "folder does not exist"),
        ([".", "--format", "obj", "--out", "x"], "folder holds no frames"),
        (["{run}", "--format", "bcc", "--out", "x"], "BCC files hold curves"),
        (["{run}", "--format", "usd", "--out", "x.obj"], "unknown file type"),
        (["{run}", "--format", "gltf", "--out", "no/such/folder/x.glb"], "cannot be written"),
        (["{run}", "--format", "obj", "--out", "/dev/null/x"], "cannot be written"),
    ],
)
def test_bad_input_is_one_line(run: Path, tmp_path: Path, monkeypatch, capsys, arguments, message) -> None:
    if "usd" in arguments:
        pytest.importorskip("pxr", reason="extra 'export'")
    (tmp_path / "empty").mkdir()
    monkeypatch.chdir(tmp_path / "empty")
    capsys.readouterr()
    assert main(["convert", *(a.format(run=run) for a in arguments)]) == 2
    error = capsys.readouterr().err
    assert message in error and error.count("\n") == 1


def test_without_the_extra_the_error_says_what_to_install(run: Path, tmp_path, monkeypatch, capsys) -> None:
    monkeypatch.setattr("yarnscale.cli.convert.find_spec", lambda name: None)
    for kind in ("usd", "mp4"):
        assert main(["convert", str(run), "--format", kind, "--out", str(tmp_path / f"a.{kind}")]) == 2
        assert "yarnscale[export]" in capsys.readouterr().err
