"""Runs of any body: steps that meet frames, halved steps, and going on from a checkpoint."""

from __future__ import annotations

import math
from dataclasses import dataclass

import pytest

from yarnscale.errors import InputError
from yarnscale.motion.body import Body, Step
from yarnscale.motion.run import Run, simulate
from yarnscale.motion.schedule import Schedule
from yarnscale.numerics.newton import Status


@dataclass(frozen=True)
class Angle:
    value: float
    speed: float
    time: float = 0.0


class Pendulum(Body[Angle]):
    """A weightless body of implicit steps x'' = −x that fail where they are longer than ``fails_above`` [s]."""

    tolerance, off_place, halvings = 1e-9, 0.1, 3

    def __init__(self, *, fails_above: float = math.inf, longest: float = math.inf) -> None:
        self.fails_above, self.longest, self.lengths = fails_above, longest, list[float]()

    def _step(self, state: Angle, duration: float, inertia: bool, iterations: int | None, until: float) -> Step[Angle]:
        ahead = state.value + duration * state.speed * inertia
        value = ahead / (1.0 + duration**2)
        speed = (value - state.value) / duration if inertia else 0.0
        status = Status.CONVERGED if duration <= self.fails_above else Status.STALLED
        self.lengths.append(duration)
        return Step(Angle(value, speed, until), status, duration, 1, unrest=abs(value - ahead))

    def distances_from_places(self, state: Angle) -> dict[str, float]:
        return {"bob": abs(state.value)}

    def longest_step(self, state: Angle) -> float:
        return self.longest

    def faults(self, state: Angle) -> dict[str, int]:
        return {"high": int(state.value > 0.5)}

    def check_start(self, state: Angle) -> None:
        if abs(state.value) > 3.0:
            raise InputError("angle", expected="up to 3", found=state.value)


def ran(body: Pendulum, schedule: Schedule, start: Angle = Angle(1.0, 0.0), **options) -> tuple[Run, list, list]:
    frames: list[tuple[int, float]] = []
    kept: list[Run[Angle]] = []
    run = simulate(
        body, start, schedule, on_frame=lambda number, state: frames.append((number, round(state.time, 9))),
        on_checkpoint=kept.append, **options,
    )  # fmt: skip
    return run, frames, kept


@pytest.mark.parametrize(
    ("step", "interval", "times", "steps"),
    [
        (0.1, 0.25, [0.0, 0.25, 0.5, 0.6], 3 + 3 + 1),
        (0.1, 0.3, [0.0, 0.3, 0.6], 6),
        (0.1, 0.099, [0.0, 0.099, 0.198, 0.297, 0.396, 0.495, 0.594, 0.6], 7),
        (0.3, 0.1, [0.0, 0.3, 0.6], 2),
        (0.1, None, [0.6], 6),
    ],
)
def test_steps_meet_frames_that_are_no_closer_than_steps(
    step: float, interval: float | None, times: list[float], steps: int
) -> None:
    body = Pendulum()
    run, frames, kept = ran(body, Schedule(0.6, step, to_rest=False, frame_interval=interval))
    assert frames == list(enumerate(times)) and run.frames == len(times)
    assert run.converged and run.steps == steps == len(body.lengths)
    assert max(body.lengths) <= 1.01 * step
    # One at the start, one a step, one at the end.
    assert len(kept) == steps + 2 and [place.status for place in kept[:-1]] == [None] * (steps + 1)
    assert run.faults == {"high": sum(math.cos(time) > 0.52 for time in times)}
    assert [entry.what for entry in run.unfulfilled] == ["bob"]


def test_the_body_says_how_long_steps_may_be() -> None:
    body = Pendulum(longest=0.03)
    run, frames, _ = ran(body, Schedule(0.2, 0.1, to_rest=False, frame_interval=0.1))
    assert run.steps == 8 and [time for _, time in frames] == [0.0, 0.1, 0.2]


def test_steps_that_fail_are_halved_and_the_last_good_state_is_kept() -> None:
    run, _, _ = ran(body := Pendulum(fails_above=0.03), Schedule(0.1, 0.1, to_rest=False))
    assert run.converged and body.lengths[:3] == [0.1, 0.05, 0.025] and run.loose_steps == 0
    run, frames, kept = ran(Pendulum(fails_above=1e-3), Schedule(0.1, 0.1, to_rest=False, frame_interval=0.1))
    assert run.status is Status.STALLED and run.state == Angle(1.0, 0.0) and run.newton_iterations == 4
    assert frames == [(0, 0.0)] and kept[-1].status is Status.STALLED


@pytest.mark.parametrize("to_rest", [False, True])
def test_every_checkpoint_leads_to_the_same_end(to_rest: bool) -> None:
    schedule = Schedule(0.6, 0.1, to_rest=to_rest, frame_interval=0.25, rest_tolerance=1e-3)
    whole, frames, kept = ran(Pendulum(), schedule)
    assert whole.converged and (not to_rest or abs(whole.state.value) < 0.1)
    for place in kept:
        run, rest, _ = ran(Pendulum(), schedule, Angle(math.nan, 0.0), resume=place)
        assert vars(run) == vars(whole)
        assert rest == frames[place.frames :]


def test_a_start_that_cannot_be_is_refused() -> None:
    with pytest.raises(InputError, match="angle"):
        ran(Pendulum(), Schedule(0.1), Angle(4.0, 0.0))


def test_what_is_no_step_is_refused() -> None:
    for duration in (0.0, -1.0, math.nan):
        with pytest.raises(InputError, match="time step"):
            Pendulum().step(Angle(1.0, 0.0), duration)
    body = Pendulum()
    body.method = "explicit"
    for how in ({"inertia": False}, {"duration": math.inf}):
        with pytest.raises(InputError, match="implicit"):
            body.step(Angle(1.0, 0.0), **({"duration": 0.1} | how))


@pytest.mark.parametrize("kind", ["to_rest", "statics"])
def test_what_explicit_steps_cannot_do_is_refused_before_the_first(kind: str) -> None:
    body = Pendulum()
    body.method = "explicit"
    schedule = Schedule(1.0, 0.1, to_rest=kind == "to_rest", statics=kind == "statics")
    with pytest.raises(InputError, match="implicit"):
        simulate(body, Angle(1.0, 0.0), schedule)
    assert not body.lengths
