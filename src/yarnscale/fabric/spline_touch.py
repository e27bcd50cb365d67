"""Contact between spline yarns wherever they meet, beside the constraints that keep their stitches.

Yarns touch where their distance is less than a share of their diameter, so that stitches at rest, which are drawn with
some overlap, are free of it. The energy is that of rods, on chords between points of the curves. It is infinite where
two chords meet, and no step brings a pair closer than a fifth of its distance: yarns do not pass through each other.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.sparse import csr_array

from yarnscale.arrays import Array, Integers
from yarnscale.fabric.bspline import ORDER, blending
from yarnscale.fabric.spline_points import SplinePoints
from yarnscale.numerics.assembly import StencilSet, position_variables
from yarnscale.numerics.block_pattern import BlockPattern
from yarnscale.numerics.factor import SymmetricPattern, places_among
from yarnscale.numerics.kkt import QuadraticModel
from yarnscale.numerics.newton import Objective
from yarnscale.numerics.regularisation import ShiftedHessian
from yarnscale.yarn.contact_list import ContactList
from yarnscale.yarn.passages import Passages
from yarnscale.yarn.stiffness import PatternStiffness

CORE = 0.85
"""Diameter within which yarns press on each other, as a share of the whole."""
_MARGIN = 0.1
"""How much farther than pairs press they have places in the Hessian [r]."""


class SplineTouch:
    """Contact energy of all yarns of a fabric as a function of their control points (3n,) [m].

    Of the pairs that ``ContactList`` keeps over many steps only those within reach are evaluated; the Hessian has
    places for them, and for those nearly within reach, so that its pattern lasts.
    """

    def __init__(self, points: SplinePoints, *, own: Integers | None = None) -> None:
        """own: yarns of which a pair has at least one; None: all."""
        self.points, fabric = points, points.fabric
        core = replace(points.sheet, radius=CORE * points.sheet.radius)  # which touches later
        self._stiffness = PatternStiffness.of(core, fabric.material)
        self._strands, self._unit = self._stiffness.pattern.strands, self._stiffness.unit  # type: ignore[attr-defined]
        counted = None if own is None else np.isin(self._strands.yarn, own)
        self._list = ContactList(self._strands, self._stiffness, own=counted)
        self._radius = CORE * fabric.radius
        per, number = points.per_segment, self._strands.place  # an edge begins at its vertex's place on the yarn
        segment = np.minimum(number // per, fabric.segments_per_yarn - 1)
        self._nodes = fabric.segments[self._strands.yarn * fabric.segments_per_yarn + segment]
        first = (number - segment * per) / per
        self._shares = np.stack([blending(first), blending(first + 1.0 / per)], axis=1)
        self._rows = csr_array(points.rows[::3, ::3])
        self._columns = csr_array(self._rows.T)
        self._blocks: BlockPattern | None = None

    def _positions(self, x: Array) -> Array:
        return (self._rows @ x.reshape(-1, 3)) / self._radius

    def _pressed(self, positions: Array, margin: float = 0.0) -> tuple[Integers, Integers, StencilSet]:
        """Pairs within reach [r], and their stencils."""
        listed = self._list.at(positions)
        near = np.flatnonzero(self._list.distances(listed, positions) < self._list.reach + margin)
        every = listed.stencils
        some = replace(every, variables=every.variables[near], parameters=every.parameters[near])
        return listed.first[near], listed.second[near], some

    def near(self, margin: float) -> Integers:
        """Control points behind the pairs that are so much farther apart at rest than they touch [r], (p, 8)."""
        positions = self.points.sheet.vertices / self._radius
        first, second = self._list.pairs_within(positions, self._list.reach + margin)
        return np.concatenate([self._nodes[first], self._nodes[second]], axis=1)

    def forget(self) -> None:
        """List contacts anew."""
        self._list.forget()
        self._blocks = None

    def value(self, x: Array) -> float:
        """Energy [J]."""
        positions = self._positions(x)
        return self._unit * self._pressed(positions)[2].value(positions.ravel())

    def gradient(self, x: Array) -> tuple[float, Array]:
        """Energy [J] and gradient (3n,) [N]."""
        positions = self._positions(x)
        force = np.zeros_like(positions)
        value = self._pressed(positions)[2].gradient(positions.ravel(), force.ravel())
        return self._unit * value, self._unit / self._radius * (self._columns @ force).ravel()

    def quadratic(self, x: Array, inner: ShiftedHessian) -> tuple[float, Array, ShiftedHessian]:
        """Energy [J] and gradient (3n,) [N], and a model with the Hessian of contact, in a pattern that has both."""
        positions = self._positions(x)
        first, second, stencils = self._pressed(positions)
        value, gradient, keys, blocks = 0.0, np.zeros_like(x), np.empty(0, np.int64), np.empty((0, 9))
        if len(first):
            energies, pulls, hessians = stencils.elements(positions.ravel())
            value = self._unit * float(energies.sum())
            force = np.bincount(stencils.variables.ravel(), pulls.ravel(), minlength=positions.size).reshape(-1, 3)
            gradient = self._unit / self._radius * (self._columns @ force).ravel()
            keys, blocks = self._by_nodes(first, second, hessians)
        elif self._blocks is None:
            return value, gradient, inner
        places = self._places(keys)
        if self._blocks is None or places is None:
            self._lay_out(positions, inner.pattern)
            places = self._places(keys)
        assert self._blocks is not None and places is not None
        entries = np.zeros(self._blocks.pattern.entries)
        entries[self._inner] = inner.entries
        self._blocks.add_blocks(places, blocks, entries)
        return value, gradient, ShiftedHessian(self._blocks.pattern, entries, inner.diagonal)

    def _by_nodes(self, first: Integers, second: Integers, hessians: Array) -> tuple[Integers, Array]:
        """Keys of pairs of control points below the diagonal, (m,), and their blocks (m, 9) [N/m].

        hessians: of pairs of chords by their ends, (p, 4, 3, 4, 3).
        """
        shares = np.zeros((len(first), 4, 2 * ORDER))
        shares[:, :2, :ORDER], shares[:, 2:, ORDER:] = self._shares[first], self._shares[second]
        half = hessians.reshape(-1, 12, 4, 3).swapaxes(2, 3) @ shares[:, None]
        whole = shares.swapaxes(1, 2) @ half.reshape(-1, 4, 3 * 3 * 2 * ORDER)
        blocks = whole.reshape(-1, 2 * ORDER, 3, 3, 2 * ORDER).transpose(0, 1, 4, 2, 3)
        nodes = np.concatenate([self._nodes[first], self._nodes[second]], axis=1)
        row, column = np.broadcast_arrays(nodes[:, :, None], nodes[:, None, :])
        below = row >= column
        keys = column[below] * (self._rows.shape[1]) + row[below]  # type: ignore[index]
        return keys, self._unit / self._radius**2 * blocks[below].reshape(-1, 9)

    def _places(self, keys: Integers) -> Integers | None:
        """Where blocks stand in the pattern; None where it does not have them all."""
        if self._blocks is None:
            return None
        return places_among(self._keys, keys)

    def _lay_out(self, positions: Array, inner: SymmetricPattern) -> None:
        """The pattern for pairs that are within reach, or nearly."""
        first, second, _ = self._pressed(positions, _MARGIN)
        pairs = position_variables(np.concatenate([self._nodes[first], self._nodes[second]], axis=1))
        own = np.column_stack([inner.columns, inner.rows])
        self._blocks = BlockPattern.of(np.full(inner.size // 3, 3), [own, pairs])
        self._keys = self._blocks.keys
        self._inner = places_among(self._blocks.pattern.keys, inner.keys)

    def bound(self, x: Array, step: Array) -> float:
        """Fraction of a step (3n,) [m] in which no yarns meet."""
        return self._list.safe_fraction(self._positions(x), self._positions(step))

    def passages(self, before: Array, after: Array, rows: Array) -> Array:
        """Rows of ``Passages`` with those on the way between control points (3n,) [m]."""
        known = Passages(self._strands, self._stiffness, rows)
        return known.along(self._positions(before), self._positions(after)).rows

    def lasting(self, rows: Array) -> int:
        """Passages that no opposite one undid."""
        return len(Passages(self._strands, self._stiffness, rows).lasting().rows)


class TouchingObjective:
    """An objective of the control points of all yarns, and their contact."""

    def __init__(self, inner: Objective, touch: SplineTouch) -> None:
        self._inner, self._touch = inner, touch

    @property
    def residual_scale(self) -> float:
        """Gradient norm that counts as 1."""
        return self._inner.residual_scale

    def value(self, x: Array) -> float:
        """Energy [J]."""
        return self._inner.value(x) + self._touch.value(x)

    def gradient(self, x: Array) -> tuple[float, Array]:
        """Energy [J] and gradient (3n,) [N]."""
        (value, gradient), (more, push) = self._inner.gradient(x), self._touch.gradient(x)
        return value + more, gradient + push

    def quadratic(self, x: Array) -> tuple[float, Array, QuadraticModel]:
        """Energy, gradient and second-order model."""
        value, gradient, model = self._inner.quadratic(x)
        assert isinstance(model, ShiftedHessian)
        more, push, whole = self._touch.quadratic(x, model)
        return value + more, gradient + push, whole
