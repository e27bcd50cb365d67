"""The energy of a periodic cell as a function of co-rotated fluctuations and twists (theory §2, eq. C1).

Every copy of vertex i in tile t lies at ``m(X_i + t) + R(ξ_i + t) û_i``. Lengths are counted in yarn radii and energies
in E π r³ (``PatternStiffness``) inside this room, so that tolerances and regularisation suit every pattern.
"""

from __future__ import annotations

import copy
import math
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from yarnscale.arrays import Array, Integers
from yarnscale.cell.constraints import constraint_chains, constraint_rows, independent
from yarnscale.cell.midsurface import Midsurface
from yarnscale.cell.poisson import cell_midsurface
from yarnscale.kinematics import ShellStrain
from yarnscale.numerics.affine import CopiedNodes
from yarnscale.numerics.kkt import LinearConstraints
from yarnscale.numerics.newton import Reuse
from yarnscale.numerics.null_space import ChainConstraints
from yarnscale.numerics.regularisation import ShiftedHessian
from yarnscale.yarn.contact import contact_reach
from yarnscale.yarn.energy import PATTERN_MARGIN, RodEnergy
from yarnscale.yarn.frames import unit, upright
from yarnscale.yarn.friction_pairs import FrictionPairs
from yarnscale.yarn.pattern import YarnPattern
from yarnscale.yarn.rod import ANCHORS, carried_frames
from yarnscale.yarn.stiffness import Materials, PatternStiffness
from yarnscale.yarn.strands import Strands

LARGE = 400
"""Vertices beyond which factors decide what an iteration costs."""
WIDE_MARGIN = 1.0
"""How much farther than they touch pairs have a place in the matrix of a cell that is not large [r]."""
STEP_LIMIT = 0.3
"""Largest move of a vertex in one step [r]."""
TWIST_LIMIT = 1.0
"""Largest change of a twist in one step [rad]."""
SLACK = 2.0
"""How much farther than they touch copies are enumerated [r]."""


def _size(vector: Array) -> float:
    """Euclidean norm; BLAS would share these long sums among threads, which takes a thousand times as long."""
    return math.sqrt(float(np.square(vector).sum()))


@dataclass(eq=False)
class CellEnergy:
    """Energy of a pattern under one macroscopic state; an objective for ``numerics.newton``.

    The free vector is [û (3n, in radii), θ (n)]. sliding: whether yarns may slide along themselves as a whole.
    symmetric: count every contact pair from both sides, half each; needed off singly curved states, by
    ``friction_pairs`` and by ``moved``; None: at the former two. friction_pairs: pairs that resist slip since an
    earlier state.
    """

    pattern: YarnPattern
    material: Materials
    strain: ShellStrain
    sliding: bool = False
    symmetric: bool | None = None
    friction_pairs: FrictionPairs | None = None
    nodes: CopiedNodes = field(init=False)
    constraints: LinearConstraints | ChainConstraints = field(init=False)
    residual_scale: float = field(init=False, default=1.0)

    def __post_init__(self) -> None:
        pattern, radius = self.pattern, self.pattern.radius
        self.stiffness = PatternStiffness.of(pattern, self.material)
        self.unit = self.stiffness.unit
        bent = not self.strain.is_flat
        if self.symmetric is None:
            self.symmetric = bent or self.friction_pairs is not None
        self.surface = cell_midsurface(pattern, self.strain, bending=self.symmetric)
        n = self.count = len(pattern.edges)
        large = n > LARGE
        # Yarns of a weave slide across each other on long curved paths; knits, whose contacts change, need new factors.
        self.reuse = Reuse() if large and pattern.woven else None
        self.strands = Strands.around(pattern, self._reach(SLACK))
        self.reference = self.placed(self.strands)
        offset, rotation = self.surface.at(self.reference)
        self.rotation, self.frames = rotation, rotation[:n]
        self.turning = Midsurface(self.strain, length=radius).rotation_vectors(self.reference)
        source = np.tile(np.arange(n), len(self.strands.tiles))
        turned = rotation if bent else np.empty((0, 3, 3))
        self.nodes = CopiedNodes(source, turned, offset, n, n)
        self.rods = RodEnergy(
            self.stiffness, self.strands, copies=self.nodes, symmetric=self.symmetric,
            turning=self.turning if bent else None, margin=PATTERN_MARGIN if large else WIDE_MARGIN,
        )  # fmt: skip
        self._anchors, self._anchors_by_edge = self._carried()
        self.rods.set_anchors(self._anchors, pattern.reference_twist)
        if self.friction_pairs is not None:
            self._friction = self.friction_pairs.stencils(self.strands, self.frames)
            self.rods.set_others(self._friction)
        self.constraints = self._constraints(large)
        positions, twists = self.stiffness.position_scale(), self.stiffness.twist_scale()
        self._scale = np.concatenate([np.repeat(positions, 3), twists])

    # --- set-up ---------------------------------------------------------------------------------------

    def copies_within(self, slack: float, *others: ShellStrain) -> Strands:
        """Copies that can touch the primary tile after moves of ``slack`` [r] against each other; its own or more.

        others: strains between which the cell moves, besides its own.
        """
        reach = self._reach(slack, *others)
        if reach <= self._reach(SLACK):
            return self.strands
        found = Strands.around(self.pattern, reach)
        return found if len(found.tiles) > len(self.strands.tiles) else self.strands

    def _reach(self, slack: float, *others: ShellStrain) -> float:
        """How far apart in the drawing [m] copies may be that touch after such moves."""
        pattern, strains = self.pattern, (self.strain, *others)
        edge = np.linalg.norm(pattern.edge_vectors(), axis=1).max()
        smallest = math.sqrt(min(np.linalg.eigvalsh(strain.first_form)[0] for strain in strains))
        arc = 1.0 if all(strain.is_flat for strain in strains) else math.pi / 2
        return ((contact_reach(self.stiffness.rule) + slack) * pattern.radius + edge) / smallest * arc

    def placed(self, strands: Strands) -> Array:
        """Reference coordinates of copies (T·n, 3) [r]."""
        radius = self.pattern.radius
        return strands.copies(self.pattern.vertices / radius, self.pattern.period / radius)

    @cached_property
    def _edges(self) -> tuple[Integers, Integers, Array]:
        """Edges whose frames are anchors, before and after every joint: start and end (2n,), and their vectors.

        Those are tangent and director at rest (2n, 2, 3).
        """
        vertex = np.arange(self.count)
        start, end = (
            np.concatenate(part) for part in ((self.strands.before, vertex), (vertex, self.strands.ends[vertex]))
        )
        tangent = unit(self.pattern.edge_vectors())[start % self.count]
        director = upright(self.pattern.reference_director[start % self.count], tangent)
        return start, end, np.stack([tangent, director], 1)

    def _carried(self, places: Array | None = None, rotation: Array | None = None) -> tuple[Array, Array]:
        """``ANCHORS`` of all joints (n, 12): frames of edges carried from rest to the state.

        With their derivatives by edge, tangent and director in the macroscopic state, (2n, 6, 9). places, rotation: of
        all nodes; by default those of the state.
        """
        start, end, vectors = self._edges
        places = self.nodes.offset if places is None else places
        turned = np.einsum("nij,nkj->nki", (self.rotation if rotation is None else rotation)[start], vectors)
        tangent, director, slope = carried_frames(places[end] - places[start], turned[:, 0], turned[:, 1])
        both = np.stack([tangent, director]).reshape(2, 2, self.count, 3)
        return both.transpose(2, 0, 1, 3).reshape(self.count, 12), slope

    @cached_property
    def _slopes(self) -> tuple[Array, Array]:
        """Derivatives of the places (T·n, 3, 6) and rotations (T·n, 3, 3, 6) of all nodes by the macroscopic state."""
        return self.surface.slopes(self.reference)

    @cached_property
    def _edge_slopes(self) -> Array:
        """Derivatives of edge, tangent and director of ``_edges`` in the macroscopic state, (2n, 9, 6)."""
        (start, end, vectors), (places, rotation) = self._edges, self._slopes
        turned = np.einsum("nijl,nkj->nkil", rotation[start], vectors).reshape(len(start), 6, 6)
        return np.concatenate([places[end] - places[start], turned], axis=1)

    def _constraints(self, large: bool) -> LinearConstraints | ChainConstraints:
        """Rows of ``constraint_rows``, made independent of each other; of large cells, as chains."""
        if large:
            return constraint_chains(self.pattern, self.sliding)
        rows = constraint_rows(self.pattern, self.sliding).toarray()
        matrix = independent(rows / np.linalg.norm(rows, axis=1)[:, None])
        return LinearConstraints(matrix, np.zeros(len(matrix)))

    # --- objective ------------------------------------------------------------------------------------

    def value(self, x: Array) -> float:
        """Energy [E π r³]; inf where two yarns meet."""
        return self.rods.value(self.nodes.expand(x))

    def gradient(self, x: Array) -> tuple[float, Array]:
        """Energy and gradient by the free vector."""
        value, forces = self.rods.gradient(self.nodes.expand(x))
        return value, self._summed(forces)

    def quadratic(self, x: Array) -> tuple[float, Array, ShiftedHessian]:
        """Energy, gradient and exact Hessian by the free vector."""
        value, forces, block, entries = self.rods.hessian(self.nodes.expand(x))
        return value, self._summed(forces), ShiftedHessian(block.pattern, entries, self._scale)

    def _summed(self, forces: Array) -> Array:
        """Gradient from the forces (k, N) of each term on all copies; sets ``residual_scale``."""
        gradients = [self.nodes.pull_gradient(force) for force in forces]
        # A residual of 1e-6 means: forces cancel to six digits of what the terms pull against each other. A taut
        # straight yarn pulls on no vertex; there its tension, felt where the tile ends, and round-off set the scale.
        pull = sum(_size(g[: 3 * self.count]) for g in gradients)
        tension = sum(_size(self.rods.positions(force)) for force in forces)
        self.residual_scale = pull + 1e-3 * tension + 1e-6
        return np.add.reduce(gradients)

    def bound(self, x: Array, step: Array) -> float:
        """Fraction of a step that moves no vertex, twist or pair too far."""
        moves, turns = self.split(step)
        longest, turn = math.sqrt(float((moves * moves).sum(1).max())), float(np.abs(turns).max())
        fraction = min(1.0, STEP_LIMIT / max(longest, 1e-300), TWIST_LIMIT / max(turn, 1e-300))
        full, positions = self.nodes.expand(x), self.rods.positions
        moves = positions(self.nodes.expand(x + fraction * step)) - positions(full)
        return fraction * self.rods.contact_list.safe_fraction(positions(full), moves)

    # --- read-outs ------------------------------------------------------------------------------------

    def start(self, fluctuation: Array | None = None, twist: Array | None = None) -> Array:
        """Free vector from a fluctuation û (n, 3) [r] and twists (n,); by default the pattern's rest shape."""
        u = np.zeros((self.count, 3)) if fluctuation is None else fluctuation
        theta = self.pattern.twist if twist is None else twist
        free = np.concatenate([u.ravel(), theta])
        return self.constraints.project(free)

    def split(self, x: Array) -> tuple[Array, Array]:
        """Fluctuation (n, 3) [r] and twists (n,) of a free vector."""
        return x[: 3 * self.count].reshape(-1, 3), x[3 * self.count :]

    def parts(self, x: Array) -> dict[str, float]:
        """Energy of stretch, bending with twist, and contact [J/m²]."""
        parts = self.rods.parts(self.nodes.expand(x))
        return {name: value / self.pattern.area for name, value in parts.items()}

    def stress(self, x: Array) -> Array:
        """∂Ψ/∂(s_x, s_a, s_y, II11, II12, II22) at fixed û and θ [J/m², J/m]: the exact stress of an equilibrium.

        Positions follow the state through (C1), the reference frames of the rods through their anchors.
        """
        return self._by_state(x) * self.unit / self.pattern.area

    def _by_state(self, x: Array) -> Array:
        """∂W/∂(state) at fixed û and θ, (6,)."""
        forces, turns, by_edge = self._pulls(x)
        places, rotation = self._slopes
        total = np.einsum("ni,nil->l", forces, places) + np.einsum("nij,nijl->l", turns, rotation)
        return total + np.einsum("ni,nil->l", by_edge, self._edge_slopes)

    def _pulls(self, x: Array) -> tuple[Array, Array, Array]:
        """∂W by places (T·n, 3), rotations (T·n, 3, 3) and, through the anchors, edges with their frames (2n, 9)."""
        full = self.nodes.expand(x)
        forces = self.rods.positions(self.rods.gradient(full)[1].sum(axis=0))
        turns = forces[:, :, None] * self.split(x)[0][self.nodes.source][:, None]
        if self.friction_pairs is not None and self._friction.count:
            vertices, vectors = self.friction_pairs.turned(self.strands)
            by_vectors = self._friction.by_parameters(full, ("offset", "normal")).reshape(-1, 2, 3)
            np.add.at(turns, vertices, np.einsum("kvi,kvj->kij", by_vectors, vectors))
        return forces, turns, np.einsum("ni,nij->nj", self._by_frames(full), self._anchors_by_edge)

    def _by_frames(self, full: Array) -> Array:
        """∂W by the anchors in the order of ``_edges``, (2n, 6)."""
        by_anchors = self.rods.bend_twist.by_parameters(full, ANCHORS).reshape(self.count, 2, 2, 3)
        return by_anchors.transpose(2, 0, 1, 3).reshape(2 * self.count, 6)

    def moved(self, component: int, step: float) -> CellEnergy:
        """The energy a small step away in one component of the state, to first order in the step.

        It has the contacts of this one, which must be ``symmetric``; and the slopes of this one, see ``second``.
        """
        assert self.symmetric
        (places, rotation), other = self._slopes, copy.copy(self)
        other.rotation = self.rotation + step * rotation[..., component]
        other.frames = other.rotation[: self.count]
        other.nodes = CopiedNodes(
            self.nodes.source, other.rotation, self.nodes.offset + step * places[..., component], self.count, self.count
        )
        other._anchors, other._anchors_by_edge = other._carried()
        other.rods = self.rods.with_copies(other.nodes)
        other.rods.set_anchors(other._anchors, self.pattern.reference_twist)
        if self.friction_pairs is not None:
            other._friction = self.friction_pairs.stencils(self.strands, other.frames)
            other.rods.set_others(other._friction)
        return other

    def second(self, x: Array, moved: list[CellEnergy], step: Array) -> Array:
        """∂²W/∂(state)² at fixed û and θ, (6, 6); moved: this energy a step away in every component.

        Changes of forces are differences of ``moved``; those of the slopes are in closed form.
        """
        here = self._by_state(x)
        forces, turns, by_edge = self._pulls(x)
        start, end, vectors = self._edges
        np.add.at(forces, end, by_edge[:, :3])
        np.add.at(forces, start, -by_edge[:, :3])
        np.add.at(turns, start, np.einsum("nki,nkj->nij", by_edge[:, 3:].reshape(-1, 2, 3), vectors))
        loaded = np.flatnonzero((forces != 0.0).any(axis=1) | (turns != 0.0).any(axis=(1, 2)))
        along = np.stack([(other._by_state(x) - here) / h for other, h in zip(moved, step, strict=True)])
        return along + self.surface.second(self.reference[loaded], forces[loaded], turns[loaded])

    def gaps(self, x: Array) -> Array:
        """Distances of all listed pairs over the yarn diameter."""
        return self.rods.gaps(self.nodes.expand(x))

    def positions(self, x: Array) -> Array:
        """World positions of the primary tile's vertices, (n, 3) [m]."""
        return self.rods.positions(self.nodes.expand(x))[: self.count] * self.pattern.radius
