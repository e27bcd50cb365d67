"""Whether yarns of a cell passed through each other between two of its shapes (``yarn.passages``)."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from yarnscale.arrays import Array
from yarnscale.cell.energy import CellEnergy
from yarnscale.cell.midsurface import Midsurface
from yarnscale.cell.poisson import cell_midsurface
from yarnscale.kinematics import ShellStrain
from yarnscale.yarn.passages import Passages
from yarnscale.yarn.strands import Strands

Shape = tuple[ShellStrain, Array]
"""A strain and a fluctuation (n, 3) [r]."""


def passages_between(energy: CellEnergy, before: Shape, after: Shape) -> Passages:
    """Passages on the straight motion of all copies that can meet on it, from one shape to another.

    Pairs that the contact list of a bent cell leaves out are left out.
    """
    moved = after[1] - before[1]
    slack = 2.0 * float(np.sqrt((moved * moved).sum(axis=1).max()))
    strands = energy.copies_within(slack, before[0], after[0])
    ends = (_nodes(energy, strands, *shape) for shape in (before, after))
    found = Passages(strands, energy.stiffness).along(*ends)
    bent = next((strain for strain, _ in (after, before) if not strain.is_flat), None)
    if bent is None or not len(found.rows):
        return found
    turning = Midsurface(bent, length=energy.pattern.radius).rotation_vectors(energy.placed(strands))
    first, second = found.rows[:, :2].astype(np.int64).T
    turned = turning[second] - turning[first]
    return replace(found, rows=found.rows[(turned * turned).sum(axis=1) < math.pi**2])


def _nodes(energy: CellEnergy, strands: Strands, strain: ShellStrain, fluctuation: Array) -> Array:
    """Positions (T·n, 3) [r] of copies in a shape."""
    if strain is energy.strain and strands is energy.strands:
        return energy.nodes.expand(np.append(fluctuation, np.zeros(energy.count)))[: -energy.count].reshape(-1, 3)
    surface = energy.surface if strain is energy.strain else cell_midsurface(energy.pattern, strain)
    points, rotation = surface.at(energy.placed(strands))
    return points + np.einsum("nij,nj->ni", rotation, np.tile(fluctuation, (len(strands.tiles), 1)))


def _shape(energy: CellEnergy, x: Array, strain: ShellStrain | None = None) -> Shape:
    return strain or energy.strain, energy.split(x)[0]


def passages_from_drawing(energy: CellEnergy, x: Array) -> Passages:
    """Those on the motion to a free vector from the rest shape carried to its state, û = 0, entangled as drawn."""
    return passages_between(energy, _shape(energy, np.zeros_like(x)), _shape(energy, x))


def has_passages(energy: CellEnergy, x: Array) -> bool:
    """Whether the straight motion from the drawing to a free vector takes yarns through each other.

    If not, both are the same fabric; if so, they may be.
    """
    return len(passages_from_drawing(energy, x).lasting().rows) > 0


def linked_differently(energy: CellEnergy, x: Array) -> bool:
    """Whether linking numbers of a free vector are not those of the drawing: it is another fabric then."""
    return passages_from_drawing(energy, x).changes_links()


def jump_is_safe(energy: CellEnergy, x: Array, origin: ShellStrain) -> bool:
    """Whether a fluctuation may be taken over from the state ``origin`` without a yarn passing another."""
    if np.array_equal(origin.vector, energy.strain.vector):
        return True
    found = passages_between(energy, _shape(energy, x, origin), _shape(energy, x))
    return len(found.lasting().rows) == 0


def safe_move(energy: CellEnergy, before: Array, after: Array) -> bool:
    """Whether no yarn passes another on the straight path between two free vectors of one state."""
    return len(passages_between(energy, _shape(energy, before), _shape(energy, after)).lasting().rows) == 0
