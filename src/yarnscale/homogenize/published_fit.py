"""The published form of a homogenized material: splines of one and two strains, fitted as HYLC20 §6 says.

It is the baseline of the compact energy (``compact_fit``):

1. strains are divided by their largest sampled size, and energies with their slopes are resampled at control points
   by moving least squares (local quadratic polynomials), which evens out the noise of buckling;
2. from the lowest control point outward, energies that fall are raised (quasi-convex marching);
3. slopes are bounded so that every piece between control points is monotone (Fritsch and Carlson 1980, for the
   two-dimensional terms Carlson and Fritsch 1989 along both strains);
4. f_ij takes what f_0 + f_i + f_j leave over on its plane, f_ij(0, ·) = f_ij(·, 0) = 0. The term of s_x and s_y, which
   contains the contraction across a pull, is not marched.

Beyond the control points all terms continue linearly. The supplement of HYLC20 with its constants is not
public; the width of the local polynomials and the number of control points are ours.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.sparse import csr_matrix

from yarnscale.arrays import Array
from yarnscale.errors import InputError
from yarnscale.shell.materials.spline_material import SplineMaterial
from yarnscale.shell.materials.spline_patches import AXES, PLANES
from yarnscale.shell.materials.tables import BicubicSpline, CubicSpline, union_knots

IN_STRESS = [0, 1, 2, 3, 5]
"""Components of stress that belong to s_x, s_a, s_y, λ_x and λ_y."""
SHEAR = 1
_STRETCHES = (0, 2)
_SAME = 1e-9
"""Strains, over the largest, below which a state counts as lying on an axis or plane."""


@dataclass(frozen=True)
class PublishedOptions:
    """How to fit.

    knots: most control points of an axis (a term of two strains has half as many on each). smoothing: width of the
    local polynomials over the distance of the sampled states; 0.25 and less interpolates every state.
    even_knots: bending control points spaced evenly, not closer to zero. pairs: terms of two strains too.
    symmetric_shear: make the energy even in s_a.
    """

    knots: int = 25
    smoothing: float = 0.35
    even_knots: bool = False
    pairs: bool = True
    symmetric_shear: bool = True

    def __post_init__(self) -> None:
        if self.knots < 5:
            raise InputError("control points", expected="at least 5", found=self.knots)
        if not 0.0 < self.smoothing <= 100.0:
            raise InputError("smoothing", expected="a number in 0 … 100", found=self.smoothing)


@dataclass(frozen=True)
class _States:
    """Sampled states over the largest of each strain: x (n, 5), energies above rest (n,), slopes by x (n, 5)."""

    x: Array
    energies: Array
    slopes: Array

    def on(self, axes: tuple[int, ...]) -> _States:
        """Those where no other strain acts."""
        others = np.delete(np.abs(self.x), axes, axis=1)
        use = (others < _SAME).all(axis=1)
        return _States(self.x[use][:, axes], self.energies[use], self.slopes[use][:, axes])

    def mirrored(self) -> _States:
        """Means of the states and their mirror images, whose shear has the other sign."""
        signs = np.where(np.arange(5) == SHEAR, -1.0, 1.0)
        x, slopes = (np.concatenate([a, a * signs]) for a in (self.x, self.slopes))
        x, place, count = np.unique(x.round(9) + 0.0, axis=0, return_inverse=True, return_counts=True)
        mean = csr_matrix((1 / count[place], (place, np.arange(len(place)))))
        return _States(x, mean @ np.tile(self.energies, 2), mean @ slopes)

    def less(self, terms: tuple[CubicSpline, ...]) -> _States:
        """What one-dimensional terms leave over."""
        columns = list(zip(terms, self.x.T, strict=True))
        energies = self.energies - sum(term(x) for term, x in columns)
        return _States(self.x, energies, self.slopes - np.stack([term(x, 1) for term, x in columns], axis=1))


def strains_of(states: ArrayLike) -> Array:
    """Six strains of a shell from (s_x, s_a, s_y, λ_x, λ_y): II = diag(λ_x, λ_y), shape (n, 6)."""
    return np.insert(np.asarray(states, dtype=np.float64), 4, 0.0, axis=1)


def fit_spline_material(
    strains: ArrayLike,
    energies: ArrayLike,
    stresses: ArrayLike | None = None,
    *,
    density: float,
    options: PublishedOptions | None = None,
    provenance: Mapping[str, object] | None = None,
) -> SplineMaterial:
    """Spline material of sampled states on the axes and planes of (s_x, s_a, s_y, λ_x, λ_y).

    strains (n, 5) [-, 1/m]; energies (n,) [J/m²], NaN where unknown; stresses (n, 5) = dψ/d(s_x, s_a, s_y, II11, II22),
    NaN where unknown; density [kg/m²]. The undeformed state must be among them. States off the planes do not count.
    Terms of strains that were not sampled are zero. Raises InputError on arrays that do not match or where the
    undeformed state is missing. Source: HYLC20 §6.2.
    """
    options = options or PublishedOptions()
    states, constant, scale = _scaled(strains, energies, stresses)
    count = len(states.energies)
    if options.symmetric_shear:
        states = states.mirrored()
    axes = [_axis_term(states, k, options) for k in range(5)]
    planes: dict[tuple[int, int], BicubicSpline] = {}
    for i, j in PLANES if options.pairs else ():
        on_plane = states.on((i, j))
        if np.any((np.abs(on_plane.x) > _SAME).all(axis=1)):
            term = _plane_term(on_plane, (axes[i], axes[j]), (i, j), options)
            planes[i, j] = _bicubic_in_units(term, scale[i], scale[j])
    box = np.stack([states.x.min(axis=0), states.x.max(axis=0)], axis=1) * scale[:, None]
    box[box[:, 0] == box[:, 1]] = (-1e-9, 1e-9)
    record = {"states": count, "options": asdict(options)}
    return SplineMaterial(
        constant, tuple(_cubic_in_units(f, unit) for f, unit in zip(axes, scale, strict=True)), planes,
        density=density, range=box, provenance={**(provenance or {}), "fit": record},
    )  # fmt: skip


def _scaled(strains: ArrayLike, energies: ArrayLike, stresses: ArrayLike | None) -> tuple[_States, float, Array]:
    """Checked states over the largest sampled strains; the energy at rest [J/m²]; those strains (5,)."""
    strain, energy = np.asarray(strains, dtype=np.float64), np.asarray(energies, dtype=np.float64)
    if strain.ndim != 2 or strain.shape[1] != 5:
        raise InputError("strains", expected=f"shape (n, 5), {', '.join(AXES)}", found=strain.shape)
    n = len(strain)
    stress = np.full((n, 5), np.nan) if stresses is None else np.asarray(stresses, dtype=np.float64)
    for name, array, shape in (("energies", energy, (n,)), ("stresses", stress, (n, 5))):
        if array.shape != shape:
            raise InputError(name, expected=f"shape {shape}", found=array.shape)
    known = np.isfinite(strain).all(axis=1) & np.isfinite(energy)
    if not np.any(known):
        raise InputError("samples", expected="at least one valid state", found="none")
    strain, energy, stress = strain[known], energy[known], stress[known]
    scale = np.abs(strain).max(axis=0)
    scale[scale == 0] = 1.0
    resting = (np.abs(strain) < _SAME * scale).all(axis=1)
    if not np.any(resting):
        raise InputError("samples", expected="the undeformed state among them", found="none with zero strain")
    constant = float(energy[resting].mean())
    return _States(strain / scale, energy - constant, stress * scale), constant, scale


def _axis_term(states: _States, axis: int, options: PublishedOptions) -> CubicSpline:
    """f_i over scaled strains: zero at zero, falling to its lowest place and rising after it."""
    on_axis = states.on((axis,))
    knots = _knots(on_axis.x[:, 0], axis, options.knots, options)
    if len(knots) == 1:
        return CubicSpline(np.array([-1.0, 1.0]), np.zeros(2), np.zeros(2))
    found = _resampled(on_axis, knots[:, None], options.smoothing)
    # Monotone pieces are lowest at a control point: one belongs where the energy is lowest.
    fine = np.linspace(knots[0], knots[-1], 401)
    lowest = fine[np.argmin(CubicSpline(knots, found[:, 0], found[:, 1])(fine))]
    mirrored = [lowest, -lowest] if axis == SHEAR and options.symmetric_shear else [lowest]
    knots = union_knots(knots, np.array(mirrored))
    found = _resampled(on_axis, knots[:, None], options.smoothing)
    values, slopes = found[:, 0], found[:, 1]
    if axis == SHEAR and options.symmetric_shear:
        values, slopes = 0.5 * (values + values[::-1]), 0.5 * (slopes - slopes[::-1])
    lowest = int(np.argmin(values))
    values[lowest:] = np.maximum.accumulate(values[lowest:])
    values[lowest::-1] = np.maximum.accumulate(values[lowest::-1])
    values -= values[np.argmin(np.abs(knots))]
    return CubicSpline(knots, values, _monotone(slopes, values, knots))


def _plane_term(
    states: _States, terms: tuple[CubicSpline, CubicSpline], pair: tuple[int, int], options: PublishedOptions
) -> BicubicSpline:
    """f_ij over scaled strains: what both one-dimensional terms leave over on their plane."""
    rest = states.less(terms)
    most = options.knots // 2 + 1
    u, v = (_knots(states.x[:, k], pair[k], most, options) for k in range(2))
    grid = np.stack(np.meshgrid(u, v, indexing="ij"), axis=-1).reshape(-1, 2)
    found = _resampled(rest, grid, options.smoothing).reshape(len(u), len(v), 6)
    values, slopes_u, slopes_v, twists = (found[..., k].copy() for k in (0, 1, 2, 4))
    if SHEAR in pair and options.symmetric_shear:
        even = [np.flip(a, pair.index(SHEAR)) for a in (values, slopes_u, slopes_v, twists)]
        signs = (1, -1, 1, -1) if pair[0] == SHEAR else (1, 1, -1, -1)
        values, slopes_u, slopes_v, twists = (
            0.5 * (a + sign * b) for a, b, sign in zip((values, slopes_u, slopes_v, twists), even, signs, strict=True)
        )  # fmt: skip
    row, column = int(np.argmin(np.abs(u))), int(np.argmin(np.abs(v)))
    values[row], values[:, column] = 0.0, 0.0
    if pair != _STRETCHES:
        along = terms[0](u)[:, None] + terms[1](v)
        values = _marched(values + along) - along
        values[row], values[:, column] = 0.0, 0.0
    slopes_u, slopes_v = _monotone(slopes_u.T, values.T, u).T, _monotone(slopes_v, values, v)
    slopes_u[:, column], slopes_v[row] = 0.0, 0.0
    bound = np.minimum(np.abs(slopes_u) / _least_gap(v), np.abs(slopes_v) / _least_gap(u)[:, None])
    bound[row], bound[:, column] = np.inf, np.inf
    twists = np.clip(twists, -3 * bound, 3 * bound)
    return BicubicSpline(u, v, values, slopes_u, slopes_v, twists)


def _knots(samples: Array, axis: int, most: int, options: PublishedOptions) -> Array:
    """Control points over the range of scaled samples, zero among them; of bending closer to zero unless even."""
    distinct = np.unique(np.append(samples, 0.0).round(9))
    grading = 2.0 if axis > 2 and not options.even_knots else 0.0
    sides = []
    for sign in (-1.0, 1.0):
        there = sign * distinct
        count = min(np.count_nonzero(there > 0), (most - 1) // 2)
        steps = np.arange(1, count + 1) / max(count, 1)
        sides.append(sign * there.max() * (np.sinh(grading * steps) / np.sinh(grading) if grading else steps))
    return np.concatenate([sides[0][::-1], [0.0], sides[1]])


def _resampled(states: _States, places: Array, smoothing: float) -> Array:
    """Moving least squares: value, slopes and coefficients of the products at places (m, d), (m, 1 + d + …).

    At each place a quadratic polynomial is fitted to energies and slopes of the states around it, weighted by a
    Gaussian whose width follows the distance of the states there.
    """
    d = places.shape[1]
    unknowns = (d + 1) * (d + 2) // 2
    near = min(len(states.x), unknowns)
    result = np.zeros((len(places), unknowns))
    # A small weight on second derivatives where the states do not determine them.
    ridge = 1e-4 * np.eye(unknowns)[1 + d :]
    for place, found in zip(places, result, strict=True):
        distance = np.linalg.norm(states.x - place, axis=1)
        width = smoothing * np.sort(distance)[near - 1] / 1.5 + 1e-12
        weight = np.maximum(np.exp(-0.5 * (distance / width) ** 2), 1e-8)
        use = np.argsort(distance)[: max(near, np.count_nonzero(weight > 1e-8))]
        rows = _quadratics((states.x[use] - place) / width) * weight[use, None]
        target = np.concatenate([states.energies[None, use], width * states.slopes[use].T]) * weight[use]
        known = np.isfinite(target)
        matrix, right = np.concatenate([rows[known], ridge]), np.append(target[known], np.zeros(len(ridge)))
        found[:] = np.linalg.lstsq(matrix, right, rcond=None)[0]
        found[1 : 1 + d] /= width
        found[1 + d :] /= width**2
    return result


def _quadratics(y: Array) -> Array:
    """Polynomials 1, y_i, y_i y_j (i ≤ j) at points (n, d), then their derivatives by y_1 … y_d: (1 + d, n, …)."""
    n, d = y.shape
    i, j = np.triu_indices(d)
    unit, one, zero = np.eye(d), np.ones((n, 1)), np.zeros((n, 1))
    values = np.concatenate([one, y, y[:, i] * y[:, j]], axis=1)
    slopes = [
        np.concatenate([zero, zero + unit[k], unit[k, i] * y[:, j] + y[:, i] * unit[k, j]], axis=1)
        for k in range(d)
    ]  # fmt: skip
    return np.stack([values, *slopes])


def _monotone(slopes: Array, values: Array, knots: Array) -> Array:
    """Slopes (..., n) bounded so that a cubic rises or falls between knots as its values do (Fritsch and Carlson)."""
    rise = np.diff(values) / np.diff(knots)
    bounded = slopes.copy()
    for side in (bounded[..., :-1], bounded[..., 1:]):
        side[side * rise <= 0] = 0.0
    with np.errstate(divide="ignore", invalid="ignore"):
        size = np.hypot(bounded[..., :-1], bounded[..., 1:]) / np.abs(rise)
        factor = np.where(size > 3.0, 3.0 / size, 1.0)
    ones = np.ones((*factor.shape[:-1], 1))
    return bounded * np.minimum(np.append(factor, ones, axis=-1), np.append(ones, factor, axis=-1))


def _marched(values: Array) -> Array:
    """Values (n, m) raised so that they do not fall from the lowest place outward, ring by ring."""
    result = values.copy()
    i, j = np.meshgrid(*(np.arange(size) for size in values.shape), indexing="ij")
    lowest = np.unravel_index(np.argmin(values), values.shape)
    di, dj = i - lowest[0], j - lowest[1]
    ring = np.maximum(np.abs(di), np.abs(dj))
    for k in range(2, int(ring.max()) + 1):
        a, b = i[ring == k], j[ring == k]
        # The place one ring nearer, on the straight line to the lowest; between two nodes.
        x, y = a - di[ring == k] / k, b - dj[ring == k] / k
        low = np.floor(x + 1e-9).astype(int), np.floor(y + 1e-9).astype(int)
        high = np.ceil(x - 1e-9).astype(int), np.ceil(y - 1e-9).astype(int)
        share = (x - low[0]) + (y - low[1])
        inner = (1 - share) * result[low] + share * result[high]
        result[a, b] = np.maximum(result[a, b], inner)
    return result


def _least_gap(knots: Array) -> Array:
    """Smaller one of the two intervals beside each knot."""
    gaps = np.diff(knots)
    return np.minimum(np.append(gaps, np.inf), np.append(np.inf, gaps))


def _cubic_in_units(spline: CubicSpline, unit: float) -> CubicSpline:
    return CubicSpline(spline.knots * unit, spline.values, spline.slopes / unit)


def _bicubic_in_units(spline: BicubicSpline, u: float, v: float) -> BicubicSpline:
    return BicubicSpline(
        spline.knots_u * u, spline.knots_v * v, spline.values, spline.slopes_u / u, spline.slopes_v / v,
        spline.twists / (u * v),
    )  # fmt: skip
