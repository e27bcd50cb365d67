"""From yarn to shell material with few solves: 240 states of a stockinette under loads, over two processes.

A real material takes some hundred states (`yarnscale homogenize`, 750 by default); this one shows the way. The fit is
judged on states that it has not seen. Processes are spawned, hence the guard at the end.
"""

from pathlib import Path
from tempfile import TemporaryDirectory

import yarnscale as ys


def main() -> None:
    yarn = ys.YarnMaterial.preset("hylc2020-stockinette")
    cell = ys.PeriodicCell(ys.settled(ys.patterns.build("stockinette"), yarn).pattern, yarn)
    with TemporaryDirectory() as folder:
        outcome = ys.homogenize_cell(cell, Path(folder), solves=240, limit=5.0)
        ys.write_material(Path(folder) / "stockinette.json", outcome.material)
        material = ys.read_material(Path(folder) / "stockinette.json")

    summary, errors = outcome.summary, outcome.errors
    print(f"{summary.converged} of {summary.states} states converged in {summary.seconds:.1f} s")
    print(f"median error on {errors.states} unseen states: {errors.median:.1%} of the stress itself")
    assert errors.median < 0.5

    # The material is a function of six strains; its stress is the derivative, as in the cell.
    stretched = ys.ShellStrain(s_x=0.1)
    fitted, exact = material.energy_density(stretched.vector[None])[0], cell.relax(stretched).energy_density
    print(f"10 % along the course: {fitted:.4f} J/m² fitted, {exact:.4f} J/m² from the yarns")


if __name__ == "__main__":
    main()
