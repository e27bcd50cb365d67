"""Runs, imposed deformations and measures of spline yarns."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from yarnscale.fabric.measures import fibre_extension, penetration
from yarnscale.fabric.spline_knit import SplineFabric, jersey
from yarnscale.fabric.spline_motion import SplineMotion, YarnMotion
from yarnscale.fabric.volume import BoundingVolume
from yarnscale.motion.run import simulate
from yarnscale.motion.schedule import Schedule
from yarnscale.numerics.newton import Status
from yarnscale.yarn.material import YarnMaterial


@pytest.fixture(scope="module")
def fabric() -> SplineFabric:
    return jersey(4, 5, YarnMaterial.preset("wool"))


def test_frames_come_at_their_times_and_energy_is_only_lost(fabric: SplineFabric) -> None:
    volume = BoundingVolume.around(fabric.control, (5, 5))
    moving, times, energies = SplineMotion(fabric, volume=volume, held=fabric.top), [], []

    def keep(number: int, motion: YarnMotion) -> None:
        assert number == len(times)
        times.append(motion.time)
        energies.append(moving.energies(motion))

    schedule = Schedule(0.1, 1 / 240, to_rest=False, frame_interval=0.025)
    run = simulate(moving, moving.start, schedule, on_frame=keep)
    assert run.status is Status.CONVERGED
    np.testing.assert_allclose(times, [0, 0.025, 0.05, 0.075, 0.1], atol=1e-12)
    totals = [sum(e.values()) for e in energies]
    assert all(later < earlier + 1e-12 for earlier, later in itertools.pairwise(totals))


def test_fine_volumes_take_a_rolled_shape(fabric: SplineFabric) -> None:
    """Fourth order in the width of patches."""

    def rolled(points: np.ndarray) -> np.ndarray:
        angle, size = 30.0 * points[:, 0], 1.0 / 30.0 - points[:, 2]
        return np.stack([size * np.sin(angle), points[:, 1], 1.0 / 30.0 - size * np.cos(angle)], axis=1)

    rest, errors = fabric.control.reshape(-1, 3), []
    for count in (5, 7, 11):
        volume = BoundingVolume.around(rest, (count, count))
        errors.append(np.abs(volume.weights(rest) @ volume.interpolated(rolled) - rolled(rest)).max())
    assert errors[2] < 2e-7 and errors[1] / errors[2] > 12


def test_traction_extends_fibres_as_much_as_they_lie_along_it(fabric: SplineFabric) -> None:
    volume = BoundingVolume.around(fabric.control, (5, 5))
    rest = fabric.control.reshape(-1, 3)
    largest, mean = fibre_extension(
        fabric, volume.weights(rest) @ volume.interpolated(lambda points: points * [1.1, 1.0, 1.0])
    )
    assert 0 < mean < largest <= 0.1 + 1e-9
    assert fibre_extension(fabric, rest) == pytest.approx((0.0, 0.0), abs=1e-14)


def test_penetration_is_the_missing_share_of_the_diameter(fabric: SplineFabric) -> None:
    """Squeezed through the thickness, contacts at distance d come to s·d."""
    rest = fabric.control.reshape(-1, 3)
    assert penetration(fabric, rest) == 0.0
    gap = fabric.at(rest, fabric.first) - fabric.at(rest, fabric.second)
    closest = np.linalg.norm(gap, axis=1).min()
    squeezed = rest * [1.0, 1.0, 0.5]
    expected = 1.0 - 0.5 * closest / (2 * fabric.radius)
    assert penetration(fabric, squeezed) == pytest.approx(expected, abs=0.02)
