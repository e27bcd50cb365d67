"""A bounding volume around yarns that are elastic rods."""

from __future__ import annotations

import math

import numpy as np
import pytest

from yarnscale.drawing import library
from yarnscale.errors import InputError
from yarnscale.fabric.boundary import SEWN, SEWN_WIDTH, glue
from yarnscale.fabric.direct_energy import FabricEnergy
from yarnscale.fabric.direct_motion import FabricMotion, MotionSettings
from yarnscale.fabric.direct_objective import FabricObjective
from yarnscale.fabric.direct_static import rod_equilibrium
from yarnscale.fabric.rod_volume import RodVolume, VolumeDynamics
from yarnscale.fabric.sheet import YarnSheet
from yarnscale.fabric.sheet_scene import stretch
from yarnscale.fabric.volume import BoundingVolume
from yarnscale.numerics.affine import MappedObjective
from yarnscale.numerics.newton import Status
from yarnscale.numerics.sums import Springs
from yarnscale.yarn.material import YarnMaterial


def _energy(columns: int, rows: int, name: str = "plain") -> FabricEnergy:
    sheet = YarnSheet.of(library.build(name), columns, rows)
    material = YarnMaterial.preset(library.structure(name).material)
    # Firm borders: without friction what is glued softly slides far, which no volume guesses.
    firm = glue(sheet, material, width=SEWN_WIDTH * sheet.radius, stiffness=SEWN)
    return FabricEnergy(sheet, material, springs=firm)


@pytest.fixture(scope="module")
def energy() -> FabricEnergy:
    return _energy(3, 3)


@pytest.fixture(scope="module")
def volume(energy: FabricEnergy) -> RodVolume:
    return RodVolume(energy, BoundingVolume.around(energy.sheet.vertices, (5, 4)))


def test_moves_yarns_affinely_and_keeps_their_shape(energy: FabricEnergy, volume: RodVolume) -> None:
    """Displacements that are linear in the place are displacements of control points; what is none is projected."""
    random, x = np.random.default_rng(0), energy.start()
    x[: 3 * energy.count] += 0.1 * random.standard_normal(3 * energy.count)  # any shape, not only the sheet's own
    matrix, shift = 0.1 * random.standard_normal((3, 3)), random.standard_normal(3)
    control = volume.volume.control_at_rest / energy.radius
    nodes, positions = volume.maps_from(x)
    there = positions.expand(nodes.expand((control @ matrix.T + shift).ravel()))
    places = energy.sheet.vertices / energy.radius
    moved = energy.positions(there) - energy.positions(x)
    np.testing.assert_allclose(moved, places @ matrix.T + shift, atol=1e-11)
    np.testing.assert_array_equal(there[3 * energy.count :], x[3 * energy.count :])
    np.testing.assert_allclose(volume.projected(there - x), there - x, atol=1e-9)
    rough = random.standard_normal(len(x))
    once = volume.projected(rough)
    np.testing.assert_allclose(volume.projected(once), once, atol=1e-9)
    assert np.linalg.norm(once) < 0.5 * np.linalg.norm(rough)


def test_pulls_gradients_and_matrices_back(energy: FabricEnergy, volume: RodVolume) -> None:
    """Against finite differences of the energy and against Bᵀ H B with a dense B."""
    random, x = np.random.default_rng(1), energy.start()
    energy.anchor(x)
    weight = random.random(len(x))
    objective = FabricObjective(energy, [Springs(weight, x + 1.0)], np.zeros(len(x)))
    nodes, positions = volume.maps_from(x)
    reduced = MappedObjective(MappedObjective(objective, positions), nodes)
    free = 1e-3 * random.standard_normal(volume.unknowns)
    _, gradient, model = reduced.quadratic(free)
    direction = random.standard_normal(volume.unknowns)
    ahead, behind = (reduced.value(free + sign * 1e-5 * direction) for sign in (1, -1))
    assert gradient @ direction == pytest.approx((ahead - behind) / 2e-5, rel=1e-5)
    whole = objective.quadratic(positions.expand(nodes.expand(free)))[2]
    for shift in (0.0, 0.1):
        moves = np.kron(np.asarray(volume.weights), np.eye(3))[:, ::7]  # type: ignore[call-overload]
        basis = np.concatenate([moves, np.zeros((energy.count, moves.shape[1]))])
        expected = basis.T @ whole.pattern.multiply(whole.values(shift), basis)
        found = model.pattern.multiply(model.values(shift), np.eye(volume.unknowns)[::7].T)[::7]
        np.testing.assert_allclose(found, expected, atol=1e-8 * np.abs(expected).max())


def test_falls_freely_whatever_the_yarns_do(energy: FabricEnergy) -> None:
    """The volume can move as a whole, so that its centre of mass falls as Euler's implicit steps do."""
    dynamics = VolumeDynamics(
        energy,
        MotionSettings(tolerance=1e-6, enough=0.0, iterations=40),
        volume=RodVolume(energy, BoundingVolume.around(energy.sheet.vertices, (5, 5))),
    )
    motion, step, count = dynamics.start(), 1 / 200, 5
    mass = energy.masses()
    start = mass @ energy.positions(motion.x) / mass.sum()
    for _ in range(count):
        result = dynamics.step(motion, step)
        assert result.status is Status.CONVERGED
        motion = result.state
    fallen = (mass @ energy.positions(motion.x) / mass.sum() - start) * energy.radius
    np.testing.assert_allclose(fallen[2], -9.81 * step**2 * count * (count + 1) / 2, rtol=1e-5)
    np.testing.assert_allclose(fallen[:2], 0.0, atol=1e-5 * abs(fallen[2]))
    with pytest.raises(InputError, match="explicit"):
        VolumeDynamics(energy, MotionSettings(method="explicit"), volume=dynamics.volume)


def test_its_equilibrium_is_a_first_guess_that_saves_iterations() -> None:
    """Knitting stretched between grips: from the guess, the yarns come to the same force in fewer Newton iterations."""
    energy = _energy(4, 4, "stockinette")
    scene = stretch(energy.sheet, amount=0.2, duration=1.0)
    before = rod_equilibrium(energy, energy.start(), scene.holds(0.0), tolerance=1e-4)
    holds = scene.holds(1.0)
    alone = rod_equilibrium(energy, before.x, holds, tolerance=1e-4)
    volume = RodVolume(energy, BoundingVolume.around(energy.sheet.vertices, (4, 4)))
    within = VolumeDynamics(energy, MotionSettings((0.0, 0.0, 0.0)), scene.holds, volume=volume)
    guess = within.step(FabricMotion(before.x, 0.0 * before.x), math.inf, iterations=50, until=1.0)
    guided = rod_equilibrium(energy, guess.state.x, holds, tolerance=1e-4)
    assert guess.status is alone.status is guided.status is Status.CONVERGED
    assert guess.iterations <= 4
    assert guided.iterations < alone.iterations
    forces = [scene.force(energy, rest.x, 1.0) for rest in (alone, guided)]
    assert forces[1] == pytest.approx(forces[0], rel=1e-3)
