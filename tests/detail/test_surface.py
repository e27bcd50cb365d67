"""The smooth surface of a mesh: what it reproduces exactly, and how fast it converges elsewhere."""

from __future__ import annotations

import numpy as np
import pytest

from yarnscale.detail.surface import SurfaceFit
from yarnscale.shell.mesh import TriangleMesh, disk, rectangle

SECOND = np.array([[[3.0, -1.0, 0.5], [2.0, 0.7, -4.0]], [[2.0, 0.7, -4.0], [-1.0, 2.0, 6.0]]])


def quadratic(xi: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A quadratic map to space and its gradient."""
    first = np.array([[1.1, 0.1, 0.2], [-0.2, 0.9, 0.1]])
    points = xi @ first + 0.5 * np.einsum("na,nb,abc->nc", xi, xi, SECOND)
    return points, first + np.einsum("nb,abc->nac", xi, SECOND)


@pytest.mark.parametrize(
    "mesh",
    [
        rectangle(0.1, 0.07, 0.01, irregularity=0.29, seed=3),
        rectangle(0.1, 0.02, 0.01, grain=0.7),
        disk(0.05, 0.01),
    ],
    ids=["irregular", "narrow", "disk"],
)
def test_quadratics_are_exact_up_to_the_border(mesh: TriangleMesh) -> None:
    points, gradient = quadratic(mesh.material)
    found, _, second = SurfaceFit.of(mesh).forms(points)
    np.testing.assert_allclose(found, gradient, atol=1e-11)
    normal = np.cross(gradient[:, 0], gradient[:, 1])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    expected = np.einsum("nc,abc->nab", normal, SECOND)
    np.testing.assert_allclose(
        second, np.stack([expected[:, 0, 0], expected[:, 0, 1], expected[:, 1, 1]], 1), atol=1e-8
    )


def test_a_mesh_too_small_for_a_quadratic_keeps_affine_maps() -> None:
    corners = np.array([[0, 0], [1, 0], [0, 1], [1, 1], [2, 0], [2, 1]], float)
    mesh = TriangleMesh(corners, np.array([[0, 1, 2], [1, 3, 2], [1, 4, 3], [4, 5, 3]]))
    gradient = np.array([[1.0, 0.2, 0.3], [0.1, 0.8, -0.5]])
    found, first, second = SurfaceFit.of(mesh).forms(corners @ gradient)
    metric = gradient @ gradient.T
    np.testing.assert_allclose(first, np.tile([metric[0, 0], metric[0, 1], metric[1, 1]], (6, 1)), atol=1e-12)
    np.testing.assert_allclose(found, np.broadcast_to(gradient, (6, 2, 3)), atol=1e-12)
    np.testing.assert_allclose(second, 0.0, atol=1e-12)


def test_forms_of_a_wave_converge() -> None:
    errors = []
    for spacing in (0.02, 0.01):
        mesh = rectangle(0.2, 0.2, spacing, irregularity=0.2, seed=1)
        x, y = mesh.material.T
        points = np.column_stack([x, y, 0.02 * np.sin(20 * x) * np.cos(15 * y)])
        slope = np.array([0.4 * np.cos(20 * x) * np.cos(15 * y), -0.3 * np.sin(20 * x) * np.sin(15 * y)])
        gradient, first, second = SurfaceFit.of(mesh).forms(points)
        bend = -8 * np.sin(20 * x) * np.cos(15 * y) / np.sqrt(1 + (slope**2).sum(axis=0))
        inner = (np.abs(mesh.material) < 0.06).all(axis=1)
        errors.append(
            (
                np.abs(gradient[inner, :, 2] - slope.T[inner]).mean(),
                np.abs(second[inner, 0] - bend[inner]).mean(),
                np.abs(first[inner, 0] - (1 + slope[0] ** 2)[inner]).mean(),
            )
        )
    orders = np.log2(np.array(errors[0]) / errors[1])
    assert orders[0] > 1.6 and orders[1] > 0.7 and orders[2] > 0.9


def test_a_roll_of_few_triangles_is_not_compressed() -> None:
    """A cylinder of a radius of one and a half edges: a fit alone would see a fifth of compression."""
    mesh = rectangle(0.1, 0.06, 0.006)
    angle = mesh.material[:, 0] / 0.009
    points = np.column_stack([0.009 * np.sin(angle), mesh.material[:, 1], 0.009 * (1 - np.cos(angle))])
    gradient, first, _ = SurfaceFit.of(mesh).forms(points)
    assert np.sqrt(first[:, 0]).min() > 0.97
    assert np.linalg.norm(gradient[:, 0], axis=1).min() < 0.9
