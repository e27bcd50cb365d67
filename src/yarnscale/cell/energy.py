"""The energy of a periodic cell as a function of co-rotated fluctuations and twists (theory §2, eq. C1).

Every copy of vertex i in tile t lies at ``m(X_i + t) + R(ξ_i + t) û_i``. Lengths are counted in yarn radii and energies
in E π r³ (``PatternStiffness``) inside this room, so that tolerances and regularisation suit every pattern.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from yarnscale.cell.constraints import constraint_chains, constraint_rows, independent
from yarnscale.cell.contact_list import ContactList, Contacts
from yarnscale.cell.midsurface import Midsurface
from yarnscale.cell.poisson import cell_midsurface
from yarnscale.kinematics import ShellStrain
from yarnscale.numerics.affine import CopiedNodes
from yarnscale.numerics.assembly import StencilSet, position_variables
from yarnscale.numerics.block_pattern import BlockPattern
from yarnscale.numerics.kkt import LinearConstraints
from yarnscale.numerics.newton import Reuse
from yarnscale.numerics.null_space import ChainConstraints
from yarnscale.numerics.sums import ShiftedHessian
from yarnscale.yarn.close_pairs import pair_gaps, safe_fraction
from yarnscale.yarn.contact import contact_reach
from yarnscale.yarn.pattern import YarnPattern
from yarnscale.yarn.rod import ANCHORS, BEND_TWIST, carried_frames
from yarnscale.yarn.stiffness import Materials, PatternStiffness
from yarnscale.yarn.strands import Strands

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

LARGE = 400
"""Vertices beyond which factors decide what an iteration costs."""
TIGHT_MARGIN = 0.1
"""How much farther than they touch pairs have a place in the matrix of a large cell [r]."""
STEP_LIMIT = 0.3
"""Largest move of a vertex in one step [r]."""
TWIST_LIMIT = 1.0
"""Largest change of a twist in one step [rad]."""
SLACK = 2.0
"""How much farther than they touch copies are enumerated [r]."""
GAP_SHARE = 0.8
"""Share of its distance that a pair may close in one step: yarns never pass through each other."""


def _unit(vectors: Array) -> Array:
    return vectors / np.linalg.norm(vectors, axis=1)[:, None]


def _size(vector: Array) -> float:
    """Euclidean norm; BLAS would share these long sums among threads, which takes a thousand times as long."""
    return math.sqrt(float(np.square(vector).sum()))


@dataclass(eq=False)
class CellEnergy:
    """Energy of a pattern under one macroscopic state; an objective for ``numerics.newton``.

    The free vector is [û (3n, in radii), θ (n)]. sliding: whether yarns may slide along themselves as a whole.
    symmetric: count every contact pair from both sides, half each; needed off singly curved states only.
    """

    pattern: YarnPattern
    material: Materials
    strain: ShellStrain
    sliding: bool = False
    symmetric: bool = False
    nodes: CopiedNodes = field(init=False)
    constraints: LinearConstraints | ChainConstraints = field(init=False)
    residual_scale: float = field(init=False, default=1.0)

    def __post_init__(self) -> None:
        pattern, radius = self.pattern, self.pattern.radius
        self.stiffness = PatternStiffness.of(pattern, self.material)
        self.unit = self.stiffness.unit
        self.surface = cell_midsurface(pattern, self.strain)
        n = self.count = len(pattern.edges)
        self._large = n > LARGE
        # Yarns of a weave slide across each other on long curved ways; knits, whose contacts change, need new factors.
        self.reuse = Reuse() if self._large and pattern.woven else None
        self.strands = self._copies_within(SLACK)
        self.reference = self.placed(self.strands)
        offset, rotation = self.surface.at(self.reference)
        self.turning = Midsurface(self.strain, length=radius).rotation_vectors(self.reference)
        source = np.tile(np.arange(n), len(self.strands.tiles))
        turned = np.empty((0, 3, 3)) if self.strain.is_flat else rotation
        self.nodes = CopiedNodes(source, turned, offset, n, n)
        turning = None if self.strain.is_flat else self.turning
        self.contact_list = ContactList(
            pattern, self.strands, self.nodes, self.stiffness, symmetric=self.symmetric, turning=turning
        )
        self._rod_stencils(rotation)
        self._pattern: BlockPattern | None = None
        self.constraints = self._constraints()
        positions, twists = self.stiffness.position_scale(), self.stiffness.twist_scale()
        self._scale = np.concatenate([np.repeat(positions, 3), twists])

    # --- set-up ---------------------------------------------------------------------------------------

    def copies_within(self, slack: float) -> Strands:
        """Copies that can touch the primary tile after moves of ``slack`` [r] against each other; its own or more."""
        found = self.strands if slack <= SLACK else self._copies_within(slack)
        return found if len(found.tiles) > len(self.strands.tiles) else self.strands

    def _copies_within(self, slack: float) -> Strands:
        pattern, first = self.pattern, self.strain.first_form
        edge = np.linalg.norm(pattern.edge_vectors(), axis=1).max()
        smallest = math.sqrt(np.linalg.eigvalsh(first)[0])
        arc = 1.0 if self.strain.is_flat else math.pi / 2
        reach = ((contact_reach(self.stiffness.rule) + slack) * pattern.radius + edge) / smallest * arc
        return Strands.around(pattern, reach)

    def placed(self, strands: Strands) -> Array:
        """Reference coordinates of copies (T·n, 3) [r]."""
        radius = self.pattern.radius
        return strands.copies(self.pattern.vertices / radius, self.pattern.period / radius)

    def _rod_stencils(self, rotation: Array) -> None:
        pattern, n = self.pattern, self.count
        vertex, ends = np.arange(n), self.strands.ends[:n]
        scalars = 3 * len(self.nodes.source)
        stretch = position_variables(np.stack([vertex, ends], 1))
        self.stretch = StencilSet(self.stiffness.stretch_energy, stretch, self.stiffness.edge_parameters(), 2)

        before, back = pattern.previous_vertex, self.strands.before
        tangent, director, slope = self._anchors(vertex, ends, rotation)
        tangent_before, director_before, slope_before = self._anchors(back, vertex, rotation)
        # Rows in the order of ``ANCHORS``.
        both = slope_before[:, :3], slope[:, :3], slope_before[:, 3:], slope[:, 3:]
        self._anchor_slope = np.concatenate(both, axis=1)
        bend, twist = self.stiffness.joint_stiffness()
        parameters = np.column_stack(
            [
                tangent_before, tangent, director_before, director, pattern.reference_twist,
                pattern.rest_curvature, pattern.rest_twist, bend, twist,
            ]
        )  # fmt: skip
        joints = np.column_stack(
            [position_variables(np.stack([back, vertex, ends], 1)), scalars + before, scalars + vertex]
        )
        self.bend_twist = StencilSet(BEND_TWIST, joints, parameters, 3)
        self._rods = (self.stretch, self.bend_twist)
        self._rod_unknowns = [self.nodes.unknowns(s.variables) for s in self._rods]

    def _anchors(self, start: Indices, end: Indices, rotation: Array) -> tuple[Array, Array, Array]:
        """Tangent and director of edges (start node → end node) carried from rest to the macroscopic state.

        Also their derivatives by that state, (N, 6, 6): rows tangent and director, columns the six components.
        """
        vertex = start % self.count
        rest = _unit(self.pattern.edge_vectors())[vertex]
        director = self.pattern.reference_director[vertex]
        director = _unit(director - (director * rest).sum(1)[:, None] * rest)
        turn = rotation[start]
        edge = self.nodes.offset[end] - self.nodes.offset[start]
        turned = np.einsum("nij,nj->ni", turn, rest), np.einsum("nij,nj->ni", turn, director)
        tangent, carried, slope = carried_frames(edge, *turned)

        def by_state(nodes: Indices, vector: Array) -> Array:
            return self.surface.by_state(self.reference[nodes], vector)

        still = np.zeros_like(rest)
        at_start = by_state(start, still)
        inputs = (
            by_state(end, still) - at_start,
            by_state(start, rest) - at_start,
            by_state(start, director) - at_start,
        )
        return tangent, carried, slope @ np.concatenate(inputs, axis=1)

    def _constraints(self) -> LinearConstraints | ChainConstraints:
        """Rows of ``constraint_rows``, made independent of each other; of large cells, as chains."""
        if self._large:
            return constraint_chains(self.pattern, self.sliding)
        rows = constraint_rows(self.pattern, self.sliding).toarray()
        matrix = independent(rows / np.linalg.norm(rows, axis=1)[:, None])
        return LinearConstraints(matrix, np.zeros(len(matrix)))

    def _positions(self, full: Array) -> Array:
        return full[: 3 * len(self.nodes.source)].reshape(-1, 3)

    def _block_pattern(self, contacts: Contacts, full: Array) -> BlockPattern:
        """The matrix pattern, made anew only where contacts do not fit into it.

        Of a large cell it has only pairs that touch or nearly do: factors cost more than patterns.
        """
        if self._large:
            return self._tight_pattern(contacts, full)
        if contacts.slots is None:
            if self._pattern is None or not self._pattern.covers(contacts.unknowns):
                wide = self.contact_list.unknowns_ahead(self._positions(full))
                self._lay_out([contacts.unknowns, wide])
            assert self._pattern is not None
            contacts.slots = self._pattern.slots(contacts.unknowns)
        assert self._pattern is not None
        return self._pattern

    def _tight_pattern(self, contacts: Contacts, full: Array) -> BlockPattern:
        ends, touch = self.strands.ends, contact_reach(self.stiffness.rule)
        gaps = pair_gaps(self._positions(full), ends, contacts.first, contacts.second)
        if self._pattern is not None and contacts.slots is None:
            self._place(contacts)
        if contacts.slots is None or (~contacts.covered & (gaps < touch)).any():
            self._lay_out([contacts.unknowns[gaps < touch + TIGHT_MARGIN]])
            self._place(contacts)
        assert self._pattern is not None
        return self._pattern

    def _place(self, contacts: Contacts) -> None:
        """Slots of the pairs that the pattern covers."""
        assert self._pattern is not None
        contacts.covered = self._pattern.covered(contacts.unknowns)
        contacts.slots = self._pattern.slots(np.where(contacts.covered[:, None], contacts.unknowns, -1))

    def _lay_out(self, contacts: list[Indices]) -> None:
        """A new pattern of the rods and of the unknowns of contacts (N, 12) each."""
        groups = np.concatenate([np.full(self.count, 3), np.ones(self.count, np.int64)])
        self._pattern = BlockPattern.of(groups, [*self._rod_unknowns, *contacts])
        self._rod_slots = [self._pattern.slots(u) for u in self._rod_unknowns]

    def contacts(self, free: Array, full: Array) -> Contacts:
        """Contact stencils valid at the free vector and its full vector."""
        return self.contact_list.at(free[: 3 * self.count].reshape(-1, 3), self._positions(full))

    # --- objective ------------------------------------------------------------------------------------

    def value(self, x: Array) -> float:
        """Energy [E π r³]; inf where two yarns meet."""
        full = self.nodes.expand(x)
        contacts = self.contacts(x, full)
        value = sum(s.value(full) for s in (*self._rods, contacts.stencils))
        return value if math.isfinite(value) else math.inf

    def gradient(self, x: Array) -> tuple[float, Array]:
        """Energy and gradient by the free vector."""
        full = self.nodes.expand(x)
        contacts = self.contacts(x, full)
        value, forces = 0.0, []
        for stencils in (*self._rods, contacts.stencils):
            forces.append(np.zeros(len(full)))
            value += stencils.gradient(full, forces[-1])
        return self._summed(value, forces)

    def quadratic(self, x: Array) -> tuple[float, Array, ShiftedHessian]:
        """Energy, gradient and exact Hessian by the free vector."""
        full = self.nodes.expand(x)
        contacts = self.contacts(x, full)
        block = self._block_pattern(contacts, full)
        assert contacts.slots is not None
        entries = np.zeros(block.pattern.entries)
        value, forces = 0.0, []
        for stencils, slots in zip(
            (*self._rods, contacts.stencils), (*self._rod_slots, contacts.slots), strict=True
        ):
            forces.append(np.zeros(len(full)))
            value += stencils.hessian(full, forces[-1], slots, self.nodes.rotation, entries)
        value, gradient = self._summed(value, forces)
        return value, gradient, ShiftedHessian(block.pattern, entries, self._scale)

    def _summed(self, value: float, forces: list[Array]) -> tuple[float, Array]:
        """Energy and gradient from the forces of each term on all copies; sets ``residual_scale``."""
        gradients = [self.nodes.pull_gradient(force) for force in forces]
        # A residual of 1e-6 means: forces cancel to six digits of what the terms pull against each other. A taut
        # straight yarn pulls on no vertex; there its tension, felt where the tile ends, and round-off set the scale.
        pull = sum(_size(g[: 3 * self.count]) for g in gradients)
        tension = sum(_size(self._positions(force)) for force in forces)
        self.residual_scale = pull + 1e-3 * tension + 1e-6
        return (value if math.isfinite(value) else math.inf), sum(gradients)  # type: ignore[return-value]

    def bound(self, x: Array, step: Array) -> float:
        """Fraction of a step that moves no vertex, twist or pair too far."""
        n = self.count
        moves = step[: 3 * n].reshape(-1, 3)
        longest = math.sqrt(float((moves * moves).sum(1).max()))
        turn = float(np.abs(step[3 * n :]).max())
        fraction = min(1.0, STEP_LIMIT / max(longest, 1e-300), TWIST_LIMIT / max(turn, 1e-300))
        full = self.nodes.expand(x)
        contacts = self.contacts(x, full)
        ahead = self._positions(self.nodes.expand(x + fraction * step)) - self._positions(full)
        return fraction * safe_fraction(
            self._positions(full), ahead, self.strands.ends, contacts.first, contacts.second, GAP_SHARE
        )

    # --- read-outs ------------------------------------------------------------------------------------

    def start(self, fluctuation: Array | None = None, twist: Array | None = None) -> Array:
        """Free vector from a fluctuation û (n, 3) [r] and twists (n,); by default the pattern's rest shape."""
        u = np.zeros((self.count, 3)) if fluctuation is None else fluctuation
        theta = self.pattern.twist if twist is None else twist
        free = np.concatenate([u.ravel(), theta])
        return self.constraints.project(free)

    def parts(self, x: Array) -> dict[str, float]:
        """Energy of stretch, bending with twist, and contact [J/m²]."""
        full = self.nodes.expand(x)
        unit = self.unit / self.pattern.area
        named = zip(
            ("stretch", "bend_twist", "contact"), (*self._rods, self.contacts(x, full).stencils), strict=True
        )
        return {name: stencils.value(full) * unit for name, stencils in named}

    def stress(self, x: Array) -> Array:
        """∂Ψ/∂(s_x, s_a, s_y, II11, II12, II22) at fixed û and θ [J/m², J/m]: the exact stress of an equilibrium.

        Positions follow the state through (C1), the reference frames of the rods through their anchors.
        """
        full = self.nodes.expand(x)
        force = np.zeros(len(full))
        for stencils in (*self._rods, self.contacts(x, full).stencils):
            stencils.gradient(full, force)
        nodes = self._positions(force)
        loaded = np.flatnonzero((nodes != 0.0).any(axis=1))
        fluctuation = x[: 3 * self.count].reshape(-1, 3)[self.nodes.source[loaded]]
        slopes = self.surface.by_state(self.reference[loaded], fluctuation)
        by_anchors = self.bend_twist.by_parameters(full, ANCHORS)
        total = np.einsum("ni,nij->j", nodes[loaded], slopes) + np.einsum(
            "ni,nij->j", by_anchors, self._anchor_slope
        )
        return total * self.unit / self.pattern.area

    def gaps(self, x: Array) -> Array:
        """Distances of all listed pairs over the yarn diameter."""
        full = self.nodes.expand(x)
        contacts = self.contacts(x, full)
        ends = self.strands.ends
        gaps = pair_gaps(self._positions(full), ends, contacts.first, contacts.second)
        return gaps / self._diameters(contacts)

    def _diameters(self, contacts: Contacts) -> Array:
        """Sum of the radii of each pair's yarns (N,) [r]."""
        relative = self.pattern.relative_radius
        return relative[contacts.first] + relative[contacts.second % self.count]

    def positions(self, x: Array) -> Array:
        """World positions of the primary tile's vertices, (n, 3) [m]."""
        return self._positions(self.nodes.expand(x))[: self.count] * self.pattern.radius
