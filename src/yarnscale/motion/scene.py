"""What can be simulated, of cloth and of yarns alike, and the outcome."""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

from yarnscale.motion.body import Body, State
from yarnscale.motion.run import Run, RunProgress, simulate
from yarnscale.motion.schedule import Schedule
from yarnscale.motion.unfulfilled import Unfulfilled

Result = TypeVar("Result")
"""The outcome of a kind of scenes, a ``SimulatedOutcome``."""


class SimulatedScene(ABC, Generic[State, Result]):
    """A first state, a schedule, and a body that moves.

    may_give_way: whether motion of handles, grips and obstacles may remain unfulfilled; else such a run fails.
    """

    start: State
    schedule: Schedule
    may_give_way: bool

    @property
    @abstractmethod
    def settings(self) -> dict[str, object]:
        """Everything that a run depends on, by name."""

    @property
    @abstractmethod
    def body(self) -> Body[State]:
        """What moves. Raises InputError for numbers out of range."""

    @abstractmethod
    def outcome(self, body: Any, run: Run[State], seconds: float) -> Result:
        """The outcome of a run of its body that took some seconds."""


@dataclass(frozen=True, eq=False)
class SimulatedOutcome(Generic[State]):
    """Outcome of a scene: its run, seconds of work, and numbers of the last state by name."""

    scene: Any
    run: Run[State]
    seconds: float
    measures: Mapping[str, float | None]

    @property
    def state(self) -> State:
        """The last state."""
        return self.run.state

    @property
    def unfulfilled(self) -> tuple[Unfulfilled, ...]:
        """Motions of handles, grips and obstacles that were not carried out."""
        return self.run.unfulfilled

    @property
    def converged(self) -> bool:
        """Whether the whole schedule was completed."""
        return self.run.converged

    @property
    def succeeded(self) -> bool:
        """Whether the schedule was completed without faults and without forbidden unfulfilled motion."""
        fulfilled = self.scene.may_give_way or not self.unfulfilled
        return self.converged and not any(self.run.faults.values()) and fulfilled


def run_scene(
    scene: SimulatedScene[State, Result],
    *,
    on_step: Callable[[RunProgress], None] | None = None,
    on_frame: Callable[[int, State], None] | None = None,
    on_checkpoint: Callable[[Run[State]], None] | None = None,
    resume: Run[State] | None = None,
) -> Result:
    """Simulate a scene; callbacks and ``resume`` as in ``simulate``."""
    began, body = time.perf_counter(), scene.body
    run = simulate(
        body, scene.start, scene.schedule, on_step=on_step, on_frame=on_frame, on_checkpoint=on_checkpoint,
        resume=resume,
    )  # fmt: skip
    return scene.outcome(body, run, time.perf_counter() - began)
