"""One scenario, two simulations: every yarn of a sheet, and its homogenized cloth (HYLC20 Fig. 16 and Table 2).

python benchmarks/validation.py [PATTERN ...] --size 0.06 --out DIR

The stretch test of HYLC20 at the size that is given: two bars move apart and stand still, gravity through the
thickness. The material is homogenized from the same pattern at rest and kept in DIR. Prints seconds per 1/30 s frame of
both and their ratio, stretch in the middle along and across the pull, the width at half way, how high the edges stand,
and the force on a bar; writes pictures side by side.
"""

from __future__ import annotations

import argparse
import json
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np
import pyvista
from numpy.typing import NDArray

from yarnscale.cell import PeriodicCell
from yarnscale.cell.rest import settled
from yarnscale.fabric.boundary import glue
from yarnscale.fabric.direct_energy import FabricEnergy
from yarnscale.fabric.direct_motion import FabricDynamics, MotionSettings
from yarnscale.fabric.direct_moves import PassageCount
from yarnscale.fabric.direct_run import run_fabric
from yarnscale.fabric.direct_static import Holds
from yarnscale.fabric.run import MotionSchedule
from yarnscale.fabric.sheet import YarnSheet
from yarnscale.fabric.yarn_friction import YarnFriction
from yarnscale.files.material_json import read_material, write_material
from yarnscale.homogenize.homogenize import homogenize
from yarnscale.shell.dynamics.simulate import Schedule
from yarnscale.shell.scenes.scene import (
    BAR_TRAVEL,
    SHEET,
    bar_duration,
    bar_points,
    run_scene,
    stretch,
)
from yarnscale.show import theme
from yarnscale.show.canvas import aim, canvas, light
from yarnscale.show.curves import Curve
from yarnscale.show.tubes import tube_mesh
from yarnscale.yarn import library
from yarnscale.yarn.material import YarnMaterial

Array = NDArray[np.float64]
PATTERNS = ("stockinette", "rib-1x1", "honeycomb", "basket-2x2", "satin-5")
TRAVELS = {name: BAR_TRAVEL["basket"] for name in ("basket-2x2", "satin-5", "plain", "twill-2x2")}
"""Way of a bar for a sheet of 30 cm [m]; other patterns go as far as stockinette."""
FRAME, AFTER = 1 / 30, 0.4
GLUED = 0.5
"""Width of the border that is glued, weakly [radii]: wide stiff borders carry the pull and keep knits from curling."""
DAMPING = 10.0
"""Of non-rigid motion, of yarns and of cloth [1/s]."""


@dataclass(frozen=True)
class Measured:
    """What one simulation came to: lengths [m], force on a bar [N], seconds per frame of 1/30 s."""

    vertices: int
    seconds: float
    along: float
    across: float
    width: float
    height: float
    force: float
    passages: int = 0


def shape(rest: Array, places: Array, size: float, axis: int) -> tuple[float, float, float, float]:
    """Stretch along and across in the middle, width half way between the bars, height over the middle [m].

    rest: where vertices lie in the flat sheet (n, 2), its middle at 0; places: (n, 3).
    """
    inner = (np.abs(rest) < 0.1 * size).all(axis=1)
    design = np.column_stack([rest[inner], np.ones(inner.sum())])
    gradient = np.linalg.lstsq(design, places[inner], rcond=None)[0][:2]
    along, across = np.linalg.norm(gradient[axis]), np.linalg.norm(gradient[1 - axis])
    middle = places[np.abs(rest[:, axis]) < 0.03 * size]
    width = np.ptp(middle[:, 1 - axis])
    height = np.abs(places[:, 2] - places[inner, 2].mean()).max()
    return float(along), float(across), float(width), float(height)


def of_yarns(
    cell: PeriodicCell, axis: int, travel: float, duration: float, options: argparse.Namespace
) -> tuple[Measured, list[Curve]]:
    """Every yarn."""
    size = options.size
    state = cell.relax()
    sheet = YarnSheet.filling(cell.pattern, size, size)
    sheet = sheet.moved(cell.placement(state)(sheet.source, sheet.tile), twist=state.twist[sheet.source])
    flat = sheet.vertices[:, :2]
    rest = flat - 0.5 * (flat.min(axis=0) + flat.max(axis=0))
    nodes, sides = [], []
    for side in (-1.0, 1.0):
        held = bar_points(rest, axis, side, size)
        nodes.append(held)
        sides.append(np.full(len(held), side))
    held, side = np.concatenate(nodes), np.concatenate(sides)

    def holds(time: float) -> Holds:
        targets = sheet.vertices[held].copy()
        targets[:, axis] += side * travel * min(1.0, time / duration)
        return Holds(held, targets)

    energy = FabricEnergy(
        sheet,
        cell.material,
        springs=glue(sheet, cell.materials[0], width=GLUED * sheet.radius, stiffness=0.05),
    )
    friction = YarnFriction(options.friction) if options.friction else None
    dynamics = FabricDynamics(
        energy, MotionSettings((0.0, 0.0, -9.81), DAMPING, friction), holds,
        count=PassageCount(energy, energy.start()),
    )  # fmt: skip
    run = run_fabric(dynamics, MotionSchedule(duration + AFTER, 1 / 60))
    places = energy.positions(run.motion.x) * sheet.radius
    pull = holds(run.motion.time).forces(energy, run.motion.x)[:, axis]
    frames = run.motion.time / FRAME
    measured = Measured(
        sheet.vertex_count, run.seconds / frames, *shape(rest, places, size, axis),
        float(np.abs([pull[side < 0].sum(), pull[side > 0].sum()]).mean()), run.passages,
    )  # fmt: skip
    return measured, [Curve(line, k) for k, line in enumerate(np.split(places, sheet.offsets[1:-1]))]


def of_cloth(
    folder: Path, cell: PeriodicCell, axis: int, travel: float, duration: float, options: argparse.Namespace
) -> tuple[Measured, Array, NDArray[np.int64]]:
    """The homogenized cloth."""
    path = folder / "material.json"
    if not path.exists():
        write_material(path, homogenize(cell, folder, resume=True).material)
    direction = ("course", "wale")[axis]
    scene = stretch(
        read_material(path),
        direction=direction,
        travel=travel,
        duration=duration,
        size=options.size,
        spacing=options.spacing,
        air_drag=0.0,
    )
    cloth = replace(scene.cloth, damping=DAMPING)
    result = run_scene(replace(scene, cloth=cloth, schedule=Schedule(duration + AFTER, FRAME, to_rest=False)))
    places = result.state.positions
    measured = Measured(
        cloth.mesh.vertex_count, result.seconds / (result.simulated_seconds / FRAME),
        *shape(cloth.mesh.panel, places, options.size, axis), result.measures["bar_force"],
    )  # fmt: skip
    return measured, places, cloth.mesh.triangles


def draw(path: Path, radius: float, curves: list[Curve], places: Array, triangles: NDArray[np.int64]) -> None:
    """Yarns to the left, cloth to the right, on one scale."""
    width, height = 1400, 640
    everything = np.concatenate([places, *(curve.points for curve in curves)])
    with canvas(path, size=(width, height), shape=(1, 2)) as plotter:
        for column in range(2):
            plotter.subplot(0, column)
            plotter.set_background(theme.PAPER)
            light(plotter)
            if column == 0:
                plotter.add_mesh(tube_mesh(curves, radius), scalars="colour", rgb=True, smooth_shading=True)
            else:
                cloth = pyvista.PolyData.from_regular_faces(places, triangles)
                back = {"color": theme.CLOTH_BACK}
                plotter.add_mesh(cloth, color=theme.CLOTH_FRONT, backface_params=back, smooth_shading=True)
            aim(plotter, everything, camera="oblique", aspect=0.5 * width / height)


def compare(name: str, options: argparse.Namespace) -> list[dict]:
    """Both simulations of a pattern, pulled along its courses and along its wales."""
    folder = options.out / name
    folder.mkdir(parents=True, exist_ok=True)
    yarn = YarnMaterial.preset(library.structure(name).material)
    cell = PeriodicCell(settled(library.build(name), yarn).pattern, yarn)
    travel = TRAVELS.get(name, BAR_TRAVEL["stockinette"]) * options.size / SHEET
    duration = bar_duration(travel)
    rows = []
    for axis, direction in enumerate(("course", "wale")):
        cloth, places, triangles = of_cloth(folder, cell, axis, travel, duration, options)
        yarns, curves = of_yarns(cell, axis, travel, duration, options)
        draw(options.out / f"{name}-{direction}.png", cell.pattern.radius, curves, places, triangles)
        rows.append({"pattern": name, "direction": direction, "yarns": asdict(yarns), "cloth": asdict(cloth)})
        with (options.out / "validation.jsonl").open("a") as log:
            log.write(json.dumps(rows[-1]) + "\n")
        told(rows[-1])
    return rows


HEAD = (
    "pattern      pull     vertices       s/frame    ratio  along  across  width [mm]  height [mm]  force [N]"
)
"""Of pairs: yarns / cloth."""


def told(row: dict) -> None:
    """One line of the table: yarns / cloth."""
    yarns, cloth = row["yarns"], row["cloth"]
    pairs = [
        (yarns[key] * unit, cloth[key] * unit)
        for key, unit in (("along", 1), ("across", 1), ("width", 1e3), ("height", 1e3), ("force", 1))
    ]
    shapes = "  ".join(f"{a:5.3g}/{b:<5.3g}" for a, b in pairs)
    print(
        f"{row['pattern']:12s} {row['direction']:6s} {yarns['vertices']:6d}/{cloth['vertices']:<5d} "
        f"{yarns['seconds']:7.2f}/{cloth['seconds']:<5.2f} {yarns['seconds'] / cloth['seconds']:6.1f}  {shapes}"
        + (f"  {yarns['passages']} passages" if yarns["passages"] else ""),
        flush=True,
    )


if __name__ == "__main__":
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("patterns", nargs="*", default=PATTERNS)
    parser.add_argument("--size", type=float, default=0.06, help="edge of the sheet [m]")
    parser.add_argument("--spacing", type=float, default=0.0025, help="edge of the triangles of cloth [m]")
    parser.add_argument("--friction", type=float, default=0.3, help="of yarns on each other")
    parser.add_argument("--out", type=Path, required=True)
    chosen = parser.parse_args()
    print(HEAD)
    for pattern in chosen.patterns:
        compare(pattern, chosen)
