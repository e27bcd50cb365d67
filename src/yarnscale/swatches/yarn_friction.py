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
from yarnscale.swatches.measurements import Direction
from yarnscale.swatches.uniform_data import UniformCurve, UniformData
from yarnscale.swatches.uniform_loop import UniformLoop
from yarnscale.swatches.yarn_states import YarnCurve, cycled
from yarnscale.yarn.friction import YarnFriction

LARGEST = 0.8
"""Largest coefficient of friction that is sought."""
USUAL = 0.2
"""Coefficient with which the search begins."""
_EVALUATIONS, _CLOSE = 6, 0.004
"""Coefficients that are tried, and difference of the share of work that is none."""
_NOISE = 0.02
"""Uncertainty of a measured share of work."""


@dataclass(frozen=True, eq=False)
class YarnFrictionFit:
    """Friction of a yarn.

    coefficient: μ. uncertainty: change of μ that changes the share of work by 0.02. by_direction: coefficient of each
    direction by itself, where one within the range was found. measured: loops of the fabric; simulated: of the cell
    with the coefficient, along all directions that were fitted. elastic: curves of the cell without friction. rounds:
    how often the yarn was fitted again.
    """

    coefficient: float
    uncertainty: float
    by_direction: Mapping[Direction, float]
    measured: tuple[UniformLoop, ...]
    simulated: tuple[UniformLoop, ...]
    elastic: tuple[YarnCurve, ...]
    rounds: int = 0

    @property
    def at_bound(self) -> bool:
        """Whether the cell returns more work than was measured, whatever its friction."""
        return self.coefficient >= LARGEST * (1 - 1e-9)

    @property
    def pairs(self) -> list[tuple[UniformLoop, UniformLoop]]:
        """Measured and simulated loops of the same directions."""
        simulated = {loop.direction: loop for loop in self.simulated}
        return [(loop, simulated[loop.direction]) for loop in self.measured if loop.direction in simulated]

    def with_loading(self, curve: UniformCurve) -> tuple[Array, Array]:
        """Stress [N/m] and contraction of the simulated loading at the stretches of a curve, NaN without one."""
        for loop in self.simulated:
            if loop.direction is curve.direction and loop.contraction is not None:
                return _between(loop, loop.loading, curve.stretch), _between(loop, loop.contraction, curve.stretch)
        return np.full(len(curve.stretch), np.nan), np.full(len(curve.stretch), np.nan)

    def removed_from(self, data: UniformData) -> UniformData:
        """Curves as they would be without friction: stress times the simulated ratio, contraction less the difference.

        Directions and states that the cell did not reach stay as they are.
        """
        elastic, curves = {curve.direction: curve for curve in self.elastic}, []
        for curve in data.curves:
            stress, contraction = self.with_loading(curve)
            own = elastic.get(curve.direction)
            if own is not None and own.converged.any():
                good = own.converged
                stretch = np.append(0.0, own.stretch[good])
                plain = np.interp(curve.stretch, stretch, np.append(0.0, own.stress[good]))
                across = np.interp(curve.stretch, stretch, np.append(0.0, own.contraction[good]))
                known = np.isfinite(stress) & (stress > 0.0) & (curve.stretch <= stretch[-1] * (1 + 1e-9))
                ratio = np.where(known, plain / np.where(known, stress, 1.0), 1.0)
                curve = replace(
                    curve, stress=ratio * curve.stress,
                    contraction=curve.contraction + np.where(known, across - contraction, 0.0),
                )  # fmt: skip
            curves.append(curve)
        return replace(data, curves=tuple(curves))

    def unloading_error(self, data: UniformData) -> dict[Direction, float]:
        """Mean error of σ/(1 + s) on the way back over the largest of the comfort range of ``data``, by direction."""
        return {
            measured.direction: float(
                np.mean(np.abs(np.maximum(own.unloading, 0.0) - measured.unloading) / (1.0 + measured.stretch))
            )
            / data.stress_scale
            for measured, own in self.pairs
        }


def _between(loop: UniformLoop, values: Array, stretch: Array) -> Array:
    from scipy.interpolate import PchipInterpolator

    return PchipInterpolator(loop.stretch, values, extrapolate=False)(np.minimum(stretch, loop.stretch[-1]))


def fit_friction(
    cell: PeriodicCell,
    measured: Sequence[UniformLoop],
    elastic: Sequence[YarnCurve],
    *,
    guess: float = USUAL,
) -> YarnFrictionFit | None:
    """The friction with which a cell at rest returns as much of the work as the fabric; None where it cannot follow.

    elastic: the cell's curves along all directions that were fitted. guess: coefficient to begin with.
    """
    loops: dict[float, dict[Direction, UniformLoop | None]] = {}
    wanted = float(np.mean([loop.returned for loop in measured]))

    def mean_returned(coefficient: float) -> float:
        friction = YarnFriction(coefficient)
        loops[coefficient] = {m.direction: cycled(cell, m.direction, m.stretch[1:], friction) for m in measured}
        # Of the directions that the cell can follow with this friction.
        more = [own.returned - m.returned for m in measured if (own := loops[coefficient][m.direction]) is not None]
        return wanted + float(np.mean(more)) if more else np.nan

    shares = searched_friction(mean_returned, wanted, guess)
    reached = {mu: share for mu, share in shares.items() if mu in loops and np.isfinite(share)}
    if not reached:
        return None
    best = min(reached, key=lambda mu: (abs(reached[mu] - wanted), mu))
    by_direction = {}
    for loop in measured:
        known = {mu: found.returned for mu, kept in loops.items() if (found := kept[loop.direction]) is not None}
        if (own := _crossing({0.0: 1.0} | known, loop.returned)) is not None:
            by_direction[loop.direction] = own
    simulated = [loop for loop in loops[best].values() if loop is not None]
    for curve in elastic:
        if curve.direction not in loops[best] and curve.converged.all():
            further = cycled(cell, curve.direction, curve.stretch, YarnFriction(best))
            simulated += [] if further is None else [further]
    slope = _slope({0.0: 1.0} | reached, best)
    uncertainty = min(_NOISE / slope, LARGEST) if slope > 0 else LARGEST
    return YarnFrictionFit(best, uncertainty, by_direction, tuple(measured), tuple(simulated), tuple(elastic))


def searched_friction(returned: Callable[[float], float], wanted: float, guess: float) -> dict[float, float]:
    """Shares of work by the coefficients that were tried, of which the nearest is within 0.004 of the wanted one.

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


def _slope(shares: Mapping[float, float], at: float) -> float:
    """Decrease of the share by the coefficient there, from the nearest other one."""
    other = min((mu for mu in shares if mu != at), key=lambda mu: abs(mu - at))
    return -(shares[at] - shares[other]) / (at - other)
