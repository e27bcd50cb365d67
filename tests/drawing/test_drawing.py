"""From chart to yarns: the lines cross as the chart says, and swelling lets nothing pass through."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import HealthCheck, given, seed, settings
from hypothesis import strategies as st

from yarnscale.drawing import library, swell
from yarnscale.drawing.curves import PeriodicCurve, pattern_from_curves
from yarnscale.drawing.knit import knit
from yarnscale.drawing.loop_paths import row_paths
from yarnscale.drawing.stitches import StitchChart
from yarnscale.drawing.swell import swollen
from yarnscale.errors import InputError
from yarnscale.yarn.clearance import closest_approach
from yarnscale.yarn.close_pairs import pair_gaps
from yarnscale.yarn.pattern import YarnPattern

CHARTS = [structure.chart for structure in library.STRUCTURES.values() if structure.chart]
OTHER_CHARTS = [
    ("kt", "kt", "kt", "kp"),
    ("kf", "p-", "tk", "kb", "kk"),
    ("kk", *["tk"] * 5),
    ("k", *["t"] * 7),
    ("k--p", "k-bt"),
    ("k-k|-p-",),
]
WALE, COURSE = 8.0, 5.0


def schematic(chart: StitchChart, edge: float) -> YarnPattern:
    """The schematic lines, sampled with edges of `edge` radii as swelling begins with them."""
    period = np.array([WALE * chart.wales, COURSE * chart.courses])
    curves = [PeriodicCurve(path * [WALE, COURSE, 1.1], (1, 0)) for path in row_paths(chart)]
    counts = [round(curve.length(period) / edge) for curve in curves]
    sampled = [curve.resampled(count, period) for curve, count in zip(curves, counts, strict=True)]
    return pattern_from_curves(sampled, period, 1.0)


@pytest.mark.parametrize("rows", [*CHARTS, *OTHER_CHARTS])
def test_lines_cross_as_the_chart_says(
    rows: tuple[str, ...],
    crossing_words: Callable[[YarnPattern], list[str]],
    same_cycle: Callable[[str, str], bool],
) -> None:
    """Also when sampled coarsely: no corner is cut off through another yarn."""
    chart = StitchChart.read(rows)
    lines = schematic(chart, 0.5 * min(1.0, 3.0 / max(1, chart.most_tucks)))
    for word, expected in zip(crossing_words(lines), chart.words, strict=True):
        assert same_cycle(word, expected)
    # One yarn above, one below: words that begin at another crossing would let two yarns meet.
    assert closest_approach(lines).distance > 0.1


@seed(7)
@settings(max_examples=40, deadline=None, derandomize=True, suppress_health_check=[HealthCheck.too_slow])
@given(st.data())
def test_any_chart_is_drawn_as_it_says(data: st.DataObject) -> None:
    """`row_paths` itself checks the number of crossings of every row."""
    width, height = data.draw(st.integers(1, 4)), data.draw(st.integers(1, 6))
    symbols = st.sampled_from("kkpptbf-")
    rows = ["".join(data.draw(symbols) for _ in range(width)) for _ in range(height)]
    try:
        chart = StitchChart.read(rows)
    except InputError:
        return
    for path, word in zip(row_paths(chart), chart.words, strict=True):
        assert np.abs(path[:, 2]).max() <= 1.0
        assert len(word) % 2 == 0


@pytest.mark.parametrize("rows", [("kt", "kk"), ("k-|-p", "-k|p-"), ("kk", "pf", "kk", "fp")])
def test_swelling_lets_no_yarn_through(rows: tuple[str, ...], monkeypatch: pytest.MonkeyPatch) -> None:
    """In every step, no listed pair comes closer than a part of its distance on the way."""
    steps = 0
    fraction_of = swell.safe_fraction

    def watched(nodes, moves, ends, first, second, share):
        nonlocal steps
        fraction = fraction_of(nodes, moves, ends, first, second, share)
        before = pair_gaps(nodes, ends, first, second)
        for part in (0.5, 1.0):
            after = pair_gaps(nodes + part * fraction * moves, ends, first, second)
            assert (after > 0.55 * before).all()
        steps += 1
        return fraction

    monkeypatch.setattr(swell, "safe_fraction", watched)
    knit(rows, wale_spacing=6.5, course_spacing=4.5)
    assert steps > 300


def test_swollen_loops_keep_their_crossings(
    crossing_words: Callable[[YarnPattern], list[str]], same_cycle: Callable[[str, str], bool]
) -> None:
    """Where the loops stay beside each other the plan keeps the chart's crossings to the end."""
    for rows in (["k"], ["kk", "pf", "kk", "fp"], ["kk", "kb"]):
        chart = StitchChart.read(rows)
        period = np.array([9.0 * chart.wales, 5.5 * chart.courses])
        curves = [PeriodicCurve(path * [9.0, 5.5, 1.1], (1, 0)) for path in row_paths(chart)]
        pattern = pattern_from_curves(swollen(curves, period), period, 1.0)
        for word, expected in zip(crossing_words(pattern), chart.words, strict=True):
            assert same_cycle(word, expected)


@pytest.mark.parametrize(
    ("rows", "sizes"),
    [
        (("kt", "kt", "kt", "kp"), (9.0, 6.0)),
        (("kf", "p-", "tk", "kb", "kk"), (9.0, 6.0)),
        (("kb", "kb", "kb", "kk"), (9.0, 5.0)),
        (("tk", "tk", "tk", "tk", "kk"), (9.0, 5.0)),
        (("k--k", "k-bk"), (9.0, 6.0)),
        (("kk-|-pp",), (5.5, 4.5)),
        (("k-k|-p-", "-k-|p-p"), (5.5, 4.0)),
    ],
)
def test_other_charts_find_room(rows: tuple[str, ...], sizes: tuple[float, float]) -> None:
    pattern = knit(rows, wale_spacing=sizes[0], course_spacing=sizes[1])
    assert closest_approach(pattern).distance > 0.9 * 2e-3
    edge = pattern.rest_length / pattern.radius
    assert 0.9 < edge.min() < edge.max() < 1.25


def test_drawing_is_repeatable() -> None:
    assert library.build("interlock").content_hash() == library.build("interlock").content_hash()
