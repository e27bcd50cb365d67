"""Grips that were not where they are to be."""

from __future__ import annotations

import numpy as np
import pytest

from yarnscale.drawing import library
from yarnscale.fabric.direct_energy import FabricEnergy
from yarnscale.fabric.direct_motion import FabricDynamics
from yarnscale.fabric.holds import Holds
from yarnscale.fabric.rod_volume import RodVolume, VolumeDynamics
from yarnscale.fabric.sheet import YarnSheet
from yarnscale.fabric.sheet_scene import stretch
from yarnscale.fabric.spline_knit import jersey
from yarnscale.fabric.spline_motion import SplineMotion, YarnMotion
from yarnscale.fabric.volume import BoundingVolume
from yarnscale.motion.run import simulate
from yarnscale.motion.schedule import Schedule
from yarnscale.yarn.material import YarnMaterial

WOOL = YarnMaterial.preset("wool")
ONE_STEP = Schedule(0.03, 0.03, to_rest=False)


def small() -> tuple[YarnSheet, FabricEnergy]:
    sheet = YarnSheet.of(library.build("plain"), 2, 2)
    return sheet, FabricEnergy(sheet, WOOL)


def test_distances_are_of_the_farthest_vertex_along_the_held_axes() -> None:
    sheet, energy = small()
    nodes = np.array([0, 5, 9])
    targets = sheet.vertices[nodes] + np.array([[1e-3, 0, 0], [0, 5e-3, 3e-3], [0, 0, 2e-3]])
    grips = {"left": np.array([True, False, True]), "right": np.array([False, True, False])}
    found = Holds(nodes, targets, (True, False, True), handles=grips).distances(energy, energy.start())
    assert found == {"left": pytest.approx(2e-3), "right": pytest.approx(3e-3)}
    assert Holds(nodes, targets).distances(energy, energy.start()) == {
        "held vertices": pytest.approx(np.hypot(5e-3, 3e-3))
    }
    assert Holds.none().distances(energy, energy.start()) == {"held vertices": 0.0}


@pytest.mark.parametrize("amount", [0.1, 3.0])
def test_yarns_go_with_their_grips_and_a_volume_cannot_follow_far(amount: float) -> None:
    sheet, energy = small()
    scene = stretch(sheet, amount=amount, duration=0.03)
    dynamics = FabricDynamics(energy, holds=scene.holds)
    free = simulate(dynamics, dynamics.start(), ONE_STEP)
    assert free.unfulfilled == ()
    volume = RodVolume(energy, BoundingVolume.around(energy.sheet.vertices, (4, 4)))
    dynamics = VolumeDynamics(energy, holds=scene.holds, volume=volume)
    held = simulate(dynamics, dynamics.start(), ONE_STEP)
    if amount < 1.0:
        assert held.unfulfilled == ()
        return
    assert [entry.what for entry in held.unfulfilled] == ["first grip", "second grip"]
    distances = dynamics.distances_from_places(held.state)
    for entry in held.unfulfilled:
        assert entry.first == held.state.time and entry.distance == distances[entry.what] > sheet.radius


def test_spline_yarns_that_were_moved_off_their_row_are_told() -> None:
    fabric = jersey(3, 3, WOOL)
    moving = SplineMotion(fabric, held=fabric.top)
    assert simulate(moving, moving.start, ONE_STEP).unfulfilled == ()
    start = moving.start
    off = YarnMotion(start.positions + np.array([0.0, 0.0, 0.01]), start.velocities)
    assert moving.distances_from_places(off) == {"held row": pytest.approx(0.01)}
