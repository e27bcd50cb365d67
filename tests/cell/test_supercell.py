"""Cells of several tiles."""

from __future__ import annotations

import pytest

from yarnscale.cell import PeriodicCell
from yarnscale.cell.supercell import study, supercell, tiled
from yarnscale.drawing import library
from yarnscale.errors import InputError
from yarnscale.kinematics import ShellStrain
from yarnscale.yarn.material import YarnMaterial

CELL = PeriodicCell(library.build("stockinette"), YarnMaterial.preset("hylc2020-stockinette"))


def test_a_repeated_equilibrium_is_one_of_the_larger_cell() -> None:
    strain = ShellStrain(0.1, 0.05, 0.1)
    state = CELL.relax(strain)
    larger = supercell(CELL, (2, 1)).relax(strain, start=tiled(state, (2, 1)))
    assert larger.iterations <= 1
    assert larger.energy_density == pytest.approx(state.energy_density, rel=1e-9)


def test_a_study_refers_to_one_tile() -> None:
    strain = ShellStrain(-0.15, 0.0, 0.0)
    one, two = study(CELL, strain, [(1, 1), (1, 2)], starts=2)
    assert one.drop == 0.0 and (one.size, two.size) == ((1, 1), (1, 2))
    assert two.vertices == 2 * one.vertices
    assert two.state.converged and not two.state.passages
    assert two.drop >= -1e-9
    assert two.energy_density == pytest.approx(one.energy_density * (1 - two.drop))
    assert one.seconds > 0 and two.iterations > 0


@pytest.mark.parametrize("sizes", [[], [(0, 1)], [(100, 100)]])
def test_sizes_are_checked(sizes: list[tuple[int, int]]) -> None:
    with pytest.raises(InputError, match="cell size"):
        study(CELL, ShellStrain(), sizes)
