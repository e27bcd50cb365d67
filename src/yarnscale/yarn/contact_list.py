"""Which segments of yarns, and of their copies, press on each other: a list that is renewed only now and then.

Lengths are counted in yarn radii, energies in the unit of ``PatternStiffness``.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numba
import numpy as np
from numpy.typing import NDArray

from yarnscale.arrays import Array, Flags, Integers
from yarnscale.numerics.assembly import StencilSet, position_variables
from yarnscale.yarn.close_pairs import close_pairs, pair_gaps, safe_fraction
from yarnscale.yarn.contact import contact_energy, contact_reach, contact_samples
from yarnscale.yarn.stiffness import PatternStiffness
from yarnscale.yarn.strands import Strands

SKIN = 0.7
"""How much farther than contact pairs are listed [r]."""
GAP_SHARE = 0.8
"""Share of its distance that a pair may close in one step: yarns never pass through each other."""


@dataclass(eq=False)
class PlacedPairs:
    """Those of the listed pairs, (N,) by ``chosen``, that have a place in the matrix: where their Hessian goes."""

    chosen: Flags
    stencils: StencilSet
    slots: NDArray[np.int32]


@dataclass(eq=False)
class Contacts:
    """Pairs listed at positions ``built_at`` (n, 3) of the primary tile, their stencils, and those in the matrix.

    first, second: primary segment and segment of a copy of every pair (N,), by their first nodes.
    """

    first: Integers
    second: Integers
    built_at: Array
    stencils: StencilSet
    placed: PlacedPairs | None = None


class ContactList:
    """Lists the pairs of yarns, anew only where vertices have moved far enough; positions are those of all nodes."""

    def __init__(
        self,
        strands: Strands,
        stiffness: PatternStiffness,
        *,
        symmetric: bool = False,
        turning: Array | None = None,
        own: Flags | None = None,
    ) -> None:
        """symmetric: every pair from both sides, half each. turning: rotation vectors (T·n, 3), None: flat.

        own: nodes of which a pair has at least one (T·n,); None: all.
        """
        self._own = own
        self._strands, self._stiffness = strands, stiffness
        self._symmetric, self._turning = symmetric, turning
        self._length = stiffness.pattern.rest_length / stiffness.pattern.radius
        self.reach, self._neighbours = contact_reach(stiffness.rule), stiffness.neighbours(strands)
        self._last: Contacts | None = None

    def at(self, positions: Array) -> Contacts:
        """The pairs valid at positions (T·n, 3); listed anew when a vertex has moved half a skin since."""
        old, primary = self._last, positions[: self._strands.count]
        if old is not None and 2.0 * self._longest(primary - old.built_at) <= SKIN:
            return old
        first, second = self.pairs_within(positions, self.reach + SKIN)
        if old is not None and np.array_equal(first, old.first) and np.array_equal(second, old.second):
            old.built_at = primary.copy()
            return old
        rule, polyline = self._stiffness.rule, self._stiffness.pattern.polyline
        energy = contact_energy(rule.kernel, contact_samples(rule, polyline=polyline))
        edge = second % self._strands.count
        measure = self._length[first] * self._length[edge] * (0.5 if self._symmetric else 1.0)
        parameters = self._stiffness.pair_parameters(first, edge, measure)
        stencils = StencilSet(energy, self.variables(first, second), parameters, 4)
        self._last = Contacts(first, second, primary.copy(), stencils)
        return self._last

    def forget(self) -> None:
        """List pairs anew."""
        self._last = None

    def pairs_within(self, positions: Array, reach: float, *, moves: Array | None = None) -> tuple[Integers, Integers]:
        """Close pairs; those that only meet because a strongly bent cell rolls through itself are left out.

        Copies are those of an endless periodic surface: more than half a turn apart, two of them are near in space only
        because the cylinder closes on itself, which no cloth that is bent like this at one point has to do.
        """
        first, second = close_pairs(
            self._strands, positions, reach, neighbours=self._neighbours, ordered=self._symmetric, moves=moves
        )
        if self._own is not None:
            kept = self._own[first] | self._own[second]
            first, second = first[kept], second[kept]
        if self._turning is None:
            return first, second
        turned = self._turning[second] - self._turning[first]
        kept = (turned * turned).sum(axis=1) < math.pi**2
        return first[kept], second[kept]

    def distances(self, contacts: Contacts, positions: Array) -> Array:
        """Distances of listed pairs (N,) [r]."""
        return pair_gaps(positions, self._strands.ends, contacts.first, contacts.second)

    def safe_fraction(self, positions: Array, moves: Array) -> float:
        """Fraction of moves (T·n, 3) that brings no pair closer than 1 − ``GAP_SHARE`` of its distance, at most 1.

        Pairs that are not listed are farther apart than short moves take them; for long ones they are searched.
        """
        if 2.0 * self._longest(moves[: self._strands.count]) <= GAP_SHARE * self.reach:
            contacts = self.at(positions)
            pairs = contacts.first, contacts.second
        else:
            pairs = self.pairs_within(positions, 0.0, moves=moves / GAP_SHARE)
        return safe_fraction(positions, moves, self._strands.ends, *pairs, GAP_SHARE)

    def variables(self, first: Integers, second: Integers) -> Integers:
        """Variables of the stencils of pairs (N, 12)."""
        ends = self._strands.ends
        return position_variables(np.stack([first, ends[first], second, ends[second]], 1))

    def _longest(self, moves: Array) -> float:
        """Length of the longest of moves (n, 3).

        What all have in common does not count where copies are not turned: fabric that moves as one keeps its pairs.
        """
        return _longest_move(moves, self._turning is None)


@numba.njit(cache=True, error_model="numpy")
def _longest_move(moves, relative):
    common, largest = np.zeros(3), 0.0
    if relative:
        for k in range(moves.shape[0]):
            for c in range(3):
                common[c] += moves[k, c]
        common /= moves.shape[0]
    for k in range(moves.shape[0]):
        square = 0.0
        for c in range(3):
            square += (moves[k, c] - common[c]) ** 2
        largest = max(largest, square)
    return np.sqrt(largest)
