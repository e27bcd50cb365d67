"""What every simulation of a finite fabric consists of, whatever its yarns are, and its outcome."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, field, fields
from typing import NamedTuple

import numpy as np

from yarnscale.arrays import Array, Flags, Integers
from yarnscale.fabric.volume import BoundingVolume
from yarnscale.motion.body import Body, Method, State
from yarnscale.motion.integrator import Integrator
from yarnscale.motion.obstacles import Obstacle
from yarnscale.motion.run import Run
from yarnscale.motion.scene import SimulatedOutcome, SimulatedScene
from yarnscale.motion.schedule import FRAME, Schedule

USUAL_STEP = 1 / 240
"""Implicit steps of fabrics [s]; how far light fabric falls in longer ones is in docs/validation/fabric.md."""


def fabric_schedule(duration: float = 3.0, time_step: float = USUAL_STEP) -> Schedule:
    """Dynamics of a duration [s], a frame every 1/30 s. time_step: of implicit steps [s]. Raises InputError."""
    return Schedule(duration, time_step, to_rest=False, frame_interval=FRAME)


class YarnLines(NamedTuple):
    """Yarn i has the points offsets[i] … offsets[i + 1] − 1.

    offsets: (c + 1,); radii (c,) [m]; closed: (c,) whether the last point joins the first; colours: (c,) numbers.
    """

    offsets: Integers
    radii: Array
    closed: Flags
    colours: Integers


@dataclass(frozen=True, eq=False, kw_only=True)
class FabricScene(SimulatedScene[State, "FabricResult[State]"], ABC):
    """A finite fabric to simulate.

    schedule: of the motion. damping: rate at which non-rigid motion decays [1/s]. volume: around the yarns, whose
    control points are then the unknowns. method: of steps; explicit ones are as long as is stable. integrator: of
    implicit ones. may_give_way: whether grips may be kept from their prescribed places.
    """

    schedule: Schedule = field(default_factory=fabric_schedule)
    damping: float = 1.0
    volume: BoundingVolume | None = None
    method: Method = "implicit"
    integrator: Integrator = "euler"
    may_give_way: bool = False

    @property
    def settings(self) -> dict[str, object]:
        return {entry.name: getattr(self, entry.name) for entry in fields(self)}

    @property
    @abstractmethod
    def gravity(self) -> tuple[float, float, float]:
        """Gravity [m/s²]."""

    @property
    def obstacles(self) -> Sequence[Obstacle]:
        """Obstacles that the fabric touches."""
        return ()

    @property
    @abstractmethod
    def lines(self) -> YarnLines:
        """The yarns."""

    @abstractmethod
    def points(self, state: State) -> Array:
        """Points of all yarns at a state (n, 3) [m]."""

    @abstractmethod
    def centre_of_mass(self, state: State) -> Array:
        """Centre of mass (3,) [m]."""

    @abstractmethod
    def counts(self) -> dict[str, int]:
        """Sizes of the model; ``reduced_unknowns`` in a volume."""

    @abstractmethod
    def measures(self, state: State) -> dict[str, float]:
        """Numbers that describe the yarns at a state, by name."""

    def drops(self, state: State) -> dict[str, float | None]:
        """How far the centre of mass and the lowest point fell since the start [m]; None without gravity."""
        strength = float(np.linalg.norm(self.gravity))
        if strength == 0.0:
            return {"centre_drop": None, "lower_edge_drop": None}
        down = np.array(self.gravity) / strength
        fallen = self.centre_of_mass(state) - self.centre_of_mass(self.start)
        lowest = [float((self.points(s) @ down).max()) for s in (self.start, state)]
        return {"centre_drop": float(fallen @ down), "lower_edge_drop": lowest[1] - lowest[0]}

    def outcome(self, body: Body[State], run: Run[State], seconds: float) -> FabricResult[State]:
        return FabricResult(self, run, seconds, {**self.measures(run.state), **self.drops(run.state)})


@dataclass(frozen=True, eq=False)
class FabricResult(SimulatedOutcome[State]):
    """Outcome of a scene: its run, seconds of work, and numbers of the last state by name."""

    scene: FabricScene[State]

    def summary(self) -> dict[str, object]:
        """Everything but the shape, as plain values."""
        return {**self.scene.counts(), **self.run.summary(), "seconds": self.seconds, **self.measures}
