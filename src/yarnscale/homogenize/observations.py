"""Checked samples and the options of a fit: what both of its stages read."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from yarnscale.errors import InputError
from yarnscale.shell.materials.spline_patches import AXES

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

SHEAR = 1
"""Index of s_a."""
IN_STRESS = [0, 1, 2, 3, 5]
"""Components of stress that belong to s_x, s_a, s_y, λ_x and λ_y."""
_ON_AXIS = 1e-9
"""Strains below this fraction of the sampled range count as zero."""


@dataclass(frozen=True)
class FitOptions:
    """How to fit.

    axis_knots, plane_knots: most knots an axis has in one- and two-dimensional terms.
    smoothing: weight of squared third differences of coefficients beside squared relative residuals; little of it
    lets splines that meet both energies and slopes ring between samples.
    small: energy, as a fraction of the largest along the same side of an axis, below which residuals stop being
    relative. noise: fraction of its energy to which a sampled state is believed.
    reach: distance, as a fraction of the range, over which an error in stress counts as one in energy.
    symmetric_shear: make the energy even in s_a. quasi_convex: of the one-dimensional terms.
    pairs: two-dimensional terms too. grading: concentration of bending knots around zero.
    """

    axis_knots: int = 25
    plane_knots: int = 17
    smoothing: float = 1e-2
    small: float = 0.02
    noise: float = 0.02
    reach: float = 0.15
    symmetric_shear: bool = True
    quasi_convex: bool = True
    pairs: bool = True
    grading: float = 2.0


@dataclass(frozen=True)
class Observations:
    """Samples: strains (n, 5), energies (n,), stresses (n, 5), weights (n,); NaN where unknown."""

    strains: Array
    energies: Array
    stresses: Array
    weights: Array

    @cached_property
    def acting(self) -> Mask:
        """Which strains of a state are not zero, (n, 5)."""
        size = np.abs(self.strains)
        return np.asarray(size > _ON_AXIS * np.max(size, axis=0))

    @cached_property
    def resting(self) -> Mask:
        """The undeformed states, (n,)."""
        return ~np.any(self.acting, axis=1)

    def on_axis(self, axis: int) -> Mask:
        """States where only this strain acts, (n,)."""
        return self.acting[:, axis] & (self.acting.sum(axis=1) == 1)

    def on_plane(self, i: int, j: int) -> Mask:
        """States where both of these strains act and no other, (n,)."""
        return self.acting[:, i] & self.acting[:, j] & (self.acting.sum(axis=1) == 2)

    @cached_property
    def off_planes(self) -> Mask:
        """States of three and more strains or of both curvatures, (n,)."""
        return (self.acting.sum(axis=1) > 2) | (self.acting[:, 3] & self.acting[:, 4])


def observations(
    strains: ArrayLike,
    energies: ArrayLike,
    stresses: ArrayLike | None = None,
    *,
    weights: ArrayLike | None = None,
    valid: ArrayLike | None = None,
) -> Observations:
    """Samples that can be used: valid, finite, of positive weight. InputError on arrays that do not match."""
    strain, energy = np.asarray(strains, dtype=np.float64), np.asarray(energies, dtype=np.float64)
    if strain.ndim != 2 or strain.shape[1] != 5:
        raise InputError("strains", expected=f"shape (n, 5), {', '.join(AXES)}", found=strain.shape)
    n = len(strain)
    stress = np.full((n, 5), np.nan) if stresses is None else np.asarray(stresses, dtype=np.float64)
    weight = np.ones(n) if weights is None else np.asarray(weights, dtype=np.float64)
    keep = np.ones(n, dtype=bool) if valid is None else np.asarray(valid, dtype=bool)
    for name, array, shape in (
        ("energies", energy, (n,)),
        ("stresses", stress, (n, 5)),
        ("weights", weight, (n,)),
        ("valid", keep, (n,)),
    ):
        if array.shape != shape:
            raise InputError(name, expected=f"shape {shape}", found=array.shape)
    keep = keep & np.all(np.isfinite(strain), axis=1) & np.isfinite(energy) & (weight > 0)
    if not np.any(keep):
        raise InputError("samples", expected="at least one valid state", found="none")
    return Observations(strain[keep], energy[keep], stress[keep], weight[keep])


def strains_of(states: ArrayLike) -> Array:
    """Six strains of a shell from (s_x, s_a, s_y, λ_x, λ_y): II = diag(λ_x, λ_y), shape (n, 6)."""
    states = np.asarray(states, dtype=np.float64)
    return np.insert(states, 4, 0.0, axis=1)


def side_energies(data: Observations, constant: float) -> Array:
    """Largest |ψ − ψ0| [J/m²] on the negative and positive side of each axis, (5, 2).

    A side without samples takes the value of the other; both are NaN where the axis has none.
    """
    result = np.full((5, 2), np.nan)
    for axis in range(5):
        for side, sign in enumerate((-1, 1)):
            chosen = data.on_axis(axis) & (sign * data.strains[:, axis] > 0)
            if np.any(chosen):
                result[axis, side] = max(np.max(np.abs(data.energies[chosen] - constant)), 1e-300)
        result[axis] = np.where(np.isnan(result[axis]), result[axis, ::-1], result[axis])
    return result


def of_side(pair: Array, strains: Array) -> Array:
    """The negative or positive one of two values by the sign of each strain; the smaller one at zero."""
    negative, positive = pair
    return np.where(strains < 0, negative, np.where(strains > 0, positive, min(negative, positive)))
