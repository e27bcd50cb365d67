"""Yarns on cloth against the cell's own equilibria, and what may not change them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from yarnscale.cell import PeriodicCell
from yarnscale.cell.midsurface import Midsurface
from yarnscale.cell.poisson import cell_midsurface
from yarnscale.detail.fluctuations import FluctuationTable
from yarnscale.detail.yarns import YarnDetail
from yarnscale.errors import InputError
from yarnscale.kinematics import ShellStrain
from yarnscale.shell.mesh import TriangleMesh, rectangle


def deformed(mesh: TriangleMesh, strain: ShellStrain) -> np.ndarray:
    return Midsurface(strain).at(np.column_stack([mesh.material, np.zeros(len(mesh.material))]))[0]


def equilibrium(cell: PeriodicCell, strain: ShellStrain, detail: YarnDetail) -> np.ndarray:
    """Where the cell itself puts the copies of its vertices."""
    layout, pattern = detail.layout, cell.pattern
    tiles = np.rint((layout.material - pattern.vertices[layout.vertex, :2]) / pattern.period)
    return cell.placement(cell.relax(strain))(layout.vertex, tiles.astype(np.int64))


def motion(seed: int) -> tuple[np.ndarray, np.ndarray]:
    generator = np.random.default_rng(seed)
    turn = np.linalg.qr(generator.normal(size=(3, 3)))[0]
    return turn * np.linalg.det(turn), generator.normal(size=3)


def wavy(mesh: TriangleMesh) -> np.ndarray:
    x, y = mesh.material.T
    return np.column_stack(
        [1.1 * x + 0.1 * y, 0.95 * y, 0.008 * np.sin(60 * x + 1) * np.cos(45 * y) + 0.004 * np.cos(90 * y)]
    )


@pytest.mark.parametrize("s", [(0.05, 0.0, 0.1), (0.2, 0.15, 0.1), (0.2, 0.0, 0.25)])
def test_uniform_strain_is_the_cell_exactly(
    cell: PeriodicCell, table: FluctuationTable, s: tuple[float, float, float]
) -> None:
    mesh = rectangle(0.05, 0.04, 0.008, irregularity=0.28, grain=0.3)
    detail, strain = YarnDetail.of(table, mesh), ShellStrain(*s)
    turn, shift = motion(2)
    found = detail.curves(deformed(mesh, strain) @ turn.T + shift)
    expected = equilibrium(cell, strain, detail) @ turn.T + shift
    # The equilibria are converged to some 1e-6 only, and the starts of the solves differ.
    assert np.abs(found - expected).max() < 1e-3 * cell.pattern.radius


@pytest.mark.parametrize("bend", [(40.0, 0.0), (0.0, -40.0)])
def test_a_cylinder_converges_to_the_cell(
    cell: PeriodicCell, table: FluctuationTable, bend: tuple[float, float]
) -> None:
    strain = ShellStrain(0.2, 0.0, 0.1, bend[0], 0.0, bend[1])
    errors = []
    for spacing in (0.008, 0.004):
        mesh = rectangle(0.04, 0.04, spacing)
        detail = YarnDetail.of(table, mesh)
        surface, radius = cell_midsurface(cell.pattern, strain), cell.pattern.radius
        points = surface.at(np.column_stack([mesh.material, np.zeros(len(mesh.material))]) / radius)[0]
        gaps = detail.curves(points * radius) - equilibrium(cell, strain, detail)
        errors.append(np.linalg.norm(gaps, axis=1).mean())
    assert errors[1] < 0.02 * cell.pattern.radius
    assert np.log2(errors[0] / errors[1]) > 1.7


def test_rigid_motions_carry_the_yarns_along(made_up: FluctuationTable) -> None:
    mesh = rectangle(0.05, 0.05, 0.006, irregularity=0.2)
    detail = YarnDetail.of(made_up, mesh)
    turn, shift = motion(7)
    before = detail.curves(wavy(mesh))
    after = detail.curves(wavy(mesh) @ turn.T + shift)
    np.testing.assert_allclose(after, before @ turn.T + shift, atol=1e-12)


def test_yarns_are_seamless_across_triangles(made_up: FluctuationTable) -> None:
    """A point on a shared edge lies at one place, whichever of the two triangles it is reckoned from."""
    mesh = rectangle(0.05, 0.05, 0.006, irregularity=0.25)
    detail = YarnDetail.of(made_up, mesh)
    triangle, edge = np.nonzero(mesh.has_neighbour)
    here, there = mesh.triangles[triangle, edge], mesh.triangles[triangle, (edge + 1) % 3]
    share = np.random.default_rng(0).uniform(size=len(triangle))
    pairs = {(int(a), int(b)): k for k, (a, b) in enumerate(zip(here, there, strict=True))}
    twin = np.array([pairs[int(b), int(a)] for a, b in zip(here, there, strict=True)])

    def placed(owner: np.ndarray) -> np.ndarray:
        place = np.zeros((len(owner), 3))
        for column, weight in ((here, share), (there, 1 - share)):
            place[mesh.triangles[owner] == column[:, None]] = weight
        material = np.einsum("nk,nkc->nc", place, mesh.material[mesh.triangles[owner]])
        vertex = np.arange(len(owner)) % len(made_up.pattern.vertices)
        layout = replace(detail.layout, vertex=vertex, triangle=owner, place=place, material=material)
        return replace(detail, layout=layout).curves(wavy(mesh))

    assert np.abs(placed(triangle) - placed(triangle[twin])).max() < 1e-14


def test_states_are_those_of_the_surface(made_up: FluctuationTable) -> None:
    mesh = rectangle(0.05, 0.05, 0.003)
    strain = ShellStrain(0.1, 0.2, -0.05, 20.0, 0.0, 0.0)
    states = YarnDetail.of(made_up, mesh).states(deformed(mesh, strain))
    np.testing.assert_allclose(states[:, :3], np.broadcast_to([0.1, 0.2, -0.05], states[:, :3].shape), atol=2e-3)
    np.testing.assert_allclose(states[:, 3], 20.0, rtol=1e-2)


@pytest.mark.parametrize("shape", ["line", "point", "folded", "mirrored"])
def test_ruined_cloth_still_gives_finite_yarns(made_up: FluctuationTable, shape: str) -> None:
    mesh = rectangle(0.05, 0.05, 0.006, irregularity=0.2)
    flat = np.column_stack([mesh.material, np.zeros(len(mesh.material))])
    ruin = {
        "line": flat * [1.0, 0.0, 0.0],
        "point": flat * 0.0,
        "folded": np.abs(flat),
        "mirrored": flat * [-1.0, 1.0, 1.0],
    }
    found = YarnDetail.of(made_up, mesh).curves(ruin[shape])
    assert np.isfinite(found).all() and np.abs(found).max() < 0.1


def test_positions_of_another_mesh_are_refused(made_up: FluctuationTable) -> None:
    mesh = rectangle(0.03, 0.03, 0.006)
    detail = YarnDetail.of(made_up, mesh)
    with pytest.raises(InputError, match="positions of the cloth"):
        detail.curves(np.zeros((3, 3)))
    bad = np.zeros((mesh.vertex_count, 3))
    bad[4, 1] = np.nan
    with pytest.raises(InputError, match="finite"):
        detail.curves(bad)
