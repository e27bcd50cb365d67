"""Published patterns: rest energies and the table of tensile equilibria (needs the reference data folder)."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from yarnscale.cell import PeriodicCell
from yarnscale.files.pyp import read_pyp
from yarnscale.kinematics import ShellStrain
from yarnscale.yarn.material import YarnMaterial

REST = {"stockinette": 0.0553, "satin": 0.00381}


def published_cell(shared: Path, name: str) -> PeriodicCell:
    pattern = read_pyp(shared / "reference" / f"{name}.pyp")
    return PeriodicCell(pattern, YarnMaterial.preset(f"hylc2020-{name}"))


@pytest.mark.parametrize("name", REST)
def test_rest_energy(shared: Path, name: str) -> None:
    state = published_cell(shared, name).relax()
    assert state.converged
    assert state.energy_density == pytest.approx(REST[name], rel=5e-3)
    assert state.energy_density == pytest.approx({"stockinette": 0.0552671, "satin": 0.0038070}[name], rel=5e-4)


@pytest.mark.parametrize("name", REST)
def test_ten_tensile_states(shared: Path, name: str) -> None:
    """Uniaxial, biaxial and sheared tension, spread over the table; within 1 % of its total."""
    table = np.load(shared / "reference" / f"{name}.npz")
    total = sum(table[f"oracle_{part}"] for part in ("Es", "Eb", "Et", "Ec"))
    axes = [table[f"axes_{k}"] for k in ("sx", "sa", "sy")]
    chosen = [
        (3, 4, 2), (4, 4, 2), (6, 4, 2), (2, 4, 3), (2, 4, 5), (3, 4, 3), (5, 4, 5), (4, 5, 3), (3, 2, 4), (6, 6, 5)
    ]  # fmt: skip
    cell = published_cell(shared, name)
    for index in chosen:
        assert table["valid"][index]
        strain = ShellStrain(*(float(axis[i]) for axis, i in zip(axes, index, strict=True)))
        state = cell.relax(strain)
        assert state.converged
        assert state.energy_density == pytest.approx(total[index], rel=0.01), strain


@pytest.mark.parametrize("name", REST)
def test_the_published_convergence_criterion_is_met(shared: Path, name: str) -> None:
    state = published_cell(shared, name).relax(ShellStrain(0.1, 0.05, 0.1))
    assert state.residual <= 1e-6
    assert state.min_distance_over_diameter > 0.5
    assert state.contacts > 50
    assert sum(state.energy_parts.values()) == pytest.approx(state.energy_density, rel=1e-10)
