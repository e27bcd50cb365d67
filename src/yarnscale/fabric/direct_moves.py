"""Ways on which no yarn passes another, and a count of those that did."""

from __future__ import annotations

from yarnscale.arrays import Array
from yarnscale.fabric.direct_energy import FabricEnergy
from yarnscale.yarn.passages import Passages

_MOST_PIECES = 400


def safe_way(energy: FabricEnergy, start: Array, goal: Array, count: PassageCount | None = None) -> Array:
    """The farthest state on the straight way to ``goal`` (4n,) that is reached without yarns passing each other."""
    x = start
    for _ in range(_MOST_PIECES):
        step = goal - x
        if not step.any():
            break
        fraction = energy.bound(x, step)
        x = goal if fraction >= 1.0 else x + fraction * step
        arrive(energy, x, count)
        if fraction < 1e-3:
            break
    return x


def arrive(energy: FabricEnergy, x: Array, count: PassageCount | None) -> None:
    """Carry frames to a state (4n,) that a step has reached, and count passages on the way there."""
    energy.anchor(x)
    if count is not None:
        count.follow(x)


class PassageCount:
    """How often a yarn passed through another on the way of a fabric, piece by piece.

    Yarns are linked after the way as they were before it exactly where no passage is left. ``follow`` takes the states
    in order; between two of them all vertices move straight, as they do in a Newton step.
    """

    def __init__(self, energy: FabricEnergy, start: Array) -> None:
        self._energy = energy
        self.begin(start, Passages(energy.strands, energy.stiffness).rows)

    def begin(self, x: Array, rows: Array) -> None:
        """Go on from a state (4n,) with the passages (m, 6) found before it."""
        self._last, self.found = x.copy(), Passages(self._energy.strands, self._energy.stiffness, rows)

    def follow(self, x: Array) -> None:
        """The next state (4n,)."""
        positions = self._energy.positions
        self._last, self.found = x.copy(), self.found.along(positions(self._last), positions(x))

    @property
    def passages(self) -> int:
        """Passages that no opposite one near the same place undid."""
        return len(self.found.lasting().rows)
