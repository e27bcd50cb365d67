"""``yarnscale register``: what it writes, goes on from, and refuses."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import urllib.request
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import yarnscale
from yarnscale.drawing import library
from yarnscale.files.patterns import read_pattern
from yarnscale.swatches.registration.curves import YarnCurves
from yarnscale.swatches.registration.registration import Registration


@pytest.fixture(scope="module")
def pictures(lit_picture: Callable[..., np.ndarray], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with both sides of stockinette, six pixels for a radius of 0.5 mm."""
    folder = tmp_path_factory.mktemp("pictures")
    true = YarnCurves.of(library.build("stockinette", radius=1.0, wale_spacing=8.4, loop_height=8.0))
    for side in ("front", "back"):
        Image.fromarray(np.clip(lit_picture(true, side), 0, 255).astype(np.uint8)).save(folder / f"{side}.png")
    return folder


def _command(pictures: Path, out: Path, *more: object) -> tuple[object, ...]:
    sides = ("--front", pictures / "front.png", "--back", pictures / "back.png")
    return ("register", *sides, "--chart", "stockinette", "--out", out, "--no-page", *more)


def test_a_pattern_and_its_counts(run, pictures: Path, tmp_path: Path) -> None:
    out = tmp_path / "found.json"
    done = run(*_command(pictures, out, "--scale", "12px/mm", "--json"))
    assert done.status == 0, done.err
    found = json.loads(done.out)
    assert found["wales_per_cm"] == pytest.approx(10 / 4.2, rel=0.02)
    assert found["courses_per_cm"] == pytest.approx(10 / 2.25, rel=0.02)
    pattern = read_pattern(out)
    assert pattern.radius == pytest.approx(0.5e-3, rel=0.08) and pattern.name == "found"
    again = run(*_command(pictures, out, "--scale", "12 px/mm"))
    assert again.status == 0 and "going on from here" in again.err
    other = run(*_command(pictures, out, "--scale", "13 px/mm"))
    assert other.status == 2 and "state of another registration" in other.err
    other = run(*_command(pictures, out, "--scale", "12 px/mm", "--radius", "0.0005"))
    assert other.status == 2 and "--radius and --period" in other.err


def test_the_page_of_a_command_that_was_killed_goes_on(pictures: Path, tmp_path: Path) -> None:
    out = tmp_path / "out.json"
    scale = ("--scale", "12px/mm")
    words = [str(word) for word in _command(pictures, out, *scale) if word != "--no-page"]
    environment = os.environ | {"PYTHONPATH": str(Path(yarnscale.__file__).parents[1])}

    def started() -> tuple[subprocess.Popen[str], str]:
        command = [sys.executable, "-m", "yarnscale", *words]
        process = subprocess.Popen(command, stderr=subprocess.PIPE, stdout=subprocess.PIPE, text=True, env=environment)
        assert process.stderr is not None
        lines = iter(process.stderr.readline, "")
        return process, next(line.split()[0] for line in lines if line.startswith("http://127.0.0.1:"))

    def ask(address: str, name: str, **request: object) -> dict:
        headers = {"Content-Type": "application/json"}
        made = urllib.request.Request(address + name, json.dumps(request).encode(), headers)
        return json.loads(urllib.request.urlopen(made, timeout=60).read())

    process, address = started()
    place = ask(address, "undo")["sides"]["front"]["controls"][2]
    told = ask(address, "move", side="front", point=2, place=[place[0] + 1.0, place[1]])
    assert told["pins"] == [2]
    process.kill()
    process.communicate()
    assert not out.exists()
    process, address = started()
    assert ask(address, "finish")["pins"] == [2]
    assert process.wait(60) == 0 and "1 points" in process.communicate()[0]
    assert read_pattern(out).radius == pytest.approx(0.5e-3, rel=0.08)


def test_traced_curves_need_their_size(run, refused, tmp_path: Path) -> None:
    traced = tmp_path / "traced.csv"
    true = YarnCurves.of(library.build("plain", radius=1.0))
    state, rows = Registration(true, {}, 1.0), ["side,curve,x,y"]
    for side, turn in (("front", 1.0), ("back", -1.0)):
        seen = state.seen(side)
        runs = np.split(np.arange(len(seen)), np.flatnonzero(np.diff(seen.astype(int))) + 1)
        for number, part in enumerate(part for part in runs if seen[part[0]] and len(part) > 1):
            rows += [f"{side},{number},{turn * x},{y}" for x, y in true.samples[part, :2]]
    traced.write_text("\n".join(rows))
    out = tmp_path / "out.json"
    command = ("register", "--traced", traced, "--chart", "plain", "--out", out)
    size = f"{true.period[0]}x{true.period[1]}"
    assert "--radius is missing" in refused(*command, "--period", size)
    assert "period of the traced curves is unknown" in refused(*command, "--radius", "0.001")
    for more in (["--no-page"], ["--port", "8000"], ["--overwrite"], ["--scale", "600dpi"]):
        assert f"{more[0]};" in refused(*command, "--radius", "0.001", *more)
    assert not out.exists()
    assert run(*command, "--radius", "0.001", "--period", size).status == 0
    assert read_pattern(out).period == pytest.approx(1e-3 * true.period)


def test_what_is_refused_in_one_line(refused, pictures: Path, tmp_path: Path) -> None:
    out = tmp_path / "out.json"
    text = tmp_path / "text.png"
    text.write_text("no picture at all")
    cut = tmp_path / "cut.png"
    cut.write_bytes((pictures / "front.png").read_bytes()[:2000])
    small, grey, noise = (tmp_path / f"{name}.png" for name in ("small", "grey", "noise"))
    Image.new("L", (20, 300)).save(small)
    Image.new("L", (200, 200), 77).save(grey)
    Image.fromarray(np.random.default_rng(0).integers(0, 255, (200, 200), np.uint8)).save(noise)
    yarns = tmp_path / "yarns.json"
    chart = tmp_path / "broken.chart"
    chart.write_text("kind = knit\nrows:\nkq\n")
    run_on = {"--front": pictures / "front.png", "--chart": "stockinette", "--scale": "12px/mm", "--out": out}

    def told(**changed: object) -> str:
        options = run_on | {f"--{name}": value for name, value in changed.items()}
        return refused("register", "--no-page", *[item for pair in options.items() for item in pair if pair[1]])

    assert "text.png: file is no picture" in told(front=text)
    assert "no_such.png: picture cannot be read" in told(front=tmp_path / "no_such.png")
    assert "cut.png: picture" in told(front=cut)
    assert "size of the picture" in told(front=small)
    assert "of one brightness" in told(front=grey)
    assert "nothing repeats along the course" in told(front=noise)
    assert "scale of the pictures is unknown; expected --scale" in told(scale=None)
    assert "expected 40px/mm" in told(scale="fine")
    assert "expected WxH in mm" in told(period="0x3")
    assert "broken.chart:3:2" in told(chart=chart)
    yarns.write_text("{}")
    assert "expected a .chart, .wif or .k file" in told(chart=yarns)
    assert "unknown file type" in told(out=tmp_path / "out.txt")
    assert "a file in a folder that exists" in told(out=tmp_path / "nowhere" / "out.json")
    assert not list(tmp_path.glob("out*"))
