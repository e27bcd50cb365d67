"""From yarn to shell material with a handful of solves: 60 states of a stockinette, over two processes.

A real material takes some hundred states (`yarnscale homogenize`, 400 by default); this one shows the way. The fit is
judged on states that it has not seen. Processes are spawned, hence the guard at the end.
"""

from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

import yarnscale as ys


def main() -> None:
    yarn = ys.YarnMaterial.preset("hylc2020-stockinette")
    cell = ys.PeriodicCell(ys.settled(ys.patterns.build("stockinette"), yarn).pattern, yarn)
    with TemporaryDirectory() as folder:
        outcome = ys.homogenize_cell(
            cell, Path(folder), solves=60, range=ys.StrainRange((-0.1, 0.3), shear=0.3, curvature=0.05)
        )
        ys.write_material(Path(folder) / "stockinette.json", outcome.material)
        material = ys.read_material(Path(folder) / "stockinette.json")

    summary, report = outcome.summary, outcome.report
    print(f"{summary.converged} of {summary.states} states converged in {summary.seconds:.1f} s")
    print(f"median error on {report.states} unseen states: {report.energy_median:.2%} of the largest energy")
    assert report.energy_median < 0.10

    # The material is a function of six strains; its stress is the derivative, as in the cell.
    stretched = ys.ShellStrain(s_x=0.2)
    fitted, exact = material.energy_density(stretched.vector[None])[0], cell.relax(stretched).energy_density
    print(f"20 % along the course: {fitted:.4f} J/m² fitted, {exact:.4f} J/m² from the yarns")
    assert np.isclose(fitted, exact, rtol=0.1)


if __name__ == "__main__":
    main()
