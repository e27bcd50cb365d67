"""One energy of rods that touch: of a period and its copies, and of a finite fabric."""

from __future__ import annotations

import numpy as np
import pytest

from yarnscale.cell.energy import CellEnergy
from yarnscale.drawing.curves import PeriodicCurve, pattern_from_curves
from yarnscale.fabric.direct_energy import FabricEnergy
from yarnscale.fabric.sheet import YarnSheet
from yarnscale.kinematics import ShellStrain
from yarnscale.yarn.material import YarnMaterial
from yarnscale.yarn.pattern import YarnPattern

RADIUS = 1e-3
WOOL = YarnMaterial.preset("wool")


@pytest.fixture
def rings() -> YarnPattern:
    """Two rings that press on each other where they are linked, far from all their copies."""
    angle = 2.0 * np.pi * np.arange(16)[:, None] / 16
    zero, size = np.zeros_like(angle), 4.0 * RADIUS
    flat = size * np.hstack([np.cos(angle), np.sin(angle), zero])
    upright = size * np.hstack([np.cos(angle) + 0.25, zero, np.sin(angle)])
    curves = [PeriodicCurve(points, (0, 0)) for points in (flat, upright)]
    return pattern_from_curves(curves, [0.05, 0.05], RADIUS)


def test_rings_of_a_cell_are_those_of_a_finite_fabric(rings: YarnPattern) -> None:
    """Value, gradient, Hessian and step bound, at several states: copies that touch nothing change nothing."""
    offsets, tile = np.array([0, 16, 32]), np.zeros((32, 2), np.int64)
    sheet = YarnSheet.of_vertices(rings, np.arange(32), tile, offsets, np.array([True, True]))
    cell, fabric = CellEnergy(rings, WOOL, ShellStrain()), FabricEnergy(sheet, WOOL)
    random, x = np.random.default_rng(0), np.concatenate([np.zeros(96), rings.twist])
    for _ in range(3):
        x = x + 0.05 * random.standard_normal(len(x))
        full = x + np.concatenate([rings.vertices.ravel() / RADIUS, np.zeros(32)])
        probe = random.standard_normal(len(x))
        value, gradient, model = cell.quadratic(x)
        same, forces, block, entries = fabric.hessian(full)
        assert fabric.parts(full)["contact"] > 0.0
        assert value == pytest.approx(same, rel=1e-12) and cell.value(x) == pytest.approx(fabric.value(full))
        np.testing.assert_allclose(forces.sum(axis=0), gradient, atol=1e-11 * np.abs(gradient).max())
        product = model.pattern.multiply(model.values(0.0), probe)
        np.testing.assert_allclose(block.pattern.multiply(entries, probe), product, atol=1e-11 * np.abs(product).max())
        np.testing.assert_allclose(np.sort(fabric.gaps(full)), np.sort(cell.gaps(x)), rtol=1e-12)
    # Long moves are searched, short ones taken from the list.
    positions = fabric.positions(full)
    for size in (0.01, 0.5, 8.0):
        moves = random.normal(scale=size, size=positions.shape)
        safe = fabric.contact_list.safe_fraction(positions, moves)
        after = FabricEnergy(sheet, WOOL).contact_list.distances(fabric.contacts(full), positions + safe * moves)
        assert 0.0 < safe <= 1.0
        assert (after >= 0.2 * fabric.contact_list.distances(fabric.contacts(full), positions) - 1e-12).all()
