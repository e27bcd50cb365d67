"""Construction of a fabric: counts, mass, and the same fabric in another size."""

from __future__ import annotations

import numpy as np
import pytest

from yarnscale.cell.periodic import PeriodicCell
from yarnscale.drawing import library
from yarnscale.kinematics import ShellStrain
from yarnscale.swatches.construction import FabricConstruction, sized, weighed
from yarnscale.yarn.material import ContactRule, StretchRule, YarnMaterial

CELL = PeriodicCell(
    library.build("stockinette"),
    YarnMaterial(
        1e5, 4e4, 1.0, 100.0, 200.0, contact=ContactRule(kernel="est2022", weights="simpson"),
        stretch=StretchRule("two_phase", 0.02, 1e6),
    ),
)  # fmt: skip


def test_a_fabric_of_another_size_has_the_same_line_loads():
    strain = ShellStrain(s_x=0.15, s_y=-0.05)
    loads = [cell.relax(strain).stress[:3] for cell in (CELL, sized(CELL, 0.4))]
    np.testing.assert_allclose(loads[1], loads[0], rtol=1e-4, atol=1e-4 * np.abs(loads[0]).max())


def test_counts_and_masses_agree():
    cell = weighed(CELL, area_density=0.165, yarn_count=None)
    found = FabricConstruction.of(cell, (1, 1))
    assert found.area_density == pytest.approx(0.165)
    assert found.wales is not None and found.courses is not None and found.loop_length is not None
    assert found.yarn_count * found.loop_length * found.wales * found.courses == pytest.approx(0.165)
    by_yarn = FabricConstruction.of(weighed(CELL, area_density=None, yarn_count=2e-5), (1, 1))
    assert by_yarn.yarn_count == pytest.approx(2e-5)
    assert by_yarn.summary()["tex"] == pytest.approx(20)
