"""A cell of yarn pulled along one direction and free across, with friction or without, and bent.

F = U diag(1 + s, 1 − c) Uᵀ as for the shell (EST22 eq. 3 and §7.1). The contraction c is where the stress across
vanishes: Newton's method on that stress, each state starting from where the one before points to.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from yarnscale.arrays import Array, Flags
from yarnscale.cell.equilibrium import Equilibrium
from yarnscale.cell.friction import CellHistory, Solve
from yarnscale.cell.periodic import PeriodicCell
from yarnscale.homogeneous.histories import followed
from yarnscale.kinematics import ShellStrain, line_stretch
from yarnscale.swatches.measurements import Direction
from yarnscale.swatches.uniform_cycle import UniformCycle
from yarnscale.swatches.yarn_rest import beside
from yarnscale.yarn.friction import YarnFriction

_STEPS = 12
TOLERANCE = 1e-3
"""Largest stress across over the stress along from which the last step is not solved for; after it a few millionths
of the residuals are left."""
_LOOSEST = 5.0
"""How many times that still counts."""
_LARGEST_STEP = 0.1
_BESIDE = 10.0
"""How many times that is left to the last step next to a similar cell, whose slopes and contraction are known."""
_NEAR = 1e-4
"""Difference of the contraction from which the stiffness across is first taken."""
_SLACK = 0.02
"""Share of the largest stress that counts as none in unloading, and beside which the stress across does."""
_NOISE = 1e-6
"""Difference of the contraction below which that of the stress is no slope."""


@dataclass(frozen=True, eq=False)
class YarnCurve:
    """Uniaxial response of a cell; arrays (n,) at its stretches.

    stress: first Piola–Kirchhoff [N/m]. states: the equilibria, next to the contraction at which the stress across
    vanishes. converged: which states are at rest, also across. slopes: (n, 2) of the stress across and of the stress
    along by the contraction. solves: equilibria it took.
    """

    direction: Direction
    stretch: Array
    stress: Array
    contraction: Array
    converged: Flags
    states: tuple[Equilibrium, ...]
    slopes: Array
    solves: int


def pulled_strain(angle: float, stretch: float, contraction: float) -> tuple[Array, Array, Array]:
    """Strain z (6,) at a stretch s along an angle from the course [rad] and a contraction c across; ∂z/∂s and ∂z/∂c."""
    cos, sin = math.cos(angle), math.sin(angle)
    length, width = 1.0 + stretch, 1.0 - contraction
    along, across = np.array([cos**2, cos * sin, sin**2]), np.array([sin**2, -cos * sin, cos**2])
    xx, xy, yy = length**2 * along + width**2 * across
    side, area = np.sqrt([xx, yy]), math.sqrt(xx * yy)

    def slope(change: Array) -> Array:
        shear = (change[1] - 0.5 * xy * (change[0] / xx + change[2] / yy)) / area
        return np.array([0.5 * change[0] / side[0], shear, 0.5 * change[2] / side[1], 0.0, 0.0, 0.0])

    strain = np.array([side[0] - 1.0, xy / area, side[1] - 1.0, 0.0, 0.0, 0.0])
    return strain, slope(2.0 * length * along), slope(-2.0 * width * across)


def pulled(
    cell: PeriodicCell,
    direction: Direction,
    stretches: Array,
    *,
    near: YarnCurve | None = None,
    tolerance: float = TOLERANCE,
) -> YarnCurve:
    """Stretch a cell that is at rest, state by state in rising order.

    near: the curve of a similar cell at the same stretches, whose states are started from. tolerance: of the stress
    across, relative to the stress along; what is left of it goes by a last step that is not solved for.
    """
    path = _Path(cell, direction.angle, tolerance)
    states: list[_State] = []
    for k, stretch in enumerate(stretches):
        if len(states) > 1 and not (states[-2].good or states[-1].good):
            # Beyond two states that nothing brings to rest, looking for more is a waste.
            states.append(replace(states[-1], good=False))
        elif near is None or not near.converged[k]:
            states.append(path.advance(float(stretch)))
        else:
            states.append(path.beside(near, k))
    return YarnCurve(
        direction,
        np.array(stretches, np.float64),
        np.array([state.along for state in states]),
        np.array([state.width for state in states]),
        np.array([state.good for state in states]),
        tuple(state.equilibrium for state in states),
        np.array([state.slopes for state in states]),
        path.solves,
    )


def cycled(cell: PeriodicCell, direction: Direction, stretches: Array, friction: YarnFriction) -> UniformCycle | None:
    """Stretch a cell that is at rest, with friction of its yarns, state by state in rising order, and unload it.

    Unloading ends where no stress is left. None where the cell cannot follow.
    """
    path, rest = _Path(cell, direction.angle, TOLERANCE, nearby=True), cell.relax()
    if not rest.usable:
        return None

    def solver(stretch: float) -> Solve:
        return lambda rubbing, near: path.follow(rubbing, stretch, near)

    start, values = CellHistory.begin(cell, friction, rest), np.asarray(stretches, np.float64).tolist()
    there = list(followed(start, 0.0, values, solver))
    if len(there) < len(values):
        return None
    loading, across = np.array([_along(history.state, direction.angle) for history in there]).T
    unloading = np.zeros(len(values) + 1)
    unloading[-1], largest, reached = loading[-1], float(loading.max()), len(values)
    path.floor = _SLACK * largest
    for history in followed(there[-1], values[-1], [*values[-2::-1], 0.0], solver):
        reached -= 1
        unloading[reached] = _along(history.state, direction.angle)[0]
        if unloading[reached] <= 0.0:
            break
    if unloading[reached] > path.floor and reached > 0:
        return None
    stretch, width = (np.append(0.0, part) for part in (values, across))
    loading = np.append(_along(rest, direction.angle)[0], loading)
    return UniformCycle(direction, stretch, loading, unloading, width)


def _along(state: Equilibrium, angle: float) -> tuple[float, float]:
    """Stress along [N/m] and contraction across."""
    strain = state.strain.vector
    length = line_stretch(strain, angle)[0]
    area = (1.0 + strain[0]) * (1.0 + strain[2]) * math.sqrt(1.0 - strain[1] ** 2)
    width = 1.0 - area / length
    return float(state.stress @ pulled_strain(angle, length - 1.0, width)[1]), width


@dataclass(frozen=True, eq=False)
class _State:
    """An equilibrium at a contraction (width): its stress across and along, their slopes by it, whether it counts."""

    equilibrium: Equilibrium
    width: float
    across: float
    along: float
    slopes: Array
    good: bool = True

    def small(self, tolerance: float, floor: float) -> bool:
        """Whether the stress across is, beside the stress along, which counts as no less than ``floor``."""
        return abs(self.across) <= tolerance * max(abs(self.along), floor)

    def freed(self) -> _State:
        """What is left of the stress across taken away along the slopes."""
        if not self.slopes[0] > 0:
            return self
        step = -self.across / self.slopes[0]
        return replace(self, width=self.width + step, across=0.0, along=self.along + self.slopes[1] * step)


class _Path:
    """Follows the states at zero stress across from rest; nearby: as of ``PeriodicCell.relax``."""

    def __init__(
        self, cell: PeriodicCell, angle: float, tolerance: float, *, nearby: bool = False, floor: float = 1e-3
    ) -> None:
        self.tolerance, self.floor = tolerance, floor
        self.cell, self.angle, self.nearby = cell, angle, nearby
        self.last: Equilibrium | None = None
        self.slopes = np.full(2, np.nan)
        self.history: list[tuple[float, float]] = [(0.0, 0.0)]
        self.solves = 0

    def advance(self, stretch: float) -> _State:
        """The state at the next stretch."""
        return self._found(stretch, self._ahead(stretch), self.last)

    def follow(self, cell: PeriodicCell, stretch: float, near: Equilibrium) -> Equilibrium | None:
        """The equilibrium of a cell, whose friction remembers the last one, at the next stretch; None without any."""
        self.cell = cell
        (before, narrow), (last, width) = self.history[-2:] if len(self.history) > 1 else [(0.0, 0.0)] * 2
        rate = (width - narrow) / (last - before) if last != before else 0.0
        state = self._found(stretch, width + rate * (stretch - last), near)
        return state.equilibrium if state.good else None

    def beside(self, near: YarnCurve, k: int) -> _State:
        """The state next to the k-th one of another curve."""
        usual, self.cell, self.slopes = self.cell, beside(self.cell), near.slopes[k]
        found = self._found(float(near.stretch[k]), float(near.contraction[k]), near.states[k], _BESIDE)
        self.cell = usual
        return found

    def _found(self, stretch: float, width: float, start: Equilibrium | None, factor: float = 1.0) -> _State:
        tolerance = factor * self.tolerance
        state = self._solve(stretch, width, start)
        lower, upper = -np.inf, np.inf
        for _ in range(_STEPS):
            if not state.good or state.small(tolerance, self.floor):
                break
            # The stress across, ∂ψ/∂c, rises with c at a minimum.
            lower, upper = (state.width, upper) if state.across < 0 else (lower, state.width)
            if np.isnan(self.slopes[0]):
                self._keep_up(state, self._solve(stretch, state.width + _NEAR, state.equilibrium))
            soft = self.slopes[0] > 0
            step = -state.across / self.slopes[0] if soft else -0.03 * float(np.sign(state.across))
            step = float(np.clip(step, -_LARGEST_STEP, _LARGEST_STEP))
            if not lower < state.width + step < upper:
                step = 0.5 * (lower + upper) - state.width if np.isfinite(lower + upper) else step
            further = self._solve(stretch, state.width + step, state.equilibrium)
            self._keep_up(state, further)
            state = further
        state = replace(state, slopes=self.slopes, good=state.good and state.small(_LOOSEST * tolerance, self.floor))
        if state.good:
            self.last = state.equilibrium
            state = state.freed()
            self.history.append((stretch, state.width))
        return state

    def _keep_up(self, before: _State, after: _State) -> None:
        """Slopes from two states at one stretch."""
        if after.good and abs(after.width - before.width) > _NOISE:
            change = np.array([after.across - before.across, after.along - before.along])
            self.slopes = change / (after.width - before.width)

    def _ahead(self, stretch: float) -> float:
        """Contraction on the parabola through the last three states."""
        points = np.array(self.history[-3:])
        if len(points) == 1:
            return 0.0
        return float(np.polyval(np.polyfit(points[:, 0], points[:, 1], len(points) - 1), stretch))

    def _solve(self, stretch: float, width: float, start: Equilibrium | None) -> _State:
        self.solves += 1
        strain, by_stretch, by_width = pulled_strain(self.angle, stretch, width)
        found = self.cell.relax(ShellStrain.from_vector(strain), start=start, nearby=self.nearby)
        across, along = float(found.stress @ by_width), float(found.stress @ by_stretch)
        return _State(found, width, across, along, self.slopes, found.usable)


def bending_stiffness(cell: PeriodicCell, directions: Sequence[Direction]) -> Array:
    """k of the energy k κ² per area of a cylinder bent along directions, of a flat cell at rest, (n,) [J] (EST22 §5.2).

    Half of the second derivative of the energy density, yarns following. Not a number where the cell has no
    equilibrium that moduli could be taken at.
    """
    state = cell.relax()
    if not state.usable:
        return np.full(len(directions), np.nan)
    try:
        moduli = cell.moduli(state)
    except ArithmeticError:
        return np.full(len(directions), np.nan)
    along = np.array([[np.cos(d.angle), np.sin(d.angle)] for d in directions])
    curved = np.zeros((len(directions), 6))
    curved[:, 3:] = np.column_stack([along[:, 0] ** 2, along[:, 0] * along[:, 1], along[:, 1] ** 2])
    return 0.5 * np.einsum("ni,ij,nj->n", curved, moduli, curved)
