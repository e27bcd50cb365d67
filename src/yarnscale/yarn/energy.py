"""Energy of yarns as elastic rods that touch: stretch, bending with twist, contact (theory §1).

Lengths are counted in yarn radii and energies in E π r³ (``PatternStiffness``), so that tolerances and regularisation
suit every yarn. Full vectors are [positions of all nodes (3·T·n), twists (n)]; in a finite fabric, whose vertices are
its only nodes, they are the unknowns themselves.
"""

from __future__ import annotations

import copy
import math

import numpy as np
from numpy.typing import NDArray

from yarnscale.arrays import Array, Integers
from yarnscale.numerics.affine import CopiedNodes
from yarnscale.numerics.assembly import StencilSet, position_variables
from yarnscale.numerics.block_pattern import BlockPattern
from yarnscale.yarn.contact_list import SKIN, ContactList, Contacts, PlacedPairs
from yarnscale.yarn.rod import BEND_TWIST
from yarnscale.yarn.stiffness import PatternStiffness
from yarnscale.yarn.strands import Strands

PATTERN_MARGIN = 0.1
"""How much farther than they touch pairs have a place in the matrix [r]: more saves analyses, less keeps it sparse."""
NEARLY = 0.2
"""How much farther than they touch pairs are asked for a Hessian [r]: more saves slots, less saves kernels."""
NOT_TURNED = np.empty((0, 3, 3))


class RodEnergy:
    """Energy of the yarns of a stiffness: a sum of stencil energies, and its matrix by the free unknowns.

    ``set_anchors`` sets the frames; between two calls the energy is a function of the full vector alone.
    """

    def __init__(
        self,
        stiffness: PatternStiffness,
        strands: Strands,
        *,
        copies: CopiedNodes | None = None,
        symmetric: bool = False,
        turning: Array | None = None,
        margin: float = PATTERN_MARGIN,
    ) -> None:
        """copies: how nodes follow from free vertices; None: they are these. margin: as ``PATTERN_MARGIN`` [r].

        symmetric, turning: as in ``ContactList``.
        """
        self.stiffness, self.strands = stiffness, strands
        self.unit, self.count, self.radius = stiffness.unit, strands.count, stiffness.pattern.radius
        joints, ends = strands.joints, strands.ends
        nodes, turns = strands.edges_between(smooth=not stiffness.pattern.polyline)
        stretch = np.column_stack([stiffness.edge_parameters()[strands.edges], turns])
        self.stretch = StencilSet(stiffness.stretch_energy, position_variables(nodes), stretch, 4)
        before, scalars = strands.before[joints], 3 * self.count * len(strands.tiles)
        nodes = position_variables(np.stack([before, joints, ends[joints]], 1))
        self._joint_variables = np.column_stack([nodes, scalars + before % self.count, scalars + joints])
        self.contact_list = ContactList(strands, stiffness, symmetric=symmetric, turning=turning)
        self._copies, self._margin, self._positions_end = copies, margin, scalars
        self._rotation = NOT_TURNED if copies is None else copies.rotation
        self._others: tuple[StencilSet, ...] = ()
        self._rod_slots: list[NDArray[np.int32]] | None = None
        self.block: BlockPattern | None = None

    def set_anchors(self, anchors: Array, twist: Array) -> None:
        """Set the frames of all joints: (j, 12) in the order of ``ANCHORS``, and reference twists (j,) [rad]."""
        yarns, joints = self.stiffness.pattern, self.strands.joints
        bend, stiff = (values[joints] for values in self.stiffness.joint_stiffness())
        rest = yarns.rest_curvature[joints], yarns.rest_twist[joints]
        parameters = np.column_stack([anchors, twist, *rest, bend, stiff])
        self.bend_twist = StencilSet(BEND_TWIST, self._joint_variables, parameters, 3)

    def set_others(self, *stencils: StencilSet) -> None:
        """Set the stencils of other energies on the same nodes."""
        before, self._others = self._others, stencils
        if len(before) != len(stencils) or any(
            not np.array_equal(old.variables, new.variables) for old, new in zip(before, stencils, strict=True)
        ):
            self._rod_slots = None

    def with_copies(self, copies: CopiedNodes) -> RodEnergy:
        """The same with other copies, and with the contacts of this one."""
        other = copy.copy(self)
        other._copies, other._rotation = copies, copies.rotation
        return other

    def positions(self, full: Array) -> Array:
        """Positions of all nodes (T·n, 3) [r], a view."""
        return full[: self._positions_end].reshape(-1, 3)

    def contacts(self, full: Array) -> Contacts:
        """Contact stencils valid at a full vector."""
        return self.contact_list.at(self.positions(full))

    def forget_contacts(self) -> None:
        """List contacts anew, and lay out the matrix for them."""
        self.contact_list.forget()
        self.block = self._rod_slots = None

    # --- energy ---------------------------------------------------------------------------------------

    @property
    def _rods(self) -> tuple[StencilSet, ...]:
        return self.stretch, self.bend_twist, *self._others

    def value(self, full: Array) -> float:
        """Energy [E π r³]; inf where two yarns meet."""
        return _finite(sum(s.value(full) for s in (*self._rods, self.contacts(full).stencils)))

    def gradient(self, full: Array) -> tuple[float, Array]:
        """Energy, and the gradients of its terms (k, N) by the full vector."""
        terms, value = (*self._rods, self.contacts(full).stencils), 0.0
        forces = np.zeros((len(terms), len(full)))
        for stencils, force in zip(terms, forces, strict=True):
            value += stencils.gradient(full, force)
        return _finite(value), forces

    def hessian(self, full: Array) -> tuple[float, Array, BlockPattern, Array]:
        """``gradient`` with the matrix pattern and the entries of the exact Hessian by the free unknowns."""
        pairs, block, slots = self.placed(full)
        terms, value, entries = (*self._rods, pairs.stencils), 0.0, np.zeros(block.pattern.entries)
        forces = np.zeros((len(terms), len(full)))
        for stencils, force, own in zip(terms, forces, (*slots, pairs.slots), strict=True):
            value += stencils.hessian(full, force, own, self._rotation, entries)
        return _finite(value), forces, block, entries

    # --- matrix ---------------------------------------------------------------------------------------

    def placed(self, full: Array) -> tuple[PlacedPairs, BlockPattern, list[NDArray[np.int32]]]:
        """Pairs with a place in the matrix, its pattern, and the slots of the other terms.

        All pairs that touch have a place, and of those that nearly do the ones for which there is room.
        """
        contacts, block, slots = self.contacts(full), self.block, self._rod_slots
        pairs = contacts.placed
        if block is not None and slots is not None and pairs is not None and pairs.chosen.all():
            return pairs, block, slots
        gaps = self.contact_list.distances(contacts, self.positions(full)) - self.contact_list.reach
        if block is not None and slots is not None and pairs is not None and pairs.chosen[gaps < 0.0].all():
            return pairs, block, slots
        whole = contacts.stencils
        listed = self._unknowns(whole.variables)
        if block is None or slots is None or not block.covers(listed[gaps < 0.0]):
            rods = [self._unknowns(s.variables) for s in self._rods]
            if block is None or not all(map(block.covers, (*rods[2:], listed[gaps < 0.0]))):
                self.block = block = self._laid_out(rods, listed[gaps < self._margin], full)
            self._rod_slots = slots = [block.slots(unknowns) for unknowns in rods]
        chosen = gaps < min(self._margin, NEARLY)
        chosen[chosen] = block.covered(listed[chosen])
        stencils = StencilSet(whole.energy, whole.variables[chosen], whole.parameters[chosen], 4)
        contacts.placed = PlacedPairs(chosen, stencils, block.slots(listed[chosen]))
        return contacts.placed, block, slots

    def _unknowns(self, variables: Integers) -> Integers:
        return variables if self._copies is None else self._copies.unknowns(variables)

    def _laid_out(self, rods: list[Integers], near: Integers, full: Array) -> BlockPattern:
        """A pattern of the rods and of pairs within the margin, beyond the list where that is wide."""
        if self._margin > SKIN:
            reach = self.contact_list.reach + self._margin
            pairs = self.contact_list.pairs_within(self.positions(full), reach)
            near = self._unknowns(self.contact_list.variables(*pairs))
        return BlockPattern.of(np.repeat([3, 1], self.count), [*rods, near])

    # --- read-outs ------------------------------------------------------------------------------------

    def parts(self, full: Array) -> dict[str, float]:
        """Energy of stretch, bending with twist, and contact [J]."""
        parts = (self.stretch, self.bend_twist, self.contacts(full).stencils)
        names = ("stretch", "bend_twist", "contact")
        return {name: s.value(full) * self.unit for name, s in zip(names, parts, strict=True)}

    def gaps(self, full: Array) -> Array:
        """Distances of all listed pairs over the sum of their yarns' radii (N,)."""
        contacts, relative = self.contacts(full), self.stiffness.pattern.relative_radius
        diameters = relative[contacts.first] + relative[contacts.second % self.count]
        return self.contact_list.distances(contacts, self.positions(full)) / diameters


def _finite(value: float) -> float:
    return value if math.isfinite(value) else math.inf
