"""Polygons cut into triangles keep area, corners and turning; what cannot be cut is refused with its number."""

from __future__ import annotations

import numpy as np
import pytest

from yarnscale.shell.garments.polygons import (
    PolygonError,
    areas_of,
    flatness,
    in_own_plane,
    polygon_areas,
    triangulated,
)


def star(rng: np.random.Generator, count: int) -> np.ndarray:
    """A polygon that does not cross itself, mostly concave."""
    angle = 2 * np.pi * (np.arange(count) + rng.uniform(0.0, 0.6, count)) / count
    radius = rng.uniform(0.3, 1.0, count)
    return np.column_stack([radius * np.cos(angle), radius * np.sin(angle)])


def on_straight_sides(turn: float) -> np.ndarray:
    corners = np.array([[0, 0], [1, 0], [2, 0], [3, 0], [3, 1], [2, 1], [1, 1], [0, 1], [0, 0.4]]) / 30
    c, s = np.cos(turn), np.sin(turn)
    return corners @ np.array([[c, s], [-s, c]])


@pytest.mark.parametrize("turned_over", [False, True])
def test_triangles_fill_the_polygon_and_use_every_corner(turned_over: bool) -> None:
    rng = np.random.default_rng(4)
    shapes = [star(rng, n) for n in (3, 4, 4, 5, 6, 8, 13) for _ in range(3)]
    shapes += [on_straight_sides(turn) for turn in (0.0, 0.3, 1.1, 2.9)]
    shapes.append(np.array([[0.0, 0.1], [0.1, 0.15], [0.2, 0.1], [0.1, 0.2]]))  # an arrow
    shapes.append(np.array([[0.0, 0.0], [1.0, 0.0], [2.0, 0.0], [1.0, 1.0]]))  # a corner on a straight side
    if turned_over:
        shapes = [shape[::-1] for shape in shapes]
    starts = np.cumsum([0, *map(len, shapes)])
    points = np.concatenate(shapes)
    corners, faces = triangulated(points, starts)
    assert (np.diff(faces) >= 0).all()
    signed = areas_of(points[corners])
    assert (signed < 0).all() if turned_over else (signed > 0).all()
    assert flatness(points[corners]).min() > 1e-6
    whole = polygon_areas(points, starts)
    np.testing.assert_allclose(np.bincount(faces, signed), whole, rtol=1e-12)
    np.testing.assert_array_equal(np.unique(corners), np.arange(len(points)))
    np.testing.assert_array_equal(np.bincount(faces), np.diff(starts) - 2)


def test_a_polygon_in_space_is_seen_along_its_normal() -> None:
    rng = np.random.default_rng(5)
    flat = star(rng, 7)
    axes = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    seen = in_own_plane(flat @ axes[:2] + rng.normal(size=3), np.array([0, 7]))
    gaps = np.linalg.norm(seen[:, None] - seen, axis=-1)
    np.testing.assert_allclose(gaps, np.linalg.norm(flat[:, None] - flat, axis=-1), atol=1e-12)
    assert polygon_areas(seen, np.array([0, 7]))[0] > 0


@pytest.mark.parametrize(
    "broken",
    [
        [[0, 0], [1, 1], [1, 0], [0, 1], [0.5, 2]],
        [[0, 0], [1, 1], [2, 2], [3, 3], [4, 4]],
        [[0, 0], [1, 1], [1, 0], [0, 1]],
        [[0, 0], [2, 1], [1, 0], [0, 1]],  # crosses itself, with an area left over
        [[0, 0], [1, 0.1], [2, 0.2], [3, 0.3]],
        [[0, 0], [1, 0.1], [2, 0.2]],
        [[1, 1], [1, 1], [1, 1]],
    ],
)
@pytest.mark.parametrize("size", [1e-3, 1.0, 1e3])
def test_what_cannot_be_cut_is_refused_with_its_number(broken: list[list[float]], size: float) -> None:
    count = len(broken)
    points = np.concatenate([star(np.random.default_rng(6), count), size * np.array(broken, float)])
    with pytest.raises(PolygonError) as caught:
        triangulated(points, np.array([0, count, 2 * count]))
    assert caught.value.face == 1
