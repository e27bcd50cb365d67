"""Pairs of yarn segments that resist slip: springs that slide, in frames that turn with the fabric.

From one state to the next, a cell or a finite fabric minimises its energy plus the potential of these springs and
sliders, with the pressures of the last state. What a step loses is exact: sliding forces times slid distances, and what
springs lose.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from yarnscale.arrays import Array, Integers
from yarnscale.numerics.assembly import StencilSet, position_variables
from yarnscale.numerics.energy import StencilEnergy
from yarnscale.yarn.friction import FRICTION, Rubbing, YarnFriction
from yarnscale.yarn.strands import Strands


@dataclass(frozen=True, eq=False)
class FrictionPairs:
    """Pairs that pressed on each other at a state; lengths in radii, energies in E π r³.

    pairs: (k, 4) vertices at which the segments begin, and the tile of the second. place: (k, 2) where on them they
    press. apart: (k, 3) how far the first place was from the second, normal (k, 3): direction of the pressure, both in
    the frame at the first segment. limit: (k,) force μ N at which the pair slides. stiffness: (k,) of its spring, and
    spring: (k, 3) how far that was stretched, across the normal.
    """

    pairs: Integers
    place: Array
    apart: Array
    normal: Array
    limit: Array
    stiffness: Array
    spring: Array

    @classmethod
    def none(cls) -> FrictionPairs:
        """No pair."""
        vectors, numbers = np.empty((0, 3)), np.empty(0)
        return cls(np.empty((0, 4), np.int64), np.empty((0, 2)), vectors, vectors, numbers, numbers, vectors)

    @classmethod
    def since(
        cls,
        strands: Strands,
        positions: Array,
        frames: Array,
        contacts: StencilSet,
        friction: YarnFriction,
        before: FrictionPairs,
    ) -> FrictionPairs:
        """What resists slip from a state on: positions (T·n, 3) of all nodes, contact stencils and springs there.

        frames: (n, 3, 3) rotations at the primary vertices. Springs are as far stretched as they can be: across the
        normal, and by no more force than ``limit``. Pairs that do not press have none.
        """
        found = Rubbing.of(contacts, positions.ravel())
        first, second = found.nodes[:, 0], found.nodes[:, 2]
        keys = np.column_stack([first, second % strands.count, strands.tiles[second // strands.count]])
        normal = np.einsum("kji,kj->ki", frames[first], found.normal)
        limit, slack = friction.coefficient * found.pressure, np.zeros_like(normal)
        fresh = cls(keys, found.place, slack, normal, limit, found.stiffness, slack)
        kept, apart = fresh._apart(strands, positions, frames)
        spring = _held(_across(before._found(keys), normal), limit / found.stiffness)
        limit, stiffness = limit[kept], found.stiffness[kept]
        return cls(keys[kept], found.place[kept], apart, normal[kept], limit, stiffness, spring[kept])

    @property
    def stored(self) -> float:
        """Energy of all springs."""
        return float(0.5 * (self.stiffness @ (self.spring * self.spring).sum(axis=1)))

    def after(
        self, strands: Strands, positions: Array, frames: Array, before: FrictionPairs
    ) -> tuple[FrictionPairs, float]:
        """The pairs with their springs at the end of a step, and the energy lost in it, never negative.

        positions: (T·n, 3) of all nodes there. before: the pairs at the end of the step before.
        """
        springs, slid = self._springs(strands, positions, frames)
        return replace(self, spring=springs), slid + before.stored - self.stored

    def rotated(self, frames: Array) -> FrictionPairs:
        """With all vectors turned by rotations (n, 3, 3) at the primary vertices."""
        vectors = np.stack([self.apart, self.normal, self.spring], axis=1)
        apart, normal, spring = np.einsum("kij,kvj->vki", frames[self.pairs[:, 0]], vectors)
        return replace(self, apart=apart, normal=normal, spring=spring)

    def stencils(self, strands: Strands, frames: Array, energy: StencilEnergy = FRICTION) -> StencilSet:
        """Friction since the state, on nodes of copies; frames: (n, 3, 3) rotations at the primary vertices.

        energy: ``FRICTION`` or ``STEADY_FRICTION``. Pairs whose copy is not among the strands are left out, and those
        that slide without any force.
        """
        kept, nodes = self._nodes(strands)
        turn = frames[self.pairs[kept, 0]]
        offset, normal = (np.einsum("kij,kj->ki", turn, v[kept]) for v in (self.apart - self.spring, self.normal))
        limit = self.limit[kept]
        parameters = np.column_stack([self.place[kept], offset, normal, limit, limit / self.stiffness[kept]])
        return StencilSet(energy, position_variables(nodes), parameters, 4)

    def turned(self, strands: Strands) -> tuple[Integers, Array]:
        """Vertices (k,) whose frames the stencils turn with, and the vectors (k, 2, 3) in them: offset and normal."""
        kept, _ = self._nodes(strands)
        return self.pairs[kept, 0], np.stack([self.apart - self.spring, self.normal], 1)[kept]

    def _springs(self, strands: Strands, positions: Array, frames: Array) -> tuple[Array, float]:
        """How far springs (k, 3) are stretched at positions (T·n, 3) of all nodes, and the energy lost by sliding."""
        kept, apart = self._apart(strands, positions, frames)
        slip = _across(apart - self.apart[kept] + self.spring[kept], self.normal[kept])
        longest = self.limit[kept] / self.stiffness[kept]
        springs = self.spring.copy()
        springs[kept] = _held(slip, longest)
        slid = np.maximum(np.linalg.norm(slip, axis=1) - longest, 0.0)
        return springs, float((self.limit[kept] * slid).sum())

    def _apart(self, strands: Strands, positions: Array, frames: Array) -> tuple[Integers, Array]:
        """Pairs that the strands have (m,), and how far apart the places on them are, in their frames (m, 3)."""
        kept, nodes = self._nodes(strands)
        s, t = self.place[kept].T
        weights = np.stack([1.0 - s, s, t - 1.0, -t], axis=1)
        apart = np.einsum("kj,kji->ki", weights, positions[nodes])
        return kept, np.einsum("kji,kj->ki", frames[self.pairs[kept, 0]], apart)

    def _found(self, pairs: Integers) -> Array:
        """Springs of other pairs (m, 4), zero where a pair is not among these."""
        springs = np.zeros((len(pairs), 3))
        if len(self.pairs) and len(pairs):
            keys = _keys(np.concatenate([self.pairs, pairs]))
            keys, wanted = keys[: len(self.pairs)], keys[len(self.pairs) :]
            order = np.argsort(keys)
            own = order[np.minimum(np.searchsorted(keys, wanted, sorter=order), len(keys) - 1)]
            known = keys[own] == wanted
            springs[known] = self.spring[own[known]]
        return springs

    def _nodes(self, strands: Strands) -> tuple[Integers, Integers]:
        """Pairs that have a copy among the strands and resist (m,), and their nodes (m, 4)."""
        inside = len(strands.ends) // strands.count
        same = (strands.tiles[None, :inside] == self.pairs[:, None, 2:]).all(axis=2)
        kept = np.flatnonzero(same.any(axis=1) & (self.limit > 0.0))
        first = self.pairs[kept, 0]
        second = same[kept].argmax(axis=1) * strands.count + self.pairs[kept, 1]
        return kept, np.stack([first, strands.ends[first], second, strands.ends[second]], 1)


def _across(vectors: Array, normal: Array) -> Array:
    return vectors - normal * (vectors * normal).sum(axis=1)[:, None]


def _held(springs: Array, longest: Array) -> Array:
    """Springs (k, 3), none longer than it can be."""
    length = np.linalg.norm(springs, axis=1)
    return springs * np.minimum(1.0, longest / np.maximum(length, 1e-300))[:, None]


def _keys(pairs: Integers) -> Integers:
    """One number for each of some pairs (k, 4), the same for the same pair; ValueError beyond 64 bits."""
    lowest = pairs.min(axis=0)
    spans = tuple((pairs.max(axis=0) - lowest + 1).tolist())
    return np.asarray(np.ravel_multi_index(tuple((pairs - lowest).T), spans), np.int64)
