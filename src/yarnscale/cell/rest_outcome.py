"""What counts as a cell at rest, and the outcome of a search for a rest shape."""

from __future__ import annotations

import enum
import time
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from yarnscale.arrays import Array
from yarnscale.cell.equilibrium import Equilibrium
from yarnscale.cell.periodic import PeriodicCell
from yarnscale.errors import InputError
from yarnscale.kinematics import COMPONENTS, ShellStrain
from yarnscale.yarn.pattern import YarnPattern

RATIO_STRAIN = 0.05
"""Strain whose stress the stress at rest is compared with."""
RATIO_LIMIT = 0.01
"""Largest ratio of a fabric at rest."""


class RestStatus(enum.Enum):
    """How the search for a rest shape ended; the value is the message."""

    CONVERGED = "at rest: the coarse stress is below its limit"
    STALLED = "stalled: stress is left that no change of the periods takes away"
    ROUND_LIMIT = "stopped at the limit of rounds"
    SKEWED = "at rest but for shear stress, which periods at a right angle cannot release"
    NOT_RELAXED = "the cell found no equilibrium"


@dataclass(frozen=True, eq=False)
class RestStress:
    """In-plane stress of a cell at rest against its stress at 5 % strain.

    at_rest: ∂Ψ/∂(s_x, s_a, s_y, II11, II12, II22) of the undeformed cell [J/m², J/m].
    course, shear, wale: ∂Ψ/∂s_x at s_x = 0.05, ∂Ψ/∂s_a at s_a = 0.05, ∂Ψ/∂s_y at s_y = 0.05 [J/m²].
    relaxed: whether all four equilibria converged.
    """

    at_rest: Array
    course: float
    shear: float
    wale: float
    relaxed: bool

    @property
    def ratios(self) -> Array:
        """|∂Ψ/∂s_x|, |∂Ψ/∂s_a|, |∂Ψ/∂s_y| at rest over course, the larger of course and wale, and wale (3,)."""
        return np.abs(self.at_rest[:3]) / self.scale

    @property
    def scale(self) -> Array:
        """What ``ratios`` are counted in (3,) [J/m²]."""
        course, wale = abs(self.course), abs(self.wale)
        return np.maximum(np.array([course, max(course, wale), wale]), 1e-300)

    @property
    def largest(self) -> float:
        """The largest of ``ratios``; at most 0.01 for a fabric at rest."""
        return float(self.ratios.max())


@dataclass(frozen=True)
class RestRound:
    """One round of a search.

    stretch: periods over those the search began with (x, y). stress: ∂Ψ/∂(s_x, s_a, s_y) [J/m²]. energy: of the
    period [J]. iterations: of the equilibrium solve.
    """

    stretch: tuple[float, float]
    stress: tuple[float, float, float]
    energy: float
    iterations: int


@dataclass(frozen=True, eq=False)
class RestShape:
    """Outcome of a search for a rest shape; ``status`` says whether it is one.

    pattern: the pattern reached, also where the search did not end well. stress: how far it is from rest.
    history: its rounds. seconds: wall time.
    """

    pattern: YarnPattern
    status: RestStatus
    stress: RestStress
    history: tuple[RestRound, ...]
    seconds: float

    def __repr__(self) -> str:
        ratio = 100.0 * self.stress.largest
        return f"RestShape({self.status.value}: {self.pattern!r}, stress {ratio:.2g} % of that at 5 % strain)"

    @property
    def converged(self) -> bool:
        """Whether the pattern is at rest."""
        return self.status is RestStatus.CONVERGED


RoundObserver = Callable[[RestRound], None]
"""Called after every round."""


def rest_stress_ratio(cell: PeriodicCell) -> RestStress:
    """How large the coarse stress at rest is against that at 5 % strain.

    The criterion of rest, in-plane: |∂Ψ/∂s_x(0)| ≤ 0.01 |∂Ψ/∂s_x(s_x = 0.05)|, the same for s_y, and |∂Ψ/∂s_a(0)|
    ≤ 0.01 of the larger of the two. Bending stress has no part in it: a fabric that curls has ∂Ψ/∂II ≠ 0 when flat.
    """
    rest = cell.relax()
    strained = [cell.relax(ShellStrain(**{name: RATIO_STRAIN}), start=rest) for name in COMPONENTS[:3]]
    course, shear, wale = (float(state.stress[k]) for k, state in enumerate(strained))
    return RestStress(rest.stress, course, shear, wale, all(state.converged for state in (rest, *strained)))


def shortened(cell: PeriodicCell, shortening: float) -> PeriodicCell:
    """The cell with all rest lengths shortened by a share; InputError outside [0, 0.5]."""
    if not 0.0 <= shortening <= 0.5:
        raise InputError("shortening is out of range", expected="0 to 0.5", found=shortening)
    lengths = cell.pattern.rest_length * (1.0 - shortening)
    return replace(cell, pattern=replace(cell.pattern, rest_length=lengths))


def note_round(
    history: list[RestRound],
    drawn: YarnPattern,
    pattern: YarnPattern,
    state: Equilibrium,
    *,
    progress: RoundObserver | None,
) -> None:
    """Add a round, a state of the pattern, to the history and report it."""
    x, y = (pattern.period * (1.0 + state.strain.vector[[0, 2]]) / drawn.period).tolist()
    course, shear, wale = state.stress[:3].tolist()
    energy = state.energy_density * pattern.area
    history.append(RestRound((x, y), (course, shear, wale), energy, state.iterations))
    if progress is not None:
        progress(history[-1])


def outcome(cell: PeriodicCell, status: RestStatus, history: list[RestRound], began: float) -> RestShape:
    """The outcome with its criterion measured, whatever the search believes."""
    stress = rest_stress_ratio(cell)
    if status is RestStatus.CONVERGED:
        course, shear, wale = stress.ratios <= RATIO_LIMIT
        if not stress.relaxed:
            status = RestStatus.NOT_RELAXED
        elif not (course and wale):
            status = RestStatus.STALLED
        elif not shear:
            status = RestStatus.SKEWED
    return RestShape(cell.pattern, status, stress, tuple(history), time.perf_counter() - began)
