"""The pair search against brute force over many images."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import lsq_linear

from yarnscale.cell.midsurface import Midsurface
from yarnscale.drawing import library
from yarnscale.drawing.curves import PeriodicCurve, pattern_from_curves
from yarnscale.errors import InputError
from yarnscale.kinematics import ShellStrain
from yarnscale.yarn.close_pairs import close_pairs, nearest_places, pair_gaps, safe_fraction
from yarnscale.yarn.pattern import YarnPattern
from yarnscale.yarn.strands import Strands


def gap_by_optimisation(a: np.ndarray, b: np.ndarray, c: np.ndarray, d: np.ndarray) -> float:
    """Distance of two segments by bounded least squares."""
    found = lsq_linear(np.column_stack([b - a, c - d]), c - a, bounds=(0, 1), tol=1e-14, method="bvls")
    return float(np.sqrt(2 * found.cost))


def segments(seed: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    points = rng.normal(size=(60, 4, 3))
    points[10:20, 3] = points[10:20, 2] + points[10:20, 1] - points[10:20, 0]  # parallel
    points[20:25, 2:, 2] = points[20:25, :2, 2] = 0.0  # in a plane, some crossing
    points[25:30, 2] = points[25:30, 0]  # a shared end
    points[30:35, 2:] = points[30:35, :2] + [0, 0, 0.5]  # side by side
    points[35:40, 3] = points[35:40, 2] + 1e-7 * (points[35:40, 1] - points[35:40, 0])  # very short
    points[40:45, 3] = points[40:45, 2] + (1 + 1e-9) * (points[40:45, 1] - points[40:45, 0])
    return points


@pytest.mark.parametrize("seed", [0, 1])
def test_distance_of_closest_points(seed: int) -> None:
    for a, b, c, d in segments(seed):
        found = np.sqrt(nearest_places(np.array([a, b, c, d]), 0, 1, 2, 3)[2])
        assert found == pytest.approx(gap_by_optimisation(a, b, c, d), rel=1e-6, abs=1e-7)


def random_pattern(seed: int) -> YarnPattern:
    """Wild yarns of few vertices that run along x, y, diagonally, backwards, or close on themselves."""
    rng = np.random.default_rng(seed)
    period = rng.uniform(4, 7, 2)
    shifts = [(1, 0), (0, 1), (1, 1), (2, -1), (0, 0), (-1, 0)]
    curves = []
    for k in rng.choice(len(shifts), 3, replace=False):
        count = int(rng.integers(3, 9))
        line = np.arange(count)[:, None] / count * np.array([*(np.array(shifts[k]) * period), 0.0])
        curves.append(PeriodicCurve(line + rng.uniform(-1.5, 1.5, (count, 3)), shifts[k]))
    return pattern_from_curves(curves, period, 0.3)


def brute(pattern: YarnPattern, points: np.ndarray, reach: float, neighbours: int) -> set[tuple[int, int, int, int]]:
    """All ordered pairs (i, j, tile) closer than reach, by unwrapped yarns and every tile in a wide box."""
    n, period = len(pattern.edges), np.array([*pattern.period, 0.0])
    start = points
    end = points[pattern.edges[:, 1]] + np.pad(pattern.edges[:, 2:], ((0, 0), (0, 1))) * period
    walks: dict[tuple[int, int, int], int] = {}  # (vertex, tile) -> edges walked, per starting segment
    pairs = set()
    for i in range(n):
        walks.clear()
        for direction in (1, -1):
            vertex, tile = i, np.zeros(2, np.int64)
            walks[i, 0, 0] = 0
            for step in range(1, neighbours + 1):
                if direction == 1:
                    tile = tile + pattern.edges[vertex, 2:]
                    vertex = int(pattern.edges[vertex, 1])
                else:
                    vertex = int(pattern.previous_vertex[vertex])
                    tile = tile - pattern.edges[vertex, 2:]
                walks[vertex, int(tile[0]), int(tile[1])] = step
        for a in range(-4, 5):
            for b in range(-4, 5):
                move = np.array([a, b, 0]) * period
                for j in range(n):
                    if (j, a, b) in walks:
                        continue
                    ends = np.array([start[i], end[i], start[j] + move, end[j] + move])
                    if nearest_places(ends, 0, 1, 2, 3)[2] < reach**2:
                        pairs.add((i, j, a, b))
    return pairs


def found_pairs(
    pattern: YarnPattern, points: np.ndarray, reach: float, neighbours: int, ordered: bool
) -> list[tuple[int, int, int, int]]:
    strands = Strands.of(pattern, (3, 3))
    first, second = close_pairs(
        strands, strands.copies(points, pattern.period), reach, neighbours=neighbours, ordered=ordered
    )
    n = len(pattern.edges)
    return [(i, k % n, *strands.tiles[k // n].tolist()) for i, k in zip(first.tolist(), second.tolist(), strict=True)]


def mirrored(pair: tuple[int, int, int, int]) -> tuple[int, int, int, int]:
    i, j, a, b = pair
    return j, i, -a, -b


@pytest.mark.parametrize("neighbours", [1, 3, 7])
@pytest.mark.parametrize("seed", range(6))
def test_pairs_against_brute_force(seed: int, neighbours: int) -> None:
    pattern = random_pattern(seed)
    expected = brute(pattern, pattern.vertices, 1.2, neighbours)
    assert len(expected) > 10
    ordered = found_pairs(pattern, pattern.vertices, 1.2, neighbours, True)
    assert len(set(ordered)) == len(ordered)
    assert set(ordered) == expected
    once = found_pairs(pattern, pattern.vertices, 1.2, neighbours, False)
    assert len(once) * 2 == len(expected), "every unordered pair exactly once"
    assert set(once) | {mirrored(pair) for pair in once} == expected


@pytest.mark.parametrize("seed", range(3))
def test_pairs_do_not_depend_on_how_vertices_are_stored(seed: int) -> None:
    """Other stored copies of the vertices are the same fabric, and so is a shifted one."""
    pattern = random_pattern(seed)
    tiles = np.random.default_rng(seed).integers(-1, 2, (len(pattern.edges), 2))
    moved = pattern.retiled(tiles)
    renamed = {
        (i, j, a + tiles[i, 0] - tiles[j, 0], b + tiles[i, 1] - tiles[j, 1])
        for i, j, a, b in brute(pattern, pattern.vertices, 1.0, 3)
    }
    inside = {pair for pair in renamed if abs(pair[2]) <= 3 and abs(pair[3]) <= 3}
    assert set(found_pairs(moved, moved.vertices, 1.0, 3, True)) == inside
    shifted = pattern.shifted(1.7, -20.3)
    assert found_pairs(shifted, shifted.vertices, 1.0, 3, False) == found_pairs(
        pattern, pattern.vertices, 1.0, 3, False
    )


def test_neighbours_are_left_out_across_the_border_of_the_period() -> None:
    """A straight yarn of four vertices: only its copies more than three edges away are pairs."""
    period = np.array([4.0, 10.0])
    curve = PeriodicCurve(np.column_stack([np.arange(4.0), np.zeros(4), np.zeros(4)]), (1, 0))
    pattern = pattern_from_curves([curve], period, 0.3)
    for neighbours in (1, 2, 3, 5):
        pairs = found_pairs(pattern, pattern.vertices, 6.5, neighbours, True)
        apart = np.array([j + 4 * a - i for i, j, a, _ in pairs])
        assert np.abs(apart).min() == neighbours + 1
        # Segments k apart are k − 1 away from each other.
        assert set(np.abs(apart).tolist()) == set(range(neighbours + 1, 8))
        assert len(pairs) == 4 * 2 * (7 - neighbours)


def test_more_pairs_than_expected_are_all_found() -> None:
    pattern = random_pattern(0)
    everything = found_pairs(pattern, pattern.vertices, 60.0, 1, True)
    n, tiles = len(pattern.edges), 49
    assert len(everything) == n * n * tiles - 3 * n


@pytest.mark.parametrize("name", ["stockinette", "satin-5"])
@pytest.mark.parametrize(
    "strain",
    [ShellStrain(0.3, 0.2, -0.3), ShellStrain(0.1, 0.0, 0.2, 60.0), ShellStrain(0, 0.1, 0, 0, 0, -90.0)],
)
def test_pairs_of_a_bent_cell_against_all_distances(name: str, strain: ShellStrain) -> None:
    pattern = library.build(name)
    n, unit = len(pattern.edges), pattern.radius
    strands = Strands.of(pattern, (2, 2))
    reference = strands.copies(pattern.vertices, pattern.period) / unit
    nodes, _ = Midsurface(strain, length=unit).at(reference)
    first, second = close_pairs(strands, nodes, 2.7, neighbours=3, ordered=True)
    every = np.repeat(np.arange(n), len(strands.ends)), np.tile(np.arange(len(strands.ends)), n)
    close = pair_gaps(nodes, strands.ends, *every) < 2.7
    candidates = set(zip(every[0][close].tolist(), every[1][close].tolist(), strict=True))
    found = set(zip(first.tolist(), second.tolist(), strict=True))
    assert len(found) > 100 and found <= candidates
    yarn, place = pattern.yarn_of_vertex, pattern.position_along_yarn
    for i, k in candidates - found:
        j = k % n
        length = (yarn == yarn[i]).sum()
        apart = (place[j] - place[i]) % length
        assert yarn[i] == yarn[j] and min(apart, length - apart) <= 3, "only neighbours may be missing"


@pytest.mark.parametrize("seed", range(5))
def test_a_safe_fraction_keeps_distances(seed: int) -> None:
    """Along the whole move no pair comes closer than 1 − share of where it was."""
    pattern = random_pattern(seed)
    strands = Strands.of(pattern, (2, 2))
    nodes = strands.copies(pattern.vertices, pattern.period)
    first, second = close_pairs(strands, nodes, 1.5, neighbours=2, ordered=False)
    step = np.random.default_rng(seed).normal(size=pattern.vertices.shape)
    moves = np.tile(step, (len(strands.tiles), 1))
    ends = strands.ends
    before = pair_gaps(nodes, ends, first, second)
    for share in (0.3, 0.8):
        fraction = safe_fraction(nodes, moves, ends, first, second, share)
        assert 0 < fraction <= 1
        for part in (0.25, 0.5, 0.75, 1.0):
            after = pair_gaps(nodes + part * fraction * moves, ends, first, second)
            assert (after >= (1 - share) * before - 1e-12).all()


def test_a_safe_fraction_is_not_needlessly_small() -> None:
    pattern = random_pattern(1)
    strands = Strands.of(pattern, (2, 2))
    nodes = strands.copies(pattern.vertices, pattern.period)
    none = np.empty(0, np.int64)
    assert safe_fraction(nodes, nodes, strands.ends, none, none, 0.8) == 1.0
    first, second = close_pairs(strands, nodes, 1.5, neighbours=2, ordered=False)
    together = np.ones_like(nodes)
    assert safe_fraction(nodes, together, strands.ends, first, second, 0.8) == 1.0
    tiny = 1e-9 * np.random.default_rng(0).normal(size=nodes.shape)
    assert safe_fraction(nodes, tiny, strands.ends, first, second, 0.8) == 1.0


def test_images_know_the_ends_of_segments() -> None:
    pattern = random_pattern(2)
    strands = Strands.of(pattern, (1, 2))
    nodes = strands.copies(pattern.vertices, pattern.period)
    n = len(pattern.edges)
    assert (strands.tiles[0] == 0).all() and len(strands.ends) == 15 * n
    edge = nodes[strands.ends] - nodes[: len(strands.ends)]
    np.testing.assert_allclose(edge, np.tile(pattern.edge_vectors(), (15, 1)), atol=1e-12)


def test_a_wide_sheet_has_the_pairs_of_its_repeats() -> None:
    unit, counts = library.build("plain"), []
    for pattern in (unit, unit.repeated(15, 14)):
        strands = Strands.of(pattern, (1, 1))
        nodes = strands.copies(pattern.vertices / pattern.radius, pattern.period / pattern.radius)
        counts.append(len(close_pairs(strands, nodes, 2.71, neighbours=3, ordered=True)[0]))
    assert counts[1] == 15 * 14 * counts[0]


@pytest.mark.parametrize("ordered", [False, True])
def test_pairs_that_move_are_those_that_may_meet(ordered: bool) -> None:
    """Of a periodic pattern, against all pairs: none is missed whose segments move together by more than their gap."""
    pattern = random_pattern(3)
    strands, n = Strands.of(pattern, (2, 2)), len(pattern.edges)
    nodes = strands.copies(pattern.vertices, pattern.period)
    moves = np.random.default_rng(3).normal([9.0, 0.0, 0.0], 0.6, (n, 3))
    moves = np.tile(moves, (len(strands.tiles), 1))
    found = set(zip(*close_pairs(strands, nodes, 0.0, neighbours=2, ordered=ordered, moves=moves), strict=True))
    every = close_pairs(strands, nodes, 50.0, neighbours=2, ordered=ordered)
    largest = np.max(
        [np.linalg.norm(moves[a] - moves[b], axis=1) for a in (every[0], strands.ends[every[0]])
         for b in (every[1], strands.ends[every[1]])], axis=0,
    )  # fmt: skip
    must = pair_gaps(nodes, strands.ends, *every) < largest
    assert must.any() and len(found) < 0.5 * len(must)
    assert found >= {(i, g) for i, g, meets in zip(*every, must, strict=True) if meets}


def test_heaps_of_segments_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("yarnscale.yarn.close_pairs.LARGEST_PAIRS", 1000)
    pattern = random_pattern(0)
    strands = Strands.of(pattern, (3, 3))
    with pytest.raises(InputError, match="too many segments lie on top of each other"):
        close_pairs(strands, strands.copies(pattern.vertices, pattern.period), 60.0, neighbours=1)


def test_arc_lengths_begin_anew_with_every_yarn() -> None:
    pattern = random_pattern(4)
    start, total = Strands.of(pattern, (1, 1)).arc_lengths(pattern.rest_length)
    for number, chain in enumerate(pattern.yarns):
        np.testing.assert_allclose(
            start[chain], np.cumsum(pattern.rest_length[chain]) - pattern.rest_length[chain], atol=1e-12
        )
        assert total[number] == pytest.approx(pattern.rest_length[chain].sum())


def test_a_finite_fabric_has_open_yarns_and_rings() -> None:
    strands = Strands.finite(np.array([0, 3, 7]), np.array([False, True]))
    assert strands.ends.tolist() == [1, 2, -1, 4, 5, 6, 3]
    assert strands.before.tolist() == [-1, 0, 1, 6, 3, 4, 5]
    assert strands.edges.tolist() == [0, 1, 3, 4, 5, 6] and strands.joints.tolist() == [1, 3, 4, 5, 6]
    # Segments 3 and 5 are opposite in the ring of four, and both ends of the open yarn lie two edges apart.
    points = np.random.default_rng(0).normal(size=(7, 3))
    pairs = set(zip(*close_pairs(strands, points, 90.0, neighbours=1), strict=True))
    assert pairs == {(i, g) for i in (0, 1) for g in (3, 4, 5, 6)} | {(3, 5), (4, 6)}
