"""Contact between spline yarns wherever they meet, beside the constraints that keep their stitches.

Yarns touch where their distance is less than a share of their diameter, so that stitches at rest, which are drawn with
some overlap, are free of it. The energy is that of rods, on chords between points of the curves. It is infinite where
two chords meet, and no step brings a pair closer than a fifth of its distance: yarns do not pass through each other.
"""

from __future__ import annotations

import numpy as np

from yarnscale.arrays import Array
from yarnscale.fabric.bspline import ORDER, blending
from yarnscale.fabric.spline_points import SplinePoints, core_of
from yarnscale.numerics.assembly import position_variables
from yarnscale.numerics.block_pattern import BlockPattern
from yarnscale.numerics.factor import SymmetricPattern
from yarnscale.numerics.kkt import QuadraticModel
from yarnscale.numerics.newton import Objective
from yarnscale.numerics.regularisation import ShiftedHessian
from yarnscale.yarn.contact_list import ContactList, Contacts
from yarnscale.yarn.passages import Passages

CORE = 0.85
"""Diameter within which yarns press on each other, as a share of the whole."""


class SplineTouch:
    """Contact energy of all yarns of a fabric as a function of their control points (3n,) [m]."""

    def __init__(self, points: SplinePoints) -> None:
        self.points, fabric = points, points.fabric
        self._stiffness = core_of(points, CORE)
        self._strands, self._unit = self._stiffness.pattern.strands, self._stiffness.unit  # type: ignore[attr-defined]
        self._list, self._radius = ContactList(self._strands, self._stiffness), CORE * fabric.radius
        per, number = points.per_segment, self._strands.place  # an edge begins at its vertex's place on the yarn
        segment = np.minimum(number // per, fabric.segments_per_yarn - 1)
        self._nodes = fabric.segments[self._strands.yarn * fabric.segments_per_yarn + segment]
        first = (number - segment * per) / per
        self._shares = np.stack([blending(first), blending(first + 1.0 / per)], axis=1)
        self._segments = position_variables(fabric.segments)
        self._listed: Contacts | None = None

    def _positions(self, x: Array) -> Array:
        return (self.points.rows @ x).reshape(-1, 3) / self._radius

    def forget(self) -> None:
        """List contacts anew."""
        self._list.forget()

    def value(self, x: Array) -> float:
        """Energy [J]."""
        positions = self._positions(x)
        return self._unit * self._list.at(positions).stencils.value(positions.ravel())

    def gradient(self, x: Array) -> tuple[float, Array]:
        """Energy [J] and gradient (3n,) [N]."""
        positions, force = self._positions(x), np.zeros(self.points.rows.shape[0])  # type: ignore[index]
        value = self._list.at(positions).stencils.gradient(positions.ravel(), force)
        return self._unit * value, self._unit / self._radius * (self.points.rows.T @ force)

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

    def added(self, model: ShiftedHessian, x: Array) -> ShiftedHessian:
        """The model with the Hessian of contact, in a pattern that has both."""
        contacts = self._list.at(self._positions(x))
        if not contacts.stencils.count:
            return model
        if contacts is not self._listed:
            self._lay_out(contacts, model.pattern)
        entries = np.zeros(self._pattern.entries)
        entries[self._places] = model.entries
        energies, _, blocks = contacts.stencils.elements(self._positions(x).ravel())
        pressed = np.flatnonzero(energies)
        shares, corners = self._pair_shares[pressed], blocks[pressed].reshape(-1, 4, 3, 4, 3)
        whole = np.einsum("nva,nvcwd,nwb->nacbd", shares, corners, shares, optimize=True)
        whole = self._unit / self._radius**2 * whole.reshape(-1, 6 * ORDER, 6 * ORDER)
        lower = whole[:, self._lower[0], self._lower[1]]
        slots = self._slots[pressed]
        # Below −1: an entry of the diagonal that two unknowns of the pair share, see ``BlockPattern.slots``.
        twice = slots < 0
        slots, lower = np.where(twice, -slots - 2, slots), np.where(twice, 2.0 * lower, lower)
        entries += np.bincount(slots.ravel(), weights=lower.ravel(), minlength=len(entries))
        return ShiftedHessian(self._pattern, entries, model.diagonal)

    def _lay_out(self, contacts: Contacts, inner: SymmetricPattern) -> None:
        first, second = contacts.first, contacts.second
        nodes = np.concatenate([self._nodes[first], self._nodes[second]], axis=1)
        unknowns = position_variables(nodes)
        blocks = BlockPattern.of(np.full(inner.size // 3, 3), [self._segments, unknowns])
        self._pattern, size = blocks.pattern, inner.size
        whole, part = (np.repeat(np.arange(size), np.diff(p.starts)) * size + p.rows for p in (blocks.pattern, inner))
        self._places = np.searchsorted(whole, part)
        self._lower = np.tril_indices(unknowns.shape[1])
        slots = blocks.slots(unknowns).transpose(0, 2, 1).reshape(-1, len(self._lower[0]))
        self._slots = slots[: len(first)]
        self._pair_shares = np.zeros((len(first), 4, 2 * ORDER))
        self._pair_shares[:, :2, :ORDER] = self._shares[first]
        self._pair_shares[:, 2:, ORDER:] = self._shares[second]
        self._listed = contacts


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
        (value, gradient, model), (more, push) = self._inner.quadratic(x), self._touch.gradient(x)
        assert isinstance(model, ShiftedHessian)
        return value + more, gradient + push, self._touch.added(model, x)
