"""Centre lines of a periodic pattern are joined right, and smoothing stays on the yarn."""

from __future__ import annotations

import numpy as np
import pytest

from yarnscale.show.curves import Curve, Placement, periodic_curves, smooth_curve

PERIOD = (2.0, 3.0)


def flat_placement(positions: np.ndarray, period: tuple[float, float]) -> Placement:
    steps = np.array([[period[0], 0.0, 0.0], [0.0, period[1], 0.0]])
    return lambda vertices, tiles: positions[vertices] + tiles @ steps


def straight_course(vertices: int = 4) -> tuple[np.ndarray, np.ndarray]:
    """One straight yarn along the course, in one period."""
    x = np.arange(vertices) * PERIOD[0] / vertices
    positions = np.stack([x, np.ones(vertices), np.zeros(vertices)], axis=1)
    following = (np.arange(vertices) + 1) % vertices
    wraps = (following == 0).astype(np.int64)
    edges = np.stack([np.arange(vertices), following, wraps, np.zeros_like(wraps)], axis=1)
    return positions, edges


def test_a_yarn_is_one_curve_through_all_tiles() -> None:
    positions, edges = straight_course()
    curves = periodic_curves(edges, flat_placement(positions, PERIOD), rings=1)
    assert len(curves) == 3  # one for each row of tiles
    for curve in curves:
        assert not curve.closed
        assert np.allclose(np.diff(curve.points[:, 0]), PERIOD[0] / 4)
        assert len(curve.points) == 12
    assert sum(int(np.sum(c.solid)) for c in curves if c.solid is not None) == 4


def test_order_of_rows_does_not_matter() -> None:
    positions, edges = straight_course(7)
    shuffled = np.random.default_rng(3).permutation(edges)
    curves = periodic_curves(shuffled, flat_placement(positions, PERIOD))
    assert sorted(len(c.points) for c in curves) == [21, 21, 21]
    assert all(np.all(np.diff(c.points[:, 0]) > 0) for c in curves)


def test_diagonal_yarn_leaves_the_window_and_comes_back() -> None:
    positions = np.array([[0.0, 0.0, 0.0], [1.0, 1.5, 0.0]])
    edges = np.array([[0, 1, 0, 0], [1, 0, 1, 1]])
    curves = periodic_curves(edges, flat_placement(positions, PERIOD), rings=1)
    assert sorted(len(c.points) for c in curves) == [2, 2, 4, 4, 6]


def test_loop_that_stays_in_its_tile_is_closed() -> None:
    angle = np.arange(12) * np.pi / 6
    positions = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    number = np.arange(12)
    edges = np.stack([number, (number + 1) % 12, 0 * number, 0 * number], axis=1)
    curves = periodic_curves(edges, flat_placement(positions, (3.0, 3.0)))
    assert len(curves) == 9
    assert all(c.closed for c in curves)
    line, solid = smooth_curve(curves[4])
    assert np.allclose(line[0], line[-1])
    assert len(line) == len(solid)
    centre = curves[4].points.mean(axis=0)
    assert np.linalg.norm(line - centre, axis=1) == pytest.approx(1.0, abs=1e-3)


def test_smoothing_passes_through_the_vertices_and_stays_near() -> None:
    t = np.linspace(0, 2 * np.pi, 25)
    points = np.stack([t, 0 * t, np.cos(t)], axis=1)
    line, solid = smooth_curve(Curve(points), per_segment=8)
    assert np.allclose(line[::8], points)
    assert solid.all()
    assert np.abs(line[:, 2] - np.cos(line[:, 0])).max() < 2e-3


def test_repeated_vertices_do_no_harm() -> None:
    points = np.array([[0.0, 0, 0], [1, 0, 0], [1, 0, 0], [2, 1, 0], [3, 1, 0]])
    line, solid = smooth_curve(Curve(points))
    assert np.isfinite(line).all()
    assert len(line) == len(solid)
