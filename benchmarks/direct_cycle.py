"""A knit with friction stretched and released yarn by yarn, against its periodic cell and cloth with friction.

python benchmarks/friction_paths.py --fit 0.3 m3/stockinette-wool
python benchmarks/direct_cycle.py --size 0.06 --friction 0.3 --cloth m3/stockinette-wool

Stockinette of wool at rest between two grips that hold it (--free: that let it narrow): equilibria at equal steps of
the grips, out and back until they pull no more; --out gets pictures. The cell follows the strains of stitches inside
the sheet, with the yarn that these have at the end of loading. Both carry the springs of their contacts from step to
step. Cloth of the material in a folder, one for each friction, is held at the edges of the grips and moved like them.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
from direct_stretch import GRIP
from knit_interior import interior

from yarnscale.cell import PeriodicCell
from yarnscale.cell.friction import CellHistory
from yarnscale.fabric.boundary import LOOPED, glue
from yarnscale.fabric.direct_energy import FabricEnergy
from yarnscale.fabric.direct_friction import FrictionHistory
from yarnscale.fabric.direct_static import rod_equilibrium, safe_path
from yarnscale.fabric.holds import Holds
from yarnscale.fabric.sheet import YarnSheet
from yarnscale.files import material_library
from yarnscale.files.material_json import read_material
from yarnscale.files.patterns import read_pattern, read_yarns
from yarnscale.homogeneous.histories import path_with_friction
from yarnscale.kinematics import ShellStrain
from yarnscale.motion.handles import Handle
from yarnscale.motion.quasi_static import equilibrium
from yarnscale.motion.rigid import Motion
from yarnscale.numerics.kkt import ConstrainedSolver
from yarnscale.shell.dynamics.cloth import Cloth
from yarnscale.shell.dynamics.solver import ClothSolver, SolverOptions
from yarnscale.shell.mesh import rectangle
from yarnscale.shell.state import ClothState
from yarnscale.yarn.friction import YarnFriction
from yarnscale.yarn.material import YarnMaterial

Array = np.ndarray
FABRIC = "stockinette-wool"
"""Of the material library."""


def cycled(options: argparse.Namespace, friction: YarnFriction, folder: Path | None) -> None:
    size, amount, steps, out = options.size, options.amount, options.steps, options.out
    axis = ("course", "wale").index(options.direction)
    file = material_library.file_of(FABRIC, material_library.PATTERN)
    pattern, material = read_pattern(file), read_yarns(file)
    assert isinstance(material, YarnMaterial)
    cell = PeriodicCell(pattern, material)
    rest = cell.relax()
    sheet = YarnSheet.filling(pattern, size, size)
    sheet = sheet.moved(cell.placement(rest)(sheet.source, sheet.tile), twist=rest.twist[sheet.source])
    # Edges that narrow are glued, so that cut yarns do not draw back into the stitches.
    rows = np.minimum(sheet.tile[:, 1 - axis], sheet.tile[:, 1 - axis].max() - sheet.tile[:, 1 - axis])
    springs = glue(sheet, material, distance=rows * sheet.radius, width=0.5 * sheet.radius, stiffness=options.glue)
    energy = FabricEnergy(sheet, material, springs=springs)
    energy.count_passages()
    places = sheet.vertices
    low, high = places[:, axis].min(), places[:, axis].max()
    sides = [np.flatnonzero(places[:, axis] < low + GRIP), np.flatnonzero(places[:, axis] > high - GRIP)]
    nodes, side = np.concatenate(sides), np.repeat([-1.0, 1.0], [len(s) for s in sides])
    between, width = high - low - 2.0 * GRIP, sheet.size[1 - axis]
    held = (axis == 0, axis == 1, True) if options.free else (True, True, True)

    def holds(share: float) -> Holds:
        targets = places[nodes].copy()
        targets[:, axis] += 0.5 * share * between * side
        return Holds(nodes, targets, held)

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
    if folder is not None:
        # Half a stitch at either grip is held with it.
        for length in (between, between - pattern.period[axis]):
            began = time.process_time()
            room = (length, width) if axis == 0 else (width, length)
            pulled = cloth_cycle(folder, room, axis, amount * between / length, steps)
            share = pulled[:, 0] * length / between
            print(f"cloth {length:.4f} m: {loop(share, pulled[:, 1], steps)}, {time.process_time() - began:.0f} s")
            print("  " + ", ".join("{:.4f}: {:.2f}".format(*row) for row in pulled), flush=True)


def cloth_cycle(folder: Path, size: tuple[float, float], axis: int, amount: float, steps: int) -> Array:
    """Shares of stretch and loads [N/m] of a sheet of cloth with friction that is held and moved like the yarns.

    size: of what is between the grips [m].
    """
    mesh = rectangle(*size, min(size) / 16)
    start, places = ClothState.flat(mesh), mesh.panel[:, axis]
    handles = []
    for name, side in (("low", -1.0), ("high", 1.0)):
        vertices = np.flatnonzero(side * places > 0.5 * size[axis] * (1.0 - 1e-9))
        shift = [0.0, 0.0, 0.0]
        shift[axis] = 0.5 * side * amount * size[axis]
        motion = Motion((shift[0], shift[1], shift[2]), 0.0, 1.0, ease=False)
        handles.append(Handle(name, vertices, start.positions[vertices], motion))
    material = read_material(folder / "material.json")
    solver = ClothSolver(Cloth(mesh, material, tuple(handles), gravity=(0.0, 0.0, 0.0)), SolverOptions(1e-3))
    state, found, up = start, [], np.linspace(0.0, 1.0, steps + 1)
    for number, share in enumerate([*up, *up[-2::-1]]):
        step, crept = equilibrium(solver, state, time=float(share))
        state = step.state
        pull = sum(side * solver.pull(h, state)[axis] for h, side in zip(handles, (-1, 1), strict=True)) / 2
        found.append((share * amount, pull / size[1 - axis]))
        if crept or step.status.name != "CONVERGED":
            print(f"  cloth at {share * amount:.4f}: {step.status.name}{', crept' if crept else ''}")
        if number > steps and pull < 0.0:
            break
    return np.array(found)


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
    """Largest stress, work and work returned, and the stretch at which a hundredth of it is left on the way back."""
    work = float(np.trapezoid(stress[: steps + 1], stretch[: steps + 1]))
    back = -float(np.trapezoid(stress[steps:], stretch[steps:]))
    little, left = 0.01 * stress[steps], np.nan
    for a, b in pairwise(range(steps, len(stress))):
        if stress[a] > little >= stress[b]:
            left = stretch[b] + (stretch[a] - stretch[b]) * (little - stress[b]) / (stress[a] - stress[b])
            break
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


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--size", type=float, default=0.04, help="of the sheet [m]")
    parser.add_argument("--amount", type=float, default=0.2, help="largest stretch")
    parser.add_argument("--friction", type=float, nargs="+", default=[0.1, 0.3])
    parser.add_argument("--steps", type=int, default=8, help="of the way out")
    parser.add_argument("--direction", choices=("course", "wale"), default="course")
    parser.add_argument("--glue", type=float, default=LOOPED, help="stiffness of the borders over that of yarn")
    parser.add_argument("--free", action="store_true", help="grips let the fabric narrow; not for cloth")
    parser.add_argument("--cloth", type=Path, nargs="+", help="folders of materials, one for each friction")
    parser.add_argument("--out", type=Path, help="folder for pictures")
    options = parser.parse_args()
    folders = options.cloth or [None] * len(options.friction)
    for coefficient, folder in zip(options.friction, folders, strict=True):
        cycled(options, YarnFriction(coefficient), folder)


if __name__ == "__main__":
    main()
