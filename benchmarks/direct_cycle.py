"""A knit with friction stretched and released yarn by yarn, against its periodic cell with friction.

python benchmarks/direct_cycle.py [size in m] [stretch] [friction, such as 0.1,0.3] [steps] [course or wale] [folder]

Stockinette at rest between two grips that let it narrow: equilibria at equal steps of the grips, out and back until
they pull no more; the folder gets pictures. The cell follows the strains of the stitches inside the sheet, with the
yarn that these have at the end of loading. Both carry the springs of their contacts from step to step.
"""

from __future__ import annotations

import sys
import time
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
from direct_stretch import GRIP, stockinette
from knit_interior import interior

from yarnscale.cell import PeriodicCell
from yarnscale.cell.friction import CellHistory
from yarnscale.cell.rest import settled
from yarnscale.fabric.boundary import glue
from yarnscale.fabric.direct_energy import FabricEnergy
from yarnscale.fabric.direct_friction import FrictionHistory
from yarnscale.fabric.direct_static import rod_equilibrium, safe_path
from yarnscale.fabric.holds import Holds
from yarnscale.fabric.sheet import YarnSheet
from yarnscale.homogeneous.histories import path_with_friction
from yarnscale.kinematics import ShellStrain
from yarnscale.numerics.kkt import ConstrainedSolver
from yarnscale.yarn.friction import YarnFriction

Array = np.ndarray


def cycled(size: float, amount: float, friction: YarnFriction, steps: int, axis: int, out: Path | None) -> None:
    drawn, material = stockinette(27)
    pattern = settled(drawn, material).pattern
    cell = PeriodicCell(pattern, material)
    rest = cell.relax()
    sheet = YarnSheet.filling(pattern, size, size)
    sheet = sheet.moved(cell.placement(rest)(sheet.source, sheet.tile), twist=rest.twist[sheet.source])
    # Edges that narrow are glued, so that cut yarns do not draw back into the stitches.
    rows = np.minimum(sheet.tile[:, 1 - axis], sheet.tile[:, 1 - axis].max() - sheet.tile[:, 1 - axis])
    springs = glue(sheet, material, distance=rows * sheet.radius, width=0.5 * sheet.radius, stiffness=0.05)
    energy = FabricEnergy(sheet, material, springs=springs)
    energy.count_passages()
    places = sheet.vertices
    low, high = places[:, axis].min(), places[:, axis].max()
    sides = [np.flatnonzero(places[:, axis] < low + GRIP), np.flatnonzero(places[:, axis] > high - GRIP)]
    nodes, side = np.concatenate(sides), np.repeat([-1.0, 1.0], [len(s) for s in sides])
    between, width = high - low - 2.0 * GRIP, sheet.size[1 - axis]
    free = (axis == 0, axis == 1, True)

    def holds(share: float) -> Holds:
        targets = places[nodes].copy()
        targets[:, axis] += 0.5 * share * between * side
        return Holds(nodes, targets, free)

    print(
        f"{sheet.vertex_count} vertices, {sheet.size[0]:.4f} × {sheet.size[1]:.4f} m, friction {friction.coefficient:g}"
    )
    began, solver, x, before = time.perf_counter(), ConstrainedSolver(), energy.start(), 0.0
    history = FrictionHistory.slack(energy)
    up = np.linspace(0.0, amount, steps + 1)
    rows_found, middle = [], 0.5 * (low + high) / sheet.radius
    for number, share in enumerate([*up, *up[-2::-1]]):
        step = history.begin(energy, friction, x)
        goal = x.copy()
        points = energy.positions(goal)
        points[:, axis] = middle + (points[:, axis] - middle) * (1.0 + share) / (1.0 + before)
        ahead = safe_path(energy, x, goal)
        found = rod_equilibrium(energy, ahead, holds(share), tolerance=2e-4, max_iterations=300, linear=solver)
        x, before, history = found.x, share, step.end(found.x)
        inside = interior(pattern, energy, x, share=0.5)
        pull = float(holds(share).forces(energy, x)[:, axis] @ side) / 2.0 / width
        rows_found.append((share, pull, inside, history))
        strain = inside.strain
        print(
            f"{share:.4f}: {pull:7.3f} N/m, inside {inside.stress[axis]:7.3f} {inside.stress[1 - axis]:6.3f} N/m at "
            f"{strain.s_x:.4f} {strain.s_y:.4f}, shear {strain.s_a:.4f}, yarn {inside.yarn:.4f}; taken "
            f"{1e6 * history.dissipated:.2f} µJ, springs {1e6 * history.stored(energy):.2f} µJ; {found.status.name} "
            f"{found.iterations}, passages {energy.passage_count}, {time.perf_counter() - began:.0f} s",
            flush=True,
        )
        if out is not None and number in (0, steps):
            draw(out / f"cycle-{friction.coefficient:g}-{number}.png", sheet, energy.positions(x) * sheet.radius)
        if number > steps and pull < 0.0:
            break
    if out is not None:
        draw(out / f"cycle-{friction.coefficient:g}-end.png", sheet, energy.positions(x) * sheet.radius)
    yarn = rows_found[steps][2].yarn
    own = PeriodicCell(replace(pattern, rest_length=pattern.rest_length * yarn), material)
    strains = [replace(row[2].strain, II11=0.0, II12=0.0, II22=0.0) for row in rows_found]
    stresses = cell_stresses(own, friction, strains)[:, 2 * axis]
    plain = np.array([own.relax(s).stress[2 * axis] for s in strains])
    sheet_stress = np.array([row[2].stress[axis] for row in rows_found])
    stretch = np.array([strain.vector[2 * axis] for strain in strains])
    for values in zip(stretch, sheet_stress, stresses, plain, [row[1] for row in rows_found], strict=True):
        print("  stretch {:.4f}: inside {:.3f}, cell {:.3f}, without friction {:.3f}; grips {:.3f} N/m".format(*values))
    for name, stress in (("inside", sheet_stress), ("cell", stresses), ("grips", np.array([r[1] for r in rows_found]))):
        where = stretch if name != "grips" else np.array([r[0] for r in rows_found])
        print(f"{name}: {loop(where, stress, steps)}", flush=True)


def cell_stresses(cell: PeriodicCell, friction: YarnFriction, strains: list[ShellStrain]) -> Array:
    """Stress of the cell along strains with four steps between each, (n, 6) [N/m]; NaN where it does not get to."""
    start = CellHistory.begin(cell, friction, cell.relax(strains[0]))
    finer = [
        ShellStrain.from_vector(a.vector + k / 4 * (b.vector - a.vector))
        for a, b in pairwise(strains)
        for k in range(1, 5)
    ]
    found = [start.state.stress, *(h.state.stress for h in path_with_friction(start, finer))]
    return np.array([*found, *[np.full(6, np.nan)] * (1 + len(finer) - len(found))])[::4]


def loop(stretch: Array, stress: Array, steps: int) -> str:
    """Largest stress, work and work returned, and the stretch at which no stress is left on the way back."""
    work = float(np.trapezoid(stress[: steps + 1], stretch[: steps + 1]))
    back = -float(np.trapezoid(stress[steps:], stretch[steps:]))
    ends = [(a, b) for a, b in pairwise(range(steps, len(stress))) if stress[a] > 0.0 >= stress[b]]
    left = np.nan
    if ends:
        a, b = ends[0]
        left = stretch[b] + (stretch[a] - stretch[b]) * stress[b] / (stress[b] - stress[a])
    return (
        f"peak {stress[steps]:.3f} N/m, work {work:.4f}, returned {back:.4f} J/m² ({back / work:.2f}), left {left:.4f}"
    )


def draw(path: Path, sheet: YarnSheet, places: Array) -> None:
    from yarnscale.show.curves import Curve
    from yarnscale.show.tubes import yarn_picture

    path.parent.mkdir(parents=True, exist_ok=True)
    ends = zip(sheet.offsets[:-1], sheet.offsets[1:], strict=True)
    curves = [Curve(places[a:b], number) for number, (a, b) in enumerate(ends)]
    yarn_picture(path, curves, sheet.radius, camera=(0.2, -0.5, 1.0), size=(900, 700))


if __name__ == "__main__":
    given = dict(enumerate(sys.argv[1:]))
    for coefficient in given.get(2, "0.1,0.3").split(","):
        cycled(
            float(given.get(0, "0.04")), float(given.get(1, "0.2")), YarnFriction(float(coefficient)),
            int(given.get(3, "8")), ("course", "wale").index(given.get(4, "course")),
            Path(given[5]) if 5 in given else None,
        )  # fmt: skip
