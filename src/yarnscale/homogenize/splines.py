"""Smooth (C²) cubic spline bases for fitting, reduced so that what must hold does hold.

Coefficients that are free are few; a reduction matrix gives all B-spline coefficients from them. It builds in that the
function vanishes at zero, that it is even where asked for, and that it is constant beyond the sampled range (the last
coefficients repeated, so that it runs flat within two intervals, C² everywhere).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BSpline

Array = NDArray[np.float64]

_SAME = 1e-6
"""Sampled strains closer than this fraction of their range count as one."""


def knots_for(samples: Array, *, limit: int, even: bool, grading: float, slopes: bool) -> Array:
    """Knots over the range of some sampled strains, zero among them; even: symmetric.

    The distinct sampled values, and their middles where slopes were sampled too; where these are more than ``limit``,
    that many knots, spaced as sinh(grading · t) from zero outwards (0: evenly) to have more of them near zero.
    """
    values = np.concatenate([samples, -samples, [0.0]]) if even else np.append(samples, 0.0)
    values = np.unique(values)
    reach = values[-1] - values[0]
    values = values[np.concatenate([[True], np.diff(values) > _SAME * reach])]
    values[np.argmin(np.abs(values))] = 0.0
    if even:
        values = 0.5 * (values - values[::-1])
    if slopes:
        values = np.sort(np.concatenate([values, 0.5 * (values[1:] + values[:-1])]))
    if len(values) <= limit:
        return values
    low, high = -values[0], values[-1]
    below = int(np.clip(round((limit - 1) * low / (low + high)), low > 0, limit - 1 - (high > 0)))
    above = below if even else limit - 1 - below
    return np.concatenate([_graded(below, values[0], grading)[::-1], [0.0], _graded(above, high, grading)])


def _graded(count: int, end: float, grading: float) -> Array:
    steps = np.arange(1, count + 1) / max(count, 1)
    return end * (steps if grading == 0 else np.sinh(grading * steps) / np.sinh(grading))


@dataclass(frozen=True, eq=False)
class LineBasis:
    """C² cubic splines on an interval, linear combinations of ``count`` free coefficients, zero at zero.

    knots (n,): breakpoints, 0 among them. even: f(−x) = f(x) (knots must be symmetric).
    flat: constant beyond the knots; otherwise functions are only meant within the knots.
    """

    knots: Array
    even: bool = False
    flat: bool = False

    @cached_property
    def breaks(self) -> Array:
        """Breakpoints of the pieces, with those of the flat ends."""
        if not self.flat:
            return self.knots
        least = 0.08 * (self.knots[-1] - self.knots[0])
        first, last = (max(step, least) for step in np.diff(self.knots)[[0, -1]])
        left, right = self.knots[0] - first * np.array([2, 1]), self.knots[-1] + last * np.array([1, 2])
        return np.concatenate([left, self.knots, right])

    @cached_property
    def _extended(self) -> Array:
        """The knot vector of the B-splines: breakpoints and three more on each side."""
        first, last = np.diff(self.breaks)[[0, -1]]
        left, right = (
            self.breaks[0] - first * np.array([3, 2, 1]),
            self.breaks[-1] + last * np.array([1, 2, 3]),
        )
        return np.concatenate([left, self.breaks, right])

    @property
    def active(self) -> int:
        """Number of coefficients before they are reduced (and repeated at flat ends)."""
        return len(self.knots) + 2

    @cached_property
    def centers(self) -> Array:
        """Where each active coefficient acts (Greville abscissae), shape (active,)."""
        t = self._extended
        centers = (t[1:-3] + t[2:-2] + t[3:-1]) / 3
        return centers[2:-2] if self.flat else centers

    @cached_property
    def _repeat(self) -> Array:
        """All B-spline coefficients from the active ones."""
        eye = np.eye(self.active)
        return np.concatenate([eye[[0, 0]], eye, eye[[-1, -1]]]) if self.flat else eye

    @cached_property
    def _at_zero(self) -> Array:
        return self._functions(np.zeros(1), 0)[0] @ self._repeat

    @cached_property
    def reduction(self) -> Array:
        """Active coefficients from the free ones, (active, count): even, and zero at zero."""
        n = self.active
        fold = np.eye(n)
        if self.even:
            fold = fold[:, : (n + 1) // 2] + fold[:, ::-1][:, : (n + 1) // 2]
            fold = np.minimum(fold, 1.0)
        weight = self._at_zero @ fold
        k = int(np.argmax(np.abs(weight)))
        rest = np.delete(np.eye(fold.shape[1]), k, axis=1)
        rest[k] = -np.delete(weight, k) / weight[k]
        return fold @ rest

    @property
    def count(self) -> int:
        """Number of free coefficients."""
        return self.reduction.shape[1]

    def _functions(self, x: Array, derivative: int) -> Array:
        t = self._extended
        inside = np.clip(x, self.breaks[0], self.breaks[-1])
        found = BSpline(t, np.eye(len(t) - 4), 3)(inside, nu=derivative)
        if derivative and self.flat:
            found[inside != x] = 0.0
        return found

    def design(self, x: Array, derivative: int = 0) -> Array:
        """Values (or derivatives) of the free functions at x, shape (len(x), count)."""
        return self.active_design(x, derivative) @ self.reduction

    def active_design(self, x: Array, derivative: int = 0) -> Array:
        """Values (or derivatives) of the functions of the active coefficients at x, (len(x), active)."""
        return self._functions(np.asarray(x, dtype=np.float64), derivative) @ self._repeat

    def differences(self, order: int) -> Array:
        """Differences of active coefficients, zero for polynomials of degree < order: (active − order, active).

        Scaled by the local distance of the coefficients, so that they have the unit of the function.
        """
        rows, places = np.eye(self.active), self.centers
        for k in range(1, order + 1):
            gap = (places[k:] - places[:-k])[:, None]
            rows = k * np.diff(rows, axis=0) / gap
        span = (places[order:] - places[:-order]) / order
        return rows * (span**order)[:, None]
