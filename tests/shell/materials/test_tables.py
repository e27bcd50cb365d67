"""Spline tables against closed forms, their continuation, their refinement and the interval search."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from yarnscale.errors import InputError
from yarnscale.shell.materials.tables import (
    BicubicSpline,
    CubicSpline,
    find_interval,
    padded_knots,
    shift,
    union_knots,
)

KNOTS = np.array([-0.7, -0.2, 0.0, 0.4, 1.1])


def cubic(x, derivative=0):
    return np.polynomial.Polynomial([0.3, -1.2, 0.8, 2.0]).deriv(derivative)(x)


def bicubic(u, v, du=0, dv=0):
    return cubic(u, du) * np.polynomial.Polynomial([1.0, 0.5, -0.7, 0.9]).deriv(dv)(v)


def random_spline(seed: int) -> CubicSpline:
    rng = np.random.default_rng(seed)
    return CubicSpline(KNOTS, rng.normal(size=5), rng.normal(size=5))


def random_bicubic(seed: int) -> BicubicSpline:
    rng = np.random.default_rng(seed)
    u, v = KNOTS, np.array([-30.0, 0.0, 10.0, 50.0])
    return BicubicSpline(u, v, *(rng.normal(size=(5, 4)) for _ in range(4)))


def test_cubic_is_reproduced_between_the_knots():
    spline = CubicSpline(KNOTS, cubic(KNOTS), cubic(KNOTS, 1))
    x = np.linspace(-0.69, 1.09, 50)
    for order in range(3):
        np.testing.assert_allclose(spline(x, order), cubic(x, order), rtol=1e-12, atol=1e-12)


def test_linear_tail_follows_the_end_slope():
    spline = random_spline(1)
    for end, x in ((0, -2.0), (-1, 3.0)):
        expected = spline.values[end] + spline.slopes[end] * (x - KNOTS[end])
        assert spline(x) == pytest.approx(expected, rel=1e-14)
        assert spline(x, 2) == 0


def test_splines_are_continuously_differentiable():
    spline = random_spline(2)
    for order in range(2):
        left, right = spline(KNOTS - 1e-12, order), spline(KNOTS, order)
        np.testing.assert_allclose(left, right, atol=1e-9)


def test_bicubic_is_reproduced_inside_and_linear_by_axis_outside():
    u, v = KNOTS, np.array([-1.0, 0.0, 0.5, 2.0])
    grid = np.meshgrid(u, v, indexing="ij")
    spline = BicubicSpline(u, v, *(bicubic(*grid, *order) for order in ((0, 0), (1, 0), (0, 1), (1, 1))))
    a, b = np.meshgrid(np.linspace(-0.69, 1.09, 12), np.linspace(-0.9, 1.9, 12), indexing="ij")
    for order in ((0, 0), (1, 0), (0, 2), (1, 1)):
        np.testing.assert_allclose(spline(a, b, order), bicubic(a, b, *order), rtol=1e-11, atol=1e-11)
    line = bicubic(1.1, 0.3) + 0.9 * bicubic(1.1, 0.3, 1, 0)
    assert spline(2.0, 0.3) == pytest.approx(line, rel=1e-12)
    corner = sum(bicubic(1.1, 2.0, i, j) * 0.9**i * 1.5**j for i, j in ((0, 0), (1, 0), (0, 1), (1, 1)))
    assert spline(2.0, 3.5) == pytest.approx(corner, rel=1e-12)


def test_refinement_changes_the_table_and_not_the_function():
    finer_u = union_knots(KNOTS, np.array([-1.3, -0.45, 0.2, 2.0]))
    finer_v = union_knots(np.array([-30.0, 0.0, 10.0, 50.0]), np.array([-45.0, 3.0, 80.0]))
    rng = np.random.default_rng(3)
    u, v = rng.uniform(-2, 3, 400), rng.uniform(-90, 120, 400)
    one, two = random_spline(4), random_bicubic(5)
    table_one, table_two = one.refined_table(finer_u), two.refined_table(finer_u, finer_v)
    i, j = np.searchsorted(finer_u, u, "right"), np.searchsorted(finer_v, v, "right")
    a = u - np.concatenate([finer_u[:1], finer_u])[i]
    b = v - np.concatenate([finer_v[:1], finer_v])[j]
    powers_a, powers_b = a[:, None] ** np.arange(4), b[:, None] ** np.arange(4)
    np.testing.assert_allclose(np.sum(table_one[i] * powers_a, 1), one(u), rtol=1e-10, atol=1e-10)
    found = np.einsum("na,nab,nb->n", powers_a, table_two[i, j], powers_b)
    np.testing.assert_allclose(found, two(u, v), rtol=1e-9, atol=1e-9)


def test_shift_moves_the_origin():
    c = np.array([0.3, -1.2, 0.8, 2.0])
    x = np.linspace(-1, 1, 7)
    moved = shift(c, 0.37)
    np.testing.assert_allclose(np.polynomial.Polynomial(moved)(x), cubic(x + 0.37), rtol=1e-13)


def test_union_takes_knots_once_that_differ_by_rounding():
    assert len(union_knots(np.array([0.0, 0.1 + 0.2, 1.0]), np.array([0.0, 0.3, 1.0]))) == 3


@settings(deadline=None)  # the first call compiles
@given(st.lists(st.floats(-1e3, 1e3), min_size=1, max_size=40, unique=True), st.floats(-2e3, 2e3))
def test_interval_search_agrees_with_searchsorted(values, x):
    knots = np.sort(np.array(values))
    assert find_interval(padded_knots(knots), x) == np.searchsorted(knots, x, "right")


def test_interval_search_survives_nan_and_infinity():
    padded = padded_knots(KNOTS)
    assert find_interval(padded, float("nan")) == 0
    assert find_interval(padded, float("-inf")) == 0
    assert find_interval(padded, 1e300) == len(KNOTS)


@pytest.mark.parametrize(
    ("knots", "values", "word"),
    [
        ([0.0], [1.0], "two knots"),
        ([0.0, 0.0], [1.0, 1.0], "increasing"),
        ([0.0, np.nan], [1.0, 1.0], "increasing"),
        ([0.0, 1.0], [1.0], "shape"),
        ([0.0, 1.0], [1.0, np.inf], "finite"),
    ],
)
def test_bad_nodal_data_is_refused(knots, values, word):
    with pytest.raises(InputError, match=word):
        CubicSpline(np.array(knots), np.array(values), np.zeros(len(values)))
