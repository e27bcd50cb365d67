"""The energy of a periodic cell as a function of co-rotated fluctuations and twists (theory §2, eq. C1).

Every copy of vertex i in tile t lies at ``m(X_i + t) + R(ξ_i + t) û_i``. Lengths are counted in yarn radii and energies
in E π r³ (``PatternStiffness``) inside this room, so that tolerances and regularisation suit every pattern.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from yarnscale.arrays import Array, Integers
from yarnscale.cell.constraints import constraint_chains, constraint_rows, independent
from yarnscale.cell.friction_pairs import FrictionPairs
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
    symmetric: count every contact pair from both sides, half each; needed off singly curved states and by
    ``friction_pairs``; None: there. friction_pairs: pairs that resist slip since an earlier state.
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
        self.surface = cell_midsurface(pattern, self.strain)
        n = self.count = len(pattern.edges)
        large = n > LARGE
        # Yarns of a weave slide across each other on long curved paths; knits, whose contacts change, need new factors.
        self.reuse = Reuse() if large and pattern.woven else None
        self.strands = Strands.around(pattern, self._reach(SLACK))
        self.reference = self.placed(self.strands)
        offset, rotation = self.surface.at(self.reference)
        self.frames = rotation[:n]
        self.turning = Midsurface(self.strain, length=radius).rotation_vectors(self.reference)
        source = np.tile(np.arange(n), len(self.strands.tiles))
        bent = not self.strain.is_flat
        turned = rotation if bent else np.empty((0, 3, 3))
        self.nodes = CopiedNodes(source, turned, offset, n, n)
        self.rods = RodEnergy(
            self.stiffness, self.strands, copies=self.nodes,
            symmetric=bent or self.friction_pairs is not None if self.symmetric is None else self.symmetric,
            turning=self.turning if bent else None, margin=PATTERN_MARGIN if large else WIDE_MARGIN,
        )  # fmt: skip
        anchors, self._anchor_slope = self._anchors(rotation)
        self.rods.set_anchors(anchors, pattern.reference_twist)
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

    def _anchors(self, rotation: Array) -> tuple[Array, Array]:
        """``ANCHORS`` of all joints (n, 12), and their derivatives by the macroscopic state (n, 12, 6)."""
        vertex, found = np.arange(self.count), []
        for start, end in ((self.strands.before, vertex), (vertex, self.strands.ends[: self.count])):
            found.append(self._carried(start, end, rotation))
        (tangent, director, slope), (after, director_after, slope_after) = found
        anchors = np.concatenate([tangent, after, director, director_after], axis=1)
        parts = slope[:, :3], slope_after[:, :3], slope[:, 3:], slope_after[:, 3:]
        return anchors, np.concatenate(parts, axis=1)

    def _carried(self, start: Integers, end: Integers, rotation: Array) -> tuple[Array, Array, Array]:
        """Tangent and director of edges (start node → end node) carried from rest to the macroscopic state.

        Also their derivatives by that state, (N, 6, 6): rows tangent and director, columns the six components.
        """
        vertex = start % self.count
        rest = unit(self.pattern.edge_vectors())[vertex]
        director = upright(self.pattern.reference_director[vertex], rest)
        turn = rotation[start]
        edge = self.nodes.offset[end] - self.nodes.offset[start]
        turned = np.einsum("nij,nj->ni", turn, rest), np.einsum("nij,nj->ni", turn, director)
        tangent, carried, slope = carried_frames(edge, *turned)

        surface, place, still = self.surface, self.reference[start], np.zeros_like(rest)
        inputs = (
            surface.by_state(self.reference[end], still) - surface.by_state(place, still),
            surface.frames_by_state(place, rest),
            surface.frames_by_state(place, director),
        )
        return tangent, carried, slope @ np.concatenate(inputs, axis=1)

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
        full = self.nodes.expand(x)
        nodes = self.rods.positions(self.rods.gradient(full)[1].sum(axis=0))
        loaded = np.flatnonzero((nodes != 0.0).any(axis=1))
        fluctuation = self.split(x)[0][self.nodes.source[loaded]]
        slopes = self.surface.by_state(self.reference[loaded], fluctuation)
        by_anchors = self.rods.bend_twist.by_parameters(full, ANCHORS)
        total = np.einsum("ni,nij->j", nodes[loaded], slopes) + np.einsum("ni,nij->j", by_anchors, self._anchor_slope)
        if self.friction_pairs is not None and self._friction.count:
            vertices, vectors = self.friction_pairs.turned(self.strands)
            by_vectors = self._friction.by_parameters(full, ("offset", "normal")).reshape(-1, 2, 3)
            for k in (0, 1):
                turned = self.surface.frames_by_state(self.reference[vertices], vectors[:, k])
                total += np.einsum("ni,nij->j", by_vectors[:, k], turned)
        return total * self.unit / self.pattern.area

    def gaps(self, x: Array) -> Array:
        """Distances of all listed pairs over the yarn diameter."""
        return self.rods.gaps(self.nodes.expand(x))

    def positions(self, x: Array) -> Array:
        """World positions of the primary tile's vertices, (n, 3) [m]."""
        return self.rods.positions(self.nodes.expand(x))[: self.count] * self.pattern.radius
