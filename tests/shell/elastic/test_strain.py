"""Fundamental forms: sign, invariance, derivatives, convergence, free edges, folds beyond half a turn."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

from yarnscale.shell.elastic.elements import ShellElements, shell_elements
from yarnscale.shell.elastic.strain import GEOMETRY, form_kernels, fundamental_forms
from yarnscale.shell.mesh import TriangleMesh, rectangle


def cylinder(mesh: TriangleMesh, curvature: float, angle: float = 0.0) -> np.ndarray:
    """The mesh rolled without stretch about an axis perpendicular to the direction ``angle``; z = +u²/2 at first."""
    along = np.array([np.cos(angle), np.sin(angle)])
    across = np.array([-along[1], along[0]])
    u, v = mesh.material @ along, mesh.material @ across
    flat = np.outer(np.sin(curvature * u) / curvature, along) + np.outer(v, across)
    return np.column_stack([flat, (1 - np.cos(curvature * u)) / curvature])


def columns(elements: ShellElements, values: np.ndarray) -> np.ndarray:
    """(blocks, 6, BLOCK) → (6, elements with area)."""
    return values.transpose(1, 0, 2).reshape(6, -1)[:, elements.areas.ravel() > 0]


def inner(mesh: TriangleMesh, elements: ShellElements, margin: float) -> np.ndarray:
    """Elements with area whose triangle is ``margin`` away from the outline."""
    centres = np.abs(mesh.panel[mesh.triangles].mean(axis=1)) + margin < mesh.panel.max(axis=0)
    return centres.all(axis=1)[elements.triangles.ravel()][elements.areas.ravel() > 0]


@pytest.mark.parametrize("angle", [0.0, 0.4, np.pi / 2, 2.5])
def test_cylinder_has_its_curvature_with_its_sign(angle: float) -> None:
    mesh = rectangle(0.1, 0.1, 0.004)
    elements = shell_elements(mesh)
    forms = columns(elements, elements.forms(cylinder(mesh, 10.0, angle)))
    c, s = np.cos(angle), np.sin(angle)
    expected = np.array([1, 0, 1, 10 * c * c, 10 * c * s, 10 * s * s])
    found = forms[:, inner(mesh, elements, 0.008)]
    np.testing.assert_allclose(found[:3], expected[:3, None] * np.ones(found.shape[1]), atol=2e-4)
    np.testing.assert_allclose(found[3:], expected[3:, None] * np.ones(found.shape[1]), atol=0.15)


def test_error_of_forms_falls_with_the_square_of_the_spacing() -> None:
    errors = []
    for spacing in (0.008, 0.004, 0.002):
        mesh = rectangle(0.064, 0.064, spacing)
        elements = shell_elements(mesh)
        forms = columns(elements, elements.forms(cylinder(mesh, 20.0, 0.3)))[:, inner(mesh, elements, 0.018)]
        c, s = np.cos(0.3), np.sin(0.3)
        expected = np.array([1, 0, 1, 20 * c * c, 20 * c * s, 20 * s * s])
        scale = np.array([1, 1, 1, 20, 20, 20])
        errors.append(np.abs((forms - expected[:, None]) / scale[:, None]).max())
    rates = np.log2(np.array(errors[:-1]) / errors[1:])
    # The rows are not exactly equilateral, which limits the rate on the finest mesh.
    assert rates[0] > 1.5 and errors[-1] < 0.03, (errors, rates)


def test_rigid_motion_changes_nothing() -> None:
    rng = np.random.default_rng(1)
    mesh = rectangle(0.05, 0.05, 0.01)
    elements = shell_elements(mesh)
    positions = cylinder(mesh, 15.0, 0.7) + 1e-4 * rng.standard_normal((mesh.vertex_count, 3))
    rotation, _ = np.linalg.qr(rng.standard_normal((3, 3)))
    rotation *= np.sign(np.linalg.det(rotation))
    moved = positions @ rotation.T + [0.3, -2.0, 1.0]
    before, after = elements.forms(positions), elements.forms(moved)
    np.testing.assert_allclose(after, before, rtol=1e-9, atol=1e-8)


def test_turning_the_cloth_over_changes_the_sign_of_curvature() -> None:
    mesh = rectangle(0.05, 0.05, 0.01)
    elements = shell_elements(mesh)
    up, down = cylinder(mesh, 10.0, 0.3), cylinder(mesh, 10.0, 0.3) * [1, 1, -1]
    np.testing.assert_allclose(elements.forms(up)[:, 3:], -elements.forms(down)[:, 3:], atol=1e-9)


def random_state(seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Positions (18, 8) and geometry (18, 8) of crumpled stencils with all that geometry may hold."""
    rng = np.random.default_rng(seed)
    flat = np.array([[0, 0, 0], [1, 0, 0], [0.5, 0.9, 0], [0.5, -0.9, 0], [1.5, 0.8, 0], [-0.5, 0.8, 0]], float)
    positions = (flat.ravel()[:, None] + 0.2 * rng.standard_normal((18, 8))).copy()
    geometry = np.zeros((GEOMETRY, 8))
    geometry[0:4] = np.array([1.0, 0, -0.5, 1.1])[:, None] + 0.1 * rng.standard_normal((4, 8))
    geometry[4:8] = np.array([1.0, 0, -0.5, 1.1])[:, None] + 0.1 * rng.standard_normal((4, 8))
    geometry[8, ::2] = 1.0
    geometry[9:12] = 1.0
    geometry[10, 3] = geometry[9, 5] = 0.0
    geometry[12:18] = rng.uniform(-1, 1, (6, 8))
    return positions, geometry


def test_jacobian_matches_finite_differences() -> None:
    positions, geometry = random_state()
    forms, jacobian = np.empty((6, 8)), np.empty((108, 8))
    form_kernels().jacobian(8, 8, positions, geometry, forms, jacobian)
    plain = np.empty((6, 8))
    form_kernels().value(8, 8, positions, geometry, plain)
    np.testing.assert_allclose(forms, plain, rtol=1e-12, atol=1e-13)
    step = 1e-6
    assert np.abs(jacobian).max() > 0.1
    for i in range(18):
        sides = []
        for sign in (1, -1):
            moved = positions.copy()
            moved[i] += sign * step
            side = np.empty((6, 8))
            form_kernels().value(8, 8, moved, geometry, side)
            sides.append(side)
        numeric = (sides[0] - sides[1]) / (2 * step)
        np.testing.assert_allclose(jacobian.reshape(6, 18, 8)[:, i], numeric, atol=2e-8)


def test_curvature_term_matches_finite_differences() -> None:
    positions, geometry = random_state(2)
    stress = np.random.default_rng(3).standard_normal((6, 8))
    term = np.empty((171, 8))
    form_kernels().curvature(8, 8, positions, geometry, stress, term)
    assert np.abs(term).max() > 0.1
    step = 1e-6
    for i in range(18):
        sides = []
        for sign in (1, -1):
            moved, forms, jacobian = positions.copy(), np.empty((6, 8)), np.empty((108, 8))
            moved[i] += sign * step
            form_kernels().jacobian(8, 8, moved, geometry, forms, jacobian)
            sides.append(np.einsum("kn,kin->in", stress, jacobian.reshape(6, 18, 8)))
        numeric = (sides[0] - sides[1]) / (2 * step)
        for j in range(i + 1):
            np.testing.assert_allclose(term[i * (i + 1) // 2 + j], numeric[j], atol=5e-8)


def test_kernel_is_the_symbolic_function() -> None:
    positions, geometry = random_state(4)
    forms = np.empty((6, 8))
    form_kernels().value(8, 8, positions, geometry, forms)
    x, g = ca.SX.sym("x", 18), ca.SX.sym("g", GEOMETRY)
    symbolic = ca.Function("symbolic", [x, g], [fundamental_forms(x, g)])
    for n in range(8):
        expected = np.array(symbolic(ca.DM(positions[:, n]), ca.DM(geometry[:, n]))).ravel()
        np.testing.assert_allclose(forms[:, n], expected, rtol=1e-12, atol=1e-13)


def test_folds_are_followed_beyond_half_a_turn() -> None:
    """Two leaves about one hinge: the fold angle grows through π and comes back."""
    points = np.array([[-1, 0], [0, 0], [1, 0], [-1, 1], [0, 1], [1, 1]], float) * 0.01
    mesh = TriangleMesh(points, np.array([[0, 1, 4], [0, 4, 3], [1, 2, 5], [1, 5, 4]]))
    elements = shell_elements(mesh, free_edges="zero")
    angles, reached = np.linspace(0, 4.5, 30), []
    for angle in [*angles, *angles[::-1]]:
        positions = np.column_stack([points, np.zeros(6)])
        positions[[2, 5]] = np.column_stack([0.01 * np.cos([angle] * 2), points[[2, 5], 1], 0.01 * np.sin([angle] * 2)])
        # Evaluated before the reference follows, as in a step of Newton.
        forms = columns(elements, elements.forms(positions))
        assert forms[3, 0] == pytest.approx(100 * angle, abs=1e-8)
        reached.append(elements.follow(positions))
    np.testing.assert_allclose(reached, [*angles, *angles[::-1]], atol=1e-12)


def test_free_edges_see_a_curl_only_when_extrapolated() -> None:
    mesh = rectangle(0.1, 0.1, 0.005)
    curled = cylinder(mesh, 10.0, np.pi / 2)  # about the x-axis: the rows at top and bottom are along the axis
    bending = {}
    for treatment in ("zero", "extrapolate"):
        elements = shell_elements(mesh, free_edges=treatment)
        forms = elements.forms(curled)
        energy = (forms[:, 3] ** 2 + 2 * forms[:, 4] ** 2 + forms[:, 5] ** 2) * elements.areas
        bending[treatment] = energy.sum() / (100 * mesh.areas.sum())
        assert elements.areas.sum() == pytest.approx(mesh.areas.sum())
    assert abs(bending["extrapolate"] - 1) < 2e-3
    assert bending["zero"] < 0.96
