"""Terms of all three in-plane strains: what a sum over pairs of strains cannot say.

With s = (s_x, s_a, s_y), a spline material may add to eq. 31

    g_0(s) + [F_x(s, II)]₁₁ + [F_y(s, II)]₂₂,    F_x(s, λ) = Σ_m φ_xm(λ) g_xm(s),    F_y likewise,

where the g are tensor-product cubic splines on shared knots and the shapes φ are splines of curvature. The products
keep the cost of an element low: only the g depend on three strains, and a shape adds to the polynomials in λ that the
pairwise bending terms have already.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from yarnscale.errors import InputError
from yarnscale.shell.tables import CubicSpline, checked_knots, checked_values, hermite_basis

Array = NDArray[np.float64]

SHAPES = 2
"""Shapes of curvature in each bending family."""
SOLIDS = 1 + 2 * SHAPES
"""Splines of three strains: g_0, those of the family x, those of the family y."""


@dataclass(frozen=True, eq=False)
class InsideTerms:
    """Splines of three strains and shapes of curvature.

    knots: of s_x, s_a, s_y, lengths (n, m, k). nodal (SOLIDS, 2, 2, 2, n, m, k): at each knot, the spline
    differentiated so many times by each strain. shapes_x, shapes_y: ``SHAPES`` splines of λ_x [1/m] and of λ_y.
    Outside the knots a spline goes on linearly along each strain that is out of range. Raises InputError on arrays
    that do not match.
    """

    knots: tuple[Array, Array, Array]
    nodal: Array
    shapes_x: tuple[CubicSpline, ...]
    shapes_y: tuple[CubicSpline, ...]

    def __post_init__(self) -> None:
        if len(self.knots) != 3:
            raise InputError(
                "knots of the three-dimensional terms", expected="3 lists", found=len(self.knots)
            )
        knots = tuple(checked_knots(k, "knots of the three-dimensional terms") for k in self.knots)
        object.__setattr__(self, "knots", knots)
        shape = (SOLIDS, 2, 2, 2, *(len(k) for k in knots))
        object.__setattr__(self, "nodal", checked_values(self.nodal, shape, "three-dimensional terms"))
        for name in ("shapes_x", "shapes_y"):
            object.__setattr__(self, name, tuple(getattr(self, name)))
            if len(getattr(self, name)) != SHAPES:
                raise InputError(f"{name}", expected=f"{SHAPES} splines", found=len(getattr(self, name)))

    @cached_property
    def table(self) -> Array:
        """Coefficients by interval and power of each strain, (n + 1, m + 1, k + 1, SOLIDS, 4, 4, 4)."""
        maps = [_interval_maps(k) for k in self.knots]
        result = np.einsum("iapu,tpqrulw->iatlqrw", maps[0], self.nodal, optimize=True)
        result = np.einsum("jbql,iatlqrw->iajbtrw", maps[1], result, optimize=True)
        return np.ascontiguousarray(np.einsum("kcrw,iajbtrw->ijktabc", maps[2], result, optimize=True))


def _interval_maps(knots: Array) -> Array:
    """Map from nodal derivatives to coefficients of each interval, (n + 1, 4, 2, n)."""
    n = len(knots)
    maps = np.zeros((n + 1, 4, 2, n))
    for i, step in enumerate(np.diff(knots)):
        maps[i + 1][:, :, [i, i + 1]] = hermite_basis(step).reshape(4, 2, 2)
    maps[0, [0, 1], [0, 1], 0] = 1.0
    maps[n, [0, 1], [0, 1], n - 1] = 1.0
    return maps
