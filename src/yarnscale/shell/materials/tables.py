"""Piecewise cubics in one and two variables: nodal data, their polynomial patches, and the interval search.

A spline is stored as Hermite nodal data (values and slopes at knots), as in files. For evaluation it
becomes a table of patches: n knots give n + 1 intervals, the first and last being the continuation outside
the knots, and every interval holds the coefficients of a polynomial about its origin (its left knot; the
first knot for the interval below it). A table can be refined to any superset of its knots without changing
the function, so that all tables along one axis share knots and one interval search serves them all.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numba
import numpy as np
from numpy.typing import ArrayLike

from yarnscale.arrays import Array, Integers
from yarnscale.errors import InputError

# Monomial coefficients about the left knot of the cubic on [0, h] from (p0, p1, m0, m1): powers of 1/h by
# row.
_HERMITE = np.array([[1.0, 0, 0, 0], [0, 0, 1, 0], [-3, 3, -2, -1], [2, -2, 1, 1]])


def hermite_basis(step: float) -> Array:
    """Map (p0, p1, m0, m1) of an interval of length ``step`` to monomial coefficients, shape (4, 4)."""
    basis = _HERMITE.copy()
    basis[:, 2:] *= step
    return basis / (step ** np.arange(4))[:, None]


def shift(coefficients: Array, offset: float | Array, *, axis: int = -1) -> Array:
    """Coefficients of the same cubics about an origin moved by ``offset``: q(x) = p(x + offset)."""
    c0, c1, c2, c3 = np.moveaxis(coefficients, axis, 0)
    d = offset
    moved = (c0 + d * (c1 + d * (c2 + d * c3)), c1 + d * (2 * c2 + 3 * d * c3), c2 + 3 * d * c3, c3 + 0 * d)
    return np.stack(np.broadcast_arrays(*moved), axis=axis)


def checked_knots(knots: ArrayLike, name: str) -> Array:
    """Knots as an increasing finite array of at least two; InputError otherwise."""
    array = np.array(knots, dtype=np.float64)
    if array.ndim != 1 or len(array) < 2:
        raise InputError(f"{name}", expected="at least two knots", found=f"shape {array.shape}")
    if not np.all(np.isfinite(array)) or not np.all(np.diff(array) > 0):
        raise InputError(f"{name}", expected="finite, strictly increasing knots", found=array.tolist())
    return array


def checked_values(values: ArrayLike, shape: tuple[int, ...], name: str) -> Array:
    """Finite float array of the given shape; InputError otherwise."""
    array = np.array(values, dtype=np.float64)
    if array.shape != shape:
        raise InputError(name, expected=f"shape {shape}", found=f"shape {array.shape}")
    if not np.all(np.isfinite(array)):
        raise InputError(name, expected="finite numbers", found="NaN or infinity")
    return array


def origins(knots: Array) -> Array:
    """Origin of each of the n + 1 intervals."""
    return np.concatenate([knots[:1], knots])


def _interval_of(knots: Array, x: Array) -> Integers:
    return np.searchsorted(knots, x, side="right")


def _inside(knots: Array, coarse: Array) -> Integers:
    """For each interval of ``knots``, the interval of ``coarse`` (a subset of the knots) that contains it."""
    middles = np.concatenate([knots[:1] - 1.0, 0.5 * (knots[1:] + knots[:-1]), knots[-1:] + 1.0])
    return _interval_of(coarse, middles)


@dataclass(frozen=True, eq=False)
class CubicSpline:
    """A C¹ piecewise cubic of one variable from values and slopes at its knots.

    knots (n,), values (n,), slopes (n,) = d value / d variable. Outside, it is continued linearly.
    Raises InputError for wrong lengths, knots that do not increase, and numbers that are not finite.
    """

    knots: Array
    values: Array
    slopes: Array

    def __post_init__(self) -> None:
        knots = checked_knots(self.knots, "knots")
        object.__setattr__(self, "knots", knots)
        object.__setattr__(self, "values", checked_values(self.values, knots.shape, "values"))
        object.__setattr__(self, "slopes", checked_values(self.slopes, knots.shape, "slopes"))

    @cached_property
    def table(self) -> Array:
        """Coefficients by interval and power, shape (n + 1, 4)."""
        n, p, m = len(self.knots), self.values, self.slopes
        table = np.zeros((n + 1, 4))
        for i, step in enumerate(np.diff(self.knots)):
            table[i + 1] = hermite_basis(step) @ np.array([p[i], p[i + 1], m[i], m[i + 1]])
        table[0, :2], table[n, :2] = (p[0], m[0]), (p[-1], m[-1])
        return table

    def __call__(self, x: ArrayLike, derivative: int = 0) -> Array:
        """Value, or derivative of the given order (0 to 3), at points of any shape."""
        x = np.asarray(x, dtype=np.float64)
        interval = _interval_of(self.knots, x)
        powers = _powers(x - origins(self.knots)[interval], derivative)
        return np.einsum("...a,...a->...", self.table[interval], powers)

    def refined_table(self, knots: Array) -> Array:
        """The table on a superset of the knots: the same function, shape (len(knots) + 1, 4)."""
        parent = _inside(knots, self.knots)
        return shift(self.table[parent], origins(knots) - origins(self.knots)[parent])


@dataclass(frozen=True, eq=False)
class BicubicSpline:
    """A C¹ piecewise bicubic of two variables from values, slopes and twists at a grid of knots.

    knots_u (n,), knots_v (m,); values, slopes_u, slopes_v, twists (= mixed derivative), each (n, m). Outside,
    it is continued linearly along each axis; zero slopes at the border give a constant.
    """

    knots_u: Array
    knots_v: Array
    values: Array
    slopes_u: Array
    slopes_v: Array
    twists: Array

    def __post_init__(self) -> None:
        u, v = checked_knots(self.knots_u, "knots_u"), checked_knots(self.knots_v, "knots_v")
        object.__setattr__(self, "knots_u", u)
        object.__setattr__(self, "knots_v", v)
        for name in ("values", "slopes_u", "slopes_v", "twists"):
            object.__setattr__(self, name, checked_values(getattr(self, name), (len(u), len(v)), name))

    @cached_property
    def table(self) -> Array:
        """Coefficients by interval of u, interval of v, power of u, power of v: (n + 1, m + 1, 4, 4)."""
        data = np.block([[self.values, self.slopes_v], [self.slopes_u, self.twists]])
        return np.einsum("iap,pq,jbq->ijab", _node_map(self.knots_u), data, _node_map(self.knots_v), optimize=True)

    def __call__(self, u: ArrayLike, v: ArrayLike, derivative: tuple[int, int] = (0, 0)) -> Array:
        """Value, or derivative of the given orders, at points (u, v) that broadcast."""
        u, v = np.broadcast_arrays(np.asarray(u, dtype=np.float64), np.asarray(v, dtype=np.float64))
        i, j = _interval_of(self.knots_u, u), _interval_of(self.knots_v, v)
        powers_u = _powers(u - origins(self.knots_u)[i], derivative[0])
        powers_v = _powers(v - origins(self.knots_v)[j], derivative[1])
        return np.einsum("...a,...ab,...b->...", powers_u, self.table[i, j], powers_v)

    def refined_table(self, knots_u: Array, knots_v: Array) -> Array:
        """The table on supersets of both knot vectors: the same function."""
        i, j = _inside(knots_u, self.knots_u), _inside(knots_v, self.knots_v)
        moved = shift(self.table[np.ix_(i, j)], (origins(knots_u) - origins(self.knots_u)[i])[:, None, None], axis=2)
        return shift(moved, (origins(knots_v) - origins(self.knots_v)[j])[None, :, None], axis=3)


def _powers(x: Array, derivative: int) -> Array:
    """Monomials 1, x, x², x³ differentiated ``derivative`` times, shape (..., 4)."""
    result = np.zeros((*x.shape, 4))
    for power in range(derivative, 4):
        factor = np.prod(np.arange(power, power - derivative, -1, dtype=np.float64))
        result[..., power] = factor * x ** (power - derivative)
    return result


def _node_map(knots: Array) -> Array:
    """For each interval, the map from all nodal (values, slopes) to coefficients: (n + 1, 4, 2n)."""
    n = len(knots)
    maps = np.zeros((n + 1, 4, 2 * n))
    for i, step in enumerate(np.diff(knots)):
        maps[i + 1][:, [i, i + 1, n + i, n + i + 1]] = hermite_basis(step)
    maps[0][[0, 1], [0, n]] = 1.0
    maps[n][[0, 1], [n - 1, 2 * n - 1]] = 1.0
    return maps


def union_knots(*knots: Array) -> Array:
    """Sorted union of knot vectors, with knots that differ only by rounding taken once."""
    merged = np.unique(np.concatenate(knots))
    span = merged[-1] - merged[0]
    return merged[np.concatenate([[True], np.diff(merged) > 1e-12 * span])]


def padded_knots(knots: Array) -> Array:
    """Knots followed by +inf up to a power of two minus one, for ``find_interval``."""
    size = 1
    while size - 1 < len(knots):
        size *= 2
    return np.concatenate([knots, np.full(size - 1 - len(knots), np.inf)])


@numba.njit(inline="always", cache=True)
def find_interval(padded: Array, x: float) -> int:
    """Interval of x among padded knots: the number of knots ≤ x, by a binary search without branches.

    A NaN gives interval 0.
    """
    step = (len(padded) + 1) >> 1
    index = 0
    while step > 0:
        index += step if padded[index + step - 1] <= x else 0
        step >>= 1
    return index
