"""Friction in a periodic cell along a path of macroscopic states (theory §2): what its contacts remember.

From one state to the next the cell minimises its energy plus the potential of springs and sliders (``FrictionPairs``)
between all segments that press, with the pressures of the last state: errors are of the order of the step. The energy
lost in a step is exact: sliding forces times slid distances, and what springs lose.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from yarnscale.arrays import Array
from yarnscale.cell.energy import CellEnergy
from yarnscale.cell.equilibrium import Equilibrium
from yarnscale.cell.periodic import PeriodicCell
from yarnscale.errors import InputError
from yarnscale.yarn.friction import YarnFriction
from yarnscale.yarn.friction_pairs import FrictionPairs

Solve = Callable[[PeriodicCell, Equilibrium], Equilibrium | None]


@dataclass(frozen=True, eq=False)
class CellHistory:
    """A cell with friction at the end of a step: the equilibrium, and the pairs that press, with their springs.

    stored: energy of yarns and springs [J/m²]. dissipated: by friction in the step to this state, never negative
    [J/m²].
    """

    cell: PeriodicCell
    friction: YarnFriction
    state: Equilibrium
    friction_pairs: FrictionPairs
    stored: float
    dissipated: float = 0.0

    @classmethod
    def begin(cls, cell: PeriodicCell, friction: YarnFriction, state: Equilibrium) -> CellHistory:
        """A cell at an equilibrium of it without friction: no spring is stretched.

        Raises InputError for a state that is no equilibrium, or whose yarns passed through each other.
        """
        if not state.usable:
            raise InputError("start of a path with friction", expected="an equilibrium", found=state.outcome)
        return cls(cell, friction, state, FrictionPairs.none(), sum(state.energy_parts.values()))

    def step(self, solve: Solve) -> CellHistory | None:
        """The history at a next state; None where there is none.

        solve: the next equilibrium of a cell that resists slip since this state, from this equilibrium.
        """
        pairs = self._pairs()
        state = solve(replace(self.cell, friction_pairs=pairs), self.state)
        if state is None or not state.usable:
            return None
        energy, positions = self._places(state)
        new, lost = pairs.after(energy.strands, positions, energy.frames, self.friction_pairs)
        unit = energy.unit / self.cell.pattern.area
        stored = sum(state.energy_parts.values()) + new.stored * unit
        return replace(self, state=state, friction_pairs=new, stored=stored, dissipated=lost * unit)

    def _places(self, state: Equilibrium) -> tuple[CellEnergy, Array]:
        """The energy under a state, and the positions of all nodes."""
        energy = replace(self.cell, friction_pairs=FrictionPairs.none()).energy(state.strain)
        x = energy.start(state.fluctuation / self.cell.pattern.radius, state.twist)
        return energy, energy.rods.positions(energy.nodes.expand(x))

    def _pairs(self) -> FrictionPairs:
        """What resists slip since this state."""
        energy, positions = self._places(self.state)
        contacts = energy.rods.contacts(np.concatenate([positions.ravel(), self.state.twist])).stencils
        parts = energy.strands, positions, energy.frames, contacts
        return FrictionPairs.since(*parts, self.friction, self.friction_pairs)
