"""Stretch, bending and twist: derivatives, closed forms, invariance and anchors."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from yarnscale.numerics.energy import StencilEnergy
from yarnscale.numerics.kernel import run_columns
from yarnscale.yarn.frames import (
    GAUSS_POINTS,
    curve_length,
    material_curvature,
    parallel_transport,
    reference_twist,
)
from yarnscale.yarn.rod import ANCHORS, BEND_TWIST, STRETCH, TWO_PHASE_STRETCH, carried_frames


def values(energy: StencilEnergy, q: np.ndarray, p: np.ndarray) -> np.ndarray:
    return run_columns(energy.value, q, p)[0][:, 0]


def edges(count: int, seed: int = 0) -> np.ndarray:
    """Edges strained by −0.4 … 0.6 of a rest length 1.3, where they go on straight; those beside them are random."""
    rng = np.random.default_rng(seed)
    direction = rng.normal(size=(count, 3))
    direction *= (1.3 * np.linspace(0.6, 1.6, count) / np.linalg.norm(direction, axis=1))[:, None]
    start = rng.normal(size=(count, 3))
    beside = 0.7 * rng.normal(size=(2, count, 3))
    ends = [start, start + direction, start + beside[0], start + direction + beside[1]]
    return np.concatenate(ends, axis=1)


def unit(vectors: np.ndarray) -> np.ndarray:
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def joints(count: int, seed: int = 0, *, bend: float = 1.0) -> tuple[np.ndarray, np.ndarray]:
    """Random bent joints with random anchors: a rest shape of its own for each."""
    rng = np.random.default_rng(seed)
    edge = rng.normal(size=(count, 1, 3)) + bend * 0.5 * rng.normal(size=(count, 2, 3))
    points = np.concatenate([np.zeros((count, 1, 3)), np.cumsum(edge, axis=1)], axis=1) + 0.3
    twists = rng.uniform(-1, 1, (count, 2))
    tangent = unit(edge + 0.4 * np.linalg.norm(edge, axis=2, keepdims=True) * rng.normal(size=(count, 2, 3)))
    director = rng.normal(size=(count, 2, 3))
    director = unit(director - (director * tangent).sum(-1, keepdims=True) * tangent)
    carried = parallel_transport(director[:, 0], tangent[:, 0], tangent[:, 1])
    second = np.cross(tangent[:, 1], director[:, 1])
    joint_twist = -np.arctan2((carried * second).sum(1), (carried * director[:, 1]).sum(1))
    rest = rng.normal(size=(count, 3))
    stiffness = rng.uniform(0.5, 2, (count, 2))
    p = np.column_stack([tangent.reshape(count, 6), director.reshape(count, 6), joint_twist, 0.3 * rest, stiffness])
    return np.column_stack([points.reshape(count, 9), twists]), p


def two_phase_parameters(count: int) -> np.ndarray:
    return np.tile([1.3, 2.0, 50.0, 0.15, 0.0, 0.0], (count, 1))


CASES = {
    "stretch": (STRETCH, edges(37), np.tile([1.3, 4.0, 0.0, 0.0], (37, 1))),
    "bent edges": (STRETCH, edges(37), np.tile([1.3, 4.0, 1.0, 1.0], (37, 1))),
    "two phases": (TWO_PHASE_STRETCH, edges(37), two_phase_parameters(37)),
    "bend and twist": (BEND_TWIST, *joints(40)),
    "nearly straight": (BEND_TWIST, *joints(40, 1, bend=1e-3)),
    "sharply bent": (BEND_TWIST, *joints(40, 2, bend=2.0)),
}


@pytest.mark.parametrize("case", CASES)
def test_gradient_and_hessian_against_differences(case: str) -> None:
    energy, q, p = CASES[case]
    n, lower = energy.variable_count, np.tril_indices(energy.variable_count)
    value, gradient, entries = run_columns(energy.hessian, q, p)
    np.testing.assert_allclose(value[:, 0], values(energy, q, p), rtol=1e-12, atol=1e-14)
    np.testing.assert_allclose(gradient, run_columns(energy.gradient, q, p)[1], rtol=1e-9, atol=1e-10)
    assert (np.abs(gradient).max(axis=1) > 1e-3).all() and (np.abs(entries).max(axis=1) > 1e-3).all()
    hessian = np.zeros((len(q), n, n))
    hessian[:, lower[0], lower[1]] = hessian[:, lower[1], lower[0]] = entries
    step = 1e-6
    for k in range(n):
        move = step * np.eye(n)[k]
        slope = (values(energy, q + move, p) - values(energy, q - move, p)) / (2 * step)
        ahead, behind = (run_columns(energy.gradient, q + sign * move, p)[1] for sign in (1, -1))
        scale = np.abs(gradient).max(axis=1) + np.abs(value[:, 0])
        np.testing.assert_array_less(np.abs(slope - gradient[:, k]), 1e-7 * scale)
        scale = np.abs(hessian).max(axis=(1, 2))
        error = np.abs((ahead - behind) / (2 * step) - hessian[:, k]).max(axis=1)
        np.testing.assert_array_less(error, 1e-6 * scale)


@pytest.mark.parametrize("case", CASES)
def test_parameter_derivatives_against_differences(case: str) -> None:
    energy, q, p = CASES[case]
    names = ANCHORS if energy is BEND_TWIST else tuple(energy.parameters)
    if case == "two phases":
        # Away from the kinks, across which a central difference averages.
        strain = np.linalg.norm(q[:, 3:6] - q[:, :3], axis=1) / 1.3 - 1
        clear = (np.abs(strain) > 1e-3) & (np.abs(strain - 0.15) > 1e-3)
        q, p = q[clear], p[clear]
    columns = np.concatenate([np.arange(p.shape[1])[energy.parameter_rows(name)] for name in names])
    by_parameter, mixed = run_columns(energy.mixed(names), q, p)
    mixed = mixed.reshape(len(q), energy.variable_count, len(columns))
    assert np.abs(by_parameter).max() > 1e-2 and np.abs(mixed).max() > 1e-2
    for k, column in enumerate(columns):
        move = 1e-6 * np.eye(p.shape[1])[column]
        slope = (values(energy, q, p + move) - values(energy, q, p - move)) / 2e-6
        ahead, behind = (run_columns(energy.gradient, q, p + sign * move)[1] for sign in (1, -1))
        scale = np.abs(by_parameter).max(axis=1) + np.abs(mixed).max(axis=(1, 2))
        np.testing.assert_array_less(np.abs(slope - by_parameter[:, k]), 1e-7 * scale)
        error = np.abs((ahead - behind) / 2e-6 - mixed[:, :, k]).max(axis=1)
        np.testing.assert_array_less(error, 1e-6 * scale)


def test_stretch_is_half_k_l_strain_squared() -> None:
    q, p = edges(11), np.tile([1.3, 4.0, 0.0, 0.0], (11, 1))
    expected = 0.5 * 4.0 * 1.3 * np.linspace(-0.4, 0.6, 11) ** 2
    np.testing.assert_allclose(values(STRETCH, q, p), expected, rtol=1e-12, atol=1e-30)


def test_a_ring_through_its_gauss_points_is_not_strained() -> None:
    """A polygon of n edges has the length of the circle through the Gauss points of its edges."""
    for count in (6, 8, 12, 30):
        angle = 2 * np.pi * np.arange(count) / count
        ring = np.stack([np.cos(angle), np.sin(angle), 0 * angle], 1)
        place = (1 - GAUSS_POINTS[0]) * ring[0] + GAUSS_POINTS[0] * ring[1]
        length = 2 * np.pi * np.linalg.norm(place) / count
        q = np.concatenate([np.roll(ring, turn, axis=0) for turn in (0, -1, 1, -2)], axis=1)
        energy = values(STRETCH, q, np.tile([length, 1.0, 1.0, 1.0], (count, 1)))
        np.testing.assert_allclose(np.sqrt(2 * energy / length), 0, atol=8 / count**6)
        around = np.arange(count)
        lengths = curve_length(np.roll(ring, -1, axis=0) - ring, (around - 1) % count, (around + 1) % count)
        np.testing.assert_allclose(lengths, length, rtol=30 / count**6)


def test_the_two_phases_are_the_published_formula() -> None:
    """EST22 eq. 5, branch by branch."""
    soft, stiff, knee, length = 2.0, 50.0, 0.15, 1.3
    strain = np.array([-0.3, -0.01, 0.0, 0.01, 0.1, 0.15, 0.16, 0.5])
    q = np.zeros((len(strain), 12))
    q[:, 4] = length * (1 + strain)
    q[:, 7], q[:, 10] = -1.0, 9.0
    expected = [
        0.5 * length * stiff * e**2
        if e <= 0
        else 0.5 * length * soft * e**2
        if e <= knee
        else 0.5 * length * (stiff * (e - knee) ** 2 + soft * knee * (2 * e - knee))
        for e in strain
    ]
    found = values(TWO_PHASE_STRETCH, q, two_phase_parameters(len(strain)))
    np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-15)


@pytest.mark.parametrize("kink", [0.0, 0.15])
def test_energy_and_force_of_the_two_phases_are_continuous(kink: float) -> None:
    q = np.zeros((2, 12))
    q[:, 3] = 1.3 * (1 + kink + np.array([-1e-9, 1e-9]))
    q[:, 6], q[:, 9] = -1.0, 9.0
    value, gradient, lower = run_columns(TWO_PHASE_STRETCH.hessian, q, two_phase_parameters(2))
    assert abs(value[1, 0] - value[0, 0]) < 1e-8
    assert np.abs(gradient[1] - gradient[0]).max() < 1e-6
    along = lower[:, 0]  # of x0, along the edge: k/l
    soft_first = along if kink else along[::-1]
    np.testing.assert_allclose(soft_first, [2.0 / 1.3, 50.0 / 1.3], rtol=1e-6)


@pytest.mark.parametrize("case", CASES)
def test_rigid_motion_changes_nothing(case: str) -> None:
    """Anchors turn with the yarn: the state as a whole is moved."""
    energy, q, p = CASES[case]
    nodes = energy.variable_count // 3
    turn, shift = Rotation.random(random_state=3).as_matrix(), np.array([5.0, -2.0, 0.5])
    points = q[:, : 3 * nodes].reshape(-1, nodes, 3)
    moved = np.column_stack([(points @ turn.T + shift).reshape(len(q), -1), q[:, 3 * nodes :]])
    turned = p.copy()
    if energy is BEND_TWIST:
        turned[:, :12] = (p[:, :12].reshape(-1, 4, 3) @ turn.T).reshape(-1, 12)
    np.testing.assert_allclose(values(energy, moved, turned), values(energy, q, p), rtol=1e-10, atol=1e-12)
    force = run_columns(energy.gradient, q, p)[1][:, : 3 * nodes].reshape(-1, nodes, 3)
    np.testing.assert_allclose(force.sum(axis=1), 0, atol=1e-10 * np.abs(force).max())


def test_torque_on_a_joint_is_balanced_by_its_anchors() -> None:
    """Rotating everything is free, so torque of the nodes and of the anchors cancel."""
    q, p = joints(20, 5)
    force = run_columns(BEND_TWIST.gradient, q, p)[1][:, :9].reshape(-1, 3, 3)
    by_anchor = run_columns(BEND_TWIST.mixed(ANCHORS), q, p)[0].reshape(-1, 4, 3)
    torque = np.cross(q[:, :9].reshape(-1, 3, 3), force).sum(axis=1)
    anchors = np.cross(p[:, :12].reshape(-1, 4, 3), by_anchor).sum(axis=1)
    assert np.abs(torque).max() > 1e-2
    np.testing.assert_allclose(torque + anchors, 0, atol=1e-11)


def at_rest(count: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Joints in their anchored shape with its own curvature and twist as rest values."""
    q, p = joints(count, seed)
    points = q[:, :9].reshape(-1, 3, 3)
    tangent = unit(np.diff(points, axis=1))
    director = np.random.default_rng(seed).normal(size=tangent.shape)
    director = unit(director - (director * tangent).sum(-1, keepdims=True) * tangent)
    for i in range(count):
        previous = np.array([0, 0])
        joint_twist = reference_twist(tangent[i], director[i], previous)[1]
        p[i, 12] = joint_twist
        p[i, 13:15] = material_curvature(tangent[i], director[i], q[i, 9:], previous)[1]
        p[i, 15] = q[i, 10] - q[i, 9] + joint_twist
    p[:, :6], p[:, 6:12] = tangent.reshape(-1, 6), director.reshape(-1, 6)
    return q, p


def test_the_rest_shape_costs_nothing_and_is_an_equilibrium() -> None:
    """Ties the kernel to the frames of ``frames``, which files are read with."""
    q, p = at_rest(15, 7)
    value, gradient = run_columns(BEND_TWIST.gradient, q, p)
    np.testing.assert_allclose(value, 0, atol=1e-24)
    np.testing.assert_allclose(gradient, 0, atol=1e-12)


def test_bending_of_a_straight_isotropic_rod_knows_only_the_angle() -> None:
    """|κb| = 2 tan(φ/2) whatever θ and the directors are; with κ̄ = 0 and no twist stiffness."""
    angle = np.linspace(0.0, 2.5, 13)
    q, p = joints(13, 8)
    q[:, :9] = 0.0
    q[:, 3] = 0.7
    q[:, 6], q[:, 7] = 0.7 + 1.1 * np.cos(angle), 1.1 * np.sin(angle)
    q[:, 10] = q[:, 9] - p[:, 12]
    p[:, 13:15], p[:, 16], p[:, 17] = 0.0, 3.0, 0.0
    points = q[:, :9].reshape(-1, 3, 3)
    # Material frames that agree across the joint: anchors in the present shape.
    tangent = unit(np.diff(points, axis=1))
    director = np.cross([0.3, 0.1, 1.0], tangent[:, 0])
    p[:, :6] = tangent.reshape(-1, 6)
    first = unit(director)
    second = parallel_transport(first, tangent[:, 0], tangent[:, 1])
    p[:, 6:12] = np.column_stack([first, second])
    p[:, 12] = 0.0
    q[:, 10] = q[:, 9]
    np.testing.assert_allclose(values(BEND_TWIST, q, p), 0.5 * 3.0 * (2 * np.tan(angle / 2)) ** 2, rtol=1e-10)


def test_twist_is_the_difference_of_the_angles_of_a_straight_rod() -> None:
    q, p = joints(9, 9)
    count = len(q)
    q[:, :9] = [0, 0, 0, 1, 0, 0, 2.5, 0, 0]
    p[:, :12] = [1, 0, 0, 1, 0, 0, 0, 1, 0, 0, 1, 0]
    p[:, 12] = 0.0
    p[:, 13:16] = 0.0
    q[:, 9], q[:, 10] = 0.3, 0.3 + np.linspace(-7, 7, count)  # more than a full turn
    expected = 0.5 * p[:, 17] * np.linspace(-7, 7, count) ** 2
    np.testing.assert_allclose(values(BEND_TWIST, q, p), expected, rtol=1e-12, atol=1e-14)


def test_the_energy_is_a_function_of_the_state() -> None:
    """A closed path of the middle vertex leads back to the same energy: frames carry no history."""
    q, p = at_rest(1, 10)
    start = values(BEND_TWIST, q, p)
    q[:, 3:6] += [0.2, 0.1, -0.1]
    moved = values(BEND_TWIST, q, p)
    q[:, 3:6] -= [0.2, 0.1, -0.1]
    assert moved[0] > 1e-4
    np.testing.assert_allclose(values(BEND_TWIST, q, p), start, atol=1e-20)


def test_carried_frames_and_their_derivatives() -> None:
    rng = np.random.default_rng(0)
    edge = rng.normal(size=(12, 3))
    tangent = unit(edge + 0.3 * rng.normal(size=(12, 3)))
    director = unit(np.cross(tangent, rng.normal(size=(12, 3))))
    found_tangent, found, slope = carried_frames(edge, tangent, director)
    np.testing.assert_allclose(found_tangent, unit(edge), rtol=1e-12)
    np.testing.assert_allclose(found, parallel_transport(director, tangent, unit(edge)), atol=1e-12)
    np.testing.assert_allclose((found * found_tangent).sum(1), 0, atol=1e-13)
    for k in range(9):
        move = 1e-6 * np.eye(9)[k].reshape(3, 3)
        ahead = carried_frames(edge + move[0], tangent + move[1], director + move[2])
        behind = carried_frames(edge - move[0], tangent - move[1], director - move[2])
        both = (np.concatenate(ahead[:2], 1) - np.concatenate(behind[:2], 1)) / 2e-6
        np.testing.assert_allclose(slope[:, :, k], both, atol=1e-8 * max(1.0, np.abs(slope).max()))
