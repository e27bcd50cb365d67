"""Cells under loads: stress meets the loads, free sides bear nothing, curvature is held or free."""

from __future__ import annotations

import numpy as np
import pytest

from yarnscale.cell import PeriodicCell
from yarnscale.drawing import library
from yarnscale.homogeneous.fabrics import CellFabric
from yarnscale.homogeneous.loads import FLAT, Loads, Prescribed, equilibrium_under
from yarnscale.kinematics import line_stretch
from yarnscale.yarn.material import PRESETS

SCALE = np.array([0.5] * 3 + [100.0] * 3)


@pytest.fixture(scope="module")
def cell() -> PeriodicCell:
    return PeriodicCell(library.build("plain"), PRESETS["hylc2020-stockinette"])


def test_given_loads_are_met_and_given_strains_are_held(cell: PeriodicCell) -> None:
    loads = Loads.components(s_x=1.0, s_y=0.5)
    found = equilibrium_under(CellFabric(cell), loads, prescribed=Prescribed.components(s_a=0.1) + FLAT)
    assert found.converged and found.response.state.usable
    assert found.strain[[1, 3, 4, 5]] == pytest.approx([0.1, 0, 0, 0], abs=1e-12)
    assert found.stress[[0, 2]] == pytest.approx([1.0, 0.5], abs=5e-3)
    assert found.moduli == pytest.approx(cell.moduli(found.response.state), rel=1e-6)


def test_pull_along_the_bias_leaves_the_sides_free(cell: PeriodicCell) -> None:
    angle = np.pi / 4
    free = equilibrium_under(CellFabric(cell), Loads(), prescribed=FLAT)
    found = equilibrium_under(CellFabric(cell), Loads.tension(angle, 0.3), prescribed=FLAT, start=free, tolerance=1e-5)
    assert free.converged and found.converged
    # P = 2 F ∂Ψ/∂I by the chain rule from the stress, with F the square root of I, has no traction on the sides.
    a, shear, b = 1 + found.strain[0], found.strain[1], 1 + found.strain[2]
    forms = np.array([[2 * a, 0, 0], [shear * b, a * b, shear * a], [0, 0, 2 * b]])
    slope = np.linalg.solve(forms.T, found.stress[:3])
    values, vectors = np.linalg.eigh(np.array([[a * a, shear * a * b], [shear * a * b, b * b]]))
    stretch = vectors @ np.diag(np.sqrt(values)) @ vectors.T
    nominal = 2 * stretch @ np.array([[slope[0], slope[1] / 2], [slope[1] / 2, slope[2]]])
    along, across = np.array([np.cos(angle), np.sin(angle)]), np.array([-np.sin(angle), np.cos(angle)])
    assert np.linalg.norm(nominal @ along) == pytest.approx(0.3, rel=1e-3)
    assert nominal @ across == pytest.approx(np.zeros(2), abs=1e-3)
    assert line_stretch(found.strain, angle)[0] > line_stretch(free.strain, angle)[0] + 0.005


def test_curvature_across_is_free_while_the_one_along_is_held(cell: PeriodicCell) -> None:
    found = equilibrium_under(CellFabric(cell), Loads(), prescribed=Prescribed.components(II11=20.0))
    assert found.converged
    assert found.strain[3] == pytest.approx(20.0)
    assert (found.stress * SCALE)[[0, 1, 2, 4, 5]] == pytest.approx(np.zeros(5), abs=2e-5)
