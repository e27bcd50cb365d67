"""The closed-form midsurface: fundamental forms, derivatives, and the series near zero angle."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import quad_vec
from scipy.spatial.transform import Rotation

from yarnscale.cell.midsurface import Midsurface
from yarnscale.kinematics import ShellStrain

FLAT = ShellStrain(0.2, 0.3, -0.1)
SINGLY_CURVED = [
    ShellStrain(0.2, 0.3, -0.1, 80.0),
    ShellStrain(-0.3, -0.5, 0.4, 0.0, 0.0, -120.0),
    ShellStrain(0.2, 0.3, -0.1, 8.0, 4.0, 2.0),
    ShellStrain(0.0, 0.0, 0.0, -9.0, 30.0, -100.0),
]
STATES = [ShellStrain(), FLAT, *SINGLY_CURVED]


def points(count: int = 25, size: float = 0.02, seed: int = 0) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return np.column_stack([rng.uniform(-size, size, (count, 2)), rng.uniform(-2e-3, 2e-3, count)])


def on_surface(reference: np.ndarray) -> np.ndarray:
    return reference * [1.0, 1.0, 0.0]


@pytest.mark.parametrize("strain", STATES)
def test_fundamental_forms_by_differences(strain: ShellStrain) -> None:
    """∇φ and the normal give back I and II everywhere, not only at the origin."""
    surface, xi = Midsurface(strain), on_surface(points())
    step = 1e-6
    moves = step * np.eye(3)[:2]
    tangent = [(surface.at(xi + m)[0] - surface.at(xi - m)[0]) / (2 * step) for m in moves]
    normal = surface.at(xi)[1][:, :, 2]
    slope = [(surface.at(xi + m)[1] - surface.at(xi - m)[1])[:, :, 2] / (2 * step) for m in moves]
    for a in range(2):
        np.testing.assert_allclose((tangent[a] * normal).sum(1), 0, atol=1e-8)
        for b in range(2):
            np.testing.assert_allclose((tangent[a] * tangent[b]).sum(1), strain.first_form[a, b], atol=1e-8)
            # z = +x²/2 with normal +z has II11 = +1: II = −n,a · m,b.
            np.testing.assert_allclose(-(slope[a] * tangent[b]).sum(1), strain.second_form[a, b], atol=1e-6 * 120)


@pytest.mark.parametrize("strain", STATES)
def test_frames_are_rotations_and_the_thickness_follows_the_normal(strain: ShellStrain) -> None:
    reference = points()
    place, turn = Midsurface(strain).at(reference)
    np.testing.assert_allclose(turn @ turn.transpose(0, 2, 1), np.tile(np.eye(3), (25, 1, 1)), atol=1e-13)
    np.testing.assert_allclose(np.linalg.det(turn), 1)
    foot, same = Midsurface(strain).at(on_surface(reference))
    np.testing.assert_allclose(same, turn, atol=1e-14)
    np.testing.assert_allclose(place - foot, reference[:, 2:] * turn[:, :, 2], atol=1e-15)


def test_a_flat_state_is_the_root_of_the_first_form() -> None:
    place, turn = Midsurface(FLAT).at(points())
    values, vectors = np.linalg.eigh(FLAT.first_form)
    root = vectors @ np.diag(np.sqrt(values)) @ vectors.T
    np.testing.assert_allclose(place[:, :2], points()[:, :2] @ root, rtol=1e-12, atol=1e-16)
    np.testing.assert_allclose(place[:, 2], points()[:, 2])
    np.testing.assert_allclose(turn, np.tile(np.eye(3), (25, 1, 1)), atol=1e-15)


def test_a_cylinder_is_a_circle_of_the_right_radius_bent_upwards() -> None:
    curvature = 50.0
    x = np.linspace(-0.03, 0.03, 13)
    place, _ = Midsurface(ShellStrain(II11=curvature)).at(np.column_stack([x, 0 * x, 0 * x]))
    expected = np.column_stack([np.sin(curvature * x), 0 * x, 1 - np.cos(curvature * x)] / np.array(curvature))
    np.testing.assert_allclose(place, expected.reshape(-1, 3), atol=1e-15)
    assert (place[[0, -1], 2] > 0).all()


@pytest.mark.parametrize("scale", [0.0, 1e-9, 1e-4, 0.1, 0.499999, 0.5, 0.500001, 1.0, 3.0, 7.0])
def test_rotation_and_left_jacobian_at_small_and_large_angles(scale: float) -> None:
    """R = exp [w]× and φ = ∫₀¹ R(tξ) dt S ξ, on both sides of where the series hands over (angle ½)."""
    strain = ShellStrain(0.0, 0.0, 0.0, 1.0)
    xi = np.array([[scale, 0.3, 0.0]])
    place, turn = Midsurface(strain).at(xi)
    w = np.array([0.0, -scale, 0.0])
    np.testing.assert_allclose(turn[0], Rotation.from_rotvec(w).as_matrix(), rtol=0, atol=4e-16)
    integral, _ = quad_vec(lambda t: Rotation.from_rotvec(t * w).apply(xi[0]), 0, 1, epsabs=1e-15)
    np.testing.assert_allclose(place[0], integral, rtol=0, atol=1e-14)


def test_series_and_closed_form_agree_where_they_meet() -> None:
    """No step in value or derivative at the change-over."""
    strain = ShellStrain(0.1, 0.2, 0.0, 1.0)
    surface = Midsurface(strain)
    angle = 0.5
    turning = np.linalg.norm(surface.rotation_vectors(np.array([[1.0, 0.0, 0.0]])))
    x = angle / turning * (1 + np.array([-1e-13, 1e-13]))
    reference = np.column_stack([x, 0 * x, 0 * x + 0.1])
    for pair in (*surface.at(reference), *surface.slopes(reference)):
        np.testing.assert_allclose(pair[0], pair[1], atol=2e-12)


@pytest.mark.parametrize("strain", STATES)
def test_derivatives_by_the_state(strain: ShellStrain) -> None:
    reference, fluctuation = points(), 1e-3 * np.random.default_rng(1).normal(size=(25, 3))

    def moved(vector: np.ndarray) -> np.ndarray:
        place, turn = Midsurface(ShellStrain.from_vector(vector)).at(reference)
        return place + np.einsum("nij,nj->ni", turn, fluctuation)

    places, turns = Midsurface(strain).slopes(reference)
    slopes = places + np.einsum("nijl,nj->nil", turns, fluctuation)
    for k in range(6):
        step = np.eye(6)[k] * (1e-6 if k < 3 else 1e-3)
        expected = (moved(strain.vector + step) - moved(strain.vector - step)) / (2 * step[k])
        assert np.abs(expected).max() > 0
        np.testing.assert_allclose(slopes[:, :, k], expected, atol=1e-7 * np.abs(expected).max())


@pytest.mark.parametrize("strain", STATES)
def test_the_unit_of_length_does_not_matter(strain: ShellStrain) -> None:
    reference, unit = points(), 1e-3
    metres, radii = Midsurface(strain), Midsurface(strain, length=unit)
    np.testing.assert_allclose(radii.at(reference / unit)[0] * unit, metres.at(reference)[0], rtol=1e-12, atol=1e-16)
    inside, outside = radii.slopes(reference / unit), metres.slopes(reference)
    np.testing.assert_allclose(inside[0] * unit, outside[0], rtol=1e-10, atol=1e-14)
    np.testing.assert_allclose(inside[1], outside[1], rtol=1e-10, atol=1e-14)


@pytest.mark.parametrize("strain", SINGLY_CURVED)
def test_copies_are_related_by_rigid_motions(strain: ShellStrain) -> None:
    """What makes one tile of a singly curved cell stand for all: distances do not depend on the tile."""
    reference, shift = points(), np.array([0.013, -0.021, 0.0])
    surface = Midsurface(strain)
    here, there = surface.at(reference)[0], surface.at(reference + shift)[0]
    distance = [np.linalg.norm(p[:, None] - p[None], axis=2) for p in (here, there)]
    np.testing.assert_allclose(distance[0], distance[1], atol=1e-14)


@pytest.mark.parametrize("strain", SINGLY_CURVED)
def test_rotation_vectors(strain: ShellStrain) -> None:
    reference = points()
    surface = Midsurface(strain)
    vectors = surface.rotation_vectors(reference)
    np.testing.assert_allclose(Rotation.from_rotvec(vectors).as_matrix(), surface.at(reference)[1], rtol=0, atol=1e-13)
