"""A run that goes on from any of its checkpoints ends as the run that never stopped."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from yarnscale.motion.handles import Handle
from yarnscale.motion.obstacles import Sphere
from yarnscale.motion.run import Run, simulate
from yarnscale.motion.schedule import Schedule
from yarnscale.shell.contact.cloth_contact import ContactSettings
from yarnscale.shell.dynamics.cloth import Cloth
from yarnscale.shell.dynamics.solver import ClothSolver, SolverOptions
from yarnscale.shell.materials.orthotropic import JERSEY
from yarnscale.shell.mesh import rectangle
from yarnscale.shell.state import ClothState

TOLERANCE = 1e-7


def swinging() -> tuple[Cloth, ClothState]:
    """A small sheet held at two corners that falls against a ball: velocities, folds, friction and contact."""
    mesh = rectangle(0.1, 0.1, 0.0125)
    material = replace(
        JERSEY, stretch_coupling=5.0, area=0.0, log_area=0.0, bend_weft=2e-5, bend_bias=1e-5, bend_warp=2e-5
    )
    start = ClothState.flat(mesh)
    corners = np.array([mesh.nearest_vertex((-0.05, y)) for y in (-0.05, 0.05)])
    held = Handle("corners", corners, start.positions[corners])
    ball = Sphere((0.0, 0.0, -0.03), 0.02)
    settings = ContactSettings(friction=0.3)
    return Cloth(mesh, material, (held,), contact=settings, obstacles=(ball,), damping=1.0), start


def run(schedule: Schedule, resume: Run | None = None) -> tuple[Run, list[Run], list[int]]:
    cloth, start = swinging()
    solver = ClothSolver(cloth, SolverOptions(tolerance=TOLERANCE))
    kept: list[Run] = []
    frames: list[int] = []
    outcome = simulate(
        solver,
        start,
        schedule,
        on_frame=lambda number, _: frames.append(number),
        on_checkpoint=kept.append,
        resume=resume,
    )
    return outcome, kept, frames


@pytest.mark.parametrize("to_rest", [False, True])
def test_from_every_checkpoint_the_end_is_the_same(to_rest: bool) -> None:
    schedule = Schedule(0.16, 0.02, to_rest=to_rest, frame_interval=0.04, longest_step=0.1, max_rest_steps=6)
    whole, kept, frames = run(schedule)
    # At the start, after every step, and at the end where that is no step.
    assert len(kept) == 1 + whole.steps + (not to_rest) and frames == list(range(len(frames)))
    speed = np.abs(whole.state.velocities).max()
    for place in kept[2::4] + kept[-1:]:
        outcome, _, rest = run(schedule, resume=place)
        assert outcome.status is whole.status and outcome.steps == whole.steps
        assert rest == list(range(place.frames, len(frames)))
        np.testing.assert_allclose(outcome.state.positions, whole.state.positions, atol=1e-6)
        np.testing.assert_allclose(outcome.state.velocities, whole.state.velocities, atol=1e-4 * max(speed, 1))
        assert outcome.state.time == whole.state.time


def test_a_forgotten_velocity_would_be_seen() -> None:
    """The tolerance above tells a state without its velocities apart."""
    schedule = Schedule(0.12, 0.02, to_rest=False)
    whole, kept, _ = run(schedule)
    place = kept[3]
    still = ClothState(place.state.positions, np.zeros_like(place.state.velocities), place.state.time)
    cloth, _ = swinging()
    solver = ClothSolver(cloth, SolverOptions(tolerance=TOLERANCE))
    other = simulate(solver, still, schedule, resume=Run(still, 0.0, steps=place.steps))
    assert np.abs(other.state.positions - whole.state.positions).max() > 1e-3
