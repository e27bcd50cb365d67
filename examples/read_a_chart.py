"""Knit from a chart of your own: a few lines of text become a periodic pattern, at rest under its own yarn.

The chart shows the right side, the last row on top (docs/reference/chart_format.md). Every command that takes a pattern
takes such a file: `yarnscale relax checks.chart`.
"""

from pathlib import Path
from tempfile import TemporaryDirectory

import yarnscale as ys

CHART = """
# Knit and purl stitches in a chequerboard.
kind = knit
name = checks
radius = 1 mm
rows:
kp
pk
"""

with TemporaryDirectory() as folder:
    path = Path(folder) / "checks.chart"
    path.write_text(CHART, encoding="utf-8")
    drawn = ys.read_pattern(path)

    wool = ys.YarnMaterial.preset("wool")
    shape = ys.settled(drawn, wool)
    ys.write_pattern(shape.pattern, Path(folder) / "checks.json")
    again = ys.read_pattern(Path(folder) / "checks.json")

width, height = shape.pattern.period / drawn.period
print(f"{shape.status.value}; {width:.3f} of the drawn width, {height:.3f} of its height")
assert shape.converged and shape.stress.largest < 0.01

# Written and read, it is the same fabric.
energies = [ys.PeriodicCell(pattern, wool).relax().energy_density for pattern in (shape.pattern, again)]
assert abs(energies[0] / energies[1] - 1.0) < 1e-9
