"""What a static or implicit step of a finite fabric minimises: its energy, springs to targets, loads and obstacles."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from yarnscale.fabric.direct_energy import FabricEnergy
from yarnscale.numerics.factor import SymmetricPattern

Array = NDArray[np.float64]


_LOOSE = 1e-4
"""Share of the diagonal regularisation that is left where yarns are tied to each other."""


class NodeForce(Protocol):
    """An energy of every vertex by itself, such as contact with an obstacle; lengths in radii, energies in E π r³."""

    def begin(self, positions: Array, start: float, end: float) -> None:
        """Begin a step of motion from a time to another [s] at positions (n, 3): what rubs does so from there on."""
        ...

    def slowed(self, velocity: Array, yielding: Array, duration: float) -> Array:
        """Velocities (n, 3) after the friction of an explicit step; yielding: (n,) one over masses, 0 if led."""
        ...

    def at(self, positions: Array) -> tuple[float, Array, Array]:
        """Energy, gradient (n, 3) and a positive semidefinite Hessian (n, 3, 3) at positions (n, 3)."""
        ...


@dataclass(frozen=True, eq=False)
class Wells:
    """Springs of all unknowns to where they should be, ½ Σ weight (x − centre)²; both (4n,)."""

    weight: Array
    centre: Array

    @classmethod
    def none(cls, count: int) -> Wells:
        """No springs of ``count`` vertices."""
        return cls(np.zeros(4 * count), np.zeros(4 * count))

    def with_(self, other: Wells) -> Wells:
        """Both, up to a constant energy."""
        weight = self.weight + other.weight
        centre = self.weight * self.centre + other.weight * other.centre
        return Wells(weight, np.divide(centre, weight, out=np.zeros_like(centre), where=weight > 0))


@dataclass(eq=False)
class FabricModel:
    """H + shift·(D + T): D diagonal, scaled separately for positions and twists, T ties of yarns to each other."""

    pattern: SymmetricPattern
    entries: Array
    scale: Array
    ties: Array | None = None

    def values(self, shift: float) -> Array:
        """Entries of the regularised Hessian."""
        if shift == 0.0:
            return self.entries
        values = self.entries.copy() if self.ties is None else self.entries + shift * self.ties
        values[self.pattern.diagonal] += shift * self.scale
        return values


@dataclass(eq=False)
class FabricObjective:
    """Energy + wells − load·x + obstacles; an objective for ``numerics.newton``.

    load: (4n,) force on every unknown. force_floor: gradient norm that counts as 1 where nothing pulls.
    pull_share: how much the terms' pulling against each other counts, on top of that. tied: regularise what yarns do
    against each other rather than every motion, so that a step cut short is no step through honey.
    """

    energy: FabricEnergy
    wells: Wells
    load: Array
    obstacles: Sequence[NodeForce] = ()
    force_floor: float = 1e-9
    pull_share: float = 1.0
    tied: bool = False
    residual_scale: float = field(init=False, default=1.0)

    def __post_init__(self) -> None:
        stiffness = self.energy.stiffness
        self._scale = np.concatenate([np.repeat(stiffness.position_scale(), 3), stiffness.twist_scale()])
        # At the end of an open yarn no edge has a twist; its unknown stands still.
        self._idle = 3 * self.energy.count + np.flatnonzero(self.energy.sheet.following < 0)
        self._block: object = None

    def value(self, x: Array) -> float:
        """Energy [E π r³]; inf where two yarns meet."""
        away = x - self.wells.centre
        outer = 0.5 * float((self.wells.weight * away) @ away) - float(self.load @ x)
        positions = self.energy.positions(x)
        return self.energy.value(x) + outer + sum(o.at(positions)[0] for o in self.obstacles)

    def gradient(self, x: Array) -> tuple[float, Array]:
        """Energy and gradient."""
        value, gradient, pull = self.energy.gradient(x)
        return self._completed(x, value, gradient, pull, None, None)

    def quadratic(self, x: Array) -> tuple[float, Array, FabricModel]:
        """Energy, gradient and exact Hessian."""
        value, gradient, pull, block, entries = self.energy.hessian(x)
        diagonal = block.pattern.diagonal
        entries[diagonal] += self.wells.weight
        entries[diagonal[self._idle]] += self._scale[self._idle]
        value, gradient = self._completed(x, value, gradient, pull, entries, diagonal)
        if not self.tied:
            return value, gradient, FabricModel(block.pattern, entries, self._scale)
        scale = self._scale.copy()
        scale[: 3 * self.energy.count] *= _LOOSE
        return value, gradient, FabricModel(block.pattern, entries, scale, self.energy.ties(x))

    def _completed(
        self,
        x: Array,
        value: float,
        gradient: Array,
        pull: float,
        entries: Array | None,
        diagonal: NDArray[np.int64] | None,
    ) -> tuple[float, Array]:
        away = x - self.wells.centre
        spring = self.wells.weight * away
        value += 0.5 * float(spring @ away) - float(self.load @ x)
        gradient = gradient + spring - self.load
        n = self.energy.count
        for obstacle in self.obstacles:
            extra, force, hessian = obstacle.at(self.energy.positions(x))
            value += extra
            gradient[: 3 * n] += force.ravel()
            if entries is not None and diagonal is not None:
                _add_blocks(entries, diagonal[: 3 * n].reshape(-1, 3), hessian)
        self.residual_scale = self.pull_share * pull + self.force_floor
        return value, gradient


def _add_blocks(entries: Array, diagonal: NDArray[np.int64], hessian: Array) -> None:
    """Add symmetric 3×3 blocks of vertices; a column's entries begin with the rest of its vertex."""
    for column in range(3):
        for row in range(column, 3):
            entries[diagonal[:, column] + row - column] += hessian[:, row, column]
