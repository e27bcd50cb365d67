"""Near pairs of a vertex and a triangle, and of two edges: a list that is valid for several iterations.

The list is valid while every vertex stays in a box around its position, or around its path, with a margin: then no
other pair can be closer than the thickness.

Between two surfaces a quarter of the pressure comes from the vertices of each, half from pairs of edges. A vertex
represents its area, but is near several triangles if these are not large compared with the thickness; and the number
of pairs of edges per area grows as they get shorter. So the weight of a pair is the area of its vertex or its edges
over the mean number of such pairs at a point: pairs per area times the area in which a pair repels. This area is
S + P r₁ + π r₂² for a triangle of area S and outline P, and (2/π) a b + 2 (a + b) r₁ + π r₂² for edges of lengths a and
b at random angles (Steiner's formula), with r₁ and r₂ from ``barrier.reach_aside``.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from yarnscale.arrays import Array, Flags, Integers
from yarnscale.numerics.threads import equal_ranges, run_parts
from yarnscale.shell.contact import pair_loops
from yarnscale.shell.contact.barrier import ContactSettings, reach_aside
from yarnscale.shell.contact.broad_phase import Surfaces, near_pairs

_PARALLEL = 1e-3
"""Squared sine of the angle between edges, for their rest lengths, below which repulsion is reduced."""


@dataclass(frozen=True, eq=False)
class Pairs:
    """Pairs that may be near while every vertex stays in its box ``lowest`` … ``highest`` (nv, 3) [m].

    figures: numbers of the vertex and the triangle, for the first ``corners`` pairs, or of the two edges (n, 2);
    vertices: (n, 4); gaps: distances (n,) [m] at ``origin`` (nv, 3); radius: of a ball about the vertex of every pair.
    """

    lowest: Array
    highest: Array
    figures: Integers
    vertices: Integers
    corners: int
    origin: Array
    gaps: Array
    radius: float = 0.0

    def hold(self, positions: Array) -> bool:
        """Whether every vertex is in its box."""
        return bool((positions >= self.lowest).all() and (positions <= self.highest).all())

    def held_share(self, start: Array, moves: Array) -> float:
        """Share of moves, in 0 … 1, during which every vertex stays in its box; 0 if one is outside at the start."""
        if not self.hold(start):
            return 0.0
        room = np.where(moves > 0, self.highest, self.lowest) - start
        far = np.abs(moves) > np.abs(room)
        return float((room[far] / moves[far]).min(initial=1.0))


@dataclass(frozen=True, eq=False)
class Close:
    """Pairs nearer than some distance at ``positions`` (nv, 3).

    vertices: (k, 4); is_corner: whether of a vertex and a triangle, (k,); weights: (k,); coefficients: Σ c x leads
    from one closest point to the other (k, 4); distances: (k,) [m]; normals: their gradients by Σ c x (k, 3); fade:
    factor of repulsion and its first and second derivative by the squared cross product of edges, each (k,).
    """

    positions: Array
    vertices: Integers
    is_corner: Flags
    weights: Array
    coefficients: Array
    distances: Array
    normals: Array
    fade: tuple[Array, Array, Array]


class PairSearch:
    """Near pairs of surfaces whose vertices were at ``rest`` (nv, 3), the first ``cloth`` triangles of the cloth."""

    def __init__(self, triangles: Integers, cloth: int, rest: Array, settings: ContactSettings) -> None:
        self.surfaces = Surfaces.of(triangles, cloth)
        self.settings, self.slack = settings, settings.thickness
        corners = rest[triangles]
        thirds = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1) / 6
        self.vertex_areas = np.bincount(triangles.ravel(), np.repeat(thirds, 3), len(rest))
        edges = self.surfaces.edges
        self.edge_areas = np.bincount(self.surfaces.sides.ravel(), np.repeat(thirds, 3), len(edges))
        self.lengths = np.linalg.norm(rest[edges[:, 1]] - rest[edges[:, 0]], axis=1)
        self._fit_obstacles(thirds)
        self.strip, self.disc = reach_aside(settings.thickness)
        around = self.lengths[self.surfaces.sides].sum(axis=1)
        self.shares *= 3.0 * thirds / self._met(3.0 * thirds, around)
        self._pairs: Pairs | None = None
        self._close: Close | None = None

    def _fit_obstacles(self, thirds: Array) -> None:
        """Limit the areas of coarse obstacles and add the rest to the vertices of the cloth.

        Vertices and edges of obstacles represent at most the mean area of those inside the cloth; the rest is
        added to the cloth's vertices, by triangle of the obstacle. thirds: of areas of triangles, (m,) [m²].
        """
        surfaces, split = self.surfaces, self.surfaces.cloth
        usual = thirds[:split].mean()
        fineness = np.minimum(1.0, usual / np.maximum(thirds, 1e-300))
        fineness[:split] = 1.0
        self.shares = 1.0 - 0.75 * fineness
        for areas, figures, around in (
            (self.vertex_areas, surfaces.triangles, 6.0),
            (self.edge_areas, surfaces.sides, 2.0),
        ):
            of_body = np.ones(len(areas), bool)
            of_body[figures[:split]] = False
            areas[of_body] = np.minimum(areas[of_body], around * usual)

    def _met(self, over: Array, around: Array) -> Array:
        """Area from which a figure repels [m²]: its own, and that beside it weighted with the force.

        over, around: area [m²] and outline [m] of a triangle, or of the mean parallelogram of two edges.
        """
        return over + around * self.strip + math.pi * self.disc**2

    def _edge_areas(self, met: Integers) -> Array:
        """Areas represented by pairs of edges (n, 2), (n,) [m²]."""
        first, second = self.lengths[met].T
        spanned = self._met(2.0 / math.pi * first * second, 2.0 * (first + second))
        return 0.5 * self.edge_areas[met].prod(axis=1) / spanned

    def along(self, start: Array, end: Array) -> Pairs:
        """Pairs that can be near along the straight path from start to end."""
        pairs = self._pairs
        if pairs is None or not (pairs.hold(start) and pairs.hold(end)):
            pairs = self._pairs = self._search(start, end)
        return pairs

    def known(self, start: Array, moves: Array) -> tuple[Pairs | None, float]:
        """Pairs that can be near along a share of moves (nv, 3), and that share, as far as no search is needed."""
        return self._pairs, 0.0 if self._pairs is None else self._pairs.held_share(start, moves)

    def close(self, positions: Array) -> Close:
        """Pairs nearer than the thickness."""
        if self._close is None or not np.array_equal(self._close.positions, positions):
            self._close = self._closest(positions, self.settings.thickness)
        return self._close

    def nearer(self, positions: Array, within: float) -> Integers:
        """Vertices (n, 4) of pairs closer than a distance [m]; complete up to the thickness only."""
        pairs = self.along(positions, positions)
        return pairs.vertices[nearer(pairs, positions, within)[0]]

    def _closest(self, positions: Array, within: float) -> Close:
        pairs = self.along(positions, positions)
        numbers, coefficients, distances, normals = nearer(pairs, positions, within)
        vertices = pairs.vertices[numbers]
        corners, met = np.split(pairs.figures[numbers], [np.searchsorted(numbers, pairs.corners)])
        areas = self.shares[corners[:, 1]] * self.vertex_areas[corners[:, 0]]
        weights = self.settings.stiffness * np.concatenate([areas, self._edge_areas(met)])
        limits = np.concatenate([np.zeros(len(corners)), _PARALLEL * (self.lengths[met] ** 2).prod(axis=1)])
        fade = _fade(pair_loops.crossed_squares(positions, vertices), limits)
        is_corner = np.arange(len(numbers)) < len(corners)
        return Close(positions, vertices, is_corner, weights, coefficients, distances, normals, fade)

    def _search(self, start: Array, end: Array) -> Pairs:
        surfaces, lowest, highest = self.surfaces, np.minimum(start, end), np.maximum(start, end)
        reach = 0.5 * self.settings.thickness + self.slack
        corners, met = near_pairs(surfaces, lowest - reach, highest + reach, within_cloth=self.settings.self_contact)
        of_corners = np.column_stack([corners[:, 0], surfaces.triangles[corners[:, 1]]])
        vertices = np.concatenate([of_corners, surfaces.edges[met].reshape(-1, 4)])

        def part(bounds: tuple[int, int]) -> Array:
            return pair_loops.distances(start, vertices, len(corners), *bounds)

        gaps = np.concatenate(run_parts(part, equal_ranges(len(vertices))))
        figures, slack = np.concatenate([corners, met]), self.slack
        return Pairs(lowest - slack, highest + slack, figures, vertices, len(corners), start, gaps)


def nearer(pairs: Pairs, positions: Array, within: float) -> tuple[Integers, Array, Array, Array]:
    """Numbers (k,), coefficients, distances and normals (see ``Close``) of pairs closer than ``within`` [m]."""
    moved = np.linalg.norm(positions - pairs.origin, axis=1)

    def part(bounds: tuple[int, int]) -> tuple[Integers, Array, Array, Array]:
        return pair_loops.pairs_within(
            positions, pairs.vertices, pairs.corners, pairs.gaps, moved, pairs.radius, within, *bounds
        )

    found = run_parts(part, equal_ranges(len(pairs.vertices)))
    numbers, coefficients, distances, normals = (np.concatenate(a) for a in zip(*found, strict=True))
    return numbers, coefficients, distances, normals


def _fade(crossed: Array, limits: Array) -> tuple[Array, Array, Array]:
    """Factor of the repulsion of edges, 0 if they are parallel, with derivatives (Li et al. 2020, eq. 24)."""
    faded = crossed < limits
    limit = np.where(faded, limits, 1.0)
    share = np.where(faded, crossed / limit, 1.0)
    slope = np.where(faded, 2.0 / limit * (1.0 - share), 0.0)
    return share * (2.0 - share), slope, np.where(faded, -2.0 / limit**2, 0.0)
