"""Which segments of a cell's copies press on each other, and the contact stencils of those pairs.

Lengths are counted in yarn radii, energies in the unit of the cell.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from yarnscale.numerics.affine import CopiedNodes
from yarnscale.numerics.assembly import StencilSet, position_variables
from yarnscale.yarn.close_pairs import close_pairs
from yarnscale.yarn.contact import contact_energy, contact_reach
from yarnscale.yarn.pattern import YarnPattern
from yarnscale.yarn.stiffness import PatternStiffness
from yarnscale.yarn.strands import Strands

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

SKIN = 0.7
"""How much farther than contact pairs are listed [r]; at least twice a step's longest move, so that none is missed."""
PATTERN_MARGIN = 0.3
"""How much farther than the list the matrix pattern looks ahead [r]; saves symbolic analyses."""


@dataclass(eq=False)
class Contacts:
    """Pairs listed at the fluctuation ``built_at`` (n, 3), and their stencils.

    first, second: primary segment and copied segment of every pair (N,). unknowns: (N, 12) free unknowns behind the
    stencils' variables. slots: where their Hessian goes, once that is known; covered: (N,) which pairs have
    a place there.
    """

    first: Indices
    second: Indices
    built_at: Array
    stencils: StencilSet
    unknowns: Indices
    slots: NDArray[np.int32] | None = None
    covered: NDArray[np.bool_] = field(default_factory=lambda: np.empty(0, bool))


class ContactList:
    """Lists the pairs of one cell, anew only where vertices have moved far enough."""

    def __init__(
        self,
        pattern: YarnPattern,
        strands: Strands,
        nodes: CopiedNodes,
        stiffness: PatternStiffness,
        *,
        symmetric: bool,
        turning: Array | None,
    ) -> None:
        """symmetric: every pair from both sides, half each. turning: rotation vectors (T·n, 3), None in flat cells."""
        self._strands, self._nodes, self._turning = strands, nodes, turning
        self._stiffness, self._symmetric = stiffness, symmetric
        self._length = pattern.rest_length / pattern.radius
        self._reach = contact_reach(stiffness.rule) + SKIN
        self._last: Contacts | None = None

    def at(self, fluctuation: Array, positions: Array) -> Contacts:
        """Stencils valid at a fluctuation (n, 3); listed anew when a vertex has moved half a skin since.

        positions: of all nodes (T·n, 3).
        """
        old = self._last
        if old is not None:
            shift = fluctuation - old.built_at
            if 4.0 * float((shift * shift).sum(1).max()) <= SKIN * SKIN:
                return old
        first, second = self._pairs_within(positions, self._reach)
        if old is not None and np.array_equal(first, old.first) and np.array_equal(second, old.second):
            old.built_at = fluctuation.copy()
            return old
        rule = self._stiffness.rule
        energy = contact_energy(rule.kernel, rule.quadrature_points, rule.quadrature_weights)
        variables = self._variables(first, second)
        stencils = StencilSet(energy, variables, self._parameters(first, second), 4)
        unknowns = self._nodes.unknowns(variables)
        self._last = Contacts(first, second, fluctuation.copy(), stencils, unknowns)
        return self._last

    def unknowns_ahead(self, positions: Array) -> Indices:
        """Free unknowns of the pairs that may soon be listed, (N, 12)."""
        return self._nodes.unknowns(
            self._variables(*self._pairs_within(positions, self._reach + PATTERN_MARGIN))
        )

    def _pairs_within(self, positions: Array, reach: float) -> tuple[Indices, Indices]:
        """Close pairs; those that only meet because a strongly bent cell rolls through itself are left out.

        Copies are those of an endless periodic surface: more than half a turn apart, two of them are near in space only
        because the cylinder closes on itself, which no cloth that is bent like this at one point has to do.
        """
        neighbours = self._stiffness.rule.neighbours
        first, second = close_pairs(
            self._strands, positions, reach, neighbours=neighbours, ordered=self._symmetric
        )
        if self._turning is None:
            return first, second
        turned = self._turning[second] - self._turning[first]
        kept = (turned * turned).sum(axis=1) < math.pi**2
        return first[kept], second[kept]

    def _variables(self, first: Indices, second: Indices) -> Indices:
        ends = self._strands.ends
        return position_variables(np.stack([first, ends[first], second, ends[second]], 1))

    def _parameters(self, first: Indices, second: Indices) -> Array:
        edge = second % len(self._length)
        measure = self._length[first] * self._length[edge] * (0.5 if self._symmetric else 1.0)
        return self._stiffness.pair_parameters(first, edge, measure)
