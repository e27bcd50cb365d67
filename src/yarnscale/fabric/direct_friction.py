"""Friction between the yarns of a finite fabric from step to step: what its contacts remember (``FrictionPairs``).

Springs turn with the fabric around them, as those of a cell do with its macroscopic state: fabric that swings or drapes
does not slip. How far it turns in a step is a result of the step, so springs follow with the turn that velocities
foretell, and with what that missed in the step before.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from yarnscale.arrays import Array
from yarnscale.fabric.direct_energy import FabricEnergy
from yarnscale.yarn.friction import YarnFriction
from yarnscale.yarn.friction_pairs import FrictionPairs

_THIN = 4.0
"""Least radius of gyration of a piece of fabric about an axis of its turn [r]: a yarn around another turns none."""


@dataclass(frozen=True, eq=False)
class FabricHistory:
    """Contacts of a fabric at the end of a step, and their springs in space.

    owed: (p, 3) how far each of the energy's ``surroundings`` has turned without its springs [rad]. dissipated: what
    friction has taken since the contacts were without springs [J]; it never falls.
    """

    pairs: FrictionPairs
    owed: Array
    dissipated: float = 0.0

    @classmethod
    def slack(cls, energy: FabricEnergy) -> FabricHistory:
        """No contact has a spring yet."""
        return cls(FrictionPairs.none(), np.zeros((energy.surroundings.count, 3)))

    def begin(
        self, energy: FabricEnergy, friction: YarnFriction, x: Array, *, ahead: Array | None = None
    ) -> FrictionStep:
        """Begin a step at a state (4n,): from there on the energy resists slip. ahead: the move foretold (4n,)."""
        places, around = energy.positions(x), energy.surroundings
        turn = self.owed.copy()
        if ahead is not None:
            turn += around.rates(places, energy.positions(ahead), energy.masses(), thin=_THIN)[2]
        still = np.broadcast_to(np.eye(3), (energy.count, 3, 3))
        contacts = energy.contacts(x).stencils
        pairs = FrictionPairs.since(energy.strands, places, still, contacts, friction, self.pairs)
        frames = Rotation.from_rotvec(turn).as_matrix()[around.own]
        energy.rub(pairs.stencils(energy.strands, frames))
        return FrictionStep(self, pairs, turn, frames, places.copy())

    def stored(self, energy: FabricEnergy) -> float:
        """Energy of the springs [J]."""
        return self.pairs.stored * energy.unit


class FrictionStep(NamedTuple):
    """A step from the history ``before``: its pairs, how far their frames turn (p, 3), (n, 3, 3), and the places."""

    before: FabricHistory
    pairs: FrictionPairs
    turn: Array
    frames: Array
    places: Array

    def end(self, energy: FabricEnergy, x: Array) -> FabricHistory:
        """The history at the state that the step ended in."""
        places = energy.positions(x)
        pairs, lost = self.pairs.after(energy.strands, places, self.frames, self.before.pairs)
        spring = np.einsum("kij,kj->ki", self.frames[pairs.pairs[:, 0]], pairs.spring)
        # A rigid turn moves points by 2 tan(φ/2) times their distance from its axis half-way.
        middle, moves = 0.5 * (places + self.places), places - self.places
        tangent = energy.surroundings.rates(middle, moves, energy.masses(), thin=_THIN)[2]
        size = 0.5 * np.linalg.norm(tangent, axis=1, keepdims=True)
        turned = Rotation.from_rotvec(tangent * (np.arctan(size) / np.maximum(size, 1e-300)))
        owed = turned * Rotation.from_rotvec(self.before.owed) * Rotation.from_rotvec(self.turn).inv()
        dissipated = self.before.dissipated + lost * energy.unit
        return FabricHistory(replace(pairs, spring=spring), owed.as_rotvec(), dissipated)
