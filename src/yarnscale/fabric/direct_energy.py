"""The energy of a finite fabric, every yarn of it: stretch, bending with twist, contact, springs and obstacles.

Lengths are counted in yarn radii and energies in E π r³ (``PatternStiffness``), as in the periodic cell; full vectors
are [positions (3n), twists (n)]. Frames are anchored to the shape at which ``anchor`` was called last: between two
calls the energy is a function of the state alone, and a call leaves its value as it is.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from yarnscale.fabric.boundary import Springs
from yarnscale.fabric.sheet import YarnSheet
from yarnscale.fabric.sheet_frames import carried, joint_twists, unit_edges
from yarnscale.fabric.yarn_friction import YarnFriction, no_friction
from yarnscale.numerics.assembly import StencilSet, position_variables
from yarnscale.numerics.block_pattern import BlockPattern
from yarnscale.numerics.dissection import stages
from yarnscale.numerics.energy import StencilEnergy, Symbol
from yarnscale.yarn.close_pairs import close_pairs, pair_gaps, safe_fraction
from yarnscale.yarn.contact import contact_energy, contact_reach
from yarnscale.yarn.rod import BEND_TWIST, STRETCH
from yarnscale.yarn.stiffness import Materials, PatternStiffness

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

SKIN = 0.7
"""How much farther than contact pairs are listed [r]."""
PATTERN_MARGIN = 0.1
"""How much farther than contact the matrix pattern looks ahead [r]: more saves analyses, less makes factors sparse."""
DISSECTED = 3000
"""Vertices from which the matrix is dissected: factors of smaller ones take no time."""
STEP_LIMIT = 4.0
"""Largest move of a vertex against the fabric as a whole in one Newton step [r]."""
EDGE_LIMIT = 0.5
"""Largest change of an edge in one Newton step, over the mean length of edges."""
TWIST_LIMIT = 1.0
"""Largest change of a twist in one Newton step [rad]."""
GAP_SHARE = 0.8
"""Share of its distance that a pair may close in one step: yarns never pass through each other."""
NOT_TURNED = np.empty((0, 3, 3))


def _tied_pair(v: dict[str, Symbol], p: dict[str, Symbol]) -> Symbol:
    corners = [v[a] - v[b] for a in ("a0", "a1") for b in ("b0", "b1")]
    return 0.125 * p["stiffness"] * sum(ca.sumsqr(away) for away in corners)


def _tied_edge(v: dict[str, Symbol], p: dict[str, Symbol]) -> Symbol:
    return 0.5 * p["stiffness"] * ca.sumsqr(v["x1"] - v["x0"])


TIED_PAIR = StencilEnergy("tied_pair", {"a0": 3, "a1": 3, "b0": 3, "b1": 3}, {"stiffness": 1}, _tied_pair)  # type: ignore[arg-type]
TIED_EDGE = StencilEnergy("tied_edge", {"x0": 3, "x1": 3}, {"stiffness": 1}, _tied_edge)  # type: ignore[arg-type]
"""Springs of no length between segments that may touch and along edges: they resist no common motion."""


@dataclass(frozen=True, eq=False)
class EdgeFrames:
    """Reference directors of all edges (n, 3) and reference twists of all joints (n,) [rad]."""

    director: Array
    twist: Array


@dataclass(eq=False)
class PressedPairs:
    """Those of the listed pairs, (m,) by ``chosen``, that have a place in the matrix; ties: entries of ``ties``."""

    chosen: NDArray[np.bool_]
    stencils: StencilSet
    slots: NDArray[np.int32]
    ties: Array | None = None


@dataclass(eq=False)
class FabricContacts:
    """Pairs of segments listed at positions ``built_at`` (n, 3), their stencils, and those that press."""

    first: Indices
    second: Indices
    built_at: Array
    stencils: StencilSet
    pressed: PressedPairs | None = None


class FabricEnergy:
    """Energy of a sheet as a function of [positions / r, twists].

    springs: hold boundaries together. contact: whether yarns touch each other at all.
    """

    def __init__(
        self,
        sheet: YarnSheet,
        material: Materials,
        *,
        springs: Springs | None = None,
        contact: bool = True,
    ) -> None:
        self.sheet, self.count = sheet, sheet.vertex_count
        self.stiffness = PatternStiffness.of(sheet, material)
        self.unit, self.radius = self.stiffness.unit, sheet.radius
        self.force_unit = self.unit / self.radius
        self.springs = Springs.none() if springs is None else springs
        n, edges, joints = self.count, sheet.edges, sheet.strands.joints
        ends = sheet.following
        stretch = position_variables(np.stack([edges, ends[edges]], 1))
        own = self.stiffness.edge_parameters()[edges]
        self.stretch = StencilSet(self.stiffness.stretch_energy, stretch, own, 2)
        before = sheet.preceding[joints]
        nodes = position_variables(np.stack([before, joints, ends[joints]], 1))
        self._joint_variables = np.column_stack([nodes, 3 * n + before, 3 * n + joints])
        ties = np.column_stack(
            [
                self.springs.rest_length / self.radius,
                self.springs.stiffness * self.springs.rest_length / self.force_unit,
            ]
        )
        self.glue = StencilSet(STRETCH, position_variables(self.springs.pairs), ties, 2)
        self._friction = no_friction()
        self._rod_slots: list[NDArray[np.int32]] | None = None
        self._pattern: BlockPattern | None = None
        self._contacts: FabricContacts | None = None
        self._touch = contact and len(edges) > 1
        self._reach = contact_reach(self.stiffness.rule)
        self.searches = self.patterns = 0
        self._tangent = unit_edges(sheet.vertices, ends)
        self.frames = EdgeFrames(sheet.reference_director, sheet.reference_twist)
        self._anchored()

    # --- state ----------------------------------------------------------------------------------------

    def start(self) -> Array:
        """The sheet's own shape."""
        return self.vector(self.sheet.vertices, self.sheet.twist)

    def vector(self, positions: Array, twist: Array) -> Array:
        """Full vector of positions (n, 3) [m] and twists (n,)."""
        return np.concatenate([positions.ravel() / self.radius, twist])

    def positions(self, x: Array) -> Array:
        """Positions (n, 3) [r], a view."""
        return x[: 3 * self.count].reshape(-1, 3)

    def anchor(self, x: Array, frames: EdgeFrames | None = None) -> None:
        """Carry all frames to this state; energies stay as they are, whatever turned since the last call.

        frames: those of this state, where they are known.
        """
        tangent = unit_edges(self.positions(x), self.sheet.following)
        if frames is None:
            director = carried(self._tangent, tangent, self.frames.director)
            twist = joint_twists(tangent, director, self.sheet.preceding, self.frames.twist)
            frames = EdgeFrames(director, twist)
        self._tangent, self.frames = tangent, frames
        self._anchored()

    def _anchored(self) -> None:
        sheet, joints = self.sheet, self.sheet.strands.joints
        before = sheet.preceding[joints]
        director, turned = self.frames.director, self.frames.twist
        bend, twist = self.stiffness.joint_stiffness()
        parameters = np.column_stack(
            [
                self._tangent[before], self._tangent[joints], director[before], director[joints], turned[joints],
                sheet.rest_curvature[joints], sheet.rest_twist[joints],
                bend[joints], twist[joints],
            ]
        )  # fmt: skip
        self.bend_twist = StencilSet(BEND_TWIST, self._joint_variables, parameters, 3)

    # --- contacts -------------------------------------------------------------------------------------

    def contacts(self, x: Array) -> FabricContacts:
        """Contact stencils valid at a state; listed anew when vertices have moved half a skin."""
        positions, old = self.positions(x), self._contacts
        if old is not None:
            shift = positions - old.built_at
            # Fabric that moves as a whole keeps its neighbours.
            shift = shift - shift.mean(axis=0)
            if 4.0 * float(np.einsum("ij,ij->i", shift, shift).max()) <= SKIN * SKIN:
                return old
        first, second = self._pairs(positions, self._reach + SKIN)
        variables = self._pair_variables(first, second)
        rule = self.stiffness.rule
        energy = contact_energy(rule.kernel, rule.quadrature_points, rule.quadrature_weights)
        length = self.sheet.rest_length / self.radius
        parameters = self.stiffness.pair_parameters(first, second, length[first] * length[second])
        stencils = StencilSet(energy, variables, parameters, 4)
        self._contacts = FabricContacts(first, second, positions.copy(), stencils)
        self.searches += 1
        return self._contacts

    def forget_contacts(self) -> None:
        """List contacts anew, and lay out the matrix for them."""
        self._contacts = self._pattern = self._rod_slots = None

    def _pairs(
        self, positions: Array, reach: float, *, moves: Array | None = None
    ) -> tuple[Indices, Indices]:
        if not self._touch:
            return np.empty(0, np.int64), np.empty(0, np.int64)
        neighbours = self.stiffness.rule.neighbours
        return close_pairs(self.sheet.strands, positions, reach, neighbours=neighbours, moves=moves)

    def _pair_variables(self, first: Indices, second: Indices) -> Indices:
        ends = self.sheet.following
        return position_variables(np.stack([first, ends[first], second, ends[second]], 1))

    def _pressed(self, contacts: FabricContacts, x: Array) -> PressedPairs:
        """All pairs that touch, and others for which there is room; the matrix pattern fits them afterwards.

        Most listed pairs do not touch. A pattern with all of them would have five times as many entries in its factor.
        """
        gaps = pair_gaps(self.positions(x), self.sheet.following, contacts.first, contacts.second)
        pressed, touching = contacts.pressed, gaps < self._reach
        if pressed is not None and self._rod_slots is not None and not (touching & ~pressed.chosen).any():
            return pressed
        rods, listed, chosen = [s.variables for s in self._rods], contacts.stencils.variables, touching
        fits = self._pattern is not None and all(map(self._pattern.covers, (rods[-1], listed[touching])))
        if not fits:
            chosen = gaps < self._reach + PATTERN_MARGIN
            self._pattern = self._matrix_pattern([*rods, listed[chosen]], x)
            self.patterns += 1
            self._rod_slots = None
        assert self._pattern is not None
        if self._rod_slots is None:
            self._rod_slots = [self._pattern.slots(v) for v in rods]
        whole = contacts.stencils
        stencils = StencilSet(whole.energy, listed[chosen], whole.parameters[chosen], 4)
        contacts.pressed = PressedPairs(chosen, stencils, self._pattern.slots(listed[chosen]))
        return contacts.pressed

    def _matrix_pattern(self, unknowns: list[Indices], x: Array) -> BlockPattern:
        groups = np.concatenate([np.full(self.count, 3), np.ones(self.count, np.int64)])
        pattern = BlockPattern.of(groups, unknowns)
        if self.count < DISSECTED:
            return pattern
        # An edge's twist goes along with its first vertex.
        first, second = (met % self.count for met in pattern.meetings())
        return pattern.staged(np.tile(stages(first, second, self.positions(x)), 2))

    def ties(self, x: Array) -> Array:
        """Entries of a matrix that resists motion of yarns against each other, at the yarn's stiffness in tension."""
        pressed = self._pressed(self.contacts(x), x)
        if pressed.ties is None:
            assert self._pattern is not None and self._rod_slots is not None
            stiffness = float(self.stiffness.position_scale().mean())
            entries, idle = np.zeros(self._pattern.pattern.entries), np.zeros(len(x))
            for energy, variables, slots in (
                (TIED_PAIR, pressed.stencils.variables, pressed.slots),
                (TIED_EDGE, self.stretch.variables, self._rod_slots[0]),
            ):
                vectors = energy.variable_count // 3
                stencils = StencilSet(energy, variables, np.full((len(variables), 1), stiffness), vectors)
                stencils.hessian(x, idle, slots, NOT_TURNED, entries)
            pressed.ties = entries
        return pressed.ties

    def rub(self, x: Array, friction: YarnFriction | None) -> None:
        """Begin a step of friction at a state: what presses there resists to slip from there on. None: no friction."""
        had = self._friction.count
        contacts = self.contacts(x)
        new = (
            no_friction() if friction is None else friction.stencils(self.positions(x), contacts.stencils, x)
        )
        self._friction = new
        if had or new.count:
            self._rod_slots = None

    # --- energy ---------------------------------------------------------------------------------------

    @property
    def _rods(self) -> tuple[StencilSet, ...]:
        return self.stretch, self.bend_twist, self.glue, self._friction

    def value(self, x: Array) -> float:
        """Energy [E π r³]; inf where two yarns meet."""
        value = sum(s.value(x) for s in (*self._rods, self.contacts(x).stencils))
        return value if math.isfinite(value) else math.inf

    def gradient(self, x: Array) -> tuple[float, Array, float]:
        """Energy, gradient, and how strongly the terms pull against each other (the sum of their norms)."""
        value, total, pull = 0.0, np.zeros(len(x)), 0.0
        for stencils in (*self._rods, self.contacts(x).stencils):
            force = np.zeros(len(x))
            value += stencils.gradient(x, force)
            pull += float(np.linalg.norm(force))
            total += force
        return (value if math.isfinite(value) else math.inf), total, pull

    def hessian(self, x: Array) -> tuple[float, Array, float, BlockPattern, Array]:
        """``gradient`` with the matrix pattern and the entries of the exact Hessian."""
        pressed = self._pressed(self.contacts(x), x)
        block = self._pattern
        assert block is not None and self._rod_slots is not None
        entries, total, value, pull = np.zeros(block.pattern.entries), np.zeros(len(x)), 0.0, 0.0
        for stencils, slots in zip(
            (*self._rods, pressed.stencils), (*self._rod_slots, pressed.slots), strict=True
        ):
            force = np.zeros(len(x))
            value += stencils.hessian(x, force, slots, NOT_TURNED, entries)
            pull += float(np.linalg.norm(force))
            total += force
        return (value if math.isfinite(value) else math.inf), total, pull, block, entries

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
        if not self._touch:
            return fraction
        positions, moves = self.positions(x), fraction * moves
        meeting = self._pairs(positions, 0.0, moves=moves / GAP_SHARE)
        return fraction * safe_fraction(positions, moves, ends, *meeting, GAP_SHARE)

    # --- read-outs ------------------------------------------------------------------------------------

    def parts(self, x: Array) -> dict[str, float]:
        """Energy of stretch, bending with twist, contact and springs [J]."""
        terms = {
            "stretch": self.stretch, "bend_twist": self.bend_twist, "contact": self.contacts(x).stencils,
            "springs": self.glue,
        }  # fmt: skip
        return {name: stencils.value(x) * self.unit for name, stencils in terms.items()}

    def gaps(self, x: Array) -> Array:
        """Distances of all listed pairs over the yarn diameter."""
        contacts = self.contacts(x)
        found = pair_gaps(self.positions(x), self.sheet.following, contacts.first, contacts.second)
        return 0.5 * found

    def penetration(self, x: Array) -> float:
        """How deep yarns lie in each other, as a share of their diameter: 1 − distance/diameter, 0 where none touch."""
        return max(0.0, 1.0 - float(self.gaps(x).min(initial=1.0)))

    def extensions(self, x: Array) -> Array:
        """Length over rest length − 1 of all edges (m,)."""
        edges, positions = self.sheet.edges, self.positions(x)
        length = np.linalg.norm(positions[self.sheet.following[edges]] - positions[edges], axis=1)
        return length * self.radius / self.sheet.rest_length[edges] - 1.0

    def vertex_energies(self, x: Array) -> Array:
        """Energy shared out to vertices (n,) [J]: of an edge or pair to its ends alike, of a joint to its vertex."""
        shares = np.zeros(self.count)
        for stencils, nodes, spread in self._shares(x):
            np.add.at(shares, nodes, stencils.elements(x)[0][:, None] / spread)
        return shares * self.unit

    def _shares(self, x: Array) -> list[tuple[StencilSet, Indices, int]]:
        """Stencils, the vertices (N, k) that share each, and k."""
        contacts = self.contacts(x)
        found = (
            (self.stretch, self.stretch.variables[:, ::3] // 3),
            (self.bend_twist, self._joint_variables[:, 3:4] // 3),
            (self.glue, self.glue.variables[:, ::3] // 3),
            (contacts.stencils, contacts.stencils.variables[:, ::3] // 3),
        )
        return [(stencils, nodes, nodes.shape[1]) for stencils, nodes in found if stencils.count]

    def vertex_virials(self, x: Array) -> Array:
        """Σ ∂E/∂x ⊗ x of every stencil, shared out to vertices as ``vertex_energies`` (n, 3, 3) [J].

        Over a patch of reference area A it is A P Fᵀ, P the stress of the fabric there and F its deformation.
        """
        shares = np.zeros((self.count, 3, 3))
        for stencils, nodes, spread in self._shares(x):
            force = stencils.elements(x)[1]
            corners = stencils.variables[:, : 3 * stencils.vectors : 3] // 3
            places = self.positions(x)[corners]
            pull = np.einsum(
                "nai,naj->nij", force[:, : 3 * stencils.vectors].reshape(places.shape), places - places[:, :1]
            )
            np.add.at(shares, nodes, pull[:, None] / spread)
        return shares * self.unit

    def masses(self) -> Array:
        """Mass of every vertex (n,) [kg]."""
        line = [m.mass_per_length(self.radius) for m in self.stiffness.materials]
        return np.array(line)[self.stiffness.kind] * self.sheet.voronoi_length * self.sheet.relative_radius**2

    def spins(self) -> Array:
        """Moment of inertia of every edge about itself (n,) [kg m²]; 0 at the ends of yarns."""
        line = [m.mass_per_length(self.radius) for m in self.stiffness.materials]
        length = np.where(self.sheet.following >= 0, self.sheet.rest_length, 0.0)
        section = self.radius**2 * self.sheet.relative_radius**4
        return 0.5 * section * np.array(line)[self.stiffness.kind] * length
