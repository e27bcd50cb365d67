"""Fit the pairwise spline energy of HYLC20 eq. 31–32 to sampled energies and stresses.

Two stages of weighted, regularised linear least squares on C² cubic B-splines:

1. each f_i(θ_i) to the states of its axis, made quasi-convex (falling up to its lowest place, rising after it) and
   continued as a growing parabola;
2. all f_ij(θ_i, θ_j) together to what the f_i leave over, f_ij(0, ·) = f_ij(·, 0) = 0. Beyond the sampled range they
   run flat within two intervals and stay constant, so that there the energy grows with the f_i alone.

A sum of pairwise terms may dip below every sample where three strains act together: false wells in which a
simulation would collapse. Such states are searched for among those bent in one direction, and stage 2 is solved
again under the condition that none lies below the lowest sample. As the f_ij are constant and the f_i rise outside
the range of the search, the energy is then bounded below everywhere. In doubly bent states eq. 32 adds what both
families gain, ψ(s, λ_x, λ_y) = ψ(s, λ_x, 0) + ψ(s, 0, λ_y) − ψ(s, 0, 0): a stretched fabric that curls may lie below
its samples there (as published materials do), which only a worse fit of the samples could mend. Where the fit has a
coupling of both curvatures, the search goes through doubly bent states of the sampled range too, for those that only
the coupling put below the samples.

Weights make residuals relative: the energy of a state counts by what its second strain adds to the energy, so that
bending is not lost beside stretching, and small strains are fitted as well as large ones.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from yarnscale.errors import InputError
from yarnscale.homogenize.axis_fit import AxisTerm, fit_axis
from yarnscale.homogenize.inside_fit import InsideFit
from yarnscale.homogenize.moduli_fit import known_moduli
from yarnscale.homogenize.observations import (
    IN_STRESS,
    SHEAR,
    FitOptions,
    Observations,
    observations,
    side_energies,
    strains_of,
)
from yarnscale.homogenize.plan import bends_twice
from yarnscale.homogenize.plane_fit import PlaneFit
from yarnscale.shell.materials.material import ShellMaterial
from yarnscale.shell.materials.spline_material import SplineMaterial
from yarnscale.shell.materials.spline_patches import AXES

__all__ = ["FitOptions", "FitReport", "fit_spline_material", "strains_of", "validate"]

Array = NDArray[np.float64]

SMOOTHING_WITH_MODULI = 1e-2
"""Share of the smoothing that is left where moduli are known: they keep splines from ringing between samples."""
_COUPLING_SLACK = 0.1
"""How far the coupling may put a state below the samples, as a fraction of the largest energy of bending from rest."""
_STRETCH_LIMITS, _SHEAR_LIMITS = (-0.95, np.inf), (-0.97, 0.97)


def fit_spline_material(
    strains: ArrayLike,
    energies: ArrayLike,
    stresses: ArrayLike | None = None,
    *,
    density: float,
    moduli: ArrayLike | None = None,
    weights: ArrayLike | None = None,
    valid: ArrayLike | None = None,
    options: FitOptions | None = None,
    provenance: Mapping[str, object] | None = None,
) -> SplineMaterial:
    """Spline material of sampled states on the axes and planes of (s_x, s_a, s_y, λ_x, λ_y).

    strains (n, 5) [-, 1/m]; energies (n,) [J/m²]; stresses (n, 5) = dψ/d(s_x, s_a, s_y, II11, II22), NaN where
    unknown; moduli (n, 6, 6) = d²ψ/dz² by z = (s_x, s_a, s_y, II11, II12, II22), NaN where unknown; weights (n,) and
    valid (n,) mask; density [kg/m²]. The undeformed state must be among them. States off the planes are used lightly.
    Terms of strains that were not sampled are zero. Raises InputError on arrays that do not match or where the
    undeformed state is missing. Source: HYLC20 §6.2.
    """
    options = chosen = options or FitOptions()
    data = observations(strains, energies, stresses, moduli=moduli, weights=weights, valid=valid)
    if len(known_moduli(data)):
        options = replace(options, smoothing=SMOOTHING_WITH_MODULI * options.smoothing)
    if not np.any(data.resting):
        raise InputError("samples", expected="the undeformed state among them", found="none with zero strain")
    constant = float(np.average(data.energies[data.resting], weights=data.weights[data.resting]))
    sides = side_energies(data, constant)
    axes = [fit_axis(data, axis, constant, sides, options) for axis in range(5)]
    full = options.in_plane == "full" and bool(np.any(data.inside))
    planes = (InsideFit if full else PlaneFit)(data, axes, constant, sides, options)
    planes.solve()

    def material(record: Mapping[str, object]) -> SplineMaterial:
        return SplineMaterial(
            constant,
            tuple(axis.spline for axis in axes),
            planes.splines(),
            density=density,
            range=_sampled_box(data, options),
            provenance={**(provenance or {}), "fit": dict(record)},
            inside=planes.inside() if isinstance(planes, InsideFit) else None,
        )

    record: dict[str, object] = {"states": len(data.energies), "options": asdict(chosen)}
    if options.floor and planes.bases:
        record["floor"] = _lift(planes, material, axes)
    return material(record)


def _sampled_box(data: Observations, options: FitOptions) -> Array:
    box = np.stack([data.strains.min(axis=0), data.strains.max(axis=0)], axis=1)
    if options.symmetric_shear:
        box[SHEAR] = np.max(np.abs(box[SHEAR])) * np.array([-1, 1])
    box[box[:, 0] == box[:, 1]] = (-1e-9, 1e-9)
    return box


def _search_box(planes: PlaneFit, axes: list[AxisTerm]) -> Array:
    """Beyond it, f_ij are constant along every axis and f_i rise, (5, 2); zero along axes without samples."""
    box = np.zeros((5, 2))
    for axis, term in enumerate(axes):
        reaches = [term.spline.knots] if term.sampled else []
        for pair, bases in planes.bases.items():
            reaches += [basis.breaks for k, basis in zip(pair, bases, strict=True) if k == axis]
        if isinstance(planes, InsideFit):
            reaches += (
                [planes.lines[axis].breaks]
                if axis < 3
                else [shape.knots for shape in planes.shapes[axis - 3]]
            )
        if reaches:
            low, high = _SHEAR_LIMITS if axis == SHEAR else _STRETCH_LIMITS if axis < 3 else (-np.inf, np.inf)
            box[axis] = max(min(r[0] for r in reaches), low), min(max(r[-1] for r in reaches), high)
    return box


def _lift(
    planes: PlaneFit,
    material: Callable[[Mapping[str, object]], SplineMaterial],
    axes: list[AxisTerm],
    *,
    rounds: int = 20,
) -> dict[str, object]:
    """Search for singly bent states below all samples and fit again above them, until none is found."""
    lowest = float(planes.data.energies.min())
    twice = isinstance(planes, InsideFit) and planes.couples
    slack = _COUPLING_SLACK * float(np.nan_to_num(planes.sides[3:]).max())

    def floor(states: Array, current: SplineMaterial, energies: Array) -> Array:
        # What the one-dimensional terms alone give must be allowed: the f_ij vanish on the axes.
        gained = [np.minimum(axis.spline(x), 0.0) for axis, x in zip(axes, states.T, strict=True)]
        least = np.minimum(lowest, planes.constant + np.sum(gained, axis=0))
        low = bends_twice(states) & (energies < least)
        if current.inside is not None and np.any(low):
            alone = replace(current, inside=current.inside.without_coupling())
            summed = alone.energy_density(strains_of(states[low]))
            least[low] = np.minimum(least[low], summed) - slack
        return least

    tolerance = max(0.1 * abs(lowest), 0.03 * float(np.nanmin(planes.sides)))
    box, rng = _search_box(planes, axes), np.random.default_rng(0)
    inner = _sampled_box(planes.data, planes.options) if twice else None
    pool, best, least, held = np.zeros((0, 5)), planes.unknowns, np.inf, 0
    for step in range(rounds + 1):
        current = material({})

        def gap_of(states: Array, current: SplineMaterial = current) -> Array:
            energies = current.energy_density(strains_of(states))
            return energies - floor(states, current, energies)

        found, gap = _lowest_states(gap_of, box, inner, rng, pool)
        deepest = -float(gap.min())
        if deepest < least:
            best, least, held = planes.unknowns, deepest, np.count_nonzero(planes.multipliers)
        if deepest <= tolerance or step == rounds:
            break
        # States that rose far above the floor are let go, so that the active set stays small.
        close = gap_of(pool) < max(2 * tolerance, deepest)
        pool = np.concatenate([pool[close], found[gap < -0.5 * tolerance]])
        planes.hold_above(pool, floor(pool, current, current.energy_density(strains_of(pool))))
    planes.unknowns = best
    return {"energy": lowest, "deepest_state_below": max(least, 0.0), "states_held": int(held)}


def _lowest_states(
    gap_of: Callable[[Array], Array],
    box: Array,
    inner: Array | None,
    rng: np.random.Generator,
    known: Array,
) -> tuple[Array, Array]:
    """States (n, 5) lowest above the floor, by random sweep and descent, and their gaps (n,).

    They bend about one axis at most; where a box ``inner`` (5, 2) is given, a third bends about both, within it.
    """
    low, span = box[:, 0], box[:, 1] - box[:, 0]
    states = low + span * rng.uniform(size=(20_000, 5))
    if len(known):
        near = known[rng.integers(len(known), size=2_000)]
        near = near + 0.1 * span * rng.normal(size=near.shape)
        states = np.concatenate([states, np.clip(near, low, low + span)])
    flat = rng.integers(3, 5 if inner is None else 6, size=len(states))
    states[flat < 5, flat[flat < 5]] = 0.0
    states = _kept(states, inner)
    gap = gap_of(states)
    chosen = np.argsort(gap)[:400]
    states, gap = states[chosen], gap[chosen]
    for width in np.geomspace(0.2, 0.002, 40):
        step = width * span * rng.normal(size=states.shape) * (rng.uniform(size=states.shape) < 0.5)
        trial = np.where(states == 0.0, 0.0, np.clip(states + step, low, low + span))
        trial = _kept(trial, inner)
        found = gap_of(trial)
        better = found < gap
        states[better], gap[better] = trial[better], found[better]
    return _thinned(states, gap, span)


def _kept(states: Array, inner: Array | None) -> Array:
    """The states, those that bend about both axes moved into a box (5, 2)."""
    if inner is None:
        return states
    return np.where(bends_twice(states)[:, None], np.clip(states, inner[:, 0], inner[:, 1]), states)


def _thinned(states: Array, gap: Array, span: Array, *, count: int = 100) -> tuple[Array, Array]:
    """The lowest states of which no two lie close together."""
    scaled = states / np.where(span > 0, span, 1.0)
    kept = np.zeros(0, dtype=np.int64)
    for k in np.argsort(gap):
        if np.all(np.max(np.abs(scaled[kept] - scaled[k]), axis=1) > 0.02):
            kept = np.append(kept, k)
        if len(kept) == count:
            break
    return states[kept], gap[kept]


@dataclass(frozen=True)
class FitReport:
    """Errors of a material at states, as fractions of the largest energy above rest, or largest |stress|, among them.

    energy_median, energy_95: of |ψ_fit − ψ|. stress_median, stress_95: by (s_x, s_a, s_y, II11, II22), (5,), NaN where
    no stress is known. worst: the state with the largest error in energy, (5,).
    """

    states: int
    energy_median: float
    energy_95: float
    stress_median: Array
    stress_95: Array
    worst: Array

    def summary(self) -> dict[str, object]:
        """Plain values, for a provenance."""

        def plain(values: Array) -> list[float | None]:
            return [float(value) if np.isfinite(value) else None for value in values]

        return {
            "states": self.states,
            "energy_median": self.energy_median,
            "energy_95": self.energy_95,
            "stress_median": plain(self.stress_median),
            "stress_95": plain(self.stress_95),
            "worst": plain(self.worst),
        }


def validate(
    material: ShellMaterial,
    strains: ArrayLike,
    energies: ArrayLike,
    stresses: ArrayLike | None = None,
    *,
    valid: ArrayLike | None = None,
) -> FitReport:
    """Compare a material with states (arrays as in ``fit_spline_material``), usually ones that it has not seen."""
    data = observations(strains, energies, stresses, valid=valid)
    six = strains_of(data.strains)
    rest = float(material.energy_density(np.zeros(6)))
    largest = max(float(np.max(data.energies)) - rest, 1e-300)
    energy = np.abs(material.energy_density(six) - data.energies) / largest
    median, high = np.full(5, np.nan), np.full(5, np.nan)
    stress = np.abs(material.stress(six)[:, IN_STRESS] - data.stresses)
    for k in range(len(AXES)):
        known = np.isfinite(data.stresses[:, k])
        if np.any(known):
            relative = stress[known, k] / max(float(np.max(np.abs(data.stresses[known, k]))), 1e-300)
            median[k], high[k] = np.median(relative), np.percentile(relative, 95)
    return FitReport(
        len(energy),
        float(np.median(energy)),
        float(np.percentile(energy, 95)),
        median,
        high,
        data.strains[int(np.argmax(energy))],
    )
