"""Friction of the yarns of a fitted cell, from the share of work that fabric returns when it is let go.

Coulomb's friction makes loading take about a share a μ more than the elastic stress, and unloading as much less, so
that the share R of work that comes back is about (1 − a μ)/(1 + a μ): (1 − R)/(1 + R) is nearly linear in μ, and the
coefficient at which the cell returns as much as was measured is found in a few cycles.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from yarnscale.arrays import Array
from yarnscale.cell.periodic import PeriodicCell
from yarnscale.swatches.measurements import Direction, between
from yarnscale.swatches.uniform_cycle import UniformCycle
from yarnscale.swatches.uniform_data import UniformCurve, UniformData
from yarnscale.swatches.yarn_states import YarnCurve, cycled
from yarnscale.yarn.friction import YarnFriction
from yarnscale.yarn.material import YarnMaterial

LARGEST = 0.8
"""Largest coefficient of friction that is sought."""
USUAL = 0.2
"""Coefficient with which the search begins."""
_EVALUATIONS, _CLOSE = 6, 0.004
"""Coefficients that are tried, and difference of the share of work that is none."""
_NOISE = 0.02
"""Uncertainty of a measured share of work."""
_SAME = 1e-9
"""Relative difference of stretches that is rounding."""


@dataclass(frozen=True, eq=False)
class YarnFrictionFit:
    """Friction of a yarn.

    coefficient: μ. uncertainty: change of μ that changes the share of work by 0.02. missed: share of work that the cell
    returns with it less the measured one, means over the measured directions. by_direction: coefficient of each
    direction by itself, where one within the range was found. measured: cycles of the fabric; simulated: of the cell
    with the coefficient, along all directions of ``elastic`` that it can follow. elastic: curves of the cell without
    friction. rounds: how often the yarn was fitted again.
    """

    coefficient: float
    uncertainty: float
    missed: float
    by_direction: Mapping[Direction, float]
    measured: tuple[UniformCycle, ...]
    simulated: tuple[UniformCycle, ...]
    elastic: tuple[YarnCurve, ...]
    rounds: int = 0

    @property
    def matched(self) -> bool:
        """Whether the cell returns as much work as was measured, to 0.004."""
        return abs(self.missed) < _CLOSE

    @property
    def at_bound(self) -> bool:
        """Whether the coefficient is the largest that is sought."""
        return self.coefficient >= LARGEST * (1 - 1e-9)

    @property
    def pairs(self) -> list[tuple[UniformCycle, UniformCycle]]:
        """Measured and simulated cycles of the same directions."""
        simulated = {cycle.direction: cycle for cycle in self.simulated}
        return [(cycle, simulated[cycle.direction]) for cycle in self.measured if cycle.direction in simulated]

    @property
    def not_followed(self) -> list[Direction]:
        """Directions along which the cell has curves, but no cycle with its friction."""
        followed = [cycle.direction for cycle in self.simulated]
        return [curve.direction for curve in self.elastic if curve.direction not in followed]

    @property
    def warnings(self) -> list[str]:
        """Sentences on what the coefficient does not explain."""
        found = []
        if not self.matched and self.at_bound:
            found.append(
                "the yarn's fabric returns more of the work than was measured at any friction up to "
                f"{self.coefficient:g}"
            )
        elif not self.matched:
            found.append(
                f"with the friction of {self.coefficient:.3g} the yarn's fabric returns "
                f"{100 * abs(self.missed):.1f} % of the work {'more' if self.missed > 0 else 'less'} than "
                "was measured: no other coefficient that was tried, and that its cell can follow, is nearer"
            )
        if lost := self.not_followed:
            found.append(
                f"with friction the yarn's cell cannot be loaded and unloaded along "
                f"{', '.join(along.value for along in lost)}, which errors do not include"
            )
        return found

    def summary(self, data: UniformData) -> dict[str, object]:
        """Plain numbers; data: of loading, in whose comfort range errors of unloading are measured."""
        missed = self.unloading_error(data)
        directions = {
            cycle.direction.value: {
                "coefficient": self.by_direction.get(cycle.direction),
                "returned": own.returned,
                "measured_returned": cycle.returned,
                "stretch_left": own.stretch_left,
                "unloading_error": missed[cycle.direction],
            }
            for cycle, own in self.pairs
        }
        return {
            "coefficient": self.coefficient, "uncertainty": self.uncertainty, "at_bound": self.at_bound,
            "missed": self.missed, "rounds": self.rounds, "directions": directions,
        }  # fmt: skip

    def loading_at(self, curve: UniformCurve) -> tuple[Array, Array]:
        """Stress [N/m] and contraction of the simulated loading at a curve's stretches, NaN beyond its cycle."""
        for cycle in self.simulated:
            if cycle.direction is curve.direction and cycle.contraction is not None:
                return _on(cycle, cycle.loading, curve.stretch), _on(cycle, cycle.contraction, curve.stretch)
        return np.full(len(curve.stretch), np.nan), np.full(len(curve.stretch), np.nan)

    def removed_from(self, data: UniformData) -> UniformData:
        """Curves as they would be without friction: stress times the simulated ratio, contraction less the difference.

        Directions and states that the cell did not reach stay as they are.
        """
        elastic, curves = {curve.direction: curve for curve in self.elastic}, []
        for curve in data.curves:
            stress, contraction = self.loading_at(curve)
            own = elastic.get(curve.direction)
            if own is not None and own.converged.any():
                good = own.converged
                stretch = np.append(0.0, own.stretch[good])
                plain = np.interp(curve.stretch, stretch, np.append(0.0, own.stress[good]))
                across = np.interp(curve.stretch, stretch, np.append(0.0, own.contraction[good]))
                known = np.isfinite(stress) & (stress > 0.0) & (curve.stretch <= stretch[-1] * (1 + _SAME))
                ratio = np.where(known, plain / np.where(known, stress, 1.0), 1.0)
                curve = replace(
                    curve, stress=ratio * curve.stress,
                    contraction=curve.contraction + np.where(known, across - contraction, 0.0),
                )  # fmt: skip
            curves.append(curve)
        return replace(data, curves=tuple(curves))

    def unloading_error(self, data: UniformData) -> dict[Direction, float]:
        """Mean error of σ/(1 + s) in unloading over the largest of the comfort range of ``data``, by direction."""
        return {
            measured.direction: float(
                np.mean(np.abs(np.maximum(own.unloading, 0.0) - measured.unloading) / (1.0 + measured.stretch))
            )
            / data.stress_scale
            for measured, own in self.pairs
        }


def with_yarn_friction(cell: PeriodicCell, coefficient: float) -> PeriodicCell:
    """The cell with yarns that know their friction; its energy is the same."""
    yarns = tuple(replace(m, contact=replace(m.contact, friction=coefficient)) for m in cell.materials)
    return replace(cell, material=yarns[0] if isinstance(cell.material, YarnMaterial) else yarns)


def _on(cycle: UniformCycle, values: Array, stretch: Array) -> Array:
    """Values of a cycle at stretches, NaN beyond it; to rounding, its end is within."""
    within = stretch <= cycle.stretch[-1] * (1 + _SAME)
    return np.where(within, between(stretch, cycle.stretch, values), np.nan)


def fit_friction(
    cell: PeriodicCell,
    measured: Sequence[UniformCycle],
    elastic: Sequence[YarnCurve],
    *,
    guess: float = USUAL,
    on_cycle: Callable[[float], None] | None = None,
) -> YarnFrictionFit | None:
    """The friction with which a cell at rest returns as much of the work as the fabric; None where it cannot follow.

    A coefficient counts where the cell follows the cycles of all measured directions. elastic: the cell's curves along
    all directions that are compared. guess: coefficient to begin with. on_cycle: called with the coefficient before
    every cycle.
    """
    cycles: dict[float, dict[Direction, UniformCycle]] = {}
    wanted = float(np.mean([cycle.returned for cycle in measured]))

    def simulated(direction: Direction, stretch: Array, coefficient: float) -> UniformCycle | None:
        if on_cycle is not None:
            on_cycle(coefficient)
        return cycled(cell, direction, stretch, YarnFriction(coefficient))

    def mean_returned(coefficient: float) -> float:
        found = cycles[coefficient] = {}
        for cycle in measured:
            if (own := simulated(cycle.direction, cycle.stretch[1:], coefficient)) is None:
                return np.nan
            found[cycle.direction] = own
        return float(np.mean([own.returned for own in found.values()]))

    shares = searched_friction(mean_returned, wanted, guess)
    reached = {mu: share for mu, share in shares.items() if np.isfinite(share)}
    if not reached:
        return None
    best = min(reached, key=lambda mu: (abs(reached[mu] - wanted), mu))
    by_direction = {}
    for cycle in measured:
        known = {mu: found[cycle.direction].returned for mu, found in cycles.items() if cycle.direction in found}
        if (alone := _crossing({0.0: 1.0} | known, cycle.returned)) is not None:
            by_direction[cycle.direction] = alone
    along = dict(cycles[best])
    for curve in elastic:
        if curve.direction not in along and curve.converged.all():
            further = simulated(curve.direction, curve.stretch, best)
            along |= {} if further is None else {curve.direction: further}
    return YarnFrictionFit(
        best, _uncertainty(best, reached[best]), reached[best] - wanted, by_direction, tuple(measured),
        tuple(along.values()), tuple(elastic),
    )  # fmt: skip


def searched_friction(returned: Callable[[float], float], wanted: float, guess: float) -> dict[float, float]:
    """Shares of work by the coefficients that were tried, six at most; one within 0.004 of the wanted is the last.

    A coefficient whose share is not a number is too large. Where the share stays above the wanted one, the largest
    coefficient is tried last.
    """
    known: dict[float, float] = {}
    wanted = min(wanted, 1.0)
    low, high, next_one = (0.0, 0.0), None, min(max(guess, 1e-3), LARGEST)
    for _ in range(_EVALUATIONS):
        share = known[next_one] = returned(next_one)
        if abs(share - wanted) < _CLOSE:
            break
        here, goal = (next_one, _lost(share)), _lost(wanted)
        if np.isnan(share) or here[1] > goal:
            high = here
        elif next_one >= LARGEST:
            break
        else:
            low = here
        if high is None:
            # Somewhat farther than a line from zero says, since shares fall ever more slowly.
            next_one = min(1.05 * low[0] * goal / low[1] if low[1] > 0 else np.inf, 3.0 * low[0], LARGEST)
        elif np.isnan(high[1]):
            next_one = 0.5 * (low[0] + high[0])
        else:
            share_between = (goal - low[1]) / (high[1] - low[1])
            next_one = low[0] + min(max(share_between, 0.05), 0.95) * (high[0] - low[0])
    return known


def _lost(returned: float) -> float:
    """Of a share of work, what is nearly proportional to friction."""
    return (1.0 - returned) / (1.0 + returned)


def _crossing(shares: Mapping[float, float], wanted: float) -> float | None:
    """Coefficient at which shares first fall to the wanted one, between those known."""
    mus = sorted(mu for mu, share in shares.items() if np.isfinite(share))
    for low, high in pairwise(mus):
        if shares[high] <= wanted <= shares[low]:
            ends = [_lost(shares[low]), _lost(shares[high])]
            return float(np.interp(_lost(wanted), ends, [low, high]))
    return None


def _uncertainty(coefficient: float, returned: float) -> float:
    """Change of a coefficient that changes the share of work by 0.02, by the R of the module with λ = a μ.

    dR/dμ = −2/(1 + λ)² λ/μ.
    """
    lost = _lost(returned)
    if not lost > 0:
        return LARGEST
    return min(_NOISE * (1.0 + lost) ** 2 / 2.0 * coefficient / lost, LARGEST)
