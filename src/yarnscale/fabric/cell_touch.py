"""Contact of the yarns of all cells of a homogenized volume with each other and with their copies.

It is the energy of ``SplineTouch``, for one period in every cell: pairs of a chord of the period and a chord of any
copy, each from both sides with half its weight, since copies of a cell that bends both ways are not quite alike.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.sparse import csr_array

from yarnscale.arrays import Array, Integers
from yarnscale.drawing.curves import PeriodicCurve, pattern_from_curves
from yarnscale.fabric.bspline import ORDER, blending
from yarnscale.fabric.spline_knit import SplineFabric
from yarnscale.fabric.spline_points import points_per_segment
from yarnscale.fabric.spline_touch import CORE
from yarnscale.numerics.assembly import StencilSet, position_variables
from yarnscale.yarn.close_pairs import close_pairs, pair_gaps, safe_fraction
from yarnscale.yarn.contact import contact_energy, contact_reach, contact_samples
from yarnscale.yarn.contact_list import GAP_SHARE, SKIN
from yarnscale.yarn.pattern import YarnPattern
from yarnscale.yarn.stiffness import PatternStiffness
from yarnscale.yarn.strands import Strands

_ASTRAY = 4.0
"""How much farther than they touch chords of copies may be from the period at rest, to touch it ever [r]."""


@dataclass(frozen=True, eq=False)
class _Listed:
    """Pairs listed at points (g, T·n, 3) [r]: cell, chord of the period and chord of a copy, and their stencils."""

    points: Array
    cell: Integers
    first: Integers
    second: Integers
    stencils: StencilSet


class CellTouch:
    """Contact energy [J] of cells, each with a share of its own, as a function of the nodes of ``period``.

    period: with the nodes of all copies that may touch the fabric's own period. shares: of the cells (g,).
    """

    def __init__(self, fabric: SplineFabric, shares: Array) -> None:
        assert fabric.period is not None
        own, per = fabric.period, points_per_segment(fabric)
        self._along = blending(np.arange(per + 1) / per)
        lines = np.einsum("pj,sjc->spc", self._along[:-1], own.reference[own.segments]).reshape(own.courses, -1, 3)
        curves, size = [PeriodicCurve(line, (1, 0)) for line in lines], np.array([own.width, own.height])
        pattern = pattern_from_curves(curves, size, CORE * fabric.radius)
        self._stiffness = PatternStiffness.of(pattern, fabric.material)
        self._unit, self._radius, self.shares = self._stiffness.unit, pattern.radius, shares
        self._reach = contact_reach(self._stiffness.rule)
        self._strands, points = self._near(pattern)
        # A point k of a segment, at which a chord begins, follows from the segment's control points.
        segment, self._place = np.divmod(np.arange(len(self._strands.ends)), per)
        self.period, copies = own.with_copies(self._strands.tiles, np.unique(segment[points]))
        self._nodes = copies[segment]
        entries = np.repeat(points, ORDER), self._nodes[points].ravel()
        shape = len(segment), len(self.period.source)
        self._rows = csr_array((self._along[self._place[points]].ravel(), entries), shape=shape)
        self._columns, self._points_used = csr_array(self._rows.T), points
        each = shape[0] * np.arange(len(shares))[:, None]
        self._ends = np.where(self._strands.ends >= 0, self._strands.ends + each, -1).ravel()
        self._listed: _Listed | None = None

    def _near(self, pattern: YarnPattern) -> tuple[Strands, Integers]:
        """The period and those chords of its copies that may come to touch it, and the points at their ends."""
        strands = Strands.around(pattern, (self._reach + _ASTRAY) * pattern.radius)
        self._neighbours, n = self._stiffness.neighbours(strands), strands.count
        places = strands.copies(pattern.vertices, pattern.period) / pattern.radius
        _, others = close_pairs(strands, places, self._reach + _ASTRAY, neighbours=self._neighbours, ordered=True)
        chords = np.unique(np.concatenate([np.arange(n), others]))
        points = np.unique(np.concatenate([chords, strands.ends[chords]]))
        tiles = np.unique(points // n)
        number = np.full(len(strands.tiles), -1)
        number[tiles] = np.arange(len(tiles))
        chords, far, points = (number[k // n] * n + k % n for k in (chords, strands.ends[chords], points))
        ends = np.full(len(tiles) * n, -1)
        ends[chords] = far
        return replace(strands, tiles=strands.tiles[tiles], ends=ends), points

    def value(self, nodes: Array) -> float:
        """Energy [J] at nodes (g, m, 3) [m]."""
        points = self._points(nodes)
        return self._unit * self._pressed(points)[2].value(points.ravel())

    def gradient(self, nodes: Array) -> tuple[float, Array]:
        """Energy [J], and gradient by nodes (g, m, 3) [N]."""
        points = self._points(nodes)
        force = np.zeros_like(points)
        value = self._pressed(points)[2].gradient(points.ravel(), force.ravel())
        return self._unit * value, self._unit / self._radius * self._apply(self._columns, force)

    def hessians(self, nodes: Array) -> tuple[Integers, Integers, Array, Array]:
        """Of all pairs that press: cell (p,), nodes (p, 8), how the ends of both chords follow from them (p, 4, 8), and
        Hessians by these ends (p, 12, 12) [N/m]."""
        points = self._points(nodes)
        cell, chords, stencils = self._pressed(points)
        hessians = stencils.elements(points.ravel())[2]
        ties = np.zeros((len(cell), 4, 2 * ORDER))
        for side in range(2):
            place = self._place[chords[:, side]]
            for end in range(2):
                ties[:, 2 * side + end, ORDER * side : ORDER * (side + 1)] = self._along[place + end]
        return cell, self._nodes[chords].reshape(-1, 2 * ORDER), ties, self._unit / self._radius**2 * hessians

    def bound(self, nodes: Array, moves: Array) -> float:
        """Fraction of moves (g, m, 3) [m] from nodes in which no yarns meet, at most 1."""
        points, steps = self._points(nodes), self._points(moves)
        listed = self._at(points)
        flat, ways = points.reshape(-1, 3), steps.reshape(-1, 3)
        share = safe_fraction(flat, ways, self._ends, listed.first, listed.second, GAP_SHARE)
        # Pairs that are not listed are at least as far apart as they touch while the list is valid.
        return min(share, GAP_SHARE * self._reach / max(2.0 * self._longest(steps), 1e-300))

    def forget(self) -> None:
        """List pairs anew."""
        self._listed = None

    def _points(self, nodes: Array) -> Array:
        return self._apply(self._rows, nodes) / self._radius

    @staticmethod
    def _apply(matrix: csr_array, values: Array) -> Array:
        """A matrix (a, b) on values (g, b, 3) of every cell, (g, a, 3)."""
        wide = matrix @ values.transpose(1, 0, 2).reshape(values.shape[1], -1)
        return np.ascontiguousarray(wide.reshape(-1, len(values), 3).transpose(1, 0, 2))

    def _pressed(self, points: Array) -> tuple[Integers, Integers, StencilSet]:
        """Pairs within reach: cell (p,), both chords (p, 2), and stencils."""
        listed, each = self._at(points), points.shape[1]
        gaps = pair_gaps(points.reshape(-1, 3), self._ends, listed.first, listed.second)
        near = np.flatnonzero(gaps < self._reach)
        every = listed.stencils
        some = replace(every, variables=every.variables[near], parameters=every.parameters[near])
        return listed.cell[near], np.stack([listed.first[near], listed.second[near]], 1) % each, some

    def _at(self, points: Array) -> _Listed:
        """The pairs valid at points; listed anew where these have moved half a skin against each other since."""
        old = self._listed
        if old is not None and 2.0 * self._longest(points - old.points) <= SKIN:
            return old
        strands, each = self._strands, points.shape[1]
        pairs = [
            close_pairs(strands, own, self._reach + SKIN, neighbours=self._neighbours, ordered=True) for own in points
        ]
        cell = np.repeat(np.arange(len(pairs)), [len(first) for first, _ in pairs])
        first, second = (np.concatenate([pair[side] for pair in pairs]) for side in range(2))
        length, edge = self._stiffness.pattern.rest_length / self._radius, second % strands.count
        measure = 0.5 * self.shares[cell] * length[first] * length[edge]
        parameters = self._stiffness.pair_parameters(first, edge, measure)
        rule = self._stiffness.rule
        energy = contact_energy(rule.kernel, contact_samples(rule, polyline=False))
        first, second = first + each * cell, second + each * cell
        corners = np.stack([first, self._ends[first], second, self._ends[second]], 1)
        stencils = StencilSet(energy, position_variables(corners), parameters, 4)
        self._listed = _Listed(points.copy(), cell, first, second, stencils)
        return self._listed

    def _longest(self, moves: Array) -> float:
        """Length of the longest of moves (g, k, 3), but for what all points of a cell have in common."""
        moved = moves[:, self._points_used]
        own = moved - moved.mean(axis=1, keepdims=True)
        return float(np.sqrt(np.einsum("gkc,gkc->gk", own, own).max(initial=0.0)))
