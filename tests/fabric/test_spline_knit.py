"""Spline yarns: counts of LOD03, energy, mass and contacts."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.interpolate import BSpline
from scipy.spatial.transform import Rotation

from yarnscale.errors import InputError
from yarnscale.fabric.bspline import blending, control_of_periodic
from yarnscale.fabric.spline_contacts import SplineContacts
from yarnscale.fabric.spline_knit import CurvePoints, SplineFabric, jersey
from yarnscale.fabric.spline_model import SplineEnergy
from yarnscale.yarn.material import YarnMaterial

WOOL = YarnMaterial.preset("wool")
NONE = CurvePoints(np.empty(0, np.int64), np.empty(0))


@pytest.fixture(scope="module")
def fabric() -> SplineFabric:
    return jersey(3, 4, WOOL)


def _line(length: float, segments: int, curvature: float = 0.0) -> SplineFabric:
    """One straight yarn along x, or one that lies on a circle."""
    place = np.arange(-1, segments + 2) * (length / segments)
    control = np.column_stack([place, np.zeros((len(place), 2))])
    if curvature:
        angle = place * curvature
        # The circle through the control points shrinks by (2 + cos)/3 at the knots.
        size = 3.0 / (2.0 + np.cos(angle[1] - angle[0])) / curvature
        control = size * np.column_stack([np.sin(angle), 1.0 - np.cos(angle), 0.0 * angle])
    return SplineFabric(control[None], 1e-3, WOOL, NONE, NONE, NONE)


def test_counts_are_those_of_figure_9() -> None:
    counts = jersey(15, 30, WOOL).counts()
    assert counts == {
        "control_points_per_yarn": 243,
        "dofs_per_yarn": 729,
        "control_points": 3645,
        "dofs": 10935,
        "constraints": 2700,
        "unknowns": 13635,
    }


@pytest.mark.parametrize(("rows", "columns"), [(0, 3), (3, -1), (2.5, 3)])
def test_refuses_impossible_sizes(rows: float, columns: float) -> None:
    with pytest.raises(InputError, match="whole number"):
        jersey(rows, columns, WOOL)  # type: ignore[arg-type]


def test_blending_functions_are_those_of_scipy() -> None:
    knots = np.arange(-3.0, 5.0)
    u = np.linspace(0.0, 0.99, 7)
    for derivative in range(3):
        expected = np.array([[BSpline(knots, c, 3)(v, derivative) for c in np.eye(4)] for v in u])
        np.testing.assert_allclose(blending(u, derivative), expected, atol=1e-14)


def test_periodic_control_points_go_through_the_samples() -> None:
    samples = np.random.default_rng(0).standard_normal((8, 3))
    control = control_of_periodic(samples)
    through = (np.roll(control, 1, axis=0) + 4 * control + np.roll(control, -1, axis=0)) / 6
    np.testing.assert_allclose(through, samples, atol=1e-14)


def test_gradient_and_hessian_are_derivatives(fabric: SplineFabric) -> None:
    energy, rng = SplineEnergy(fabric), np.random.default_rng(1)
    x = fabric.control.ravel() + 1e-4 * rng.standard_normal(energy.size)
    direction, h = rng.standard_normal(energy.size), 1e-8
    value, gradient, model = energy.quadratic(x)
    slope = (energy.value(x + h * direction) - energy.value(x - h * direction)) / (2 * h)
    assert value > 0
    assert gradient @ direction == pytest.approx(slope, rel=1e-6)
    change = (energy.gradient(x + h * direction)[1] - energy.gradient(x - h * direction)[1]) / (2 * h)
    np.testing.assert_allclose(
        energy.pattern.multiply(model.entries, direction), change, atol=1e-6 * np.abs(change).max()
    )


def test_stretched_straight_yarn_has_the_energy_of_a_rod() -> None:
    """½ E A ε² L, exactly: the strain is uniform."""
    fabric, strain = _line(0.1, 12), 0.03
    energy = SplineEnergy(fabric).value(((1 + strain) * fabric.control).ravel())
    stiffness = WOOL.stretch_stiffness(1e-3)
    assert energy == pytest.approx(0.5 * stiffness * strain**2 * 0.1, rel=1e-4)


def test_bent_yarn_approaches_the_energy_of_a_circle() -> None:
    """½ E I κ² L of a straight yarn bent to a circle, with the fourth order of the spline's error."""
    curvature, errors = 20.0, []
    for segments in (8, 16):
        straight, bent = _line(0.1, segments), _line(0.1, segments, curvature)
        exact = 0.5 * WOOL.bending_stiffness(1e-3) * curvature**2 * 0.1
        energy = SplineEnergy(straight).value(bent.control.ravel())
        errors.append(abs(energy / exact - 1))
    assert errors[1] < 1e-3
    assert errors[0] / errors[1] > 3


def test_rigid_motion_costs_nothing_and_keeps_contacts(fabric: SplineFabric) -> None:
    energy, contacts = SplineEnergy(fabric), SplineContacts.of(fabric)
    turn = Rotation.from_rotvec([0.3, -1.2, 0.4]).as_matrix()
    moved = fabric.control.reshape(-1, 3) @ turn.T + [0.1, -0.2, 0.05]
    assert energy.value(moved.ravel()) == pytest.approx(0.0, abs=1e-15)
    np.testing.assert_allclose(contacts.linearised(moved)[1], 0.0, atol=1e-16)


def test_contact_forces_exert_neither_force_nor_torque(fabric: SplineFabric) -> None:
    control = fabric.control.reshape(-1, 3) + 1e-4 * np.random.default_rng(2).standard_normal(
        (len(fabric.control.reshape(-1, 3)), 3)
    )
    rows, _ = SplineContacts.of(fabric).linearised(control)
    force = (rows.T @ np.random.default_rng(3).standard_normal(rows.shape[0])).reshape(-1, 3)
    scale = np.abs(force).sum()
    np.testing.assert_allclose(force.sum(axis=0), 0.0, atol=1e-13 * scale)
    np.testing.assert_allclose(np.cross(control, force).sum(axis=0), 0.0, atol=1e-13 * scale)


def test_contact_rows_are_derivatives(fabric: SplineFabric) -> None:
    contacts, rng = SplineContacts.of(fabric), np.random.default_rng(4)
    control = fabric.control.reshape(-1, 3) + 1e-4 * rng.standard_normal(fabric.control.reshape(-1, 3).shape)
    direction, h = rng.standard_normal(control.shape), 1e-7
    rows, _ = contacts.linearised(control)
    there, back = (contacts.linearised(control + sign * h * direction)[1] for sign in (1, -1))
    np.testing.assert_allclose(rows @ direction.ravel(), (there - back) / (2 * h), atol=1e-6)


def test_mass_is_that_of_the_yarn(fabric: SplineFabric) -> None:
    """A uniform velocity has ½ m v², and gravity pulls with the whole weight."""
    energy = SplineEnergy(fabric)
    mass = WOOL.mass_per_length(fabric.radius) * energy.lengths.sum()
    ones = np.ones(energy.size // 3)
    assert ones @ (energy.mass_matrix() @ ones) == pytest.approx(mass, rel=1e-12)
    np.testing.assert_allclose(
        energy.weight(np.array([0.0, 0.0, -9.81])).reshape(-1, 3).sum(axis=0),
        [0, 0, -9.81 * mass],
        atol=1e-15,
    )
    vector = np.random.default_rng(5).standard_normal((energy.size // 3, 3))
    np.testing.assert_allclose(
        energy.pattern.multiply(energy.mass_entries, vector.ravel()),
        (energy.mass_matrix() @ vector).ravel(),
        atol=1e-18,
    )


def test_mass_matrix_is_exact() -> None:
    """Against fine quadrature of the products of blending functions."""
    fabric = _line(0.1, 5)
    energy, u = SplineEnergy(fabric), (np.arange(2000) + 0.5) / 2000
    b = blending(u)
    expected = np.zeros((energy.size // 3,) * 2)
    for segment, mass in zip(fabric.segments, energy.masses, strict=True):
        expected[np.ix_(segment, segment)] += mass * b.T @ b / len(u)
    np.testing.assert_allclose(energy.mass_matrix().toarray(), expected, rtol=1e-6, atol=1e-12 * expected.max())
