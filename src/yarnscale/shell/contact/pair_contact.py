"""Energy, forces, matrix and friction of pairs: a vertex and a triangle, two edges, or a triangle and a ball's centre.

Energy Σ w b(d) over the pairs of a search, those of edges times a factor that vanishes for parallel edges (Li et al.
2020, sections 4 and 5). The weights w are areas such that the pressure does not depend on the mesh.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from yarnscale.arrays import Array, Integers
from yarnscale.numerics.block_pattern import SKIPPED, BlockPattern
from yarnscale.numerics.threads import equal_ranges, run_parts
from yarnscale.shell.contact import pair_hessian, pair_loops
from yarnscale.shell.contact.barrier import ContactSettings, barrier, smooth_length
from yarnscale.shell.contact.pair_search import Close, Pairs
from yarnscale.shell.contact.stick import begun_with, ended_with
from yarnscale.shell.state import Slips

KEPT = 0.1
"""Part of a distance that remains after a step."""


class Search(Protocol):
    """Finds pairs that are near, as ``PairSearch`` says; positions are of all vertices (nv, 3) [m]."""

    def close(self, positions: Array) -> Close: ...
    def nearer(self, positions: Array, within: float) -> Integers: ...
    def along(self, start: Array, end: Array) -> Pairs: ...
    def known(self, start: Array, moves: Array) -> tuple[Pairs | None, float]: ...


@dataclass(frozen=True, eq=False)
class _Grip:
    """Friction contacts of a step: the close pairs at its start, and their largest friction (k,) [N].

    reach: slip of full friction [m]; begun: elastic slip at the start (k, 3) [m]; between: (k, 5) as in ``Slips``, and
    signs (k,) for the order of the two edges of a pair.
    """

    close: Close
    limits: Array
    reach: float
    begun: Array
    between: Integers
    signs: Array

    def slip(self, positions: Array) -> tuple[Array, Array, Array, Array]:
        """Tangential motion of the closest points (k, 3), and its smoothed length f: f, f'/l and f'', each (k,)."""
        c = self.close
        sliding = pair_loops.slips(positions, c.positions, c.vertices, c.coefficients, c.normals) + self.begun
        return sliding, *smooth_length(np.linalg.norm(sliding, axis=1), self.reach)


class PairContact:
    """Contact of the pairs of a search. Vertices: all ``rows`` of the positions, then ``fixed`` ones (n, 3) [m]."""

    def __init__(self, search: Search, settings: ContactSettings, rows: int, fixed: Array) -> None:
        self.search, self.settings, self.rows, self.fixed = search, settings, rows, fixed
        self._grip: _Grip | None = None

    def start_step(
        self, positions: Array, duration: float, times: tuple[float, float], number: int = 0,
        slips: Slips | None = None,
    ) -> None:  # fmt: skip
        """See ``ClothContact.start_step``; times: between which obstacles move [s]."""
        if self.settings.friction == 0.0:
            return
        everything = self.everything(positions)
        close = self.search.close(everything)
        slope, reach = barrier(close.distances, self.settings.thickness)[1], self.settings.slip * duration
        swapped = ~close.is_corner & (close.vertices[:, 0] > close.vertices[:, 2])
        between = np.column_stack([2 * number + close.is_corner, close.vertices])
        between[swapped, 1:] = close.vertices[swapped][:, [2, 3, 0, 1]]
        signs = np.where(swapped, -1.0, 1.0)
        begun = signs[:, None] * begun_with(slips, between, close.normals, reach)
        limits = -self.settings.friction * close.weights * close.fade[0] * slope
        self._grip = _Grip(close, limits, reach, self._carried(close, begun, times), between, signs)

    def _carried(self, close: Close, begun: Array, times: tuple[float, float]) -> Array:
        """Slips (k, 3) with which a step begins, less the motion of surfaces that vertices do not show."""
        return begun

    def slips(self, positions: Array) -> Slips:
        grip = self._grip
        if grip is None:
            return Slips(np.zeros((0, 5), np.int64), np.zeros((0, 3)))
        sliding = grip.slip(self.everything(positions))[0]
        return ended_with(grip.between, grip.signs[:, None] * sliding, grip.reach)

    def value(self, positions: Array) -> float:
        everything = self.everything(positions)
        close = self.search.close(everything)
        if (close.distances <= 0).any():
            return math.inf
        energy = barrier(close.distances, self.settings.thickness)[0]
        value = float((close.weights * close.fade[0]) @ energy)
        if self._grip is not None:
            value += float(self._grip.limits @ self._grip.slip(everything)[1])
        return value

    def gradient(self, positions: Array, gradient: Array) -> float:
        everything = self.everything(positions)
        close = self.search.close(everything)
        if (close.distances <= 0).any():
            return math.inf
        energy, slope, _ = barrier(close.distances, self.settings.thickness)
        fade, turning, _ = (close.weights * factor for factor in close.fade)
        forces = np.zeros_like(everything)
        pulls = (fade * slope)[:, None] * close.normals
        pair_loops.add_pulls(close.vertices, close.coefficients, pulls, forces)
        pair_loops.add_moments(everything, close.vertices, turning * energy, forces)
        value = float(fade @ energy)
        if (grip := self._grip) is not None:
            sliding, potential, rate, _ = grip.slip(everything)
            pulls = (grip.limits * rate)[:, None] * sliding
            pair_loops.add_pulls(grip.close.vertices, grip.close.coefficients, pulls, forces)
            value += float(grip.limits @ potential)
        gradient += forces[: self.rows]
        return value

    def hessian(self, positions: Array) -> tuple[Integers, Array]:
        everything, grip = self.everything(positions), self._grip
        close = self.search.close(everything)
        count = len(close.distances)
        pairs = close.vertices if grip is None else np.concatenate([close.vertices, grip.close.vertices])
        graph, vertices = self._graph(pairs)
        slots = np.ascontiguousarray(graph.slots(vertices).transpose(0, 2, 1).reshape(-1, 10)[: len(pairs)])
        blocks = np.zeros((graph.pattern.entries, 9))
        self._add_repulsion(close, everything, slots[:count], blocks)
        if grip is not None:
            sliding, _, rate, change = grip.slip(everything)
            pair_hessian.add_friction(
                grip.close.vertices, grip.close.coefficients, grip.close.normals, sliding, grip.limits * rate,
                grip.limits * change, slots[count:], blocks,
            )  # fmt: skip
        return graph.keys, blocks

    def _graph(self, pairs: Integers) -> tuple[BlockPattern, Integers]:
        """Which vertices meet in pairs (n, 4), and these with −1 for those at rest."""
        vertices = np.where(pairs < self.rows, pairs, SKIPPED)
        return BlockPattern.of(np.ones(self.rows, np.int64), [vertices]), vertices

    def _add_repulsion(self, close: Close, everything: Array, slots: NDArray[np.int32], blocks: Array) -> None:
        energy, slope, bend = barrier(close.distances, self.settings.thickness)
        fade, turning, turned = (close.weights * factor for factor in close.fade)
        pair_hessian.add_repulsion(
            everything, close.vertices, close.is_corner, close.coefficients, fade * slope, fade * bend,
            turning * energy, turned * energy, slots, blocks,
        )  # fmt: skip

    def room(self, positions: Array, within: float) -> Integers:
        """Keys, as of ``hessian``, of pairs closer than ``within`` [m]."""
        near = self.search.nearer(self.everything(positions), within)
        return self._graph(near)[0].keys

    def bound(self, positions: Array, step: Array) -> float:
        start, end = self.everything(positions), self.everything(positions + step)
        moves = end - start
        known, share = self.search.known(start, moves)
        if known is not None and 0.0 < share < 1.0:
            # Steps that are cut short need no search along their whole length.
            fraction = _free_fraction(known, start, moves, share)
            if fraction < share:
                return fraction
        return _free_fraction(self.search.along(start, end), start, moves, 1.0)

    def closest(self, positions: Array) -> float:
        return float(self.search.close(self.everything(positions)).distances.min(initial=math.inf))

    def everything(self, positions: Array) -> Array:
        """Every vertex."""
        return np.concatenate([positions, self.fixed])


def _free_fraction(pairs: Pairs, start: Array, moves: Array, until: float) -> float:
    """Fraction of moves (nv, 3), up to ``until``, during which all pairs keep a part of their distance."""
    moved, travels = np.linalg.norm(start - pairs.origin, axis=1), np.linalg.norm(moves, axis=1)

    def part(bounds: tuple[int, int]) -> float:
        return pair_loops.free_fraction(
            start, moves, pairs.vertices, pairs.corners, pairs.gaps, moved, travels, pairs.radius, KEPT, until, *bounds
        )  # fmt: skip

    return min(run_parts(part, equal_ranges(len(pairs.vertices))))
