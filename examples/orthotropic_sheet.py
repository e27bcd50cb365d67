"""A woven sheet with stiff warp and soft weft, evaluated at a strain and pulled between two bars.

An orthotropic material needs no yarns: four membrane constants, the resistance to change of area, and bending along
the two yarn directions and between them (EST22 eq. 1 and 4).
"""

import numpy as np

import yarnscale as ys

cloth = ys.OrthotropicMaterial(
    stretch_weft=20.0, stretch_coupling=2.0, stretch_warp=60.0, shear=4.0, area=0.0, log_area=0.0,
    bend_weft=2e-6, bend_bias=2e-6, bend_warp=4e-6, density=0.15,
)  # fmt: skip

# ε = ½ (1.1² − 1) along the weft; the stress by s_x is (1 + s_x) K ε.
green = 0.5 * (1.1**2 - 1.0)
strain = ys.ShellStrain(s_x=0.1).vector[None]
assert np.isclose(cloth.energy_density(strain)[0], 0.5 * 20.0 * green**2)
assert np.isclose(cloth.stress(strain)[0, 0], 1.1 * 20.0 * green)

forces = {}
for direction in ("course", "wale"):
    scene = ys.scenes.stretch(cloth, direction=direction, amount=0.1, spacing=0.025, self_contact=False)
    result = ys.run(scene)
    assert result.converged
    forces[direction] = result.measures["bar_force"]
    print(f"{direction}: {forces[direction]:.3f} N, across {result.measures['lambda_across']:.4f}")

# The sheet is wider than the bars and not free to narrow there: between the moduli and a bit.
assert 2.0 < forces["wale"] / forces["course"] < 3.5
