"""The compact energy: its derivatives, symmetry, lower bound, growth, and where it may be trusted."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from yarnscale.errors import InputError
from yarnscale.shell.materials.compact import MIRROR, CompactMaterial, SpringNetwork, shapes_of

SCALE = np.array([0.5, 0.5, 0.5, 100.0, 100.0, 100.0])


def material(*, steps: int = 3, springs: int = 5, walls: int = 2, mirrored: bool = True) -> CompactMaterial:
    rng = np.random.default_rng(7)
    arrays = SpringNetwork(*(rng.normal(size=tuple(shape)) for shape in shapes_of(steps, springs, walls)))
    positive = {n: np.abs(getattr(arrays, n)) for n in ("stiffnesses", "background", "wall_stiffnesses")}
    return CompactMaterial(0.2, SCALE, arrays._replace(**positive), density=0.2, mirrored=mirrored)


def states(count: int = 40, reach: float = 0.8) -> np.ndarray:
    return np.random.default_rng(1).uniform(-reach, reach, (count, 6)) * SCALE


def by_numpy(material: CompactMaterial, strains: np.ndarray) -> np.ndarray:
    """The equations of the module's text."""
    s = material.springs

    def spring(u):
        rho = 0.5 * (u + np.sqrt(1 + u * u))
        return (rho**3 / (1 + rho) ** 2) ** 2

    total = 0.0
    for sign in (np.ones(6), MIRROR) if material.mirrored else (np.ones(6),):
        x = strains / SCALE * sign
        a = s.step_offsets + x @ s.steps.T
        u = s.spring_offsets + x @ s.springs.T + a / np.sqrt(1 + a * a) @ s.bends.T
        walls = np.maximum(x @ s.walls.T - s.wall_offsets, 0) ** 3 @ s.wall_stiffnesses
        total = total + 0.5 * x**2 @ s.background + spring(u) @ s.stiffnesses + walls
    return material.constant + total / (2 if material.mirrored else 1)


@pytest.mark.parametrize("mirrored", [True, False])
def test_energy_is_that_of_the_text(mirrored):
    ours = material(mirrored=mirrored)
    np.testing.assert_allclose(ours.energy_density(states()), by_numpy(ours, states()), rtol=1e-13)


def test_stress_and_moduli_are_derivatives():
    ours, strains, step = material(), states(20), 1e-5 * SCALE
    for k in range(6):
        move = np.eye(6)[k] * step
        slope = (ours.energy_density(strains + move) - ours.energy_density(strains - move)) / (2 * step[k])
        np.testing.assert_allclose(ours.stress(strains)[:, k], slope, rtol=1e-7, atol=1e-8 / SCALE[k])
        bend = (ours.stress(strains + move) - ours.stress(strains - move)) / (2 * step[k])
        np.testing.assert_allclose(ours.moduli(strains)[:, k] * SCALE, bend * SCALE, rtol=1e-6, atol=1e-7 / SCALE[k])


def test_only_fabrics_that_are_their_mirror_image_are_symmetric():
    strains = states()
    for mirrored in (True, False):
        ours = material(mirrored=mirrored)
        same = np.allclose(ours.energy_density(strains * MIRROR), ours.energy_density(strains), rtol=1e-12)
        assert same == mirrored


def test_energy_is_bounded_below_and_grows_without_end():
    ours = material()
    wide = states(2000, 1.5)
    wide[:, [0, 2]] = np.maximum(wide[:, [0, 2]], -0.9)
    assert ours.energy_density(wide).min() >= ours.constant
    for direction in states(20) / np.linalg.norm(states(20) / SCALE, axis=1)[:, None]:
        direction[:3] = np.abs(direction[:3]) * [1, 0, 1]
        far = ours.energy_density(np.outer([1e3, 2e3], direction))
        assert far[1] > 3.5 * far[0]


def test_second_derivatives_are_continuous():
    ours = material(steps=0, springs=1, walls=2)
    wall, offset = ours.springs.walls[0], ours.springs.wall_offsets[0]
    there = SCALE * wall * offset / (wall @ wall) * 0.999999
    step = 1e-7 * SCALE * wall
    before, after = ours.moduli(there - step), ours.moduli(there + 20 * step)
    np.testing.assert_allclose(before * SCALE[:, None] * SCALE, after * SCALE[:, None] * SCALE, atol=1e-3)


def test_outside_counts_from_the_nearest_sample():
    samples = np.array([[0.0] * 6, [0.5, 0, 0, 0, 0, 0], [0.0, 0.2, 0, 0, 50.0, 0]])
    ours = replace(material(), samples=samples, spacing=0.5)
    asked = np.array([[0.1, 0, 0, 0, 0, 0], [1.0, 0, 0, 0, 0, 0], [0, -0.2, 0, 0, -50.0, 0], [0, 0, 0, 200, 0, 0]])
    np.testing.assert_allclose(ours.outside(asked), [0.0, 1.0, 0.0, 3.0], atol=1e-12)
    assert replace(ours, mirrored=False).outside(asked[2]) > 0


def test_arrays_that_do_not_match_are_refused():
    ours = material()
    for name, bad, word in (
        ("bends", np.zeros((5, 4)), "bends"),
        ("stiffnesses", -np.ones(5), "stiffnesses"),
        ("springs", np.full((5, 6), np.nan), "springs"),
    ):
        with pytest.raises(InputError, match=word):
            replace(ours, springs=ours.springs._replace(**{name: bad}))
    with pytest.raises(InputError, match="density"):
        replace(ours, density=0.0)
