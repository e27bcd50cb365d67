"""Bodies that move (cloth, yarns, or a volume around yarns), and the outcome of one step."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Generic, Literal, Protocol, TypeVar, get_args

from yarnscale.errors import InputError
from yarnscale.numerics.newton import Solution, Status

Method = Literal["explicit", "implicit"]


def checked_method(method: Method) -> Method:
    """The method of steps. Raises InputError for another name."""
    if method not in get_args(Method):
        raise InputError("method", expected="explicit or implicit", found=method)
    return method


class Timed(Protocol):
    """A state at a time."""

    @property
    def time(self) -> float:
        """Time [s]."""
        ...


State = TypeVar("State", bound=Timed)
"""All that the next step depends on: shape, velocity, history and the time [s]."""


@dataclass(frozen=True, eq=False)
class Step(Generic[State]):
    """One step of ``duration`` [s]: the state after it, how Newton ended, and the work.

    residual: forces left over in the body's units. unrest: the force of inertia per weight.
    """

    state: State
    status: Status
    duration: float
    iterations: int = 0
    factorisations: int = 0
    residual: float = 0.0
    unrest: float = 0.0

    @classmethod
    def of(cls, state: State, solution: Solution, duration: float, unrest: float) -> Step[State]:
        """An implicit step, by the outcome of its minimisation."""
        return cls(
            state, solution.status, duration, solution.iterations, solution.factorisations, solution.residual, unrest
        )  # fmt: skip


class Body(ABC, Generic[State]):
    """Something that moves: cloth, rods, spline yarns or a volume around yarns, as a run uses it.

    Energy, mass and bounds of motion are not part of it, since a run never needs them: each body minimises its own
    ``numerics.sums.SumOfEnergies``, which holds energy, inertia and springs, and its safe step lengths come from its
    contacts. A state carries its frames.

    tolerance: residual of a solved step; halvings: how often a step that is not kept is halved; off_place: distance
    from its place beyond which a motion was not carried out [m]; method: of steps; loose: whether steps that did not
    converge are kept, and forces left over act in the next one.
    """

    tolerance: float
    off_place: float
    halvings: int = 0
    method: Method = "implicit"
    loose: bool = False

    def step(
        self,
        state: State,
        duration: float,
        *,
        inertia: bool = True,
        iterations: int | None = None,
        until: float | None = None,
    ) -> Step[State]:
        """One step of ``duration`` [s]; inf: an equilibrium. Explicit steps must be shorter than ``longest_step``.

        inertia: without, the body begins and ends at rest. iterations: at most, None for as many as usual. until: time
        up to which prescribed motions go [s], None for the end of the step (of an equilibrium: where they are).
        The step is made, whether it is to be kept or not. Raises InputError.
        """
        if not duration > 0:
            raise InputError("time step", expected="a positive number of seconds", found=duration)
        moving = inertia and math.isfinite(duration)
        if self.method == "explicit" and not moving:
            raise InputError("steps without inertia", expected="the implicit method", found=self.method)
        end = state.time + duration if math.isfinite(duration) else state.time
        return self._step(state, duration, moving, iterations, end if until is None else until)

    @abstractmethod
    def _step(self, state: State, duration: float, inertia: bool, iterations: int | None, until: float) -> Step[State]:
        """``step`` with all of its arguments settled."""

    def keeps(self, step: Step[State]) -> bool:
        """Whether a step is accepted."""
        return step.status is not Status.INVALID if self.loose else step.status is Status.CONVERGED

    @abstractmethod
    def distances_from_places(self, state: State) -> dict[str, float]:
        """How far what is moved or held is from where it is to be, by name [m]."""

    def check_start(self, state: State) -> None:
        """Raise InputError where no motion can begin."""

    def stable_step(self, state: State) -> float:
        """An explicit step that is safely stable at a state [s]."""
        return math.inf

    def longest_step(self, state: State) -> float:
        """Longest step at a state [s]."""
        return self.stable_step(state) if self.method == "explicit" else math.inf

    def faults(self, state: State) -> Mapping[str, int]:
        """What is wrong with a frame: 1 or 0 for every kind of fault that is tested."""
        return {}

    def renewed(self, state: State, duration: float) -> State:
        """The state with which a run continues after a frame, in steps up to ``duration`` [s].

        It depends on ``state`` alone, so that a run resumed there takes the same steps.
        """
        return state

    def advance(
        self,
        state: State,
        duration: float,
        *,
        inertia: bool = True,
        iterations: int | None = None,
        unfinished: bool = False,
    ) -> Step[State]:
        """A step, halved until it is kept; where it never is, the given state with the failure's status.

        unfinished: keep what the iterations reach, whatever force is left over; it acts in the next step.
        """
        spent = factorisations = 0
        for halving in range(self.halvings + 1):
            step = self.step(state, duration / 2**halving, inertia=inertia, iterations=iterations)
            spent, factorisations = spent + step.iterations, factorisations + step.factorisations
            step = replace(step, iterations=spent, factorisations=factorisations)
            if (unfinished and step.status is Status.ITERATION_LIMIT) or self.keeps(step):
                return step
        return replace(step, state=state)
