"""What a static or implicit step of a finite fabric minimises: its energy, springs to targets, loads and obstacles."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from yarnscale.arrays import Array
from yarnscale.fabric.direct_energy import FabricEnergy
from yarnscale.numerics.factor import SymmetricPattern
from yarnscale.numerics.regularisation import ShiftedHessian
from yarnscale.numerics.sums import Load, Springs, SumOfEnergies, add_diagonal_blocks

_LOOSE = 1e-4
"""Share of the diagonal regularisation that is left where yarns are tied to each other."""


class NodeForce(Protocol):
    """An energy of every vertex by itself, such as contact with an obstacle; lengths in radii, energies in E π r³."""

    def begin(self, positions: Array, start: float, end: float) -> None:
        """Begin a step of motion from a time to another [s] at positions (n, 3), where slip begins."""
        ...

    def slowed(self, velocity: Array, yielding: Array, duration: float) -> Array:
        """Velocities (n, 3) after the friction of an explicit step; yielding: one over masses (n,), 0 if held."""
        ...

    def at(self, positions: Array) -> tuple[float, Array, Array]:
        """Energy, gradient (n, 3) and a positive semidefinite Hessian (n, 3, 3) at positions (n, 3)."""
        ...


@dataclass(frozen=True, eq=False)
class _NodeTerm:
    """A force on the vertices as a term of a sum of energies."""

    force: NodeForce
    size: int

    def value(self, x: Array) -> float:
        return self.force.at(x[: self.size].reshape(-1, 3))[0]

    def gradient(self, x: Array, gradient: Array) -> float:
        value, pull, _ = self.force.at(x[: self.size].reshape(-1, 3))
        gradient[: self.size] += pull.ravel()
        return value

    def hessian(self, x: Array, gradient: Array, pattern: SymmetricPattern, entries: Array) -> float:
        value, pull, blocks = self.force.at(x[: self.size].reshape(-1, 3))
        gradient[: self.size] += pull.ravel()
        add_diagonal_blocks(pattern, entries, blocks)
        return value


class _Yarns:
    """The energy of the yarns with its regularisation; pull: how strongly its terms pull against each other."""

    def __init__(self, energy: FabricEnergy, *, tied: bool) -> None:
        self._energy, self._tied, self.pull = energy, tied, 0.0
        stiffness = energy.stiffness
        self._scale = np.concatenate([np.repeat(stiffness.position_scale(), 3), stiffness.twist_scale()])
        # At the end of an open yarn no edge has a twist; its unknown stands still.
        self._idle = 3 * energy.count + np.flatnonzero(energy.sheet.following < 0)

    def value(self, x: Array) -> float:
        return self._energy.value(x)

    def gradient(self, x: Array) -> tuple[float, Array]:
        value, forces = self._energy.gradient(x)
        return value, self._summed(forces)

    def quadratic(self, x: Array) -> tuple[float, Array, ShiftedHessian]:
        value, forces, block, entries = self._energy.hessian(x)
        gradient = self._summed(forces)
        entries[block.pattern.diagonal[self._idle]] += self._scale[self._idle]
        if not self._tied:
            return value, gradient, ShiftedHessian(block.pattern, entries, self._scale)
        scale = self._scale.copy()
        scale[: 3 * self._energy.count] *= _LOOSE
        return value, gradient, ShiftedHessian(block.pattern, entries, scale, self._energy.ties(x))

    def _summed(self, forces: Array) -> Array:
        self.pull = sum(float(np.linalg.norm(force)) for force in forces)
        return forces.sum(axis=0)


class FabricObjective(SumOfEnergies):
    """Energy of the yarns + springs − load·x + obstacles; an objective for ``numerics.newton``.

    load: (4n,) force on every unknown. force_floor: gradient norm that counts as 1 where nothing pulls.
    pull_share: how much the terms' pulling against each other counts, on top of that. tied: regularise what yarns do
    against each other rather than every motion, so that a step that ends early does not slow the common motion.
    """

    def __init__(
        self,
        energy: FabricEnergy,
        springs: Sequence[Springs],
        load: Array,
        obstacles: Sequence[NodeForce] = (),
        *,
        force_floor: float = 1e-9,
        pull_share: float = 1.0,
        tied: bool = False,
    ) -> None:
        self._yarns = _Yarns(energy, tied=tied)
        pushes = [_NodeTerm(force, 3 * energy.count) for force in obstacles]
        super().__init__(self._yarns, [*springs, Load(load), *pushes], force_floor)
        self._pull_share = pull_share

    @property
    def residual_scale(self) -> float:
        return self._pull_share * self._yarns.pull + self._scale
