"""Knitted patterns: loops interlock as a chart says."""

from __future__ import annotations

import numpy as np
import pytest

from yarnscale.errors import InputError
from yarnscale.files.pyp import read_pyp
from yarnscale.yarn.clearance import closest_approach
from yarnscale.yarn.knit import knit
from yarnscale.yarn.library import build, names, parameter_names
from yarnscale.yarn.pattern import YarnPattern

KNITS = ["stockinette", "garter", "rib-1x1", "rib-2x2", "seed"]


def crossing_words(pattern: YarnPattern) -> list[str]:
    """For each yarn, one letter per crossing in the order along the yarn: O(ver) or U(nder), seen from +z."""
    edge, start = pattern.edge_vectors(), pattern.vertices
    found: list[list[tuple[float, str]]] = [[] for _ in pattern.yarns]
    spread = np.ceil(np.ptp(start[:, :2], axis=0) / pattern.period).astype(int) + 1
    for a in range(-spread[0], spread[0] + 1):
        for b in range(-spread[1], spread[1] + 1):
            offset = np.array([a * pattern.period[0], b * pattern.period[1], 0.0])
            gap = (start + offset)[None, :, :] - start[:, None, :]
            d, e = edge[:, None, :], edge[None, :, :]
            with np.errstate(divide="ignore", invalid="ignore"):
                s = (gap[..., 0] * e[..., 1] - gap[..., 1] * e[..., 0]) / (
                    d[..., 0] * e[..., 1] - d[..., 1] * e[..., 0]
                )
                u = (gap[..., 0] * d[..., 1] - gap[..., 1] * d[..., 0]) / (
                    d[..., 0] * e[..., 1] - d[..., 1] * e[..., 0]
                )
            for i, k in np.argwhere((s >= 0) & (s < 1) & (u >= 0) & (u < 1)):
                rise = gap[i, k, 2] + u[i, k] * edge[k, 2] - s[i, k] * edge[i, 2]
                if i == k or (pattern.next_vertex[i] == k) or (pattern.next_vertex[k] == i):
                    continue
                place = float(pattern.position_along_yarn[i] + s[i, k])
                found[pattern.yarn_of_vertex[i]].append((place, "U" if rise > 0 else "O"))
    return ["".join(letter for _, letter in sorted(row)) for row in found]


def same_cycle(word: str, other: str) -> bool:
    """Whether two words are the same up to where they begin."""
    return len(word) == len(other) and word in other + other


def stitch(own: int, above: int) -> str:
    """Crossings along one stitch: left leg up, right leg down."""
    leg = "".join("O" if sign > 0 else "U" for sign in (-own, own, above, -above))
    return leg + leg[::-1]


def test_stockinette_interlocks_as_the_published_one(shared) -> None:
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
    ],
)
def test_loops_are_drawn_through_as_the_chart_says(name: str, chart: list[str]) -> None:
    """A knit is drawn through from behind, a purl from the front, with the row above's stitch at its head."""
    sign = {"k": 1, "p": -1}
    words = crossing_words(build(name))
    for row, word in enumerate(words):
        above = chart[(row + 1) % len(chart)]
        expected = "".join(
            stitch(sign[own], sign[next_row]) for own, next_row in zip(chart[row], above, strict=True)
        )
        assert same_cycle(word, expected)


def test_purl_is_knit_seen_from_behind() -> None:
    front, back = knit(["k"]), knit(["p"])
    assert np.allclose(front.vertices * [1, 1, -1], back.vertices)


@pytest.mark.parametrize("name", names())
def test_library_patterns_have_room_and_even_edges(name: str) -> None:
    pattern = build(name)
    share = closest_approach(pattern).distance / (2 * pattern.radius)
    assert 0.85 < share < 1.05
    edge = pattern.rest_length / pattern.radius
    assert edge.min() > 0.8
    assert edge.max() < 1.2
    tangent = pattern.edge_vectors() / np.linalg.norm(pattern.edge_vectors(), axis=1)[:, None]
    bend = np.degrees(np.arccos((tangent[pattern.previous_vertex] * tangent).sum(axis=1).clip(-1, 1)))
    assert bend.max() < 75.0
    assert pattern.name == name


@pytest.mark.parametrize("name", KNITS)
@pytest.mark.parametrize("vertices_per_stitch", [20, 40])
def test_the_number_of_vertices_is_free(name: str, vertices_per_stitch: int) -> None:
    pattern = build(name, vertices_per_stitch=vertices_per_stitch, radius=2e-4)
    wales = round(pattern.period[0] / pattern.radius / {"stockinette": 8.0, "seed": 9.0}.get(name, 8.5))
    assert all(len(chain) == vertices_per_stitch * wales for chain in pattern.yarns)
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
        (["k"], {"half_thickness": 0}, "half_thickness must be positive"),
    ],
)
def test_impossible_knits_are_named(chart, options: dict[str, float], message: str) -> None:
    with pytest.raises(InputError, match=message):
        knit(chart, **options)


def test_the_library_names_what_it_does_not_know() -> None:
    with pytest.raises(InputError, match=r"unknown pattern; expected stockinette, .*; found 'lace'"):
        build("lace")
    with pytest.raises(
        InputError, match="unknown parameter colour of pattern seed; expected radius, wale_spacing"
    ):
        build("seed", colour="red")
    assert "warp_spacing" in parameter_names("plain")
