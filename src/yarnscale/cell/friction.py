"""Friction in a periodic cell along a path of macroscopic states (theory §2): what its contacts remember.

From one state to the next the cell minimises its energy plus the potential of springs and sliders (``Grip``) between
all segments that press. Their pressures are those of the new state, found by solving again; errors are of the order of
the step. What friction takes in a step is exact: sliding forces times slid ways, and what springs lose.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from yarnscale.arrays import Array
from yarnscale.cell.energy import CellEnergy
from yarnscale.cell.equilibrium import Equilibrium
from yarnscale.cell.grip import Grip
from yarnscale.cell.periodic import PeriodicCell
from yarnscale.kinematics import ShellStrain
from yarnscale.yarn.friction import Rubbing, YarnFriction

Solve = Callable[[PeriodicCell, Equilibrium], Equilibrium | None]

PASSES = 1
"""Solves of a step with the pressures of the solve before, after the first with those of the last state."""
_HALVINGS = 4


@dataclass(frozen=True, eq=False)
class CellHistory:
    """A cell with friction at a state that it came to: the equilibrium, and the pairs that press, with their springs.

    stored: energy of yarns and springs [J/m²]. dissipated: by friction in the step to this state, never negative
    [J/m²].
    """

    cell: PeriodicCell
    friction: YarnFriction
    state: Equilibrium
    grip: Grip
    stored: float
    dissipated: float = 0.0

    @classmethod
    def begin(cls, cell: PeriodicCell, friction: YarnFriction, state: Equilibrium) -> CellHistory:
        """A cell at an equilibrium of it without friction: no spring is stretched."""
        return cls(cell, friction, state, Grip.none(), sum(state.energy_parts.values()))

    def step(self, solve: Solve, *, passes: int = PASSES) -> CellHistory | None:
        """The history at a next state; None where there is none.

        solve: the next equilibrium of a cell that resists slip since this state, from a neighbouring equilibrium.
        """
        state = self.state
        for _ in range(1 + passes):
            grip = self._gripped(state)
            cell = replace(self.cell, grip=grip)
            found = solve(cell, state)
            if found is None or not found.usable:
                return None
            state = found
        energy, nodes = self._places(state)
        springs, slid = grip.springs(energy.strands, nodes, energy.frames)
        new, unit = replace(grip, spring=springs), energy.unit / self.cell.pattern.area
        lost = slid + self.grip.stored - grip.stored
        return replace(
            self,
            state=state,
            grip=new,
            stored=sum(state.energy_parts.values()) + new.stored * unit,
            dissipated=lost * unit,
        )

    def _places(self, state: Equilibrium) -> tuple[CellEnergy, Array]:
        """The energy under a state, and the positions of all nodes."""
        energy = replace(self.cell, grip=Grip.none()).energy(state.strain)
        x = energy.start(state.fluctuation / self.cell.pattern.radius, state.twist)
        return energy, energy.rods.positions(energy.nodes.expand(x))

    def _gripped(self, pressed: Equilibrium) -> Grip:
        """What resists slip since this history: the pairs that press at a next state."""
        energy, positions = self._places(pressed)
        full = np.concatenate([positions.ravel(), pressed.twist])
        pairs = Rubbing.of(energy.rods.contacts(full).stencils, full)
        first, second = pairs.nodes[:, 0], pairs.nodes[:, 2]
        keys = np.column_stack([first, second % energy.count, energy.strands.tiles[second // energy.count]])
        normal = np.einsum("kji,kj->ki", energy.frames[first], pairs.normal)
        limit = self.friction.coefficient * pairs.pressure
        grip = Grip(
            keys, pairs.place, np.zeros_like(normal), normal, limit, pairs.stiffness, np.zeros_like(normal)
        )
        energy, positions = self._places(self.state)
        return grip.since(energy.strands, positions, energy.frames, self.grip)


def path_with_friction(
    start: CellHistory, strains: Iterable[ShellStrain], *, passes: int = PASSES
) -> Iterator[CellHistory]:
    """Equilibria at one macroscopic state after the other, from a history on; it ends where none is found.

    Steps that fail are halved. Results are independent of the steps in the limit of short ones.
    """
    here: CellHistory | None = start
    for strain in strains:
        here = _stepped(here, strain, passes, _HALVINGS)
        if here is None:
            return
        yield here


def _stepped(here: CellHistory, strain: ShellStrain, passes: int, halvings: int) -> CellHistory | None:
    """The history one step on, through the state half-way where that fails; its dissipation is that of both."""

    def solve(cell: PeriodicCell, near: Equilibrium) -> Equilibrium:
        return cell.relax(strain, start=near, nearby=True)

    found = here.step(solve, passes=passes)
    if found is not None or halvings == 0:
        return found
    middle = ShellStrain.from_vector(0.5 * (here.state.strain.vector + strain.vector))
    half = _stepped(here, middle, passes, halvings - 1)
    end = None if half is None else _stepped(half, strain, passes, halvings - 1)
    return None if end is None or half is None else replace(end, dissipated=half.dissipated + end.dissipated)
