"""A cell whose yarns never touch has no pairs at all."""

from __future__ import annotations

import numpy as np

from yarnscale.cell.energy import CellEnergy
from yarnscale.drawing.curves import PeriodicCurve, pattern_from_curves
from yarnscale.kinematics import ShellStrain
from yarnscale.yarn.material import YarnMaterial


def test_a_cell_without_pairs_has_energy_gradient_and_stress() -> None:
    points = np.column_stack([np.arange(6.0), np.zeros(6), np.zeros(6)]) * 1e-3
    lone = pattern_from_curves([PeriodicCurve(points, (1, 0))], [6e-3, 20e-3], 1e-3)
    energy = CellEnergy(lone, YarnMaterial.preset("wool"), ShellStrain(0.1))
    x = energy.start()
    value, gradient, model = energy.quadratic(x)
    assert value > 0 and np.isfinite(gradient).all() and np.isfinite(model.values(0.0)).all()
    assert energy.gaps(x).size == 0
    assert energy.bound(x, np.ones_like(x)) > 0
    assert np.isfinite(energy.stress(x)).all()
