"""Pieces of knitting with borders: one yarn, knotted so that it does not unravel, that stays so when it is pulled."""

from __future__ import annotations

import math

import numpy as np
import pytest

from yarnscale.errors import InputError
from yarnscale.fabric.direct_energy import FabricEnergy
from yarnscale.fabric.direct_moves import PassageCount
from yarnscale.fabric.direct_static import Holds, equilibrium, stretched
from yarnscale.fabric.knitted_sheet import knitted_sheet, woven_in
from yarnscale.fabric.sheet import NO_PATTERN, YarnSheet
from yarnscale.yarn import library
from yarnscale.yarn.material import YarnMaterial

SOFT = YarnMaterial.preset("hylc2020-stockinette")


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
def test_a_piece_is_one_yarn_that_unravels_only_where_it_is_not_bound_off(
    name: str, columns: int, rows: int
) -> None:
    pattern = library.build(name)
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
    assert sheet.rest_length[sheet.edges[own]].sum() == pytest.approx(
        expected, abs=1.1 * turns * sheet.radius
    )
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
    pattern = library.build("stockinette")
    sizes = [_knot(s, s.vertices) for s in (knitted_sheet(pattern, n, 2) for n in (2, 3, 4))]
    assert np.diff(sizes).min() > 0.5


def test_a_piece_finds_its_shape_and_stays_knotted_when_it_is_pulled() -> None:
    sheet = knitted_sheet(library.build("stockinette"), 4, 3)
    energy = FabricEnergy(sheet, SOFT, springs=woven_in(sheet, SOFT))
    start = energy.start()
    knot = _knot(sheet, sheet.vertices)
    count = PassageCount(energy, start)
    drawn = energy.value(start)
    rest = equilibrium(energy, start, Holds.none(), tolerance=1e-2, max_iterations=30, count=count)
    assert energy.value(rest.x) < 0.1 * drawn and energy.penetration(rest.x) < 0.1
    lower, upper = np.flatnonzero(sheet.tile[:, 1] == -1), np.flatnonzero(sheet.tile[:, 1] == 3)
    lower, upper = (s[sheet.source[s] != NO_PATTERN] for s in (lower, upper))
    places = energy.positions(rest.x) * sheet.radius
    nodes = np.concatenate([lower, upper])
    height = places[upper, 1].mean() - places[lower, 1].mean()

    def holds(share: float) -> Holds:
        targets = places[nodes].copy()
        targets[len(lower) :, 1] += share * height
        return Holds(nodes, targets)

    found = stretched(
        energy, rest.x, holds, np.array([0.08, 0.16, 0.24]), tolerance=1e-2, max_iterations=25, count=count
    )
    assert count.passages == 0
    force = holds(0.24).forces(energy, found[-1].x)[len(lower) :, 1].sum()
    assert force > 1e-3  # it carries load rather than coming undone
    assert _knot(sheet, energy.positions(found[-1].x) * sheet.radius) == pytest.approx(knot, abs=1e-6)


def test_patterns_that_are_no_plain_knitting_are_refused() -> None:
    for name in ("plain", "honeycomb", "interlock", "stockinette-small"):
        with pytest.raises(InputError, match="knitted piece"):
            knitted_sheet(library.build(name), 2, 2)
    for columns, rows in ((0, 2), (2, -1), (2.5, 1), (True, 2), (10_000, 10_000)):
        with pytest.raises(InputError, match="knitted piece"):
            knitted_sheet(library.build("stockinette"), columns, rows)  # type: ignore[arg-type]
