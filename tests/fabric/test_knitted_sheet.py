"""Pieces of knitting with borders: yarns knotted so that they do not unravel, that stay so when they are pulled."""

from __future__ import annotations

import functools
import math

import numpy as np
import pytest

from yarnscale.drawing import library
from yarnscale.drawing.knit import knit
from yarnscale.errors import InputError
from yarnscale.fabric.direct_energy import FabricEnergy
from yarnscale.fabric.direct_static import rod_equilibrium
from yarnscale.fabric.holds import Holds
from yarnscale.fabric.knitted_sheet import knitted_sheet, woven_in
from yarnscale.fabric.sheet import NO_PATTERN, YarnSheet
from yarnscale.yarn.material import YarnMaterial
from yarnscale.yarn.pattern import YarnPattern

SOFT = YarnMaterial.preset("hylc2020-stockinette")


@functools.cache
def _built(name: str, vertices: int | None = None) -> YarnPattern:
    """A built-in pattern; those with held stitches or two beds take a while to draw."""
    return library.build(name, vertices_per_stitch=vertices)


def _closed(points: np.ndarray) -> np.ndarray:
    """The yarn closed by a way around the piece."""
    low, high = points.min(axis=0) - 1.0, points.max(axis=0) + 1.0
    start, end = points[0], points[-1]
    way = [[low[0], start[1], 0.0]]
    if end[0] > 0.5 * (low[0] + high[0]):
        way = [[high[0], end[1], 0.0], [high[0], low[1], 0.0], [low[0], low[1], 0.0], *way]
    else:
        way = [[low[0], end[1], 0.0], *way]
    return np.concatenate([points, way])


def _log_determinant(points: np.ndarray) -> float:
    """ln of the determinant |Δ(−1)| of the knot (Fox's colourings): 0 for a yarn that can be pulled out straight."""
    ring = np.concatenate([points, points[:1]])
    count, start, way = len(points), ring[:-1, :2], np.diff(ring[:, :2], axis=0)
    under = []
    for i in range(count):
        away = start - start[i]
        skew = way[i, 0] * way[:, 1] - way[i, 1] * way[:, 0]
        with np.errstate(divide="ignore", invalid="ignore"):
            s = (away[:, 0] * way[:, 1] - away[:, 1] * way[:, 0]) / skew
            u = (away[:, 0] * way[i, 1] - away[:, 1] * way[i, 0]) / skew
        for j in np.flatnonzero((s >= 0) & (s < 1) & (u >= 0) & (u < 1)):
            if min((j - i) % count, (i - j) % count) <= 1:
                continue
            own = ring[i, 2] + s[j] * (ring[i + 1, 2] - ring[i, 2])
            if own < ring[j, 2] + u[j] * (ring[j + 1, 2] - ring[j, 2]):
                under.append((i + s[j], j + u[j]))
    under.sort()
    arcs = len(under)
    matrix = np.zeros((arcs, arcs))
    places = np.array([place for place, _ in under])
    for row, (_, over) in enumerate(under):
        matrix[row, int(np.searchsorted(places, over)) % arcs] += 2.0
        matrix[row, row] -= 1.0
        matrix[row, (row + 1) % arcs] -= 1.0
    return float(np.linalg.slogdet(matrix[1:, 1:])[1])


def _knot(sheet: YarnSheet, positions: np.ndarray) -> float:
    return _log_determinant(_closed(positions / sheet.radius))


def test_the_determinant_knows_a_trefoil() -> None:
    t = np.linspace(0, 2 * math.pi, 60, endpoint=False)
    trefoil = np.stack([np.sin(t) + 2 * np.sin(2 * t), np.cos(t) - 2 * np.cos(2 * t), -np.sin(3 * t)], 1)
    assert _log_determinant(trefoil) == pytest.approx(math.log(3))


@pytest.mark.parametrize(
    ("name", "columns", "rows"), [("stockinette", 3, 3), ("garter", 3, 2), ("rib-1x1", 2, 2), ("seed", 1, 2)]
)
def test_a_piece_is_one_yarn_that_unravels_only_where_it_is_not_bound_off(name: str, columns: int, rows: int) -> None:
    pattern = _built(name)
    sheet = knitted_sheet(pattern, columns, rows)
    assert len(sheet.closed) == 1 and not sheet.closed[0]
    # All of the pattern's own vertices are there once, and their yarn is as long as in the pattern.
    inner = (sheet.tile >= 0).all(axis=1) & (sheet.tile < (columns, rows)).all(axis=1)
    inner &= sheet.source != NO_PATTERN
    assert inner.sum() == columns * rows * len(pattern.edges)
    key = np.column_stack([sheet.source, sheet.tile])[sheet.source != NO_PATTERN]
    assert len(np.unique(key, axis=0)) == len(key)
    own = inner[sheet.edges] & inner[sheet.following[sheet.edges]]
    turns = rows * len(pattern.yarns)
    expected = columns * rows * float(pattern.rest_length.sum())
    assert sheet.rest_length[sheet.edges[own]].sum() == pytest.approx(expected, abs=1.1 * turns * sheet.radius)
    np.testing.assert_allclose(
        sheet.vertices[inner][:, :2],
        pattern.vertices[sheet.source[inner], :2] + sheet.tile[inner] * pattern.period,
        atol=1e-12,
    )
    assert _knot(sheet, sheet.vertices) > math.log(3) - 1e-6
    loose = knitted_sheet(pattern, columns, rows, bound_off=False)
    assert _knot(loose, loose.vertices) == pytest.approx(0.0, abs=1e-6)


def test_every_loop_of_the_borders_is_needed() -> None:
    """A wale more makes a greater knot: all loops of a row are held by the others."""
    pattern = _built("stockinette")
    sizes = [_knot(s, s.vertices) for s in (knitted_sheet(pattern, n, 2) for n in (2, 3, 4))]
    assert np.diff(sizes).min() > 0.5


@pytest.mark.parametrize(
    ("name", "columns", "rows"), [("stockinette", 4, 3), ("honeycomb", 1, 1), ("half-cardigan", 1, 2)]
)
def test_a_piece_finds_its_shape_and_stays_knotted_when_it_is_pulled(name: str, columns: int, rows: int) -> None:
    sheet = knitted_sheet(_built(name), columns, rows, chart=library.structure(name).chart)
    energy = FabricEnergy(sheet, SOFT, springs=woven_in(sheet, SOFT))
    start = energy.start()
    knot = _knot(sheet, sheet.vertices)
    energy.count_passages()
    drawn = energy.value(start)
    rest = rod_equilibrium(energy, start, Holds.none(), tolerance=1e-2, max_iterations=30)
    assert energy.value(rest.x) < 0.1 * drawn and energy.penetration(rest.x) < 0.1
    lower, upper = np.flatnonzero(sheet.tile[:, 1] < 0), np.flatnonzero(sheet.tile[:, 1] >= rows)
    lower, upper = (s[sheet.source[s] != NO_PATTERN] for s in (lower, upper))
    places = energy.positions(rest.x) * sheet.radius
    nodes = np.concatenate([lower, upper])
    height = places[upper, 1].mean() - places[lower, 1].mean()

    def holds(share: float) -> Holds:
        targets = places[nodes].copy()
        targets[len(lower) :, 1] += share * height
        return Holds(nodes, targets)

    x = rest.x
    for share in (0.08, 0.16, 0.24):
        x = rod_equilibrium(energy, x, holds(share), tolerance=1e-2, max_iterations=25).x
    assert energy.passage_count == 0
    force = holds(0.24).forces(energy, x)[len(lower) :, 1].sum()
    assert force > 5e-4  # it carries load rather than coming undone
    assert _knot(sheet, energy.positions(x) * sheet.radius) == pytest.approx(knot, abs=1e-6)


HELD = {
    name: library.structure(name).chart
    for name in (
        "honeycomb",
        "cartridge-belt-rib",
        "all-needle",
        "interlock",
        "double-pique",
        "half-cardigan",
    )
}
"""Library knits with slips, misses, tucks and two beds."""


@pytest.mark.parametrize("name", HELD)
def test_held_stitches_and_two_beds_end_in_borders_too(name: str) -> None:
    chart = HELD[name]
    knots = []
    # The knot is the chart's, however finely its yarn is cut.
    for vertices in (None, 45):
        pattern = _built(name, vertices)
        sheet = knitted_sheet(pattern, 1, 2, chart=chart)
        assert len(sheet.closed) == 1
        inner = (sheet.tile[:, 1] >= 0) & (sheet.tile[:, 1] < 2) & (sheet.source != NO_PATTERN)
        # A course across the piece has its first vertex at either end.
        assert inner.sum() == 2 * (len(pattern.edges) + len(pattern.yarns))
        own = inner[sheet.edges] & inner[sheet.following[sheet.edges]]
        turns = 2 * len(pattern.yarns)
        assert sheet.rest_length[sheet.edges[own]].sum() == pytest.approx(
            2 * float(pattern.rest_length.sum()), abs=1.5 * turns * sheet.radius
        )
        knots.append(_knot(sheet, sheet.vertices))
    loose = knitted_sheet(_built(name), 1, 2, chart=chart, bound_off=False)
    assert _knot(loose, loose.vertices) == pytest.approx(0.0, abs=1e-6)
    assert knots[0] == pytest.approx(knots[1], abs=1e-6) and knots[0] > 2 * math.log(3)


@pytest.mark.parametrize(
    ("chart", "more"),
    [
        (("kk", "pf", "kk", "fp"), 1),
        (("kkkf", "pbpp"), 0),
        (("kt", "tk"), 1),
        (("kkk", "kbf", "ktk", "bkf"), 3),
    ],
)
def test_loops_that_wait_at_a_border_are_taken_up_as_by_a_row_that_knits_them_all(
    chart: tuple[str, ...], more: int
) -> None:
    """Stitches beyond the border, which the piece does not have, make no difference to its knot."""
    courses = len(chart) + more
    whole = [chart[n % len(chart)] for n in range(courses)]
    above = [chart[n % len(chart)] for n in range(courses, courses + len(chart))]
    last = "".join(next(row[wale] for row in above if row[wale] in "kp") for wale in range(len(chart[0])))
    piece = knitted_sheet(knit(chart), 1, 1, chart=chart, more_courses=more)
    longer = (*whole, last)
    alike = knitted_sheet(knit(longer), 1, 0, chart=longer, more_courses=courses)
    assert _knot(piece, piece.vertices) == pytest.approx(_knot(alike, alike.vertices), abs=1e-6)


def test_a_tuck_or_a_slip_is_another_knot_than_a_knit_stitch() -> None:
    def knot(middle: str) -> float:
        chart = ("kk", middle, "kk")
        sheet = knitted_sheet(knit(chart), 1, 1, chart=chart)
        return _knot(sheet, sheet.vertices)

    found = sorted(knot(middle) for middle in ("kk", "kp", "kt", "kb", "kf"))
    assert np.diff(found).min() > 1e-3


def _lines(sheet: YarnSheet) -> list[np.ndarray]:
    return [sheet.vertices[a:b] / sheet.radius for a, b in zip(sheet.offsets, sheet.offsets[1:], strict=False)]


def _striped(letters: str | None, courses: int) -> YarnPattern:
    return knit(
        ["k"] * courses, yarns=letters, wale_spacing=8.0, course_spacing=4.5, loop_height=7.5, overhang=2.0,
        half_thickness=1.1,
    )  # fmt: skip


@pytest.mark.parametrize(("letters", "count"), [("aabb", 4), ("aab", 4), ("abb", 4), ("ab", 4)])
def test_stripes_are_the_plain_piece_cut_at_the_selvedges(letters: str, count: int) -> None:
    """Ends that meet at a selvedge, joined, make the knot of one yarn."""
    pattern = _striped(letters, len(letters))
    rows = 2
    stripes = knitted_sheet(pattern, 3, rows, carried=0)
    assert len(stripes.closed) == count and not stripes.closed.any()
    order = [letters[0], *(b for a, b in zip(2 * letters, (2 * letters)[1:], strict=False) if a != b)]
    assert stripes.yarn_material.tolist() == ["ab".index(letter) for letter in order]
    plain = knitted_sheet(_striped(None, len(letters)), 3, rows)
    joined = _log_determinant(_closed(np.concatenate(_lines(stripes))))
    assert joined == pytest.approx(_knot(plain, plain.vertices), abs=1e-6)


def test_yarns_are_carried_up_the_side_on_which_they_are_needed() -> None:
    for letters, rows, count in (("aabb", 3, 2), ("aabbcc", 2, 3), ("aab", 2, 3), ("ab", 2, 4)):
        pattern = _striped(letters, len(letters))
        sheet = knitted_sheet(pattern, 2, rows)
        assert len(sheet.closed) == count
        apart = FabricEnergy(sheet, SOFT, springs=woven_in(sheet, SOFT))
        apart.count_passages()
        rest = rod_equilibrium(apart, apart.start(), Holds.none(), tolerance=1e-2, max_iterations=15)
        assert apart.penetration(rest.x) < 0.1 and apart.passage_count == 0


def test_every_end_is_woven_in() -> None:
    pattern = _striped("aab", 3)
    sheet = knitted_sheet(pattern, 2, 2)
    springs = woven_in(sheet, SOFT)
    ends = {int(v) for v in np.concatenate([sheet.offsets[:-1], sheet.offsets[1:] - 1])}
    assert {int(v) for v in springs.pairs[:, 0]} == ends
    assert (sheet.source[springs.pairs[:, 1]] != NO_PATTERN).all()


def test_patterns_that_are_no_knitting_are_refused() -> None:
    for name in ("plain", "honeycomb", "interlock", "stockinette-small"):
        with pytest.raises(InputError, match="knitted piece"):
            knitted_sheet(_built(name), 2, 2)
    chart = ("kk", "kt")
    with pytest.raises(InputError, match="plated"):
        knitted_sheet(knit(chart, yarns=("ab", "a")), 2, 2, chart=chart)
    with pytest.raises(InputError, match="needles out of work"):
        knitted_sheet(knit(chart), 2, 2, chart=("kb",))
    for columns, rows in ((0, 2), (2, -1), (2, 0), (2.5, 1), (True, 2), (10_000, 10_000)):
        with pytest.raises(InputError, match="knitted piece"):
            knitted_sheet(_built("stockinette"), columns, rows)  # type: ignore[arg-type]
