"""How long something moves, in which steps, and when frames are due."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

from yarnscale.errors import InputError, not_negative, positive

FRAME = 1 / 30
"""Usual time between frames [s]."""


@dataclass(frozen=True)
class LoadSteps:
    """How the load is applied.

    first, smallest, largest: shares of the whole load in one step. easy: iterations of a static solve up to which the
    next step may grow. viscous_step: first Δt of the viscous flow [s]; viscous_steps: at most, for one equilibrium.
    """

    first: float = 0.1
    smallest: float = 1e-3
    largest: float = 0.25
    easy: int = 20
    viscous_step: float = 0.02
    viscous_steps: int = 40

    def __post_init__(self) -> None:
        if not 0 < self.smallest <= self.first <= self.largest <= 1:
            expected = "0 < smallest <= first <= largest <= 1"
            raise InputError("load steps", expected=expected, found=(self.smallest, self.first, self.largest))
        positive("viscous_step", self.viscous_step, "a positive number of seconds")


@dataclass(frozen=True)
class Schedule:
    """How long to simulate.

    duration: [s] of dynamics; time_step: [s]; to_rest: whether steps without inertia follow until the body rests.
    longest_step: of these [s]; rest_tolerance: unrest (inertial force per weight) that counts as rest.
    frame_interval: [s] between frames, None for the last only. rough_iterations: Newton iterations per step of the
    dynamics, kept unconverged, where only the rest counts (None: all). max_rest_steps: at most
    so many steps to rest. statics: instead of all this, equilibria at ``load_steps`` of the motion of handles and
    obstacles, which takes ``duration``.
    """

    duration: float
    time_step: float = 0.05
    to_rest: bool = True
    longest_step: float = 0.5
    rest_tolerance: float = 1e-2
    frame_interval: float | None = None
    max_rest_steps: int = 30
    rough_iterations: int | None = None
    statics: bool = False
    load_steps: LoadSteps = field(default_factory=LoadSteps)

    def __post_init__(self) -> None:
        if self.rough_iterations is not None and self.rough_iterations < 1:
            raise InputError("rough_iterations", expected="at least 1", found=self.rough_iterations)
        if self.statics and self.duration == 0:
            raise InputError("duration", expected="a positive number for statics", found=self.duration)
        for name in ("duration", "time_step", "longest_step", "rest_tolerance", "frame_interval"):
            if (value := getattr(self, name)) is not None:
                (not_negative if name == "duration" else positive)(name, value, "a positive number")
        for name in ("time_step", "frame_interval"):
            value = getattr(self, name)
            if value is not None and self.duration > MOST_STEPS * value:
                expected = f"at least duration/{MOST_STEPS:g} = {self.duration / MOST_STEPS:g} s"
                raise InputError(name, expected=expected, found=value)

    def animated(self) -> Schedule:
        """The motion alone, with bounded work: steps and frames of 1/30 s, ``ANIMATION_ITERATIONS`` of Newton each.

        Steps are kept as they are then; the forces left over act in the next one. Contact stays free of crossings.
        """
        frame = min(self.frame_interval or FRAME, FRAME)
        return replace(
            self,
            time_step=FRAME,
            to_rest=False,
            frame_interval=frame,
            rough_iterations=ANIMATION_ITERATIONS,
            statics=False,
        )


MOST_STEPS = 1e6
"""Steps and frames of a schedule."""
ANIMATION_ITERATIONS = 20
"""Iterations a step of an animation."""
