"""One-dimensional terms: a quasi-convex C² spline through the states of one axis (stage 1 of the fit)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import nnls

from yarnscale.homogenize.observations import SHEAR, FitOptions, Observations, of_side
from yarnscale.homogenize.splines import LineBasis, knots_for
from yarnscale.shell.materials.tables import CubicSpline

Array = NDArray[np.float64]


@dataclass(frozen=True)
class AxisTerm:
    """A one-dimensional term f_i.

    reach: distance over which an error in stress counts as one in energy, on the negative and positive side, (2,).
    sampled: false where the axis has no states, and the term is zero.
    """

    spline: CubicSpline
    reach: Array
    sampled: bool = True


def fit_axis(data: Observations, axis: int, constant: float, sides: Array, options: FitOptions) -> AxisTerm:
    """Fit f_i to energies less ``constant`` and to stresses on an axis; ``sides`` from ``side_energies``."""
    if not np.any(data.on_axis(axis)):
        flat = CubicSpline(np.array([-1.0, 1.0]), np.zeros(2), np.zeros(2))
        return AxisTerm(flat, np.ones(2), sampled=False)
    use = data.on_axis(axis) | data.resting
    x, energy, stress = data.strains[use, axis], data.energies[use] - constant, data.stresses[use, axis]
    known = np.isfinite(stress)
    even = axis == SHEAR and options.symmetric_shear
    grading = options.grading / 2 if axis > 2 else 0.0
    knots = knots_for(x, limit=options.axis_knots, even=even, grading=grading, slopes=bool(np.any(known)))
    basis = LineBasis(knots, even=even)
    reach = options.reach * np.abs(knots[[0, -1]])
    reach = np.where(reach > 0, reach, reach[::-1])
    scale = options.small * of_side(sides[axis], x) + np.abs(energy)
    weight = np.sqrt(data.weights[use]) / scale
    steep = (weight * of_side(reach, x))[known]
    smooth = np.sqrt(options.smoothing) * basis.differences(3)
    nearest = np.argmin(np.abs(basis.centers[:, None] - x), axis=1)
    smooth /= np.array([scale[nearest[k : k + 4]].mean() for k in range(len(smooth))])[:, None]
    energies, slopes = weight[:, None] * basis.active_design(x), basis.active_design(x[known], 1)
    rows = np.concatenate([energies, steep[:, None] * slopes, smooth])
    target = np.concatenate([weight * energy, steep * stress[known], np.zeros(len(smooth))])
    solve = _quasi_convex if options.quasi_convex else _free
    coefficients = solve(basis, rows, target)
    # Without slopes nothing tells how deep a minimum between samples is: keep to the lowest sample.
    fine = np.linspace(knots[0], knots[-1], 201)
    for _ in range(0 if np.any(known) else 10):
        low = basis.active_design(fine) @ coefficients < energy.min() - 0.1 * scale.min()
        if not np.any(low):
            break
        rows = np.concatenate([rows, basis.active_design(fine[low]) / scale.min()])
        target = np.concatenate([target, np.full(np.count_nonzero(low), energy.min() / scale.min())])
        coefficients = solve(basis, rows, target)
    values, slopes = (basis.active_design(knots, order) @ coefficients for order in (0, 1))
    values[np.argmin(np.abs(knots))] = 0.0
    return AxisTerm(CubicSpline(knots, values, slopes), reach)


def _free(basis: LineBasis, rows: Array, target: Array) -> Array:
    free = np.linalg.lstsq(rows @ basis.reduction, target, rcond=None)[0]
    return basis.reduction @ free


def _quasi_convex(basis: LineBasis, rows: Array, target: Array) -> Array:
    """Active coefficients that fall up to one place and rise after it, for the best of all places.

    Steps between neighbours are the unknowns, with signs fixed by the place; the level follows from f(0) = 0.
    """
    n = basis.active
    at_zero = basis.active_design(np.zeros(1))[0]
    best, lowest = np.zeros(n), np.inf
    for place in [n // 2] if basis.even else range(n):
        steps = np.zeros((n, n - 1))
        for k in range(n - 1):
            steps[slice(0, k + 1) if k < place else slice(k + 1, n), k] = 1.0
        if basis.even:
            steps = (steps + steps[:, ::-1])[:, n // 2 :]
        steps -= at_zero @ steps
        found, residual = nnls(rows @ steps, target, maxiter=50 * n)
        if residual < lowest:
            best, lowest = steps @ found, residual
    return best
