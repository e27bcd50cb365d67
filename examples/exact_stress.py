"""Stress is the derivative of the energy density by the strain, exact at every equilibrium: no differences needed.

Here it is held against central differences of relaxed energies, for a plain weave that is stretched, sheared and bent,
and the moduli (one linear solve per component) against differences of stresses.
"""

from dataclasses import replace

import numpy as np

import yarnscale as ys

cell = ys.PeriodicCell(ys.patterns.build("plain"), ys.YarnMaterial.preset("hylc2020-basket"))
cell = cell.with_options(tolerance=1e-9)
strain = ys.ShellStrain(s_x=0.05, s_a=0.03, s_y=0.04, II11=20.0)
state = cell.relax(strain)
moduli = cell.moduli(state)
assert state.converged

print("component   stress      by differences   modulus     by differences")
for k, (name, step) in enumerate({"s_x": 1e-4, "s_a": 1e-4, "s_y": 1e-4, "II11": 0.02}.items()):
    low, high = (
        cell.relax(replace(strain, **{name: getattr(strain, name) + sign * step}), start=state) for sign in (-1.0, 1.0)
    )
    stress = (high.energy_density - low.energy_density) / (2 * step)
    modulus = (high.stress[k] - low.stress[k]) / (2 * step)
    print(f"{name:<10} {state.stress[k]:12.6g} {stress:12.6g} {moduli[k, k]:14.6g} {modulus:12.6g}")
    assert np.isclose(state.stress[k], stress, rtol=1e-4, atol=1e-6 * np.abs(state.stress).max())
    assert np.isclose(moduli[k, k], modulus, rtol=1e-3)
