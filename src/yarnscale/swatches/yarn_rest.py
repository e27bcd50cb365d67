"""The rest shape of yarns after every change of their parameters, as a smooth function of them (EST22 §7.2).

EST22 alternates equilibria with resets of the rest shape until the coarse stress is small. How many rounds that takes
jumps with the parameters, and so would everything measured from there. Here the number of rounds is fixed, which makes
the rest shape as smooth as its equilibria. The periods then follow to zero coarse stress, as those of fabric on a table
do: stretch is counted from there, as measured stretch is from zero force.

Resets keep what is drawn. The drawing of a chart is a scheme, though: real rib folds to a fraction of its drawn width,
since yarn that was straight bends back as soon as the loops are off the needles, and finishing sets it in between. Such
a drawing draws in first, and the rounds begin from its drawn-in shape.

An almost equal cell takes the same stages, and each is solved from the neighbour's state at that stage.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from yarnscale.arrays import Array
from yarnscale.cell.equilibrium import Equilibrium
from yarnscale.cell.periodic import PeriodicCell
from yarnscale.cell.release import Release, flat_strain, released
from yarnscale.cell.rest_shape import rebased, set_as_drawn
from yarnscale.yarn.pattern import YarnPattern

LENGTH_BOUND = 0.2
"""Largest change of a rest length, relative (EST22 §7.2)."""
_SHIFT = 1e-6
"""Regularisation of solves from the states of a similar yarn, which are near: Newton's method takes half the steps."""
_REDRAWN, _AT_REST = 4, 1e-5
"""How often a cell is drawn anew at its released periods, until they change by less."""
_FEW = 6
_DRAWING = 6
"""Steps in which a drawing draws in."""


@dataclass(frozen=True)
class RestRule:
    """How the rest shape of a drawing is computed.

    rounds: equilibria after which the rest shape moves by ``share`` of the difference to them; 0: yarns keep the rest
    shape they are drawn with. short: so many of the rounds end after ``_FEW`` iterations, while contact is strong and
    uneven. release: whether the periods follow to zero stress.
    """

    rounds: int = 4
    share: float = 0.5
    release: bool = True
    short: int = 0


KEPT_PERIODS = RestRule(rounds=8, share=1.0, release=False, short=2)
"""EST22 §7.2 as written but for the fixed number of rounds: the periods stay, and some coarse stress is left."""


@dataclass(frozen=True, eq=False)
class RestStage:
    """An equilibrium before rest; matrix: of coarse stress by the periods (2, 2), where these are released."""

    state: Equilibrium
    matrix: Array | None = None


@dataclass(frozen=True, eq=False)
class RestedCell:
    """A cell at rest: its pattern is drawn at the equilibrium.

    change: of the drawn periods, (2,). solves: equilibria that it took. relaxed: whether all are usable. stages: in
    their order, None where one was left out.
    """

    cell: PeriodicCell
    change: Array
    solves: int
    relaxed: bool
    stages: tuple[RestStage | None, ...] = ()

    @property
    def stress(self) -> Array:
        """Coarse stress that is left, ∂Ψ/∂(s_x, s_a, s_y) (3,) [N/m]; NaN where the cell found no rest."""
        last = self.stages[-1] if self.stages else None
        return np.full(3, np.nan) if last is None else last.state.stress[:3]

    @property
    def energy(self) -> float:
        """Of one period at rest [J]; infinite where the cell found no rest."""
        last = self.stages[-1] if self.relaxed and self.stages else None
        return np.inf if last is None else last.state.energy_density * self.cell.pattern.area


class _Stages:
    """Stages so far, and those of a neighbouring cell to start from."""

    def __init__(self, near: RestedCell | None) -> None:
        self._near = () if near is None or not near.relaxed else near.stages
        self.passed: list[RestStage | None] = []

    @property
    def near(self) -> RestStage | None:
        """The neighbour's stage at this place."""
        place = len(self.passed)
        return self._near[place] if place < len(self._near) else None

    @property
    def start(self) -> Equilibrium | None:
        """The neighbour's equilibrium at this place."""
        return None if self.near is None else self.near.state

    @property
    def remaining(self) -> int | None:
        """How many stages the neighbour took from here; None where it took none, or without one."""
        return max(0, len(self._near) - len(self.passed)) or None


def rested_cell(
    cell: PeriodicCell, rule: RestRule, *, draw_in: float | None = None, near: RestedCell | None = None
) -> RestedCell:
    """Bring a drawn cell to rest; ``draw_in``: how far it draws in before (``drawn_in``), None not at all.

    near: an almost equal cell at rest by the same rule; its stages are started from, with the same outcome as without
    wherever no other rest is close.
    """
    drawn, periods, solves, stages = cell.pattern, np.ones(2), 0, _Stages(near)
    low, high = drawn.rest_length * (1.0 - LENGTH_BOUND), drawn.rest_length * (1.0 + LENGTH_BOUND)
    if draw_in is not None and rule.rounds:
        narrow = drawn_in(cell, draw_in, stages)
        if not narrow.relaxed:
            return narrow
        cell, solves, periods = narrow.cell, narrow.solves, 1.0 + narrow.change
    for number in range(rule.rounds):
        # A solve that stops on its way ends elsewhere from another start: it begins anew from the drawing.
        short = number < rule.short
        state = cell.with_options(max_iterations=_FEW).relax() if short else _relaxed(cell, stages)
        solves += 1
        if not (short or state.usable):
            return RestedCell(cell, periods - 1.0, solves, False)
        stages.passed.append(None if short else RestStage(state))
        pattern = set_as_drawn(rebased(cell.pattern, state), share=rule.share)
        cell = replace(cell, pattern=replace(pattern, rest_length=np.clip(pattern.rest_length, low, high)))
    if not rule.release:
        state = _relaxed(cell, stages)
        stages.passed.append(RestStage(state))
        cell, relaxed, solves = replace(cell, pattern=rebased(cell.pattern, state)), state.usable, solves + 1
        return RestedCell(cell, periods - 1.0, solves, relaxed, tuple(stages.passed))
    remaining, matrix = stages.remaining, None
    for _ in range(_REDRAWN if remaining is None else remaining):
        found = _released(cell, stages, matrix)
        cell, solves, periods = found.cell, solves + found.solves, periods * (1.0 + found.change)
        matrix = found.matrix
        # Redrawn, the constraint that holds yarns in place follows their new tangents: a little stress comes back.
        if not found.converged or (remaining is None and np.abs(found.change).max() < _AT_REST):
            break
    return RestedCell(cell, periods - 1.0, solves, found.converged, tuple(stages.passed))


def drawn_in(cell: PeriodicCell, share: float, stages: _Stages | None = None) -> RestedCell:
    """A cell drawn anew at a share, 0 to 1, of the change of periods that frees straight yarn of coarse stress.

    Rest curvatures and twists change as much: by that share they are those of the new shape, else
    those of the drawing. Rest lengths stay. share 0: the drawing at equilibrium.
    stages: two, the periods of straight yarn and the new shape.
    """
    stages = _Stages(None) if stages is None else stages
    drawn, change, solves = cell.pattern, np.zeros(2), 0
    if share > 0.0:
        end = _released(replace(cell, pattern=_set(drawn, 0.0)), stages)
        change, solves = share * end.change, end.solves
        if not end.converged:
            return RestedCell(cell, change, solves, False)
    else:
        stages.passed.append(None)
    loose, state = replace(cell, pattern=_set(drawn, 1.0 - share)), stages.start
    # From the drawing, not back from the end: yarns that have folded over each other would stay so.
    for part in np.arange(1, _DRAWING + 1) / _DRAWING if state is None and share > 0.0 else (1.0,):
        near = loose if stages.start is None else beside(loose)
        state = near.relax(flat_strain(part * change), start=state)
        solves += 1
        if not state.usable:
            return RestedCell(cell, change, solves, False)
    assert state is not None
    stages.passed.append(RestStage(state))
    shape = rebased(loose.pattern, state)
    shape = replace(shape, rest_curvature=drawn.rest_curvature, rest_twist=drawn.rest_twist)
    cell = replace(cell, pattern=set_as_drawn(shape, share=share, lengths=False))
    return RestedCell(cell, change, solves, True, tuple(stages.passed))


def _set(pattern: YarnPattern, share: float) -> YarnPattern:
    """The pattern whose yarns have a share of their rest curvature and twist."""
    return replace(pattern, rest_curvature=share * pattern.rest_curvature, rest_twist=share * pattern.rest_twist)


def beside(cell: PeriodicCell) -> PeriodicCell:
    """The cell with options for solves that start from states of a similar one."""
    return cell.with_options(shift=_SHIFT)


def _relaxed(cell: PeriodicCell, stages: _Stages) -> Equilibrium:
    """The equilibrium at the drawn periods, from the neighbour's at this stage if there is one."""
    return cell.relax() if stages.start is None else beside(cell).relax(start=stages.start)


def _released(cell: PeriodicCell, stages: _Stages, matrix: Array | None = None) -> Release:
    """Periods at zero stress; one stage. matrix: that of an almost equal cell, where no neighbour has one."""
    near = stages.near
    if near is None:
        found = released(cell, matrix=matrix)
    else:
        found = released(beside(cell), start=near.state, matrix=near.matrix)
    stages.passed.append(RestStage(found.state, found.matrix))
    return replace(found, cell=replace(found.cell, options=cell.options))
