"""Yarns on a mesh as sheets to simulate: the cell's energy on flat cloth, frames that turn with it, borders."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from yarnscale.cell import PeriodicCell
from yarnscale.detail.yarn_sheet import sheet_on_mesh
from yarnscale.drawing import library
from yarnscale.fabric.boundary import glue
from yarnscale.fabric.direct_energy import FabricEnergy
from yarnscale.shell.mesh import TriangleMesh, rectangle
from yarnscale.yarn.material import YarnMaterial
from yarnscale.yarn.pattern import YarnPattern

STOCKINETTE = library.build("stockinette")


def _density(pattern: YarnPattern, energy: FabricEnergy, inside: np.ndarray) -> float:
    """Energy over area of the whole periods inside [J/m²]."""
    shares = energy.vertex_shares(energy.start())[0]
    return float(shares[inside].sum() / (inside.sum() / len(pattern.edges) * pattern.area))


@pytest.mark.parametrize("name", ["stockinette", "stockinette-small", "plain"])
def test_on_a_flat_mesh_the_energy_is_that_of_the_cell(name: str) -> None:
    pattern = library.build(name)
    material = YarnMaterial.preset(library.structure(name).material)
    cell = PeriodicCell(pattern, material)
    state = cell.relax()
    width, height = (8 * pattern.period).tolist()
    laid = sheet_on_mesh(pattern, rectangle(width, height, width / 9), state=state)
    energy = FabricEnergy(laid.sheet, material)
    middle = np.round(laid.sheet.tile.mean(axis=0))
    inside = np.abs(laid.sheet.tile - middle).max(axis=1) <= 1
    assert inside.sum() == 9 * len(pattern.edges)
    assert _density(pattern, energy, inside) == pytest.approx(state.energy_density, rel=1e-6)
    np.testing.assert_allclose(laid.normals, np.tile([0.0, 0.0, 1.0], (len(inside), 1)), atol=1e-9)


def test_frames_turn_with_the_mesh_and_yarns_lie_on_it() -> None:
    """A quarter of a tube in two attitudes: the same energy; yarns at the radius of the tube plus their height."""
    flat = rectangle(0.06, 0.05, 0.004)
    radius = 0.04
    angle = flat.material[:, 0] / radius
    tube = np.stack([radius * np.sin(angle), flat.material[:, 1], radius * np.cos(angle)], axis=1)
    turn = np.linalg.qr(np.random.default_rng(5).standard_normal((3, 3)))[0]
    turn *= np.linalg.det(turn)
    energies = []
    for positions in (tube, tube @ turn.T):
        laid = sheet_on_mesh(STOCKINETTE, flat, positions=positions)
        energy = FabricEnergy(laid.sheet, YarnMaterial.preset("hylc2020-stockinette"))
        energies.append(energy.value(energy.start()))
        if positions is tube:
            out = np.hypot(laid.sheet.vertices[:, 0], laid.sheet.vertices[:, 2])
            height = STOCKINETTE.vertices[laid.sheet.source, 2]
            middle = laid.border_distance > 0.008
            np.testing.assert_allclose(out[middle], radius + height[middle], atol=2e-5)
            radial = laid.sheet.vertices * [1, 0, 1] / out[:, None]
            assert (np.einsum("ni,ni->n", radial, laid.normals)[middle] > 0.999).all()
    assert energies[0] == pytest.approx(energies[1], rel=1e-9)


def test_borders_and_seams_are_told_and_glued_along_the_normal() -> None:
    """Two panels sewn along x = 0.03, each with material coordinates of its own, standing upright."""
    one = rectangle(0.03, 0.04, 0.005)
    count = len(one.material)
    triangles = np.concatenate([one.triangles, one.triangles + count])
    material = np.concatenate([one.material, one.material + np.array([0.5, 0.2])])
    spread = np.concatenate([one.material, one.material + np.array([0.03, 0.0])])
    _, first, number = np.unique(spread.round(9), axis=0, return_index=True, return_inverse=True)
    upright = np.stack([spread[first, 0], np.zeros(len(first)), spread[first, 1]], axis=1)
    mesh = TriangleMesh(material, number.reshape(-1)[triangles], corners=triangles, assembled=upright)
    laid = sheet_on_mesh(STOCKINETTE, mesh)
    low, high = one.material.min(axis=0), one.material.max(axis=0)
    x, z = laid.sheet.vertices[:, 0] - low[0], laid.sheet.vertices[:, 2] - low[1]
    np.testing.assert_allclose(high - low, [0.03, 0.04])
    near = np.min([x, np.abs(x - 0.03), 0.06 - x, z, 0.04 - z], axis=0)
    inside = (near > 0.004) & (laid.border_distance > 0.004)
    np.testing.assert_allclose(laid.border_distance[inside], near[inside], atol=6e-4)
    np.testing.assert_allclose(np.abs(laid.normals[:, 1]), 1.0, atol=1e-9)
    material_ = YarnMaterial.preset("hylc2020-stockinette")
    springs = glue(laid.sheet, material_, width=0.006, distance=laid.border_distance, normals=laid.normals, pull=0.5)
    away = laid.sheet.vertices[springs.pairs[:, 0]] - laid.sheet.vertices[springs.pairs[:, 1]]
    expected = np.sqrt(away[:, 0] ** 2 + 0.25 * away[:, 1] ** 2 + away[:, 2] ** 2)
    length = np.linalg.norm(away, axis=1)
    np.testing.assert_allclose(springs.rest_length, np.maximum(expected, 0.1 * length), rtol=1e-9)
    # The same springs as those of the sheet laid flat.
    turned = replace(laid.sheet, vertices=laid.sheet.vertices @ np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]]).T)
    flat = glue(turned, material_, width=0.006, distance=laid.border_distance, pull=0.5)
    np.testing.assert_allclose(flat.rest_length, springs.rest_length, rtol=1e-9)
