"""The energy of a finite fabric, every yarn of it: stretch, bending with twist, contact, springs and obstacles.

Lengths are counted in yarn radii and energies in E π r³ (``PatternStiffness``), as in the periodic cell; full vectors
are [positions (3n), twists (n)]. Frames are anchored to the shape at which ``anchor`` was called last: between two
calls the energy is a function of the state alone, and a call leaves its value as it is.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import casadi as ca
import numpy as np

from yarnscale.arrays import Array
from yarnscale.fabric.boundary import BorderSprings
from yarnscale.fabric.patches import Patches
from yarnscale.fabric.sheet import YarnSheet
from yarnscale.numerics.assembly import StencilSet, position_variables
from yarnscale.numerics.energy import StencilEnergy, Symbol
from yarnscale.yarn.contact_list import PlacedPairs
from yarnscale.yarn.energy import NOT_TURNED, RodEnergy
from yarnscale.yarn.frames import carried, reference_twist, unit_edges
from yarnscale.yarn.passages import Passages
from yarnscale.yarn.rod import STRETCH
from yarnscale.yarn.stiffness import Materials, PatternStiffness

STEP_LIMIT = 4.0
"""Largest move of a vertex against the fabric as a whole in one Newton step [r]."""
EDGE_LIMIT = 0.5
"""Largest change of an edge in one Newton step, over the mean length of edges."""
TWIST_LIMIT = 1.0
"""Largest change of a twist in one Newton step [rad]."""
STITCH = 8.0
"""About the size of a stitch [r]."""


def _tied_pair(v: dict[str, Symbol], p: dict[str, Symbol]) -> Symbol:
    corners = [v[a] - v[b] for a in ("a0", "a1") for b in ("b0", "b1")]
    return 0.125 * p["stiffness"] * sum(ca.sumsqr(away) for away in corners)


def _tied_edge(v: dict[str, Symbol], p: dict[str, Symbol]) -> Symbol:
    return 0.5 * p["stiffness"] * ca.sumsqr(v["x1"] - v["x0"])


TIED_PAIR = StencilEnergy("tied_pair", {"a0": 3, "a1": 3, "b0": 3, "b1": 3}, {"stiffness": 1}, _tied_pair)  # type: ignore[arg-type]
TIED_EDGE = StencilEnergy("tied_edge", {"x0": 3, "x1": 3}, {"stiffness": 1}, _tied_edge)  # type: ignore[arg-type]
"""Springs of rest length zero between segments that may touch and along edges: common motion stretches none."""


@dataclass(frozen=True, eq=False)
class EdgeFrames:
    """Reference directors of all edges (n, 3) and reference twists of all joints (n,) [rad]."""

    director: Array
    twist: Array


class TurningStencils(Protocol):
    """Stencils whose parameters turn with the fabric."""

    @property
    def stencils(self) -> StencilSet: ...

    def follow(self, places: Array) -> bool:
        """Turn with the fabric to positions (n, 3); whether they do."""
        ...


class FabricEnergy(RodEnergy):
    """Energy of a sheet as a function of [positions / r, twists].

    springs: hold boundaries together. passages: those on the straight paths from each anchored state to the next, None
    where they are not counted. Yarns are linked at the end as at the beginning exactly where none is left.
    """

    def __init__(self, sheet: YarnSheet, material: Materials, *, springs: BorderSprings | None = None) -> None:
        super().__init__(PatternStiffness.of(sheet, material), sheet.strands)
        self.sheet, self.force_unit = sheet, self.unit / self.radius
        self.springs = BorderSprings.none() if springs is None else springs
        ties = np.column_stack(
            [
                self.springs.rest_length / self.radius,
                self.springs.stiffness * self.springs.rest_length / self.force_unit,
                np.zeros((len(self.springs.pairs), 2)),
            ]
        )
        self.glue = StencilSet(STRETCH, position_variables(self.springs.pairs[:, [0, 1, 1, 0]]), ties, 4)
        self._friction: TurningStencils | None = None
        self.set_others(self.glue)
        self._ties: tuple[PlacedPairs, Array] | None = None
        self.passages: Passages | None = None
        self._places = sheet.vertices / self.radius
        self._tangent = unit_edges(sheet.vertices, sheet.following)
        self._take(EdgeFrames(sheet.reference_director, sheet.reference_twist))

    # --- state ----------------------------------------------------------------------------------------

    def start(self) -> Array:
        """The sheet's own shape."""
        return self.vector(self.sheet.vertices, self.sheet.twist)

    def vector(self, positions: Array, twist: Array) -> Array:
        """Full vector of positions (n, 3) [m] and twists (n,)."""
        return np.concatenate([positions.ravel() / self.radius, twist])

    def anchor(self, x: Array, frames: EdgeFrames | None = None) -> None:
        """Carry all frames to this state: friction may turn with the fabric; other energies stay as they are.

        frames: those of this state, where they are known; passages on the path to it are then not counted.
        """
        before, self._places = self._places, self.positions(x).copy()
        tangent = unit_edges(self._places, self.sheet.following)
        if frames is None:
            if self.passages is not None:
                self.passages = self.passages.along(before, self._places)
            if self._friction is not None and self._friction.follow(self._places):
                self.set_others(self.glue, self._friction.stencils)
            director = carried(self._tangent, tangent, self.frames.director)
            twist = reference_twist(tangent, director, self.strands.before, self.frames.twist)
            frames = EdgeFrames(director, twist)
        self._tangent = tangent
        self._take(frames)

    def _take(self, frames: EdgeFrames) -> None:
        self.frames, joints = frames, self.strands.joints
        before, tangent, director = self.strands.before[joints], self._tangent, frames.director
        anchors = (tangent[before], tangent[joints], director[before], director[joints])
        self.set_anchors(np.concatenate(anchors, axis=1), frames.twist[joints])

    def count_passages(self, rows: Array | None = None) -> None:
        """Count passages from the anchored state on; rows: of ``Passages`` found before it."""
        self.passages = Passages(self.strands, self.stiffness, np.empty((0, 6)) if rows is None else rows)

    @property
    def passage_count(self) -> int:
        """Passages that no opposite one near the same place undid."""
        return 0 if self.passages is None else len(self.passages.lasting().rows)

    # --- resistance -----------------------------------------------------------------------------------

    def ties(self, x: Array) -> Array:
        """Entries of a matrix that resists motion of yarns against each other, at the yarn's stiffness in tension."""
        pairs, block, _ = self.placed(x)
        if self._ties is None or self._ties[0] is not pairs:
            stiffness = float(self.stiffness.position_scale().mean())
            entries, idle = np.zeros(block.pattern.entries), np.zeros(len(x))
            edges = self.stretch.variables[:, :6]
            for energy, variables, own in (
                (TIED_PAIR, pairs.stencils.variables, pairs.slots),
                (TIED_EDGE, edges, block.slots(edges)),
            ):
                vectors = energy.variable_count // 3
                stencils = StencilSet(energy, variables, np.full((len(variables), 1), stiffness), vectors)
                stencils.hessian(x, idle, own, NOT_TURNED, entries)
            self._ties = pairs, entries
        return self._ties[1]

    def rub(self, friction: TurningStencils | None) -> None:
        """Set what resists slip from a state on (``FrictionStep``); None: no friction."""
        if friction is not None:
            self.set_others(self.glue, friction.stencils)
        elif self._friction is not None:
            self.set_others(self.glue)
        self._friction = friction

    @cached_property
    def surroundings(self) -> Patches:
        """Pieces of fabric with which contacts turn: cubes of a stitch's size, and those around each."""
        return Patches.cubes(self.sheet, STITCH, adjacent=True)

    def bound(self, x: Array, step: Array) -> float:
        """Fraction of a step that moves no vertex, edge, twist or pair too far."""
        n, ends = self.count, self.sheet.following
        moves = step[: 3 * n].reshape(-1, 3)
        # Yarns meet by moving against each other: what all vertices move in common counts for nothing.
        own = moves - moves.mean(axis=0)
        edges = self.sheet.edges
        limits = (
            (STEP_LIMIT, own),
            (EDGE_LIMIT * float(self.sheet.rest_length[edges].mean()) / self.radius, moves[ends[edges]] - moves[edges]),
            (TWIST_LIMIT, step[3 * n :, None]),
        )  # fmt: skip
        fraction = 1.0
        for limit, changes in limits:
            largest = math.sqrt(float(np.einsum("ij,ij->i", changes, changes).max(initial=0.0)))
            fraction = min(fraction, limit / max(largest, 1e-300))
        return fraction * self.contact_list.safe_fraction(self.positions(x), fraction * moves)

    # --- read-outs ------------------------------------------------------------------------------------

    def parts(self, x: Array) -> dict[str, float]:
        """Energy of stretch, bending with twist, contact and springs [J]."""
        return {**super().parts(x), "springs": self.glue.value(x) * self.unit}

    def penetration(self, x: Array) -> float:
        """How deep yarns lie in each other, as a share of their diameter: 1 − distance/diameter, 0 where none touch."""
        return max(0.0, 1.0 - float(self.gaps(x).min(initial=1.0)))

    def extensions(self, x: Array) -> Array:
        """Length over rest length − 1 of all edges (m,)."""
        edges, positions = self.sheet.edges, self.positions(x)
        length = np.linalg.norm(positions[self.sheet.following[edges]] - positions[edges], axis=1)
        return length * self.radius / self.sheet.rest_length[edges] - 1.0

    def vertex_shares(self, x: Array) -> tuple[Array, Array]:
        """Energy (n,) and virial Σ ∂E/∂x ⊗ x of every stencil (n, 3, 3) [J], shared out to vertices.

        Those of an edge or pair go to its ends alike, those of a joint to its vertex. Over a patch of reference area A
        the virial is A P Fᵀ, P the stress of the fabric there and F its deformation.
        """
        energies, virials = np.zeros(self.count), np.zeros((self.count, 3, 3))
        for stencils in (self.stretch, self.bend_twist, self.glue, self.contacts(x).stencils):
            if not stencils.count:
                continue
            values, force, _ = stencils.elements(x)
            corners = stencils.variables[:, : 3 * stencils.vectors : 3] // 3
            places, nodes = self.positions(x)[corners], corners[:, 1:2] if corners.shape[1] == 3 else corners
            if stencils in (self.stretch, self.glue):
                nodes = corners[:, :2]
            push = force[:, : 3 * stencils.vectors].reshape(places.shape)
            pull = np.einsum("nai,naj->nij", push, places - places[:, :1])
            np.add.at(energies, nodes, values[:, None] / nodes.shape[1])
            np.add.at(virials, nodes, pull[:, None] / nodes.shape[1])
        return energies * self.unit, virials * self.unit

    def masses(self) -> Array:
        """Mass of every vertex (n,) [kg]."""
        return self.stiffness.mass_per_length() * self.sheet.voronoi_length

    def spins(self) -> Array:
        """Moment of inertia of every edge about itself (n,) [kg m²]; 0 at the ends of yarns."""
        length = np.where(self.sheet.following >= 0, self.sheet.rest_length, 0.0)
        return 0.5 * (self.radius * self.sheet.relative_radius) ** 2 * self.stiffness.mass_per_length() * length
