"""Yarns across seams: where the pattern goes on they do as if there were none, elsewhere bridges join the ends."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from yarnscale.detail.alignment import LARGEST_STRETCH, aligned_tilings
from yarnscale.detail.fluctuations import FluctuationTable
from yarnscale.detail.joins import sewn_layout
from yarnscale.detail.tiling import Tilings, YarnLayout
from yarnscale.detail.yarns import YarnDetail
from yarnscale.errors import InputError
from yarnscale.shell.mesh import TriangleMesh


def grid(columns: int, rows: int, step: float) -> TriangleMesh:
    """A rectangle of squares cut in two, with its corner at the origin."""
    i, j = np.meshgrid(np.arange(columns + 1), np.arange(rows + 1))
    a = (np.arange(rows)[:, None] * (columns + 1) + np.arange(columns)).ravel()
    b = a + columns + 1
    triangles = np.concatenate([np.column_stack([a, a + 1, b]), np.column_stack([a + 1, b + 1, b])])
    return TriangleMesh(np.column_stack([step * i.ravel(), step * j.ravel()]).astype(np.float64), triangles)


def halves(shift: tuple[float, float] = (0.5, 0.0), *, turn: float = 0.0) -> TriangleMesh:
    """A sheet of 8 × 6 cm from two panels, sewn along x = 4 cm; the right one lies shifted or turned in the fabric."""
    sheet = grid(8, 6, 0.01)
    right = sheet.material[sheet.triangles, 0].mean(axis=1) > 0.04
    middle = np.flatnonzero(np.abs(sheet.material[:, 0] - 0.04) < 1e-9)
    doubles = np.arange(sheet.vertex_count)
    doubles[middle] = sheet.vertex_count + np.arange(len(middle))
    corners = np.where(right[:, None], doubles[sheet.triangles], sheet.triangles)
    material = np.concatenate([sheet.material, sheet.material[middle]])
    own = np.unique(corners[right])
    c, s = math.cos(turn), math.sin(turn)
    material[own] = material[own] @ np.array([[c, s], [-s, c]]) + shift
    return TriangleMesh(material, sheet.triangles, 0.0, corners, sheet.assembled)


def tube(columns: int, rows: int, step: float) -> TriangleMesh:
    """A rectangle rolled about the z-axis and sewn along its side."""
    sheet = grid(columns, rows, step)
    number, line = np.divmod(np.arange(sheet.vertex_count), columns + 1)
    vertex = number * columns + line % columns
    angle, radius = 2 * math.pi * line / columns, columns * step / (2 * math.pi)
    assembled = np.zeros((columns * (rows + 1), 3))
    assembled[vertex] = np.column_stack([radius * np.sin(angle), -radius * np.cos(angle), step * number])
    return TriangleMesh(sheet.material, vertex[sheet.triangles], 0.0, sheet.triangles, assembled)


def ends(layout: YarnLayout) -> np.ndarray:
    """Vertices at which open yarns end."""
    return np.concatenate([layout.offsets[:-1][~layout.closed], layout.offsets[1:][~layout.closed] - 1])


def segments(layout: YarnLayout) -> tuple[np.ndarray, np.ndarray]:
    """First and second vertex of every segment of the curves, rings' last one included."""
    first = np.arange(layout.vertex_count)
    second = first + 1
    second[layout.offsets[1:] - 1] = layout.offsets[:-1]
    inner = np.ones(len(first), bool)
    inner[layout.offsets[1:][~layout.closed] - 1] = False
    return first[inner], second[inner]


def bends(layout: YarnLayout, points: np.ndarray) -> np.ndarray:
    """Angle between each segment and the next [rad], at the vertex between them; 0 at ends."""
    first, second = segments(layout)
    follower = np.full(layout.vertex_count, -1)
    follower[first] = second
    start = first[follower[second] >= 0]
    middle, end = follower[start], follower[follower[start]]
    a, b = points[middle] - points[start], points[end] - points[middle]
    angles = np.zeros(layout.vertex_count)
    cosine = (a * b).sum(axis=1) / np.linalg.norm(a, axis=1) / np.linalg.norm(b, axis=1)
    angles[middle] = np.arccos(np.clip(cosine, -1.0, 1.0))
    return angles


@pytest.fixture(scope="module")
def plain(made_up: FluctuationTable) -> FluctuationTable:
    """No fluctuations: yarns as the pattern has them."""
    return replace(made_up, values=np.zeros_like(made_up.values))


def test_a_sheet_cut_and_sewn_up_has_the_yarns_of_the_whole(plain: FluctuationTable) -> None:
    whole, sewn = grid(8, 6, 0.01), halves()
    detail = YarnDetail.of(plain, sewn)
    tilings = aligned_tilings(plain.pattern.period, sewn)
    np.testing.assert_allclose(tilings.stretch, 1.0, rtol=1e-9)
    same = Tilings(tilings.origin[:1], tilings.stretch[:1])
    expected = YarnLayout.pieces(plain.pattern, whole, same).without_snippets(plain.pattern, whole)
    assert len(detail.layout.bridges.vertices) == 0
    assert len(detail.layout.yarn) >= len(expected.yarn)
    reference = replace(YarnDetail.of(plain, whole), layout=expected)
    here, there = detail.curves(sewn.assembled), reference.curves(whole.assembled)
    gaps = np.linalg.norm(here[:, None] - there[None], axis=2)
    assert gaps.min(axis=0).max() < 1e-9
    # At the seam's ends short pieces stay that a free border is rid of.
    more = here[gaps.min(axis=1) > 1e-9]
    assert len(more) == len(here) - len(there)
    assert (np.abs(more[:, 1] - 0.03) > 0.03 - plain.pattern.period[1]).all()
    near = np.abs(here[ends(detail.layout), 0] - 0.04) < 0.01
    border = np.abs(here[ends(detail.layout), 1] - 0.03) > 0.03 - 1.5 * plain.pattern.period[1]
    assert not (near & ~border).any()


@pytest.mark.parametrize("columns", [20, 23, 25])
def test_yarns_go_round_a_tube_as_if_it_had_no_seam(plain: FluctuationTable, columns: int) -> None:
    """Whatever its circumference: loose ends, jumps and kinks at the seam against the tube elsewhere."""
    pattern, mesh = plain.pattern, tube(columns, 6, 0.01)
    detail = YarnDetail.of(plain, mesh)
    layout, points = detail.layout, detail.curves(mesh.assembled)
    round_ = columns * 0.01
    tiles = round_ / (pattern.period[0] * aligned_tilings(pattern.period, mesh).stretch[0, 0])
    assert abs(tiles - round(tiles)) < 1e-3
    assert layout.closed.sum() >= 0.06 / pattern.period[1] - 2

    well_inside = np.abs(points[:, 2] - 0.03) < 0.03 - 2.0 * pattern.period[1]
    assert well_inside[ends(layout)].sum() == 0
    assert not well_inside[layout.bridges.vertices].any()
    first, second = segments(layout)
    crosses = np.abs(layout.material[first, 0] - layout.material[second, 0]) > 0.5 * round_
    assert crosses.sum() >= 0.06 / pattern.period[1] - 2
    lengths = np.linalg.norm(points[first] - points[second], axis=1)
    usual = np.array([lengths[layout.vertex[first] == v].mean() for v in range(len(pattern.vertices))])
    assert np.abs(lengths - usual[layout.vertex[first]])[crosses].max() < 0.1 * pattern.radius
    angles = bends(layout, points)
    typical = np.array([np.median(angles[layout.vertex == v]) for v in range(len(pattern.vertices))])
    at_seam = np.unique([first[crosses], second[crosses]])
    at_seam = at_seam[well_inside[at_seam]]
    assert np.abs(angles - typical[layout.vertex])[at_seam].max() < 0.1

    cut = YarnDetail.of(plain, mesh, seams="cut").layout
    assert well_inside[ends(layout)].sum() == 0 < len(ends(cut)) - len(ends(layout))


def test_a_ring_too_small_to_stretch_the_pattern_for_keeps_it(plain: FluctuationTable) -> None:
    period = plain.pattern.period
    mesh = tube(6, 6, 0.25 * period[0])  # one and a half tiles round
    np.testing.assert_allclose(aligned_tilings(period, mesh).stretch, 1.0)
    assert abs(1.5 / 2.0 - 1.0) > LARGEST_STRETCH


@pytest.mark.parametrize("turn", [0.0, 0.5 * math.pi, math.pi])
def test_where_patterns_do_not_meet_smooth_bridges_join_the_ends_one_to_one(
    plain: FluctuationTable, turn: float
) -> None:
    pattern = plain.pattern
    mesh = halves((0.5, 0.0), turn=turn)
    if turn == 0.0:
        # Half a course and a third of a wale out of step: nothing may be aligned.
        tilings = Tilings(np.array([[0.0, 0.0], [0.0, 0.0]]), np.ones((2, 2)))
        tilings.origin[1] = [0.5 + 0.35 * pattern.period[0], 0.4 * pattern.period[1]]
        layout = sewn_layout(pattern, mesh, tilings)
    else:
        layout = sewn_layout(pattern, mesh)
    detail = replace(YarnDetail.of(plain, mesh), layout=layout)
    points, radius = detail.curves(mesh.assembled), pattern.radius
    own = np.setdiff1d(np.arange(layout.vertex_count), layout.bridges.vertices)
    names = np.column_stack([layout.panel, layout.vertex, *np.rint(layout.material.T * 1e7).astype(int)])
    assert len(np.unique(names[own], axis=0)) == len(own)  # no vertex in two yarns

    def loose(some: YarnLayout, places: np.ndarray) -> int:
        at = places[ends(some)]
        return int(((np.abs(at[:, 0] - 0.04) < 2 * radius) & (np.abs(at[:, 1] - 0.03) < 0.025)).sum())

    cut = YarnDetail.of(plain, mesh, seams="cut")
    assert loose(layout, points) <= 0.2 * loose(cut.layout, cut.curves(mesh.assembled))
    first, second = segments(layout)
    lengths = np.linalg.norm(points[first] - points[second], axis=1)
    assert lengths.max() < 1.5 * pattern.rest_length.max()
    # The pattern itself turns by up to 0.63 at a vertex.
    assert bends(layout, points).max() < 1.0


def test_bridges_move_with_the_cloth(made_up: FluctuationTable) -> None:
    mesh = halves(turn=0.5 * math.pi)
    detail = YarnDetail.of(made_up, mesh)
    turn = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    before, after = (detail.curves(p) for p in (mesh.assembled, mesh.assembled @ turn.T + 0.3))
    np.testing.assert_allclose(after, before @ turn.T + 0.3, atol=1e-12)


def test_without_seams_nothing_changes_and_other_words_are_refused(plain: FluctuationTable) -> None:
    mesh, pattern = grid(5, 5, 0.01), plain.pattern
    one, two = YarnLayout.of(pattern, mesh), sewn_layout(pattern, mesh)
    np.testing.assert_array_equal(one.material, two.material)
    np.testing.assert_array_equal(one.offsets, two.offsets)
    with pytest.raises(InputError, match="joined or cut"):
        YarnDetail.of(plain, mesh, seams="glued")  # type: ignore[arg-type]


def test_yarns_of_a_stretched_pattern_feel_the_stretch(made_up: FluctuationTable) -> None:
    mesh = tube(23, 6, 0.01)
    detail = YarnDetail.of(made_up, mesh)
    stretch = aligned_tilings(made_up.pattern.period, mesh).stretch[0]
    states = detail.states(mesh.assembled)
    chord = 23 * math.sin(math.pi / 23) / math.pi
    np.testing.assert_allclose(states[:, 0], chord * stretch[0] - 1.0, atol=2e-3)
