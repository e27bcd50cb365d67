"""One implicit step, or one static equilibrium, as an energy to minimise.

    ½ rate² |x − y|²_M + ½ rate |x − past|²_D + E(x) + attachments + contact − gravity·x

with the lumped mass M, and rate, past and y from the ``integrator``; D is Rayleigh's damping matrix, αM + βK.
Without the first two terms it is a static equilibrium.

K is the stiffness at the start of the step, from the magnitudes of the moduli, without the geometric term: it
is positive, costs one matrix a step, and vanishes for rigid motions, so that momentum and angular momentum stay.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from yarnscale.numerics.factor import SymmetricPattern
from yarnscale.shell.elastic.energy import Floats, Linearisation, ShellEnergy
from yarnscale.shell.state import Attachment

ROUND_OFF = 1e-9
"""Share of the diagonal that is added to the positive model."""


class ContactEnergy(Protocol):
    """Forces between layers of cloth and from obstacles, as an energy that is inf where they meet."""

    def value(self, positions: Floats) -> float:
        """Energy [J] at positions (nv, 3)."""
        ...

    def gradient(self, positions: Floats) -> tuple[float, Floats]:
        """Energy and gradient (nv, 3) [N]."""
        ...

    def hessian(self, positions: Floats) -> tuple[NDArray[np.int64], Floats]:
        """Positive model of the Hessian: sorted keys ``column·3nv + row`` of its lower triangle, entries [N/m]."""
        ...

    def room(self, positions: Floats) -> NDArray[np.int64]:
        """Keys, sorted or not, that entries of ``hessian`` may soon have."""
        ...

    def bound(self, positions: Floats, step: Floats) -> float:
        """Fraction of a step (nv, 3) that meets nothing, in (0, 1]."""
        ...


@dataclass(frozen=True, eq=False)
class Resistance:
    """The quadratic energy ½ |x − origin|² in a positive matrix: entries in the pattern of the elastic energy [N/m]."""

    entries: Floats
    origin: Floats


@dataclass(eq=False)
class StepObjective:
    """The energy of a step for ``numerics.newton.minimise``, in the coordinates of the vertices.

    Unknowns: the nv vertices of the cloth and, after them, the points of moving obstacles, which have no other
    terms than contact and the attachment that places them.

    weights: masses·rate² [N/m], (nv,), zero for a static equilibrium; centre: y (nv, 3); load: constant forces
    (nv, 3) [N]; scale: gradient norm that counts as 1 [N]; resistance: damping by stiffness and by the air, if any.
    """

    energy: ShellEnergy
    weights: Floats
    centre: Floats
    load: Floats
    attachments: tuple[Attachment, ...] = ()
    contact: ContactEnergy | None = None
    scale: float = 1.0
    growth: PatternGrowth | None = None
    resistance: Resistance | None = None
    _memory: Linearisation | None = field(default=None, repr=False)
    _trial: Linearisation | None = field(default=None, repr=False)

    def __post_init__(self) -> None:
        if self.growth is None:
            self.growth = PatternGrowth(self.energy.pattern)

    @property
    def residual_scale(self) -> float:
        """Gradient norm that counts as 1 [N]."""
        return self.scale

    def value(self, x: Floats) -> float:
        """Energy [J]; inf where the state is not admissible."""
        positions = x.reshape(-1, 3)
        total = self._simple_terms(positions)[0]
        if self.contact is not None:
            total += self.contact.value(positions)
        return total + self.energy.value(self.cloth_rows(positions)) if math.isfinite(total) else math.inf

    def gradient(self, x: Floats) -> tuple[float, Floats]:
        """Energy [J] and gradient (3nv,) [N]."""
        # Its own memory: a model made by ``quadratic`` may still be in use.
        value, gradient, self._trial = self._linearise(x, self._trial)
        return value, gradient

    def quadratic(self, x: Floats) -> tuple[float, Floats, StepModel]:
        """Energy, gradient and the second-order model, which is valid until the next call."""
        value, gradient, self._memory = self._linearise(x, self._memory)
        return value, gradient, StepModel(self, self._memory, x.reshape(-1, 3).copy())

    def cloth_rows(self, rows: Floats) -> Floats:
        """Those rows that belong to the cloth."""
        return rows[: len(self.weights)]

    def _linearise(self, x: Floats, memory: Linearisation | None) -> tuple[float, Floats, Linearisation]:
        positions = x.reshape(-1, 3)
        linear = self.energy.linearise(self.cloth_rows(positions), memory)
        value, gradient = self._simple_terms(positions)
        self.cloth_rows(gradient)[:] += linear.gradient
        value += linear.value
        if self.contact is not None:
            touching, push = self.contact.gradient(positions)
            value, gradient = value + touching, gradient + push
        return value, gradient.ravel(), linear

    def _simple_terms(self, positions: Floats) -> tuple[float, Floats]:
        """Inertia, load, attachments and damping by stiffness."""
        away = self.cloth_rows(positions) - self.centre
        pull = self.weights[:, None] * away
        value = 0.5 * float(np.vdot(pull, away)) - float(np.vdot(self.load, away))
        gradient = np.zeros_like(positions)
        self.cloth_rows(gradient)[:] = pull - self.load
        for held in self.attachments:
            energy, force, _ = held.forces(positions)
            value += energy
            np.add.at(gradient, held.vertices, force)
        if self.resistance is not None:
            moved = (self.cloth_rows(positions) - self.resistance.origin).ravel()
            force = self.energy.pattern.multiply(self.resistance.entries, moved)
            value += 0.5 * float(moved @ force)
            self.cloth_rows(gradient)[:] += force.reshape(-1, 3)
        return value, gradient

    def diagonal(self, positions: Floats) -> Floats:
        """Diagonal of the terms that have no other entries [N/m], one per unknown."""
        assert self.growth is not None
        weights = np.zeros(self.growth.base.size // 3)
        self.cloth_rows(weights)[:] = self.weights
        for held in self.attachments:
            np.add.at(weights, held.vertices, held.forces(positions)[2])
        return np.repeat(weights, 3)


@dataclass(eq=False)
class PatternGrowth:
    """The cloth's pattern with room for the contacts met so far; it grows when new ones do not fit."""

    base: SymmetricPattern
    pattern: SymmetricPattern = field(init=False)
    _keys: NDArray[np.int64] = field(init=False, repr=False)
    _base_keys: NDArray[np.int64] = field(init=False, repr=False)
    _base_slots: NDArray[np.int64] | slice = field(init=False, repr=False)

    def __post_init__(self) -> None:
        columns = np.repeat(np.arange(self.base.size), np.diff(self.base.starts))
        self._base_keys = self._keys = columns * self.base.size + self.base.rows
        self.pattern, self._base_slots = self.base, slice(None)

    def admit(self, keys: NDArray[np.int64], room: Callable[[], NDArray[np.int64]]) -> NDArray[np.int64]:
        """Places of keys in ``pattern``, which grows where they do not fit, then also by the keys of ``room``."""
        slots = np.minimum(np.searchsorted(self._keys, keys), len(self._keys) - 1)
        if (self._keys[slots] == keys).all():
            return slots
        self._grow(np.concatenate([keys, room()]))
        return np.searchsorted(self._keys, keys)

    def spread(self, base: Floats, slots: NDArray[np.int64], entries: Floats) -> Floats:
        """Entries in ``pattern`` of a matrix in the base pattern plus entries at some of its places."""
        values = np.zeros(self.pattern.entries)
        values[self._base_slots] = base
        values[slots] += entries
        return values

    def _grow(self, keys: NDArray[np.int64]) -> None:
        # Contacts that have gone make room: only the latest and the base are kept when too many have gathered.
        kept = self._keys if len(self._keys) < 1.5 * len(self._base_keys) else self._base_keys
        # Sorted runs merge in linear time; the union of numpy hashes them.
        merged = np.sort(np.concatenate([kept, keys]), kind="stable")
        self._keys = merged[np.diff(merged, prepend=-1) > 0]
        self.pattern = SymmetricPattern.from_keys(self.base.size, self._keys)
        self._base_slots = np.searchsorted(self._keys, self._base_keys)


@dataclass(eq=False)
class StepModel:
    """Hessian H_exact + shift·(H_positive − H_exact), with each part made when needed; shift from 0.

    From 1 on the diagonal grows by (shift − 1) of itself, at least by ``ROUND_OFF``: where triangles have hardly
    any area, entries are so far apart that round-off makes even the positive model indefinite.
    """

    objective: StepObjective
    linear: Linearisation
    positions: Floats
    _parts: dict[str, Floats] = field(default_factory=dict, repr=False)

    def __post_init__(self) -> None:
        contact = self.objective.contact
        growth = self.objective.growth
        assert growth is not None
        self._growth = growth
        self._touching = None
        if contact is not None:
            keys, entries = contact.hessian(self.positions)
            # Let the pattern grow before it is asked for.
            self._touching = growth.admit(keys, lambda: contact.room(self.positions)), entries

    @property
    def pattern(self) -> SymmetricPattern:
        """Pattern of the matrix; the same object until contacts make it grow."""
        return self._growth.pattern

    def values(self, shift: float) -> Floats:
        """Entries in ``pattern`` [N/m]."""
        share = min(max(shift, 0.0), 1.0)
        elastic = np.zeros(self._growth.base.entries)
        for kind, part in (("exact", 1.0 - share), ("positive", share)):
            if part:
                values = self._part(kind)
                elastic[: len(values)] += part * values
        diagonal = self._growth.base.diagonal
        if not self.objective.weights.any():
            # Flat cloth at rest has no stiffness across its plane; the step of Newton stays finite.
            elastic[diagonal] += 1e-8 * float(np.abs(elastic[diagonal]).max())
        elastic[diagonal] += self.objective.diagonal(self.positions)
        if self.objective.resistance is not None:
            damping = self.objective.resistance.entries
            elastic[: len(damping)] += damping
        if self._touching is not None:
            elastic = self._growth.spread(elastic, *self._touching)
        if shift >= 1.0:
            elastic[self.pattern.diagonal] *= max(shift, 1.0 + ROUND_OFF)
        return elastic

    def _part(self, kind: str) -> Floats:
        if kind not in self._parts:
            self._parts[kind] = self.linear.hessian("exact" if kind == "exact" else "positive")
        return self._parts[kind]
