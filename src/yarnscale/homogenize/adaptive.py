"""Where a fit errs, and the states to solve next: disagreement of fits that each miss a part of the samples.

The states off the axes and planes are dealt into folds. A fit without a fold has not seen its states: how far it is off
there estimates the error of the fit (a little too large: it has fewer samples). Where the fits without one fold each
disagree, the samples do not say what the energy is; there the next states are drawn.

Everything follows from the samples alone: the same samples give the same states.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from yarnscale.homogenize.fit import FitOptions, fit_spline_material, strains_of
from yarnscale.homogenize.observations import observations
from yarnscale.homogenize.plan import scattered
from yarnscale.homogenize.states import IN_STRESS, SampledStates
from yarnscale.shell.materials.spline_material import SplineMaterial

Array = NDArray[np.float64]

FOLDS = 4
"""Fits that each miss one part of the samples."""
CANDIDATES = 2000
"""Places among which the next states are chosen."""
FEWEST_SCATTERED = 12
"""Below so many states off the axes and planes there is nothing to leave out."""


@dataclass(frozen=True, eq=False)
class CrossValidation:
    """Fits without one fold each, and how they do on the states they have not seen.

    energy_95, stress_95: 95th percentiles of the errors over the largest energy above rest, or the largest stress of a
    component (the worst one), among the samples. scales: those largest values (6,) [J/m², …].
    """

    materials: tuple[SplineMaterial, ...]
    energy_95: float
    stress_95: float
    scales: Array

    def disagreement(self, states: Array) -> Array:
        """Spread of the fits at states (n, 5) over the largest values, root of the summed squares, (n,)."""
        values = np.stack([_answers(material, states) for material in self.materials]) / self.scales
        return np.sqrt(np.sum(np.var(values, axis=0), axis=1))


def cross_validation(states: SampledStates, *, density: float, options: FitOptions) -> CrossValidation:
    """Leave out every fold of the states off the planes in turn, fit, and compare."""
    good = states.chosen(states.converged)
    data = observations(good.strains, good.energies, good.stresses)
    fold = np.full(len(good.strains), -1)
    off = np.flatnonzero(data.off_planes)
    # Dealt by their order: a batch, which lies where the fit was worst, is spread over all folds.
    fold[off] = np.arange(len(off)) % FOLDS
    plain = replace(options, floor=False)
    rest = float(good.energies[data.resting].mean())
    scales = np.append(np.max(np.abs(good.energies - rest)), np.nanmax(np.abs(good.stresses), axis=0))
    scales = np.maximum(scales, 1e-300)
    materials, errors = [], []
    for k in range(FOLDS):
        seen = good.chosen(fold != k)
        material = fit_spline_material(
            seen.strains, seen.energies, seen.stresses, density=density, moduli=seen.moduli, options=plain
        )
        unseen = good.chosen(fold == k)
        truth = np.column_stack([unseen.energies, unseen.stresses])
        errors.append(np.abs(_answers(material, unseen.strains) - truth) / scales)
        materials.append(material)
    high = np.percentile(np.concatenate(errors), 95, axis=0)
    return CrossValidation(tuple(materials), float(high[0]), float(high[1:].max()), scales)


def next_states(found: CrossValidation, bounds: Array, count: int, *, known: Array) -> Array:
    """``count`` states (count, 5), each place with a chance in proportion to the disagreement of the fits there.

    bounds: (5, 2). known: the states that are there, (n, 5); the candidates are the next ones of the scattered sequence
    that are not among them. Taking only the places of largest disagreement gives larger median errors in
    stress: they lie at the ends of the range, where cells buckle.
    """
    places = scattered(bounds, CANDIDATES + count, skip=len(known))
    taken = np.array([np.any(np.all(np.isclose(known, place), axis=1)) for place in places])
    places = places[~taken]
    chance = found.disagreement(places) + 1e-12
    drawn = np.random.default_rng(len(known)).choice(
        len(places), count, replace=False, p=chance / chance.sum()
    )
    return places[np.sort(drawn)]


def _answers(material: SplineMaterial, states: Array) -> Array:
    """Energy and five stresses of states (n, 5), (n, 6)."""
    six = strains_of(states)
    return np.column_stack([material.energy_density(six), material.stress(six)[:, IN_STRESS]])
