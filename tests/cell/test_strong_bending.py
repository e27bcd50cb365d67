"""Cells bent so far that a period goes round the cylinder: copies on the other side are no neighbours."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from yarnscale.cell import PeriodicCell
from yarnscale.files.material_json import read_material
from yarnscale.files.pyp import read_pyp
from yarnscale.kinematics import ShellStrain
from yarnscale.yarn.material import YarnMaterial


@pytest.mark.parametrize("component", ["II11", "II22"])
def test_energy_of_strong_bending_is_the_published_one(shared: Path, component: str) -> None:
    """±200 /m is half a turn a period for courses; a cell that rolls through itself costs a hundred times more."""
    file = shared / "reference" / "stock1.json"
    assert "coeffs" in json.loads(file.read_text())
    published = read_material(file)
    pattern = read_pyp(shared / "reference" / "stockinette.pyp")
    cell = PeriodicCell(pattern, YarnMaterial.preset("hylc2020-stockinette"))
    sign = 1.0 if component == "II11" else -1.0  # against the curl, where contact carries
    for curvature in (100.0, 150.0, 200.0):
        strain = ShellStrain(**{component: sign * curvature})
        state = cell.relax(strain)
        assert state.converged
        (expected,) = published.energy_density(strain.vector[None, :])
        assert state.energy_density == pytest.approx(expected, rel=0.06)


def test_pairs_are_less_than_half_a_turn_apart(shared: Path) -> None:
    pattern = read_pyp(shared / "reference" / "stockinette.pyp")
    cell = PeriodicCell(pattern, YarnMaterial.preset("hylc2020-stockinette"))
    curvature = 230.0
    energy = cell.energy(ShellStrain(II11=curvature))
    x = energy.start()
    pairs = energy.rods.contacts(energy.nodes.expand(x))
    apart = np.abs(energy.reference[pairs.second, 0] - energy.reference[pairs.first, 0]) * pattern.radius
    assert len(apart) > 100
    assert apart.max() * curvature < np.pi
    # The flat cell knows as many neighbours of every kind but those on the other side.
    flat = cell.energy(ShellStrain())
    assert len(apart) < 4 * len(flat.rods.contacts(flat.nodes.expand(x)).first)
