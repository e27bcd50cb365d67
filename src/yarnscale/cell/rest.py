"""Rest shapes: patterns whose cell carries no coarse in-plane stress (HYLC20 §5.1, EST22 §7.2).

A pattern as drawn is not at rest: its yarns push and pull, and a cell at its periods is under stress. Two methods
remove it. ``shrunk_to_rest`` lets the periods follow until the stress is gone, the yarns keeping their own rest shape
(straight ones stay bent in the fabric: stockinette curls). ``estimated_rest`` keeps the periods and sets what the
yarns are at rest instead, as knitting and finishing do (nothing is left that could curl).
"""

from __future__ import annotations

import time
from dataclasses import dataclass, field, replace

import numpy as np

from yarnscale.arrays import Array
from yarnscale.cell.periodic import PeriodicCell
from yarnscale.cell.rest_estimate import estimated_rest
from yarnscale.cell.rest_outcome import (
    Progress,
    RestRound,
    RestShape,
    RestStatus,
    RestStress,
    described,
    note_round,
    outcome,
    rest_stress_ratio,
    shortened,
)
from yarnscale.cell.rest_shape import rebased, set_as_drawn
from yarnscale.checked import checked
from yarnscale.errors import InputError
from yarnscale.kinematics import ShellStrain
from yarnscale.numerics.newton import Watch
from yarnscale.yarn.pattern import YarnPattern
from yarnscale.yarn.stiffness import Materials

__all__ = [
    "SETTING",
    "RestRound",
    "RestShape",
    "RestStatus",
    "RestStress",
    "estimated_rest",
    "rebased",
    "rest_stress_ratio",
    "set_as_drawn",
    "settled",
    "shrunk_to_rest",
]


SETTING = 0.8
"""Default share of the drawn curvature and twist that yarns have at rest."""
LARGEST_STEP = 0.06
"""Largest change of a period in one step, relative."""
SMALLEST_STEP = 1e-5
"""A step of the periods below this is none: the stress is that of a strain of 1e-5."""


@checked
def settled(
    pattern: YarnPattern,
    material: Materials,
    *,
    setting: float = SETTING,
    shortening: float = 0.05,
    progress: Progress | None = None,
    watch: Watch | None = None,
) -> RestShape:
    """A drawn pattern as relaxed fabric at rest; the same result every time.

    The yarns take on most of the shape they are drawn in, as yarn ravelled from a fabric has (HYLC20 fig. 10; the
    rest curvatures published with it are those of the drawings), are shortened, and the periods follow
    (``shrunk_to_rest``): that keeps what is left of their bending, so that stockinette curls, and gives a fabric whose
    yarns touch. Where shear stress is left, as in twills, the yarns are set further (``estimated_rest``), at those
    periods or, failing that, at the drawn ones; the history then continues with the rounds of that search.

    setting: share of the drawn curvature and twist that the yarns have at rest. 0 leaves straight yarns as they
    are: ribs then draw in to half their width, and loose fabrics are as stiff as their yarns bend.
    shortening: share of the rest lengths taken away; more makes a tighter fabric. progress: called after every round;
    watch: of ``PeriodicCell``.
    Raises InputError for a setting outside [0, 1] or a shortening outside [0, 0.5].
    """
    if not 0.0 <= setting <= 1.0:
        raise InputError("setting is out of range", expected="0 to 1", found=setting)
    start = set_as_drawn(pattern, share=setting, lengths=False)
    shape = shrunk_to_rest(
        PeriodicCell(start, material, watch=watch), shortening=shortening, progress=progress
    )
    if shape.status is not RestStatus.SKEWED:
        return shape
    attempts = [shape]
    # At the periods that shrinking found; where that is too tight to lose its shear stress, at those of the drawing.
    for source, share, rounds in ((shape.pattern, 0.0, 60), (start, 0.1, 200)):
        cell = PeriodicCell(source, material, watch=watch)
        attempts.append(estimated_rest(cell, shortening=share, max_rounds=rounds, progress=progress))
        if attempts[-1].converged:
            break
    last, seconds = attempts[-1], sum(attempt.seconds for attempt in attempts)
    history = tuple(entry for attempt in attempts for entry in attempt.history)
    return described(last.pattern, pattern, last.status, last.stress, history, seconds)


def shrunk_to_rest(
    cell: PeriodicCell, *, shortening: float = 0.0, max_rounds: int = 60, progress: Progress | None = None
) -> RestShape:
    """Put yarns under tension by shortening them and let the periods follow to the minimum of the energy.

    The energy of the period, stretch, bending, twist and contact together, is minimised over both periods by Newton
    steps with the exact stress and moduli, safeguarded by its decrease; the pattern is redrawn at every equilibrium
    reached (``rebased``). Rest curvatures and twists of the yarns stay. Shear stress cannot vanish so (the
    periods stay orthogonal) and bending stress need not (HYLC20 §5.1, after Leaf et al. 2018).

    shortening: share of the rest lengths taken away first; more makes a tighter fabric.
    Raises InputError for a shortening outside [0, 0.5].
    """
    began = time.perf_counter()
    search = _Shrinking(shortened(cell, shortening), cell.pattern, progress)
    status = search.run(max_rounds)
    return outcome(search.cell, cell.pattern, status, search.history, began)


@dataclass
class _Shrinking:
    """Newton's method in the two periods; ``cell`` is always drawn at its own equilibrium ``state``."""

    cell: PeriodicCell
    drawn: YarnPattern
    progress: Progress | None
    history: list[RestRound] = field(default_factory=list)

    def run(self, max_rounds: int) -> RestStatus:
        self.state = self.cell.relax()
        self._redraw()
        if not self.state.converged:
            return RestStatus.NOT_RELAXED
        for _ in range(max_rounds):
            step, small = self._newton_step()
            if small:
                return RestStatus.CONVERGED
            if not self._advance(step):
                return RestStatus.STALLED
        return RestStatus.ROUND_LIMIT

    def _redraw(self) -> None:
        """Draw the pattern at the state found and note the round."""
        pattern, state = rebased(self.cell.pattern, self.state), self.state
        scale = self.cell.pattern.area / pattern.area
        # The same equilibrium, with strains and areas counted from the new periods.
        stretch = np.array([1.0 + state.strain.s_x, 1.0, 1.0 + state.strain.s_y, 1.0, 1.0, 1.0])
        self.state = replace(
            state,
            strain=ShellStrain(),
            fluctuation=np.zeros_like(state.fluctuation),
            energy_density=state.energy_density * scale,
            stress=state.stress * stretch * scale,
        )
        self.cell = replace(self.cell, pattern=pattern)
        note_round(self.history, self.drawn, pattern, self.state, self.progress)

    def _newton_step(self) -> tuple[Array, bool]:
        """Step of (s_x, s_y), bounded, and whether it is none at a minimum."""
        stress = self.state.stress[[0, 2]]
        stiffness = self._stiffness()
        sizes, axes = np.linalg.eigh(stiffness)
        # Downhill along directions of negative stiffness too; soft ones are bounded by the length of the step.
        used = np.maximum(np.abs(sizes), 1e-6 * np.abs(sizes).max())
        step = -axes @ ((axes.T @ stress) / used)
        longest = float(np.abs(step).max())
        small = longest < SMALLEST_STEP and sizes[0] > 0.0
        return step * min(1.0, LARGEST_STEP / max(longest, 1e-300)), small

    def _stiffness(self) -> Array:
        """∂²Ψ/∂(s_x, s_y)² (2, 2); by differences of stress where the minimum is too flat for moduli."""
        try:
            return self.cell.moduli(self.state)[np.ix_([0, 2], [0, 2])]
        except ArithmeticError:
            sides = [self.cell.relax(ShellStrain(s_x=1e-3), start=self.state)]
            sides.append(self.cell.relax(ShellStrain(s_y=1e-3), start=self.state))
            slope = np.array([(side.stress - self.state.stress)[[0, 2]] / 1e-3 for side in sides])
            return 0.5 * (slope + slope.T)

    def _advance(self, step: Array) -> bool:
        """Take the step or a fraction of it that lowers the energy, and redraw."""
        before, slope = self.state, float(self.state.stress[[0, 2]] @ step)
        for _ in range(8):
            state = self.cell.relax(ShellStrain(s_x=step[0], s_y=step[1]), start=before)
            decrease = before.energy_density - state.energy_density
            force = float(np.abs(state.stress[[0, 2]]).max())
            calmer = force < 0.5 * float(np.abs(before.stress[[0, 2]]).max())
            if state.converged and (decrease > -1e-4 * slope or (calmer and abs(step).max() < 1e-3)):
                self.state = state
                self._redraw()
                return True
            step, slope = 0.5 * step, 0.5 * slope
        return False
