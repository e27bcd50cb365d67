"""Several starts: the lowest equilibrium, the same for the same seed."""

from __future__ import annotations

import numpy as np
import pytest

from yarnscale.cell import PeriodicCell
from yarnscale.drawing import library
from yarnscale.errors import InputError
from yarnscale.kinematics import ShellStrain
from yarnscale.yarn.material import YarnMaterial

CELL = PeriodicCell(library.build("stockinette"), YarnMaterial.preset("hylc2020-stockinette"))
STRAIN = ShellStrain(-0.2, 0.0, -0.15)


def test_more_starts_are_never_worse_and_deterministic() -> None:
    one, several = CELL.relax(STRAIN), CELL.with_options(starts=4).relax(STRAIN)
    assert several.converged and not several.passages
    assert several.energy_density <= one.energy_density * (1 + 1e-12)
    assert several.iterations > one.iterations
    again = CELL.with_options(starts=4).relax(STRAIN)
    assert again.energy_density == several.energy_density
    np.testing.assert_array_equal(again.positions, several.positions)


def test_at_least_one_start() -> None:
    with pytest.raises(InputError, match="starts"):
        CELL.with_options(starts=0)
