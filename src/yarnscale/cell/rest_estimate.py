"""Rest shapes of yarns estimated so that the fabric is at rest as drawn (EST22 §7.2)."""

from __future__ import annotations

import time
from dataclasses import dataclass, field, replace

import numpy as np

from yarnscale.arrays import Array
from yarnscale.cell.equilibrium import Equilibrium
from yarnscale.cell.periodic import PeriodicCell
from yarnscale.cell.rest_outcome import (
    RATIO_LIMIT,
    RestRound,
    RestShape,
    RestStatus,
    RoundObserver,
    note_round,
    outcome,
    rest_stress_ratio,
    shortened,
)
from yarnscale.cell.rest_shape import rebased, set_as_drawn, with_rest_moved
from yarnscale.errors import InputError
from yarnscale.yarn.pattern import YarnPattern

LARGEST_MOMENTUM = 0.85
"""Share of the last reset that is repeated with the next where contact decays slowly."""
LENGTH_BOUND = 0.2
"""Largest relative change of a rest length."""
_SHORT_ROUNDS, _SHORT_ITERATIONS = 4, 6
"""How many solves stop early, and after how many iterations: contact may be strong and uneven at first."""


def estimated_rest(
    cell: PeriodicCell, *, shortening: float = 0.1, max_rounds: int = 200, progress: RoundObserver | None = None
) -> RestShape:
    """Move the rest shape of the yarns towards their present one, until the stress at the given periods is small.

    Solves for equilibrium alternate with resetting rest lengths, curvatures and twists to the shape reached; contact
    pushes the yarns apart a little less every time. The first solves stop after a few iterations (EST22 §7.2). Rest
    lengths stay within ``LENGTH_BOUND`` of the given.

    A reset covers half of the difference at first, so that the search ends at the first shape that is good enough,
    still slightly pre-tensed: yarns without any force would leave a slack cell. Where contact decays
    slowly, as between stiff yarns, it covers all of it and repeats a part of the last one. For the same reason the
    yarns are shortened first by the share ``shortening`` (then reset like all else): a drawing whose yarns hardly
    touch would stay slack.

    Raises InputError for a shortening outside [0, ``LENGTH_BOUND``].
    """
    if shortening > LENGTH_BOUND:
        raise InputError("shortening is out of range", expected=f"0 to {LENGTH_BOUND:g}", found=shortening)
    began = time.perf_counter()
    search = _Estimation(shortened(cell, shortening), cell.pattern, progress)
    status = search.run(max_rounds)
    return outcome(search.cell, status, search.history, began)


@dataclass
class _Estimation:
    """Alternating solves and resets; ``cell`` is drawn at the last equilibrium."""

    cell: PeriodicCell
    drawn: YarnPattern
    progress: RoundObserver | None
    history: list[RestRound] = field(default_factory=list)
    share: float = 0.5
    momentum: float = 0.0
    stepped_back: bool = False
    scale: Array | None = None

    def __post_init__(self) -> None:
        self.last = self.cell.pattern

    def run(self, max_rounds: int) -> RestStatus:
        before = None
        for index in range(max_rounds):
            short = index < _SHORT_ROUNDS
            limit = _SHORT_ITERATIONS if short else self.cell.options.max_iterations
            state = self.cell.with_options(max_iterations=limit).relax()
            self.cell = replace(self.cell, pattern=rebased(self.cell.pattern, state))
            note_round(self.history, self.drawn, self.cell.pattern, state, progress=self.progress)
            if not (short or state.converged):
                return RestStatus.NOT_RELAXED
            if state.converged and self._at_rest(state, anew=index % 5 == 0):
                return RestStatus.CONVERGED
            stress = state.stress[:3]
            if not (before is not None and self._step_back(before, stress)):
                if before is not None:
                    self._pace(float(np.abs(stress).max() / np.abs(before).max()))
                self._reset()
            before = None if short else stress
        return RestStatus.ROUND_LIMIT

    def _at_rest(self, state: Equilibrium, *, anew: bool) -> bool:
        """Whether the criterion holds; the stress at 5 % is solved for again only where that may decide."""
        near = self.scale is None or anew or (np.abs(state.stress[:3]) < RATIO_LIMIT * self.scale).all()
        if not near:
            return False
        ratio = rest_stress_ratio(self.cell)
        self.scale = ratio.scale
        return ratio.relaxed and ratio.largest < 0.9 * RATIO_LIMIT

    def _pace(self, decay: float) -> None:
        """Choose the next reset from how much the last one lowered the stress."""
        if decay > 1.0:
            self.momentum = 0.0
        elif decay > 0.7:
            self.share = 1.0
            self.momentum = min(LARGEST_MOMENTUM, self.momentum + 0.2)

    def _step_back(self, before: Array, stress: Array) -> bool:
        """Where the last reset went past zero stress, return to about where it was zero."""
        worst = int(np.abs(stress).argmax())
        passed = before[worst] * stress[worst] < 0.0 and not self.stepped_back
        if passed:
            share, now = stress[worst] / (stress[worst] - before[worst]), self.cell.pattern
            self.cell = replace(self.cell, pattern=with_rest_moved(now, now, self.last, share))
            self.momentum = 0.0
        self.stepped_back = passed
        return passed

    def _reset(self) -> None:
        """Move the rest shape towards the drawing, and on in the direction of the last reset."""
        pattern, given = self.cell.pattern, self.drawn.rest_length
        moved = with_rest_moved(set_as_drawn(pattern, share=self.share), self.last, pattern, self.momentum)
        length = np.clip(moved.rest_length, given * (1.0 - LENGTH_BOUND), given * (1.0 + LENGTH_BOUND))
        self.last, self.cell = pattern, replace(self.cell, pattern=replace(moved, rest_length=length))
