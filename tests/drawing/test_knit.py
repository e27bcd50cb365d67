"""Knitted patterns: loops interlock as a chart says."""

from __future__ import annotations

import numpy as np
import pytest

from yarnscale.drawing.knit import knit
from yarnscale.drawing.library import build, parameter_names
from yarnscale.errors import InputError
from yarnscale.files.pyp import read_pyp
from yarnscale.yarn.clearance import closest_approach

KNITS = ["stockinette", "garter", "rib-1x1", "rib-2x2", "seed"]


def stitch(own: int, above: int) -> str:
    """Crossings along one stitch: left leg up, right leg down."""
    leg = "".join("O" if sign > 0 else "U" for sign in (-own, own, above, -above))
    return leg + leg[::-1]


def test_stockinette_interlocks_as_the_published_one(shared, crossing_words, same_cycle) -> None:
    published = read_pyp(shared / "reference" / "stockinette.pyp")
    for word in crossing_words(published):
        assert same_cycle(word, crossing_words(build("stockinette"))[0] * 2)
    assert crossing_words(build("stockinette")) == ["UOOUUOOU"]


@pytest.mark.parametrize(
    ("name", "chart"),
    [
        ("garter", ["k", "p"]),
        ("rib-1x1", ["kp"]),
        ("rib-2x2", ["kkpp"]),
        ("seed", ["kp", "pk"]),
        ("moss", ["kp", "kp", "pk", "pk"]),
        ("links", ["k", "p"]),
    ],
)
def test_loops_are_drawn_through_as_the_chart_says(name: str, chart: list[str], crossing_words, same_cycle) -> None:
    """A knit is drawn through from behind, a purl from the front, with the row above's stitch at its head."""
    sign = {"k": 1, "p": -1}
    words = crossing_words(build(name))
    for row, word in enumerate(words):
        above = chart[(row + 1) % len(chart)]
        expected = "".join(stitch(sign[own], sign[next_row]) for own, next_row in zip(chart[row], above, strict=True))
        assert same_cycle(word, expected)


def test_purl_is_knit_seen_from_behind() -> None:
    front, back = knit(["k"]), knit(["p"])
    assert np.allclose(front.vertices * [1, 1, -1], back.vertices)


@pytest.mark.parametrize("name", KNITS)
@pytest.mark.parametrize("vertices_per_stitch", [20, 40])
def test_the_number_of_vertices_is_free(name: str, vertices_per_stitch: int) -> None:
    pattern = build(name, vertices_per_stitch=vertices_per_stitch, radius=2e-4)
    wales = round(pattern.period[0] / pattern.radius / {"stockinette": 8.0, "seed": 9.0}.get(name, 8.5))
    assert all(len(chain) == vertices_per_stitch * wales for chain in pattern.yarns)
    if vertices_per_stitch == 40:
        assert closest_approach(pattern).distance > 0.8 * 2 * pattern.radius


@pytest.mark.parametrize(
    ("chart", "options", "message"),
    [
        ([], {}, "chart has the wrong number of rows"),
        (["kp", "k"], {}, "chart row 2 has another length; expected 2 stitches as in row 1; found 1"),
        (["kx"], {}, "chart row 1 column 2: unknown stitch; expected k, p, t, b, f, -; found 'x'"),
        ([""], {}, "chart row 1 is no row of stitches"),
        (["k"], {"loop_height": 2.0}, "loops of this size do not interlock"),
        (["k"], {"wale_spacing": 4.0, "overhang": 1.0}, "overlap at this stitch size"),
        (["kt", "kk"], {"overhang": 2.0}, "loop_height and overhang shape plain loops only"),
        (["kt", "kk"], {"wale_spacing": 3.0, "course_spacing": 2.0}, "overlap at this stitch size"),
        (["kk"], {"yarns": ["A", "B"]}, "yarns has the wrong length; expected 1 kinds of yarn; found 2"),
        (["kk"], {"yarns": ["ABC"]}, "yarns entry 1 is no kind of yarn; expected 1 to 2 letters"),
        (["kkkt" * 8] * 33, {}, "never knitted"),
        (["kkkb" * 9, "kbkk" * 9] * 16, {}, "chart is too large; expected at most 1024 stitches"),
        (["k"], {"half_thickness": 0}, "half_thickness must be positive"),
    ],
)
def test_impossible_knits_are_named(chart, options: dict[str, float], message: str) -> None:
    with pytest.raises(InputError, match=message):
        knit(chart, **options)


def test_the_library_names_what_it_does_not_know() -> None:
    with pytest.raises(InputError, match=r"unknown pattern; expected stockinette, .*; found 'lace'"):
        build("lace")
    with pytest.raises(InputError, match="unknown parameter colour of pattern seed; expected radius, wale_spacing"):
        build("seed", colour="red")
    assert "warp_spacing" in parameter_names("plain")


def test_plated_yarns_lie_side_by_side_and_are_numbered() -> None:
    pattern = knit(["k", "k"], wale_spacing=10, course_spacing=6.5, yarns=["AB", "B"])
    assert pattern.yarn_material is not None
    assert pattern.yarn_material.tolist() == [0, 1, 1]
    assert closest_approach(pattern).distance > 0.9 * 2e-3
    front, behind = pattern.vertices[pattern.yarns[0]], pattern.vertices[pattern.yarns[1]]
    assert front[:, 2].mean() > behind[:, 2].mean() + 0.5e-3
