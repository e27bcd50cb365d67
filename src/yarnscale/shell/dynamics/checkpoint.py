"""Where a run of cloth stands: all that is needed to go on as if it had never stopped."""

from __future__ import annotations

from dataclasses import dataclass

from yarnscale.numerics.newton import Status
from yarnscale.shell.state import ClothState
from yarnscale.unfulfilled import Unfulfilled


@dataclass(frozen=True, eq=False)
class Checkpoint:
    """A run between two steps.

    state: reached. begin: time at which the schedule began [s]. frames: written so far; next_frame: time from which
    the next is due [s]; shown: whether the state is the last frame. steps, iterations, loose: work done. crossed,
    crossed_bodies: frames in which anything, or the cloth and a body, cross. rest_step: length of the next step on the
    way to rest [s], None during the dynamics; rest_steps: done of these. unrest: of the last step. status: how the run
    ended, None while it goes on. unfulfilled: motions that were not carried out up to now.
    """

    state: ClothState
    begin: float
    frames: int = 0
    next_frame: float = 0.0
    shown: bool = False
    steps: int = 0
    iterations: int = 0
    loose: int = 0
    rest_step: float | None = None
    rest_steps: int = 0
    unrest: float = 0.0
    status: Status | None = None
    crossed: int = 0
    crossed_bodies: int = 0
    unfulfilled: tuple[Unfulfilled, ...] = ()
