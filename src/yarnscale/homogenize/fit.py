"""The published form of a homogenized material: the pairwise spline energy of HYLC20 eq. 31–32.

It is the baseline of the compact energy (``compact_fit``). Two stages of weighted, regularised linear least squares on
C² cubic B-splines:

1. each f_i(θ_i) to the states of its axis, made quasi-convex (falling up to its lowest place, rising after it);
2. all f_ij(θ_i, θ_j) together to what the f_i leave over, f_ij(0, ·) = f_ij(·, 0) = 0. Beyond the sampled range they
   run flat within two intervals and stay constant.

All are continued along straight lines. Weights make residuals relative: the energy of a state counts by what its second
strain adds to the energy, so that bending is not lost beside stretching.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict

import numpy as np
from numpy.typing import ArrayLike, NDArray

from yarnscale.errors import InputError
from yarnscale.homogenize.axis_fit import fit_axis
from yarnscale.homogenize.observations import (
    IN_STRESS,
    SHEAR,
    FitOptions,
    Observations,
    observations,
    side_energies,
    strains_of,
)
from yarnscale.homogenize.plane_fit import PlaneFit
from yarnscale.shell.materials.spline_material import SplineMaterial

__all__ = ["IN_STRESS", "FitOptions", "fit_spline_material", "strains_of"]

Array = NDArray[np.float64]


def fit_spline_material(
    strains: ArrayLike,
    energies: ArrayLike,
    stresses: ArrayLike | None = None,
    *,
    density: float,
    weights: ArrayLike | None = None,
    valid: ArrayLike | None = None,
    options: FitOptions | None = None,
    provenance: Mapping[str, object] | None = None,
) -> SplineMaterial:
    """Spline material of sampled states on the axes and planes of (s_x, s_a, s_y, λ_x, λ_y).

    strains (n, 5) [-, 1/m]; energies (n,) [J/m²]; stresses (n, 5) = dψ/d(s_x, s_a, s_y, II11, II22), NaN where
    unknown; weights (n,) and valid (n,) mask; density [kg/m²]. The undeformed state must be among them. States off the
    planes are used lightly. Terms of strains that were not sampled are zero. Raises InputError on arrays that do not
    match or where the undeformed state is missing. Source: HYLC20 §6.2.
    """
    options = options or FitOptions()
    data = observations(strains, energies, stresses, weights=weights, valid=valid)
    if not np.any(data.resting):
        raise InputError("samples", expected="the undeformed state among them", found="none with zero strain")
    constant = float(np.average(data.energies[data.resting], weights=data.weights[data.resting]))
    sides = side_energies(data, constant)
    axes = [fit_axis(data, axis, constant, sides, options) for axis in range(5)]
    planes = {}
    if options.pairs:
        fitted = PlaneFit(data, axes, constant, sides, options)
        fitted.solve()
        planes = fitted.splines()
    record = {"states": len(data.energies), "options": asdict(options)}
    return SplineMaterial(
        constant, tuple(axis.spline for axis in axes), planes, density=density, range=_sampled_box(data, options),
        provenance={**(provenance or {}), "fit": record},
    )  # fmt: skip


def _sampled_box(data: Observations, options: FitOptions) -> Array:
    box = np.stack([data.strains.min(axis=0), data.strains.max(axis=0)], axis=1)
    if options.symmetric_shear:
        box[SHEAR] = np.max(np.abs(box[SHEAR])) * np.array([-1, 1])
    box[box[:, 0] == box[:, 1]] = (-1e-9, 1e-9)
    return box
