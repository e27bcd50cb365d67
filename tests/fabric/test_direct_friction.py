"""Friction between the yarns of a finite fabric: Coulomb's law, what contacts remember, and what friction takes."""

from __future__ import annotations

import math
from collections.abc import Callable
from itertools import pairwise

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from yarnscale.drawing import library
from yarnscale.fabric.direct_energy import FabricEnergy
from yarnscale.fabric.direct_friction import FrictionHistory
from yarnscale.fabric.direct_motion import FabricDynamics, FabricMotion, MotionSettings
from yarnscale.fabric.holds import Holds
from yarnscale.fabric.sheet import YarnSheet
from yarnscale.fabric.sheet_scene import stretch
from yarnscale.yarn.friction import Rubbing, YarnFriction
from yarnscale.yarn.material import YarnMaterial

FRICTION = YarnFriction(0.3)
RADIUS = 1e-3
Crossing = Callable[[float], FabricEnergy]


def test_friction_resists_sliding_with_the_share_of_the_pressure(crossing: Crossing) -> None:
    energy = crossing(1.6)
    start = energy.start()
    pairs = Rubbing.of(energy.contacts(start).stencils, start)
    push = pairs.normal * pairs.pressure[:, None]
    FrictionHistory.slack(energy).begin(energy, FRICTION, start)
    slid = start.copy()
    energy.positions(slid)[21:, 0] += 0.5
    rubbed = energy.gradient(slid)[1].sum(axis=0)
    energy.rub(None)
    drag = energy.positions(rubbed - energy.gradient(slid)[1].sum(axis=0))
    held = drag[21:, 0].sum()
    # Some of the pressures lean along the way: their sum is an upper bound, their resultant a lower one.
    assert 0.3 * np.linalg.norm(push.sum(axis=0)) <= held <= 0.3 * pairs.pressure.sum()
    assert pairs.pressure.sum() < 1.1 * np.linalg.norm(push.sum(axis=0))
    assert np.abs(drag.sum(axis=0)).max() < 1e-12 * held


def capstan(step: float, *, inertia: bool) -> tuple[float, list[float]]:
    """A yarn half around a held one, pulled by 0.55 radii in steps [radii]: ratio of tensions, energy taken [J]."""
    leg, duration = 8, step / 0.55
    yarn = YarnMaterial(5e5, 2e5, 1e-3, 60.0, 120.0)
    turn, down = np.linspace(0.5 * math.pi, -0.5 * math.pi, 21), 0.3 * np.arange(leg, 0, -1)
    x = 1.95 * np.concatenate([np.full(leg, -1.0), -np.sin(turn), np.full(leg, 1.0)])
    z = np.concatenate([-down, 1.95 * np.cos(turn), -down[::-1]])
    over = np.column_stack([x, np.zeros(len(x)), z])
    post = np.column_stack([np.zeros(21), np.linspace(-4.0, 4.0, 21), np.zeros(21)])
    sheet = YarnSheet.from_lines([np.multiply(RADIUS, line) for line in (post, over)], RADIUS)
    nodes, ends = np.concatenate([np.arange(21), [21, 20 + len(over)]]), np.array([[0.0, 0.0, 0.5], [0.0, 0.0, -0.6]])

    def holds(time: float) -> Holds:
        targets = sheet.vertices[nodes].copy()
        targets[-2:] += time * RADIUS * ends
        return Holds(nodes, targets)

    energy = FabricEnergy(sheet, yarn)
    settings = MotionSettings((0.0, 0.0, 0.0), friction=FRICTION, damping=50.0, iterations=100, enough=1e-6)
    dynamics, x = FabricDynamics(energy, settings, holds), energy.start()
    motion, taken = FabricMotion(x, 0.0 * x), [0.0]
    for _ in range(round(1.0 / duration)):
        motion = dynamics.step(motion, duration, inertia=inertia).state
        assert motion.friction is not None
        taken.append(motion.friction.dissipated)
    followed, pulled = np.abs(holds(motion.time).forces(energy, motion.x)[-2:, 2])
    return pulled / followed, taken


def test_a_yarn_pulled_over_another_has_the_tensions_of_a_capstan_whatever_the_step() -> None:
    """Half around a held yarn: the tensions of both ends differ by exp(μ π); friction takes the same and gives none."""
    totals = []
    for step, inertia in ((0.055, True), (0.011, True), (0.0055, False)):
        ratio, taken = capstan(step, inertia=inertia)
        assert ratio == pytest.approx(math.exp(FRICTION.coefficient * math.pi), rel=0.05)
        assert min(after - before for before, after in pairwise(taken)) >= 0.0
        totals.append(taken[-1])
    assert totals == pytest.approx([totals[-1]] * 3, rel=0.02)


def test_without_a_coefficient_nothing_rubs(crossing: Crossing) -> None:
    ends = []
    for friction in (None, YarnFriction(0.0)):
        energy = crossing(1.7)
        dynamics = FabricDynamics(energy, MotionSettings((0.0, 0.0, 0.0), friction=friction))
        motion = dynamics.start()
        for _ in range(3):
            motion = dynamics.step(motion, 1e-3).state
        assert motion.friction is None or motion.friction.dissipated == 0.0
        ends.append(motion.x)
    np.testing.assert_array_equal(ends[0], ends[1])
    assert np.abs(ends[0] - energy.start()).max() > 1e-3


def test_stuck_contacts_hold_their_force_and_do_not_creep() -> None:
    """Once pressures have settled, steps that go nowhere change nothing; without memory each would lose the force."""
    sheet = YarnSheet.of(library.build("stockinette"), 2, 2)
    energy = FabricEnergy(sheet, YarnMaterial.preset("hylc2020-stockinette"))
    scene = stretch(sheet, amount=0.05, duration=1.0)
    settings = MotionSettings((0.0, 0.0, 0.0), friction=FRICTION, iterations=100)
    dynamics = FabricDynamics(energy, settings, scene.holds)
    motion, forces = dynamics.start(), []
    for time in [*np.linspace(0.1, 1.0, 5), *[1.0] * 10]:
        motion = dynamics.step(motion, math.inf, until=float(time)).state
        forces.append(scene.force(energy, motion.x, motion.time))
    assert forces[-1] == pytest.approx(forces[-6], rel=2e-3)


@pytest.mark.parametrize("inertia", [True, False])
def test_fabric_that_turns_keeps_its_springs_and_rubs_nothing(inertia: bool) -> None:
    sheet = YarnSheet.of(library.build("stockinette"), 3, 3)
    energy = FabricEnergy(sheet, YarnMaterial.preset("hylc2020-stockinette"))
    x, history = energy.start(), FrictionHistory.slack(energy)

    def moved(places: np.ndarray) -> np.ndarray:
        return np.concatenate([places.ravel(), x[3 * energy.count :]])

    for share in (0.002, 0.0):
        step = history.begin(energy, FRICTION, x)
        x = moved(energy.positions(x) * [1.0 + share, 1.0, 1.0])
        history = step.end(x)
    stored, taken = history.stored(energy), history.dissipated
    assert stored > 0.0
    turn, about = 0.05, np.array([0.6, -0.8, 0.0])
    for _ in range(20):
        places = energy.positions(x)
        ahead = moved(turn * np.cross(about, places)) if inertia else None
        step = history.begin(energy, FRICTION, x, predicted=ahead)
        x = moved(Rotation.from_rotvec(turn * about).apply(places))
        energy.anchor(x)
        history = step.end(x)
    assert history.stored(energy) == pytest.approx(stored, rel=0.02)
    assert history.dissipated - taken < 0.02 * stored
