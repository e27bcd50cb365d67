"""The gallery relaxes and draws what it is asked for."""

from __future__ import annotations

from pathlib import Path

import pytest

from yarnscale.errors import InputError
from yarnscale.kinematics import ShellStrain
from yarnscale.show.canvas import PicturesUnavailable, require_renderer
from yarnscale.show.gallery import write_gallery


def test_a_page_of_two_patterns(tmp_path: Path) -> None:
    try:
        require_renderer()
    except PicturesUnavailable as missing:
        pytest.skip(str(missing))
    states = {"at rest": ShellStrain(), "pulled": ShellStrain(s_x=0.1)}
    exhibits = write_gallery(tmp_path, names=["stockinette", "plain"], states=states, size=(160, 120))
    assert [exhibit.pattern.name for exhibit in exhibits] == ["stockinette", "plain"]
    assert all(state.converged for exhibit in exhibits for state in exhibit.states.values())
    assert len(list(tmp_path.glob("*.png"))) == 6
    page = (tmp_path / "index.html").read_text(encoding="utf-8")
    assert "Over one, under one." in page
    assert page.count('data-pane="pane-') == 2 and '<div class="stage">\n<img' in page and len(page) < 10_000_000
    assert "Chart k;" in page


def test_unknown_patterns_are_answered(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="unknown pattern"):
        write_gallery(tmp_path, names=["lace"])
