"""One implicit step, or one static equilibrium, as an energy to minimise.

    ½ rate² |x − y|²_M + ½ rate |x − past|²_D + E(x) + attachments + contact − gravity·x

with the lumped mass M, and rate, past and y from the ``integrator``; D is Rayleigh's damping matrix, αM + βK.
Without the first two terms it is a static equilibrium.

K is the stiffness at the start of the step, from the magnitudes of the moduli, without the geometric term: it
is positive, costs one matrix a step, and vanishes for rigid motions, so that momentum and angular momentum stay.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from yarnscale.arrays import Array, Integers
from yarnscale.numerics.block_pattern import BlockPattern
from yarnscale.numerics.factor import SymmetricPattern
from yarnscale.numerics.kkt import QuadraticModel
from yarnscale.numerics.sums import SumOfEnergies, Term
from yarnscale.shell.contact.cloth_contact import ClothContact
from yarnscale.shell.elastic.energy import ShellObjective

ROUND_OFF = 1e-9
"""Share of the diagonal that is added to the positive model."""


class StepObjective(SumOfEnergies):
    """The energy of a step [J] for ``numerics.newton.minimise``, in the coordinates of the vertices [m].

    Unknowns: the nv vertices of the cloth and, after them, the points of moving obstacles, which have no other
    terms than contact and the attachment that places them. terms: inertia, load, attachments, damping; scale: gradient
    norm that counts as 1 [N]; growth: of the elastic pattern, by contacts.
    """

    def __init__(
        self, elastic: ShellObjective, terms: Sequence[Term], scale: float, contact: ClothContact, growth: PatternGrowth
    ) -> None:
        super().__init__(elastic, terms, scale)
        self._contact, self._growth = contact, growth

    def value(self, x: Array) -> float:
        touching = self._contact.value(x.reshape(-1, 3))
        return touching + super().value(x) if math.isfinite(touching) else math.inf

    def gradient(self, x: Array) -> tuple[float, Array]:
        return self._with_contact(x, *super().gradient(x))

    def quadratic(self, x: Array) -> tuple[float, Array, StepModel]:
        value, gradient, model = super().quadratic(x)
        positions = x.reshape(-1, 3)
        keys, blocks = self._contact.hessian(positions)
        places = self._growth.admit(keys, lambda: self._contact.room(positions))
        return *self._with_contact(x, value, gradient), StepModel(model, self._growth, places, blocks)

    def _with_contact(self, x: Array, value: float, gradient: Array) -> tuple[float, Array]:
        touching, push = self._contact.gradient(x.reshape(-1, 3))
        return value + touching, gradient + push.ravel()


class PatternGrowth:
    """The cloth's pattern with room for the contacts met so far; it grows when new ones do not fit.

    Blocks of two vertices are named by keys ``column·vertices + row`` of the lower triangle.
    """

    def __init__(self, base: SymmetricPattern) -> None:
        self._entries, self._vertices = base.columns * base.size + base.rows, base.size // 3
        self._base = np.unique(base.columns // 3 * self._vertices + base.rows // 3)
        self._lay_out(self._base)

    @property
    def pattern(self) -> SymmetricPattern:
        return self._blocks.pattern

    def admit(self, keys: Integers, room: Callable[[], Integers]) -> Integers:
        """Places of blocks in the pattern, which grows where they do not fit, then also by the keys of ``room``."""
        places = np.minimum(np.searchsorted(self._keys, keys), len(self._keys) - 1)
        if (self._keys[places] == keys).all():
            return places
        # Contacts that have gone make room: only the latest and the base are kept when too many have gathered.
        kept = self._keys if len(self._keys) < 1.5 * len(self._base) else self._base
        self._lay_out(np.concatenate([kept, keys, room()]))
        return np.searchsorted(self._keys, keys)

    def spread(self, base: Array, places: Integers, blocks: Array) -> Array:
        """Entries in ``pattern`` of a matrix in the base pattern (overwritten) plus blocks (m, 9) at places."""
        values = base
        if self.pattern.entries > len(base):
            values = np.zeros(self.pattern.entries)
            values[self._base_slots] = base
        self._blocks.add_blocks(places, blocks, values)
        return values

    def _lay_out(self, keys: Integers) -> None:
        self._blocks = BlockPattern.from_keys(np.full(self._vertices, 3), keys)
        self._keys, pattern = self._blocks.keys, self.pattern
        self._base_slots = np.searchsorted(pattern.columns * pattern.size + pattern.rows, self._entries)


@dataclass(eq=False)
class StepModel:
    """The model of a sum with the entries of contacts, and where they are in the grown pattern.

    From shift 1 on the diagonal grows by (shift − 1) of itself, at least by ``ROUND_OFF``: where triangles have hardly
    any area, entries are so far apart that round-off makes even the positive model indefinite.
    """

    summed: QuadraticModel
    growth: PatternGrowth
    places: Integers
    blocks: Array

    @property
    def pattern(self) -> SymmetricPattern:
        """Pattern of the matrix; the same object until contacts make it grow."""
        return self.growth.pattern

    def values(self, shift: float) -> Array:
        values = self.growth.spread(self.summed.values(shift), self.places, self.blocks)
        if shift >= 1.0:
            values[self.pattern.diagonal] *= max(shift, 1.0 + ROUND_OFF)
        return values
