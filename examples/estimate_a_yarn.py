"""Estimate a yarn from tensile tests: here of a fabric whose yarn is known, to see which parameters come back.

The tests are those of a stockinette, brought to rest as estimates bring a drawn pattern to rest, stretched by half
along weft and warp. Ranges span up to four decades, so sixteen scattered starts are compared. Bending stiffness,
radius and contact stiffness come back. The loops open without stretching their yarn much, so the stretch stiffness
k_s1 is known to a fifth only, and the knee between soft and stiff stretch not at all (docs/validation/estimate.md).
"""

from tempfile import TemporaryDirectory

import numpy as np

import yarnscale as ys
from yarnscale.swatches.measurements import Direction, StretchRun, StretchTest
from yarnscale.swatches.yarn_fit import FitOptions
from yarnscale.swatches.yarn_model import yarn_model
from yarnscale.swatches.yarn_rest import KEPT_PERIODS, rested_cell
from yarnscale.swatches.yarn_states import pulled

STIFFEST = 20.0  # stretch stiffness k_s2 [N], which is measured on the yarn
KNOWN = {"k_s1": 5.0, "knee": 0.1, "k_b": 2e-8, "R_1": 0.36e-3, "k_c1": 30.0}

drawn = ys.patterns.build("stockinette")
model = yarn_model(drawn.scaled(0.4e-3 / drawn.radius), STIFFEST)
fabric = rested_cell(model.cell(np.array(list(KNOWN.values()))), KEPT_PERIODS).cell

tests = []
for direction in (Direction.WEFT, Direction.WARP):
    curve = pulled(fabric, direction, np.linspace(0.05, 0.5, 11))
    assert curve.converged.all()
    # A swatch of 5 × 50 cm: the clamps do not matter. Force [N], distance of the clamps [m], width [m].
    force, length = 0.05 * np.append(0.0, curve.stress), 0.5 * (1 + np.append(0.0, curve.stretch))
    width = 0.05 * (1 - np.append(0.0, curve.contraction))
    tests.append(StretchTest(direction, 0.05, (StretchRun("1", force, length, width),)))
measurements = ys.SwatchMeasurements("known yarn", tuple(tests))

with TemporaryDirectory() as folder:  # evaluations are kept here; resume=True continues with them
    options = FitOptions("sobol", starts=16, refined=1, iterations=12, samples=6)
    found = ys.estimate(measurements, model, folder, options=options)

for name, value in zip(found.fit.model.names, found.fit.values, strict=True):
    print(f"{name:5} {value:10.3g} estimated, {KNOWN[name]:8.3g} known")
print(f"error of the stress {found.error.comfort:.1%} after {found.fit.evaluations} evaluations")
estimated = dict(zip(found.fit.model.names, found.fit.values, strict=True))
assert found.error.comfort is not None and found.error.comfort < 0.01
for name, share in {"k_s1": 0.25, "k_b": 0.02, "R_1": 0.01, "k_c1": 0.05}.items():
    assert abs(estimated[name] / KNOWN[name] - 1.0) < share
assert found.fit.ambiguity < 1e-4  # no other rest shape is near
