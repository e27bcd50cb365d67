"""State of a cloth: positions, velocities, history; springs that hold vertices."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from yarnscale.arrays import Array, Integers
from yarnscale.motion.integrator import Earlier
from yarnscale.numerics.factor import SymmetricPattern
from yarnscale.shell.mesh import TriangleMesh


@dataclass(frozen=True, eq=False)
class Slips:
    """Elastic slip of every contact with friction.

    between: (n, 5), the part of ``ClothContact`` and kind of pair, and the vertices, or the one vertex or triangle,
    in contact; amounts: slips over the slip of full friction, (n, 3), none longer than 1.
    """

    between: Integers
    amounts: Array


@dataclass(frozen=True, eq=False)
class ClothState:
    """Positions and velocities of a mesh at a time.

    positions: [m], velocities: [m/s], both (nv, 3); time: [s]. fold_angles: reference angles of the elastic
    energy [rad], needed only for cloth folded by more than π (None: computed from the positions). before: the
    state one step earlier, for two-step integrators (None: they begin with one step of implicit Euler).
    obstacles: actual points of moving obstacles [m] (None: as prescribed). slips: of contacts
    with friction (None: none). memory: of friction inside the fabric, (blocks, M, BLOCK) of its elements (None: slack).
    """

    positions: Array
    velocities: Array
    time: float = 0.0
    fold_angles: Array | None = None
    before: Earlier | None = None
    obstacles: Array | None = None
    slips: Slips | None = None
    memory: Array | None = None

    @classmethod
    def flat(cls, mesh: TriangleMesh, *, height: float = 0.0) -> ClothState:
        """The cloth as cut, or as its panels are assembled, at rest and raised by ``height`` [m]."""
        positions = mesh.assembled + np.array([0.0, 0.0, height])
        return cls(positions, np.zeros_like(positions))


@dataclass(frozen=True, eq=False)
class Attachment:
    """Vertices held at targets by stiff springs; a term of a sum of energies [J], see ``numerics.sums``.

    vertices: (n,); targets: (n, 3) [m]; stiffness: of each spring [N/m]. Springs instead of eliminated
    unknowns: Newton's method then moves the cloth together with its bars, and an obstacle can stop a bar.
    The error of a target is force/stiffness, a micrometre per newton on one vertex.
    limit: largest force of a spring [N]; its energy is F²/k (√(1 + k²u²/F²) − 1).
    """

    vertices: Integers
    targets: Array
    stiffness: float = 1e6
    limit: float = math.inf

    def pull(self, positions: Array) -> Array:
        """Force of the springs on the cloth [N], (n, 3)."""
        return -self.forces(positions)[1]

    def forces(self, positions: Array) -> tuple[float, Array, Array]:
        """Energy [J], its gradient by the vertices (n, 3) [N], and stiffnesses (n,) [N/m], at least the exact ones.

        With these, one Newton step moves a free vertex to its target from any distance.
        """
        gap = positions[self.vertices] - self.targets
        square = np.einsum("ni,ni->n", gap, gap)
        reach = self.limit / self.stiffness
        stretch = np.sqrt(1.0 + square / reach**2)
        stiffness = self.stiffness / stretch
        energy = self.stiffness * float((square / (stretch + 1.0)).sum())
        return energy, stiffness[:, None] * gap, stiffness

    def value(self, x: Array) -> float:
        return self.forces(x.reshape(-1, 3))[0]

    def gradient(self, x: Array, gradient: Array) -> float:
        energy, pull, _ = self.forces(x.reshape(-1, 3))
        np.add.at(gradient.reshape(-1, 3), self.vertices, pull)
        return energy

    def hessian(self, x: Array, gradient: Array, pattern: SymmetricPattern, entries: Array) -> float:
        stiffness = self.forces(x.reshape(-1, 3))[2]
        places = pattern.diagonal[: len(x)].reshape(-1, 3)[self.vertices]
        np.add.at(entries, places, stiffness[:, None])
        return self.gradient(x, gradient)
