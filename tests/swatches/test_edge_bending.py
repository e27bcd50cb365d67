"""EST22 eq. 4 taken literally, edge by edge, against the smooth bending energy of the orthotropic material."""

from __future__ import annotations

import numpy as np
import pytest

from yarnscale.shell.elastic.energy import ShellEnergy
from yarnscale.shell.materials.orthotropic import OrthotropicMaterial
from yarnscale.shell.mesh import TriangleMesh, rectangle


def rolled(mesh: TriangleMesh, curvature: float) -> np.ndarray:
    """The panel on a cylinder whose axis is the panel's x, along which rows of edges lie."""
    x, y = mesh.panel.T
    return np.column_stack([x, np.sin(curvature * y) / curvature, (1 - np.cos(curvature * y)) / curvature])


def literal_energy(mesh: TriangleMesh, positions: np.ndarray, stiffness: float) -> float:
    """Σ over inner edges of k (3θ/H)² times the area of both triangles, H their mean altitude on the edge."""
    corners = positions[mesh.triangles]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    areas = 0.5 * np.linalg.norm(normals, axis=1)
    normals /= 2 * areas[:, None]
    sides: dict[tuple[int, int], list[int]] = {}
    for row, triangle in enumerate(mesh.triangles):
        for k in range(3):
            a, b = sorted((int(triangle[k]), int(triangle[(k + 1) % 3])))
            sides.setdefault((a, b), []).append(row)
    total = 0.0
    for (a, b), rows in sides.items():
        if len(rows) == 2:
            length = np.linalg.norm(positions[a] - positions[b])
            altitude = np.mean([2 * areas[row] / length for row in rows])
            angle = np.arccos(np.clip(normals[rows[0]] @ normals[rows[1]], -1.0, 1.0))
            total += stiffness * (3 * angle / altitude) ** 2 * areas[rows].sum()
    return total


def test_the_literal_sum_is_nine_times_the_energy_of_the_cylinder():
    """The factor that the material documents, for constants estimated edge by edge with aligned meshes."""
    mesh = rectangle(0.2, 0.2, 0.004)
    positions = rolled(mesh, 10.0)
    cloth = OrthotropicMaterial(0.0, 0.0, 0.0, 0.0, bend_weft=1e-6, bend_bias=1e-6, bend_warp=1e-6)
    smooth = ShellEnergy(mesh, cloth)
    smooth.follow(positions)
    energy = smooth.value(positions)
    assert energy == pytest.approx(1e-6 * 100 * 0.04, rel=0.03)
    assert literal_energy(mesh, positions, 1e-6) == pytest.approx(9 * energy, rel=0.05)


def test_derivatives_of_the_coefficients_are_finite_differences():
    for bias in (0.2e-6, 3e-6):  # the coupling of curvatures changes its form between these
        values = dict(
            zip(
                OrthotropicMaterial.constants(),
                (40.0, 9.0, 25.0, 6.0, 1.5, 0.3, 2e-6, bias, 1e-6),
                strict=True,
            )
        )
        cloth = OrthotropicMaterial(**values)
        for name, value in values.items():
            step = 1e-4 * value
            above = OrthotropicMaterial(**values | {name: value + step}).coefficients
            below = OrthotropicMaterial(**values | {name: value - step}).coefficients
            np.testing.assert_allclose(cloth.derivative(name), (above - below) / (2 * step), rtol=1e-8, atol=1e-9)
