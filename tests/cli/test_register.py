"""``yarnscale register``: what it writes, goes on from, and refuses."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from yarnscale.drawing import library
from yarnscale.files.patterns import read_pattern
from yarnscale.swatches.registration.curves import YarnCurves


@pytest.fixture(scope="module")
def pictures(lit_picture: Callable[..., np.ndarray], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with both sides of stockinette, six pixels for a radius of 0.5 mm."""
    folder = tmp_path_factory.mktemp("pictures")
    true = YarnCurves.of(library.build("stockinette", radius=1.0, wale_spacing=8.4, loop_height=8.0))
    for side in ("front", "back"):
        Image.fromarray(np.clip(lit_picture(true, side), 0, 255).astype(np.uint8)).save(
            folder / f"{side}.png"
        )
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
        return refused(
            "register", "--no-page", *[item for pair in options.items() for item in pair if pair[1]]
        )

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
