"""``gallery`` draws what it is asked for and says what went wrong."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from yarnscale.show.canvas import PicturesUnavailable, require_renderer


@pytest.fixture
def renderer() -> None:
    try:
        require_renderer()
    except PicturesUnavailable as missing:
        pytest.skip(str(missing))


def test_a_page_with_its_pictures_and_progress(run, renderer: None, tmp_path: Path) -> None:
    outcome = run("gallery", "plain", "plain", "--as-drawn", "--out", tmp_path, "--json")
    assert outcome.status == 0
    assert json.loads(outcome.out) == {"patterns": ["plain"], "failed": []}
    assert "gallery: 1/1 in" in outcome.err
    assert sorted(path.name for path in tmp_path.glob("[!.]*")) == ["index.html"] + [f"plain-{k}.png" for k in range(4)]


def test_charts_are_drawn_too(run, refused, renderer: None, tmp_path: Path) -> None:
    chart, out = tmp_path / "own.chart", tmp_path / "page"
    chart.write_text("kind = weave\nrows:\nx.\n.x\n")
    outcome = run("gallery", chart, "plain", "--as-drawn", "--workers", 2, "--out", out, "--json")
    assert json.loads(outcome.out) == {"patterns": ["own", "plain"], "failed": []}
    assert "Chart file own.chart" in (out / "index.html").read_text(encoding="utf-8")
    assert sorted(path.name for path in out.glob("own*.png")) == [f"own-{k}.png" for k in range(4)]


def test_unknown_names_are_refused_before_anything_is_drawn(refused, tmp_path: Path) -> None:
    out = tmp_path / "page"
    assert "unknown pattern" in refused("gallery", "plain", "lace", "--out", out)
    assert not out.exists()
