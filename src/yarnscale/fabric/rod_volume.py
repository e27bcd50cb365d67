"""A bounding volume around yarns that are elastic rods: few unknowns for steps, and first guesses of equilibria.

Vertices move with the volume, x = x₀ + Γ u (LOD03 §3), from whatever shape the yarns have; twists stay as they are.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from yarnscale.arrays import Array
from yarnscale.errors import InputError
from yarnscale.fabric.direct_energy import FabricEnergy
from yarnscale.fabric.direct_motion import FabricDynamics, FabricMotion
from yarnscale.fabric.direct_objective import FabricObjective
from yarnscale.fabric.volume import BoundingVolume
from yarnscale.numerics.affine import FreeUnknowns, MappedObjective, NodeMap
from yarnscale.numerics.newton import NewtonOptions, Objective, Solution, minimise
from yarnscale.numerics.regularisation import ShiftRule

_SHIFT = ShiftRule(start=0.0, lowest=1e-9, lowest_is_zero=True, least=1e-6)


class RodVolume:
    """A volume around the yarns of an energy's sheet in the sheet's own shape."""

    def __init__(self, energy: FabricEnergy, volume: BoundingVolume) -> None:
        """Raises InputError where yarns are outside of the volume."""
        self.energy, self.volume = energy, volume
        self.weights = volume.fast_weights(energy.sheet.vertices)

    @property
    def unknowns(self) -> int:
        """Coordinates of control points."""
        return 3 * self.volume.count

    def maps_from(self, x: Array) -> tuple[NodeMap, FreeUnknowns]:
        """Displacements of the volume (3c,) [r] to positions, and these to states (4n,), from one of them."""
        places = np.arange(3 * self.energy.count)
        return NodeMap(self.weights, x[places]), FreeUnknowns(places, x.copy())

    @cached_property
    def _inverse(self) -> Array:
        square = self.weights.T @ self.weights
        square = square if isinstance(square, np.ndarray) else square.toarray()
        return np.linalg.pinv(square, rcond=1e-12, hermitian=True)

    def projected(self, change: Array) -> Array:
        """The change of a state (4n,) nearest to this one that the volume can make."""
        moves = self.energy.positions(change)
        moves = self.weights @ (self._inverse @ (self.weights.T @ moves))
        return np.concatenate([moves.ravel(), np.zeros(self.energy.count)])

    def minimised(self, objective: Objective, start: Array, options: NewtonOptions) -> Solution:
        """Minimise an objective of the yarns by the volume alone, from a state (4n,); the solution is a state."""
        energy, (nodes, positions) = self.energy, self.maps_from(start)

        def state(free: Array) -> Array:
            return positions.expand(nodes.expand(free))

        def bound(free: Array, step: Array) -> float:
            move = np.zeros_like(start)
            move[positions.places] = nodes.expand(step) - nodes.offset
            return energy.bound(state(free), move)

        solution = minimise(
            MappedObjective(MappedObjective(objective, positions), nodes), np.zeros(self.unknowns),
            replace(options, shift=_SHIFT), bound=bound, after_step=lambda free: energy.anchor(state(free)),
        )  # fmt: skip
        return replace(solution, x=state(solution.x))


@dataclass(eq=False)
class VolumeDynamics(FabricDynamics):
    """A fabric that moves as its volume does; implicit steps only. Its equilibria are first guesses of the yarns'."""

    volume: RodVolume = field(kw_only=True)

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.method == "explicit":  # what is held would leave the volume
            raise InputError("steps of rods in a volume", expected="the implicit method", found=self.method)

    def _minimised(self, objective: FabricObjective, motion: FabricMotion, options: NewtonOptions) -> Solution:
        return self.volume.minimised(objective, motion.x, options)

    def _damped(self, x: Array, velocity: Array, duration: float) -> Array:
        return self.volume.projected(super()._damped(x, velocity, duration))
