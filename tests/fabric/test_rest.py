"""Equilibria and dynamics to rest of yarns and volumes, by the loop that runs cloth too."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from yarnscale.drawing import library
from yarnscale.errors import InputError
from yarnscale.fabric.boundary import glue
from yarnscale.fabric.direct_energy import FabricEnergy
from yarnscale.fabric.direct_motion import FabricDynamics, MotionSettings
from yarnscale.fabric.direct_static import relaxed_sheet
from yarnscale.fabric.sheet import YarnSheet
from yarnscale.fabric.sheet_scene import stretch
from yarnscale.fabric.spline_knit import jersey
from yarnscale.fabric.spline_motion import SplineMotion
from yarnscale.fabric.volume import BoundingVolume
from yarnscale.motion.run import simulate
from yarnscale.motion.schedule import Schedule
from yarnscale.yarn.friction import YarnFriction
from yarnscale.yarn.material import YarnMaterial

WOOL = YarnMaterial.preset("wool")


def glued() -> tuple[FabricEnergy, MotionSettings]:
    sheet = YarnSheet.of(library.build("plain"), 2, 2)
    energy = FabricEnergy(sheet, WOOL, springs=glue(sheet, WOOL))
    return energy, MotionSettings((0.0, 0.0, 0.0), 5.0, YarnFriction(0.1), tolerance=1e-3)


@pytest.mark.parametrize("schedule", [Schedule(1.0, statics=True), Schedule(0.5, 1 / 60, max_rest_steps=60)])
def test_rods_end_in_an_equilibrium_between_their_grips(schedule: Schedule) -> None:
    """Grips pull with opposite forces, and steps without inertia from there on lead nowhere."""
    energy, settings = glued()
    scene = stretch(energy.sheet, amount=0.05, duration=schedule.duration)
    dynamics = FabricDynamics(energy, settings, scene.holds)
    run = simulate(dynamics, dynamics.start(), schedule)
    assert run.converged and run.unfulfilled == () and not run.state.velocity.any()
    dynamics.take_up(run.state)
    forces = scene.holds(run.state.time).forces(energy, run.state.x)
    pull = scene.force(energy, run.state.x, run.state.time)
    assert pull > 0.0
    np.testing.assert_allclose(forces.sum(axis=0), 0.0, atol=2e-2 * pull)
    still = dynamics.step(run.state, 1 / 60, inertia=False).state
    gone = np.abs(energy.positions(still.x - run.state.x)).max() * energy.radius
    assert gone < 0.02 * 9.81 / 60**2


def test_a_volume_of_splines_comes_to_rest_and_stays_there() -> None:
    fabric = jersey(3, 3, WOOL)
    volume = BoundingVolume.around(fabric.control, (4, 4))
    moving = SplineMotion(fabric, volume=volume, held=fabric.top, tolerance=1e-4)
    run = simulate(moving, moving.start, Schedule(0.0, 1 / 60, max_rest_steps=60))
    assert run.converged and run.unrest < 1e-2
    assert moving.energies(run.state)["gravity"] < 0.0 == moving.energies(run.state)["kinetic"]
    still = moving.step(run.state, 1 / 60).state
    gone = np.abs(moving.yarns(still).positions - moving.yarns(run.state).positions).max()
    assert gone < 0.02 * 9.81 / 60**2
    with pytest.raises(InputError, match="in a volume"):
        (full := SplineMotion(fabric, held=fabric.top)).step(full.start, 1 / 60, inertia=False)


def test_the_energy_of_a_motion_depends_on_it_alone() -> None:
    """Not on where the frames of the energy were before; nor that of a relaxed sheet."""
    energy, settings = glued()
    dynamics = FabricDynamics(energy, settings)
    start, rng = dynamics.start(), np.random.default_rng(1)
    before, at_start = dynamics.energies(start), energy.parts(start.x)
    for _ in range(6):
        energy.anchor(start.x + rng.normal(0.0, 0.4, len(start.x)))
    assert dynamics.energies(start) == pytest.approx(before, rel=1e-12)
    dynamics.take_up(start)
    assert energy.parts(start.x) == pytest.approx(at_start, rel=1e-12)

    sheet = relaxed_sheet(energy, max_iterations=4)
    anew = FabricEnergy(sheet, WOOL, springs=energy.springs)
    x = energy.vector(sheet.vertices, sheet.twist)
    assert anew.value(anew.start()) == pytest.approx(energy.value(x), rel=1e-9)


@pytest.mark.parametrize(
    "make",
    [lambda: YarnFriction(-0.1), lambda: YarnFriction(np.nan), lambda: MotionSettings(method="explict")],  # type: ignore[arg-type]
)
def test_settings_that_no_yarn_can_have_are_refused(make: Callable[[], object]) -> None:
    with pytest.raises(InputError, match=r"friction of yarns|method"):
        make()
