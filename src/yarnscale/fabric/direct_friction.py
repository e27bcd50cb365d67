"""Friction between the yarns of a finite fabric from step to step: what its contacts remember (``FrictionPairs``).

Springs turn with the fabric around them, as those of a cell do with its macroscopic state: fabric that swings, drapes
or curls does not slip. How far it turns in a step is a result of the step. With inertia, springs turn as velocities
predict, and what is left over is added in the next step. Without, they are turned anew after every iteration of
Newton's method.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from yarnscale.arrays import Array
from yarnscale.fabric.direct_energy import FabricEnergy
from yarnscale.numerics.assembly import StencilSet
from yarnscale.yarn.friction import FRICTION, STEADY_FRICTION, YarnFriction
from yarnscale.yarn.friction_pairs import FrictionPairs

_THIN = 4.0
"""Least radius of gyration of a piece of fabric about an axis of its turn [r]: a yarn around another turns none."""


@dataclass(frozen=True, eq=False)
class FrictionHistory:
    """Contacts of a fabric at the end of a step, all their vectors in space.

    lag: (n, 3) rotation of the fabric around each vertex less that of its springs [rad]. dissipated: by friction since
    the contacts were without springs [J]; it never falls.
    """

    pairs: FrictionPairs
    lag: Array
    dissipated: float = 0.0

    @classmethod
    def slack(cls, energy: FabricEnergy) -> FrictionHistory:
        """No contact has a spring yet."""
        return cls(FrictionPairs.none(), np.zeros((energy.count, 3)))

    def begin(
        self, energy: FabricEnergy, friction: YarnFriction, x: Array, *, predicted: Array | None = None
    ) -> FrictionStep:
        """Begin a step at a state (4n,): from there on the energy resists slip.

        predicted: the move of the step that velocities lead to (4n,), None without inertia.
        """
        places, contacts = energy.positions(x).copy(), energy.contacts(x).stencils
        still = np.broadcast_to(np.eye(3), (energy.count, 3, 3))
        pairs = FrictionPairs.since(energy.strands, places, still, contacts, friction, self.pairs)
        turn = Rotation.from_rotvec(self.lag)
        if predicted is not None:
            turn = Rotation.from_rotvec(_rotations(energy, places, energy.positions(predicted))) * turn
        step = FrictionStep(self, energy, pairs, places, turn, follows=predicted is None)
        energy.rub(step)
        return step

    def stored(self, energy: FabricEnergy) -> float:
        """Energy of the springs [J]."""
        return self.pairs.stored * energy.unit


@dataclass(eq=False)
class FrictionStep:
    """A step from the history ``before``, with its pairs and the positions (n, 3) at its beginning.

    turn: of the springs at every vertex, n rotations. follows: whether they turn after every iteration.
    """

    before: FrictionHistory
    energy: FabricEnergy
    pairs: FrictionPairs
    places: Array
    turn: Rotation
    follows: bool

    def turned(self, places: Array) -> Rotation:
        """Rotation of the fabric to positions (n, 3), after that of ``lag``."""
        # A rigid rotation by φ moves points by 2 tan(φ/2) times their distance from its axis half-way.
        tangent = _rotations(self.energy, 0.5 * (places + self.places), places - self.places)
        size = 0.5 * np.linalg.norm(tangent, axis=1, keepdims=True)
        rotation = Rotation.from_rotvec(tangent * (np.arctan(size) / np.maximum(size, 1e-300)))
        return rotation * Rotation.from_rotvec(self.before.lag)

    def follow(self, places: Array) -> bool:
        """Turn with the fabric to positions (n, 3); whether springs do so within the step."""
        if self.follows:
            self.turn = self.turned(places)
        return self.follows

    @property
    def stencils(self) -> StencilSet:
        """What resists slip, with springs as they are turned now."""
        energy = FRICTION if self.follows else STEADY_FRICTION
        return self.pairs.stencils(self.energy.strands, self.turn.as_matrix(), energy)

    def end(self, x: Array) -> FrictionHistory:
        """The history at the state that the step ended in."""
        places, frames = self.energy.positions(x), self.turn.as_matrix()
        pairs, lost = self.pairs.after(self.energy.strands, places, frames, self.before.pairs)
        lag = (self.turned(places) * self.turn.inv()).as_rotvec()
        return FrictionHistory(pairs.rotated(frames), lag, self.before.dissipated + lost * self.energy.unit)


def _rotations(energy: FabricEnergy, places: Array, moves: Array) -> Array:
    """Rotation vectors of the fabric around all vertices (n, 3) in small moves (n, 3)."""
    around = energy.surroundings
    return around.shares @ around.rates(places, moves, energy.masses(), thin=_THIN)[2]
