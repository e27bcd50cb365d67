"""Shares of a cloth outside the samples of its material."""

from __future__ import annotations

import numpy as np
import pytest

from yarnscale.shell.elastic.energy import ShellEnergy
from yarnscale.shell.elastic.out_of_range import out_of_range
from yarnscale.shell.materials.compact import CompactMaterial, SpringNetwork
from yarnscale.shell.materials.orthotropic import JERSEY
from yarnscale.shell.mesh import TriangleMesh

POINTS = np.array([[0.0, 0], [1, 0], [0, 1], [1, 1], [2, 0], [2, 1]])
TRIANGLES = np.array([[0, 1, 2], [1, 3, 2], [1, 4, 3], [4, 5, 3]])


def material() -> CompactMaterial:
    none = np.zeros((0, 6)), np.zeros(0)
    springs = SpringNetwork(
        *none, np.zeros((0, 6)), np.zeros((0, 0)), np.zeros(0), np.zeros(0), np.ones(6), *none, np.zeros(0)
    )
    scale = np.array([0.5, 0.5, 0.5, 100.0, 100.0, 100.0])
    return CompactMaterial(0.1, scale, springs, density=0.2, spacing=0.5)


def test_half_of_the_cloth_that_is_pulled_holds_all_energy_outside():
    energy = ShellEnergy(TriangleMesh(POINTS, TRIANGLES), material())
    flat = np.column_stack([POINTS, np.zeros(6)])
    rest = out_of_range(energy, flat)
    assert rest is not None and (rest.triangles, rest.farthest) == (0.0, 0.0)
    flat[4:, 0] = 2.5
    pulled = out_of_range(energy, flat)
    assert pulled is not None
    assert pulled.triangles == 0.5
    assert pulled.energy == pytest.approx(1.0)
    assert pulled.farthest == pytest.approx(1.0)
    assert set(pulled.plain()) == {"triangles", "energy", "farthest"}


def test_a_material_without_samples_says_nothing():
    assert (
        out_of_range(ShellEnergy(TriangleMesh(POINTS, TRIANGLES), JERSEY), np.column_stack([POINTS, np.zeros(6)]))
        is None
    )
