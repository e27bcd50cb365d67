"""Elastic energy of a mesh: derivatives, positive model, closed forms."""

from __future__ import annotations

import numpy as np
import pytest

from yarnscale.shell.elastic.elements import FreeEdges
from yarnscale.shell.elastic.energy import ShellEnergy
from yarnscale.shell.materials.orthotropic import OrthotropicMaterial
from yarnscale.shell.mesh import rectangle

CLOTH = OrthotropicMaterial(
    stretch_weft=60.0,
    stretch_coupling=12.0,
    stretch_warp=90.0,
    shear=20.0,
    area=4.0,
    log_area=3.0,
    bend_weft=2e-5,
    bend_bias=1.5e-5,
    bend_warp=3e-5,
    density=0.2,
)


def crumpled(free_edges: FreeEdges, *, seed: int = 0) -> tuple[ShellEnergy, np.ndarray]:
    mesh = rectangle(0.05, 0.04, 0.01, irregularity=0.1)
    rng = np.random.default_rng(seed)
    positions = np.column_stack([mesh.panel, np.zeros(mesh.vertex_count)])
    positions += rng.standard_normal(positions.shape) * [6e-4, 6e-4, 3e-3]
    energy = ShellEnergy(mesh, CLOTH, free_edges=free_edges)
    energy.follow(positions)
    return energy, positions


def differences(function, positions: np.ndarray, step: float) -> np.ndarray:
    """Central differences of a function of positions, one row per coordinate."""
    rows = []
    for i in range(positions.size):
        change = np.zeros(positions.size)
        change[i] = step
        change = change.reshape(positions.shape)
        rows.append((function(positions + change) - function(positions - change)) / (2 * step))
    return np.array(rows)


@pytest.mark.parametrize("free_edges", ["zero", "extrapolate"])
def test_gradient_and_exact_hessian_match_finite_differences(free_edges: FreeEdges) -> None:
    energy, positions = crumpled(free_edges)
    linear = energy.linearise(positions)
    assert linear.value == pytest.approx(energy.value(positions), rel=1e-12)
    numeric = differences(energy.value, positions, 1e-7)
    scale = np.abs(numeric).max()
    assert scale > 1e-3
    np.testing.assert_allclose(linear.gradient.ravel(), numeric, atol=1e-6 * scale)
    alone = energy.linearise(positions, moduli=False)
    assert alone.value == pytest.approx(linear.value, rel=1e-12)
    np.testing.assert_allclose(alone.gradient, linear.gradient, atol=1e-12 * scale)
    dense = energy.pattern.multiply(linear.hessian("exact"), np.eye(positions.size))
    numeric = differences(lambda x: energy.linearise(x).gradient.ravel(), positions, 1e-7)
    np.testing.assert_allclose(dense, numeric, atol=1e-6 * np.abs(dense).max())


def test_positive_model_is_positive_where_the_exact_hessian_is_not() -> None:
    energy, positions = crumpled("extrapolate")
    linear = energy.linearise(positions)
    identity = np.eye(positions.size)
    exact = np.linalg.eigvalsh(energy.pattern.multiply(linear.hessian("exact"), identity))
    positive = np.linalg.eigvalsh(energy.pattern.multiply(linear.hessian("positive"), identity))
    assert exact[0] < -1e-3 * exact[-1]
    assert positive[0] > -1e-12 * positive[-1]


def test_models_agree_at_rest() -> None:
    energy, positions = crumpled("extrapolate")
    flat = positions * 0
    flat[:, :2] = energy.mesh.panel
    energy.follow(flat)
    linear = energy.linearise(flat)
    exact = linear.hessian("exact")
    np.testing.assert_allclose(linear.hessian("positive"), exact, atol=1e-9 * np.abs(exact).max())


def test_uniform_stretch_has_the_energy_of_the_material() -> None:
    mesh = rectangle(0.05, 0.04, 0.01)
    energy = ShellEnergy(mesh, CLOTH)
    positions = np.column_stack([mesh.panel * [1.2, 0.95], np.zeros(mesh.vertex_count)])
    density = CLOTH.energy_density(np.array([[0.2, 0.0, -0.05, 0, 0, 0]]))[0]
    assert energy.value(positions) == pytest.approx(density * 0.002, rel=1e-12)
    np.testing.assert_allclose(energy.densities(positions), density, rtol=1e-12)


def test_rigid_motion_gives_no_force() -> None:
    energy, positions = crumpled("extrapolate")
    rotation, _ = np.linalg.qr(np.random.default_rng(5).standard_normal((3, 3)))
    rotation *= np.sign(np.linalg.det(rotation))
    first, second = energy.linearise(positions), energy.linearise(positions @ rotation.T + 1.0)
    assert second.value == pytest.approx(first.value, rel=1e-10)
    np.testing.assert_allclose(second.gradient, first.gradient @ rotation.T, atol=1e-9 * np.abs(first.gradient).max())
    np.testing.assert_allclose(first.gradient.sum(axis=0), 0, atol=1e-12)
    torque = np.cross(positions, first.gradient).sum(axis=0)
    np.testing.assert_allclose(torque, 0, atol=1e-13)


def test_grain_turns_the_stiff_direction() -> None:
    mesh = rectangle(0.04, 0.04, 0.01)
    stretched = np.column_stack([mesh.panel * [1.1, 1.0], np.zeros(mesh.vertex_count)])
    along = ShellEnergy(mesh, CLOTH).value(stretched)
    turned = ShellEnergy(mesh.with_grain(np.pi / 2), CLOTH).value(stretched)
    density = CLOTH.energy_density(np.array([[0.0, 0.0, 0.1, 0, 0, 0]]))[0]
    assert turned == pytest.approx(density * 0.0016, rel=1e-10)
    assert turned > 1.2 * along


def test_states_without_area_are_refused() -> None:
    energy, positions = crumpled("extrapolate")
    assert energy.value(positions * 0) == np.inf


def test_threads_give_the_same_energy_forces_and_matrices() -> None:
    mesh = rectangle(0.1, 0.1, 0.005)
    material = crumpled("extrapolate")[0].material
    positions = np.column_stack([mesh.panel * 1.05, 1e-3 * np.sin(60 * mesh.panel[:, 0])])
    results = []
    for threads in (1, 2, 3):
        energy = ShellEnergy(mesh, material, threads=threads)
        largest = energy.follow(positions)
        linear = energy.linearise(positions)
        matrices = [linear.hessian("exact"), linear.hessian("positive")]
        results.append([energy.value(positions), largest, linear.gradient, *matrices])
    for other in results[1:]:
        for expected, found in zip(results[0], other, strict=True):
            scale = float(np.abs(expected).max())
            np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-12 * scale)
