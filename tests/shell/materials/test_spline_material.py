"""The spline material: eq. 32 as a matrix function, derivatives at the awkward places, kernels."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.interpolate import CubicSpline as SmoothSpline

from yarnscale.errors import InputError
from yarnscale.numerics.kernel import LANES
from yarnscale.shell.materials.spline_material import SplineMaterial
from yarnscale.shell.materials.spline_patches import PARAMETER_COUNT, PLANES
from yarnscale.shell.materials.tables import BicubicSpline, CubicSpline

SCALE = np.array([0.8, 0.7, 0.8, 100.0, 120.0])
REST = np.zeros(6)


def smooth_material(seed: int = 0) -> SplineMaterial:
    """Random C² splines with different knots in every term (but smooth in λ: at most a jump in the third)."""
    rng = np.random.default_rng(seed)
    axes = []
    for axis in range(5):
        knots = np.linspace(-1, 1, 7 + axis) * SCALE[axis]
        values = rng.normal(size=len(knots))
        axes.append(CubicSpline(knots, values, SmoothSpline(knots, values)(knots, 1)))
    planes = {}
    for i, j in PLANES:
        u, v = np.linspace(-0.8, 1, 5 + i) * SCALE[i], np.linspace(-1, 0.9, 4 + j) * SCALE[j]
        p = rng.normal(size=(len(u), len(v)))
        pu, pv = SmoothSpline(u, p)(u, 1), SmoothSpline(v, p, axis=1)(v, 1)
        planes[i, j] = BicubicSpline(u, v, p, pu, pv, SmoothSpline(v, pu, axis=1)(v, 1))
    return SplineMaterial(0.3, tuple(axes), planes, density=0.2)


def by_eigenvectors(material: SplineMaterial, strain: np.ndarray) -> float:
    """Eq. 31–32 as printed."""
    s = strain[:3]
    second = np.array([[strain[3], strain[4]], [strain[4], strain[5]]])
    (l1, l2), vectors = np.linalg.eigh(second)
    share = vectors[0, 0] ** 2
    flat = material.constant + sum(material.axes[k](s[k]) for k in range(3))
    flat += sum(material.planes[i, j](s[i], s[j]) for i, j in PLANES[:3])

    def bend(axis: int, value: float) -> float:
        return material.axes[axis](value) + sum(material.planes[k, axis](s[k], value) for k in range(3))

    along, across = bend(3, l1) + bend(4, l2), bend(3, l2) + bend(4, l1)
    return flat + share * along + (1 - share) * across


def states(n: int, seed: int = 1, reach: float = 1.6) -> np.ndarray:
    rng = np.random.default_rng(seed)
    strains = rng.uniform(-0.5, 0.9, (n, 6))
    strains[:, 1] = rng.uniform(-0.9, 0.9, n)
    strains[:, 3:] = rng.uniform(-reach, reach, (n, 3)) * 100
    return strains


MEETING = {
    "rest": REST,
    "sphere": np.array([0.1, -0.2, 0.15, 37.0, 0.0, 37.0]),
    "nearly a sphere": np.array([0.1, -0.2, 0.15, 37.0, 1e-9, 37.0]),
    "cylinder": np.array([0.0, 0.1, 0.0, 60.0, 0.0, 0.0]),
    "skew": np.array([0.2, 0.1, -0.1, 55.0, -25.0, 10.0]),
    "outside": np.array([0.9, 0.75, -0.85, 230.0, 80.0, -300.0]),
}


def test_energy_is_equation_32():
    material = smooth_material()
    strains = states(200)
    expected = [by_eigenvectors(material, strain) for strain in strains]
    np.testing.assert_allclose(material.energy_density(strains), expected, rtol=1e-10, atol=1e-10)


@pytest.mark.parametrize("name", list(MEETING))
def test_stress_and_moduli_are_derivatives(name):
    material = smooth_material(2)
    strain, step = MEETING[name], np.array([1e-5] * 3 + [1e-3] * 3)
    pairs = strain + np.concatenate([np.diag(step), -np.diag(step)])
    energy, stress = material.energy_density(pairs), material.stress(pairs)
    found, scale = material.stress(strain), 1 / step
    np.testing.assert_allclose(found, (energy[:6] - energy[6:]) / (2 * step), rtol=1e-5, atol=1e-12 * scale.max())
    moduli = (stress[:6] - stress[6:]) / (2 * step[:, None])
    size = np.sqrt(np.outer(np.abs(np.diag(moduli)), np.abs(np.diag(moduli)))) + 1e-6
    # Where the terms go on straight, diagonal moduli vanish, and what is left is round-off of the differences.
    round_off = 64 * np.finfo(float).eps * np.abs(stress).max(axis=0) / step[:, None]
    assert np.max((np.abs(material.moduli(strain) - moduli) - round_off) / size) < 2e-4
    assert np.max(np.abs(moduli)) > 1


@pytest.mark.parametrize("gap", [1e-1, 1e-3, 1e-5, 1e-7, 0.0])
def test_derivatives_hold_when_eigenvalues_meet_around_a_knot(gap):
    """λ1 above and λ2 below a knot by ``gap``: the moduli approach those of one piece, with the gap."""
    material = smooth_material(3)
    knot = material.axes[3].knots[5]
    turn = np.array([[np.cos(0.4), -np.sin(0.4)], [np.sin(0.4), np.cos(0.4)]])

    def at(gap: float) -> np.ndarray:
        second = turn @ np.diag([knot + gap, knot - gap]) @ turn.T
        return np.array([0.1, 0.05, -0.1, second[0, 0], second[0, 1], second[1, 1]])

    limit, found = material.moduli(at(0.0)), material.moduli(at(gap))
    weight = np.array([1.0] * 3 + [100.0] * 3)
    difference = np.abs(found - limit) * np.outer(weight, weight)
    assert np.max(difference) < 1e-8 + 30 * gap
    assert material.energy_density(at(gap)) == pytest.approx(by_eigenvectors(material, at(gap)), rel=1e-11)


def test_energy_has_no_step_where_the_formula_changes():
    material = smooth_material(4)
    center = np.array([0.1, 0.0, 0.1, 0.0, 0.0, 0.0])
    center[[3, 5]] = material.axes[3].knots[4] + 1e-7
    gaps = np.logspace(-8, -4, 60)
    strains = np.repeat(center[None], 60, axis=0)
    strains[:, 4] = gaps
    strains[:, 3] += 0.3 * gaps
    energy = material.energy_density(strains)
    slope = material.stress(center) @ np.array([0, 0, 0, 0.3, 1, 0])
    np.testing.assert_allclose(energy, material.energy_density(center) + slope * gaps, atol=1e-11)


def test_rotating_the_curvature_by_a_right_angle_swaps_the_families():
    material = smooth_material(5)
    swapped = SplineMaterial(
        material.constant,
        (*material.axes[:3], material.axes[4], material.axes[3]),
        {(i, 7 - j if j > 2 else j): term for (i, j), term in material.planes.items()},
        density=0.2,
    )
    strains = states(50, seed=8)
    turned = strains[:, [0, 1, 2, 5, 4, 3]] * np.array([1, 1, 1, 1, -1, 1])
    np.testing.assert_allclose(material.energy_density(strains), swapped.energy_density(turned), rtol=1e-10)


def test_gather_and_kernels_serve_blocks():
    material = smooth_material(6)
    strains = states(2 * LANES, seed=9)
    stride = 3 * LANES
    a, b = 1 + strains[:, 0], 1 + strains[:, 2]
    forms = np.zeros((6, stride))
    forms[:, : 2 * LANES] = np.vstack([a * a, strains[:, 1] * a * b, b * b, strains[:, 3:].T])
    forms[[0, 2], 2 * LANES :] = 1.0
    parameters = material.parameters(forms)
    assert parameters.shape == (PARAMETER_COUNT, stride)
    psi = np.zeros((1, stride))
    material.kernels().value(2 * LANES, stride, forms, parameters, psi)
    np.testing.assert_allclose(psi[0, : 2 * LANES], material.energy_density(strains), rtol=1e-14)
    assert not psi[0, 2 * LANES :].any()
    assert material.kernels() is smooth_material(7).kernels()


def test_shapes_follow_the_strains():
    material = smooth_material()
    assert material.energy_density(REST).shape == ()
    assert material.stress(np.zeros((4, 2, 6))).shape == (4, 2, 6)
    assert material.moduli(np.zeros((0, 6))).shape == (0, 6, 6)


@pytest.mark.parametrize("bad", [[0.0] * 5, [-1.0, 0, 0, 0, 0, 0], [0, 1.0, 0, 0, 0, 0], [np.nan] + [0.0] * 5])
def test_impossible_strains_are_refused(bad):
    with pytest.raises(InputError, match="strains"):
        smooth_material().energy_density(bad)


def test_unknown_planes_and_counts_are_refused():
    material = smooth_material()
    with pytest.raises(InputError, match="one-dimensional"):
        SplineMaterial(0.0, material.axes[:4], {}, density=1.0)
    with pytest.raises(InputError, match="two-dimensional"):
        SplineMaterial(0.0, material.axes, {(3, 4): material.planes[0, 3]}, density=1.0)
    with pytest.raises(InputError, match="density"):
        SplineMaterial(0.0, material.axes, {}, density=0.0)
