"""Terms of all three in-plane strains, and of both curvatures: what a sum over pairs of strains cannot say.

With s = (s_x, s_a, s_y), a spline material may add to eq. 31

    g_0(s) + [F_x(s, II)]₁₁ + [F_y(s, II)]₂₂ + χ(II) g_d(s),    F_x(s, λ) = Σ_m φ_xm(λ) g_xm(s),    F_y likewise,

where the g are tensor-product cubic splines on shared knots and the shapes φ are splines of curvature. The products
keep the cost of an element low: only the g depend on three strains, and a shape adds to the polynomials in λ that the
pairwise bending terms have already.

The last term couples the two bending families, of which eq. 32 takes the sum: saddles and domes cost another energy
than the cylinders they are made of, and a cylinder has a moment along its axis. With X = II/κ of a curvature κ,

    χ = (X₁₁ X₂₂ + X₁₂²) / (1 + tr X²),

which lies within ±½ everywhere and so cannot outgrow the bending energy. The sign of X₁₂² is measured, on solved cells
bent in any direction: where bending along both axes costs less than the sum, twisting and bending along the bias do so
too, by as much (eq. 32 gives them the mean stiffness of both axes). A determinant would make them stiffer instead.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from yarnscale.errors import InputError
from yarnscale.shell.materials.tables import CubicSpline, checked_knots, checked_values, hermite_basis

Array = NDArray[np.float64]

SHAPES = 2
"""Shapes of curvature in each bending family."""
COUPLING = 1 + 2 * SHAPES
"""Place of g_d among the splines of three strains: g_0, those of the family x, those of the family y, g_d."""
SOLIDS = COUPLING + 1


@dataclass(frozen=True, eq=False)
class InsideTerms:
    """Splines of three strains and shapes of curvature.

    knots: of s_x, s_a, s_y, lengths (n, m, k). nodal (SOLIDS, 2, 2, 2, n, m, k): at each knot, the spline
    differentiated so many times by each strain. shapes_x, shapes_y: ``SHAPES`` splines of λ_x [1/m] and of λ_y.
    curvature: κ [1/m], positive.
    Outside the knots a spline goes on linearly along each strain that is out of range. Raises InputError on arrays
    that do not match.
    """

    knots: tuple[Array, Array, Array]
    nodal: Array
    shapes_x: tuple[CubicSpline, ...]
    shapes_y: tuple[CubicSpline, ...]
    curvature: float

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
        object.__setattr__(self, "curvature", float(checked_values(self.curvature, (), "curvature")))
        if self.curvature <= 0:
            raise InputError("curvature", expected="a positive number", found=self.curvature)

    def without_coupling(self) -> InsideTerms:
        """The same with g_d = 0."""
        nodal = self.nodal.copy()
        nodal[COUPLING] = 0.0
        return replace(self, nodal=nodal)

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
