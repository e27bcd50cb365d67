"""Large cells are solved by other means than small ones, to the same equilibria."""

from __future__ import annotations

import numpy as np
import pytest

from yarnscale.cell import PeriodicCell
from yarnscale.cell import energy as cell_energy
from yarnscale.cell.constraints import constraint_rows
from yarnscale.drawing import library
from yarnscale.kinematics import ShellStrain
from yarnscale.numerics.null_space import ChainConstraints
from yarnscale.yarn.material import YarnMaterial

MATERIAL = YarnMaterial.preset("hylc2020-stockinette")


@pytest.mark.parametrize(
    ("name", "strain"),
    [
        ("twill-2x1", ShellStrain(0.05, 0.02, 0.1)),
        ("stockinette", ShellStrain(s_x=0.2, II11=20.0)),
        ("plain", ShellStrain(0.1, 0.0, 0.0, 15.0, 0.0, -15.0)),
    ],
)
def test_the_same_equilibrium_as_a_small_cell(name: str, strain: ShellStrain, monkeypatch: pytest.MonkeyPatch) -> None:
    cell = PeriodicCell(library.build(name), MATERIAL).with_options(tolerance=1e-9)
    small = cell.relax(strain)
    moduli = cell.moduli(small)
    monkeypatch.setattr(cell_energy, "LARGE", 0)
    assert isinstance(cell.energy(strain).constraints, ChainConstraints)
    large = cell.relax(strain)
    assert large.usable
    assert large.energy_density == pytest.approx(small.energy_density, rel=1e-9)
    np.testing.assert_allclose(large.stress, small.stress, rtol=1e-5, atol=1e-7 * np.abs(small.stress).max())
    np.testing.assert_allclose(cell.moduli(large), moduli, rtol=1e-3, atol=1e-5 * np.abs(moduli).max())


def test_sliding_yarns_have_twist_chains_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cell_energy, "LARGE", 0)
    pattern = library.build("plain")
    energy = PeriodicCell(pattern, MATERIAL, sliding=True).energy(ShellStrain())
    rows = constraint_rows(pattern, sliding=True)
    assert energy.constraints.matrix.shape == rows.shape
    vector = energy.constraints.project(np.random.default_rng(0).standard_normal(4 * energy.count))
    np.testing.assert_allclose(rows @ vector, 0.0, atol=1e-10 * np.abs(rows).sum())


def test_pairs_that_begin_to_touch_get_a_place_in_the_matrix(monkeypatch: pytest.MonkeyPatch) -> None:
    """The Hessian of a pattern of touching pairs is the whole one, wherever the yarns have moved."""
    monkeypatch.setattr(cell_energy, "LARGE", 0)
    pattern = library.build("basket-2x2")
    tight = PeriodicCell(pattern, MATERIAL).energy(ShellStrain())
    monkeypatch.undo()
    whole = PeriodicCell(pattern, MATERIAL).energy(ShellStrain())
    generator, x = np.random.default_rng(0), tight.start()
    sizes = []
    for _ in range(4):
        products = []
        probe = generator.standard_normal(len(x))
        for energy in (tight, whole):
            value, gradient, model = energy.quadratic(x)
            products.append(np.concatenate([model.pattern.multiply(model.values(0.1), probe), gradient, [value]]))
            sizes.append(model.pattern.entries)
        np.testing.assert_allclose(products[0], products[1], rtol=1e-9, atol=1e-9 * np.abs(products[1]).max())
        x = x + 0.1 * generator.standard_normal(len(x))
    assert sizes[0] < sizes[1]
