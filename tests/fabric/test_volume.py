"""The bounding volume and motion in it."""

from __future__ import annotations

import numpy as np
import pytest

from yarnscale.errors import InputError
from yarnscale.fabric.adaptive_volume import AdaptiveRule, AdaptiveVolume
from yarnscale.fabric.spline_knit import SplineFabric, jersey
from yarnscale.fabric.spline_motion import SplineMotion, YarnMotion
from yarnscale.fabric.volume import BoundingVolume
from yarnscale.numerics.newton import Status
from yarnscale.yarn.material import YarnMaterial


@pytest.fixture(scope="module")
def fabric() -> SplineFabric:
    return jersey(3, 4, YarnMaterial.preset("wool"))


@pytest.fixture(scope="module")
def volume(fabric: SplineFabric) -> BoundingVolume:
    return BoundingVolume.around(fabric.control, (5, 4))


def test_reproduces_the_rest_shape_and_affine_motion(fabric: SplineFabric, volume: BoundingVolume) -> None:
    rest, control = fabric.control.reshape(-1, 3), volume.control_at_rest
    weights = volume.weights(rest)
    np.testing.assert_allclose(weights @ control, rest, atol=1e-15)
    matrix, shift = np.random.default_rng(0).standard_normal((3, 3)), np.array([1.0, 2.0, 3.0])
    np.testing.assert_allclose(weights @ (control @ matrix.T + shift), rest @ matrix.T + shift, atol=1e-13)


def test_a_new_knot_changes_neither_shape_nor_velocity(fabric: SplineFabric, volume: BoundingVolume) -> None:
    rest, rng = fabric.control.reshape(-1, 3), np.random.default_rng(1)
    control = rng.standard_normal((volume.count, 3))
    for axis in (0, 1):
        finer, change = volume.refined(axis, 0.0013)
        assert finer.count > volume.count
        np.testing.assert_allclose(finer.weights(rest) @ (change @ control), volume.weights(rest) @ control, atol=1e-13)


def test_refuses_what_it_cannot_hold(fabric: SplineFabric, volume: BoundingVolume) -> None:
    with pytest.raises(InputError, match="4 to 1000"):
        BoundingVolume.around(fabric.control, (3, 5))
    with pytest.raises(InputError, match="extent"):
        BoundingVolume.around(np.zeros((10, 3)), (4, 4))
    with pytest.raises(InputError, match="points in a volume"):
        volume.weights(np.array([[1.0, 0.0, 0.0]]))
    with pytest.raises(InputError, match="new knot"):
        volume.refined(0, 10.0)


@pytest.mark.parametrize("reduced", [False, True])
@pytest.mark.parametrize("method", ["explicit", "implicit"])
def test_free_fall_is_exact(fabric: SplineFabric, volume: BoundingVolume, reduced: bool, method: str) -> None:
    """Nothing holds it: every point falls alike, n steps of Euler by g Δt² n (n + 1)/2."""
    moving = SplineMotion(fabric, volume=volume if reduced else None, tolerance=1e-6, method=method)  # type: ignore[arg-type]
    motion, count = moving.start, 20
    step = 0.45 * moving.stable_step(motion) if method == "explicit" else 1e-3
    for _ in range(count):
        result = moving.step(motion, step)
        assert result.status is Status.CONVERGED
        motion = result.state
    fallen = moving.yarns(motion).positions - fabric.control.reshape(-1, 3)
    expected = -9.81 * step**2 * count * (count + 1) / 2
    np.testing.assert_allclose(fallen[:, 1], expected, rtol=1e-4)
    np.testing.assert_allclose(fallen[:, [0, 2]], 0.0, atol=1e-4 * abs(expected))


@pytest.mark.parametrize("reduced", [False, True])
def test_explicit_motion_keeps_energy_and_momentum(fabric: SplineFabric, volume: BoundingVolume, reduced: bool) -> None:
    """Shaken without gravity: linear and angular momentum stay, energy does up to the order of the step."""
    moving = SplineMotion(fabric, volume=volume if reduced else None, gravity=(0.0, 0.0, 0.0), method="explicit")
    rest = moving.start.positions
    shake = 0.3 * np.column_stack([np.sin(200 * rest[:, 1]), np.cos(150 * rest[:, 0]), np.sin(180 * rest[:, 0])])
    # A velocity that the contacts allow: one tiny step from rest takes out what they forbid.
    motion = moving.step(YarnMotion(rest, shake), 1e-9).state

    def quantities(state: YarnMotion) -> tuple[float, np.ndarray, np.ndarray]:
        yarns = moving.yarns(state)
        momentum = moving.times_mass(yarns.velocities.ravel()).reshape(-1, 3)
        spin = np.cross(yarns.positions, momentum).sum(axis=0)
        return sum(moving.energies(state).values()), momentum.sum(axis=0), spin

    energy, momentum, spin = quantities(motion)
    step = 0.15 * moving.stable_step(motion)
    for _ in range(40):
        motion = moving.step(motion, step).state
    after = quantities(motion)
    assert after[0] == pytest.approx(energy, rel=2e-2)
    size = np.linalg.norm(momentum)
    np.testing.assert_allclose(after[1], momentum, atol=1e-9 * size)
    np.testing.assert_allclose(after[2], spin, atol=2e-3 * np.linalg.norm(spin))


def test_finer_volumes_are_softer() -> None:
    """Patches halved twice: each volume can do all that the one before it can, and sags more under its weight."""
    fabric, sagged = jersey(5, 6, YarnMaterial.preset("wool")), []
    for count in (4, 5, 7):
        volume = BoundingVolume.around(fabric.control, (count, count))
        moving = SplineMotion(fabric, volume=volume, held=fabric.top)
        motion = moving.start
        for _ in range(3):
            result = moving.step(motion, 1 / 240)
            assert result.status is Status.CONVERGED
            motion = result.state
        sagged.append(-moving.energies(motion)["gravity"])
    assert 0 < sagged[0] < sagged[1] < sagged[2]


def test_held_points_stay(fabric: SplineFabric, volume: BoundingVolume) -> None:
    for chosen in (None, volume):
        moving = SplineMotion(fabric, volume=chosen, held=fabric.top)
        motion = moving.step(moving.start, 1 / 240).state
        there = fabric.at(moving.yarns(motion).positions, fabric.top)
        np.testing.assert_allclose(there, fabric.at(fabric.control.reshape(-1, 3), fabric.top), atol=1e-8)


def test_adaptive_volume_refines_where_it_helps_and_gives_knots_back(fabric: SplineFabric) -> None:
    """Gains foretell what a step with the knot saves; refining keeps the motion; at rest the knots go again."""
    tall = jersey(8, 5, YarnMaterial.preset("wool"))
    coarse = BoundingVolume.around(tall.control, (4, 4))
    moving = SplineMotion(tall, volume=coarse, held=tall.top, tolerance=1e-6)
    adaptive, motion = AdaptiveVolume(moving, AdaptiveRule(gain=1e-7, narrowest=8.0)), moving.start
    for _ in range(2):
        motion = adaptive.moving.step(motion, 1 / 240).state
    gains = adaptive.gains(motion, 1 / 240)
    assert {knot.axis for knot in gains} == {0, 1}
    before = adaptive.moving.yarns(motion)
    finer = adaptive.adapt(motion, 1 / 240)
    assert adaptive.volume.count > coarse.count
    after = adaptive.moving.yarns(finer)
    np.testing.assert_allclose(after.positions, before.positions, atol=1e-14)
    np.testing.assert_allclose(after.velocities, before.velocities, atol=1e-12)
    knot = adaptive.knots[0]
    saved = _step_energy(moving, motion) - _step_energy(adaptive.moving, finer)
    assert saved == pytest.approx(gains[knot], rel=0.05)
    assert gains[knot] == max(gains.values())

    calm = AdaptiveVolume(adaptive.moving, AdaptiveRule(gain=1e6))
    calm.knots, calm._coarsest = list(adaptive.knots), coarse
    still = YarnMotion(adaptive.volume.control_at_rest, np.zeros_like(finer.positions), passages=np.ones((2, 6)))
    np.testing.assert_array_equal(calm.adapt(still, 1 / 240).passages, still.passages)
    assert not calm.knots and calm.volume.count == coarse.count


def _step_energy(moving: SplineMotion, motion: YarnMotion, step: float = 1 / 240) -> float:
    """What an implicit step minimises, at its minimum [J]."""
    yarns, reached = moving.yarns(motion), moving.step(motion, step).state
    away = (moving.yarns(reached).positions - yarns.positions - step * yarns.velocities).ravel()
    inertia = 0.5 * float(away @ moving.times_mass(away)) / step**2
    energies = moving.energies(reached)
    return inertia + energies["elastic"] + energies["gravity"]
