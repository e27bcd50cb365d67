"""One scenario, two simulations: every yarn of a sheet, and its homogenized cloth (HYLC20 Fig. 16 and Table 2).

python benchmarks/validation.py [PATTERN ...] --scene stretch|drape --size 0.09 --out DIR

stretch: two bars move apart and stand still, gravity through the thickness, at the proportions of the published test.
drape: the sheet falls on a ball that lies a little aside of its middle, along the courses or the wales: under the
middle a quarter turn of the sheet would change nothing. The sheet has the whole periods that come nearest to the
size, the cloth is the square of the same area. The material is homogenized from the same pattern at rest and kept in
DIR/PATTERN. Every run is kept in DIR and not repeated (delete its file to repeat it); ``validation_pictures.py`` draws
them.

Prints processor seconds per step and per 1/30 s frame of both and their ratio, as the published table does, and how the
shapes compare. Compilation is not counted.
"""

from __future__ import annotations

import argparse
import json
import math
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from validation_shapes import MiddleSurface, difference, shape_of

from yarnscale.cell import PeriodicCell
from yarnscale.cell.rest import settled
from yarnscale.drawing import library
from yarnscale.fabric.boundary import glue
from yarnscale.fabric.direct_energy import FabricEnergy
from yarnscale.fabric.direct_motion import FabricDynamics, FabricMotion, MotionSettings
from yarnscale.fabric.direct_moves import PassageCount
from yarnscale.fabric.sheet import YarnSheet
from yarnscale.fabric.sheet_scene import SheetScene, drape, pulled_apart
from yarnscale.files.material_json import read_material, write_material
from yarnscale.homogenize.homogenize import homogenize
from yarnscale.motion.obstacles import Sphere
from yarnscale.motion.run import simulate
from yarnscale.motion.schedule import Schedule
from yarnscale.shell.contact.cloth_contact import ContactSettings
from yarnscale.shell.dynamics.cloth import Cloth
from yarnscale.shell.dynamics.solver import ClothSolver
from yarnscale.shell.elastic.energy import ElementMaterial
from yarnscale.shell.mesh import rectangle
from yarnscale.shell.scenes.scene import BAR_TRAVEL, SHEET, bar_duration, bar_points, stretch
from yarnscale.shell.scenes.thickness import cloth_thickness
from yarnscale.shell.state import ClothState
from yarnscale.yarn.friction import YarnFriction
from yarnscale.yarn.material import YarnMaterial

Array = NDArray[np.float64]
PATTERNS = ("stockinette", "rib-1x1", "honeycomb", "basket-2x2", "satin-5")
FRAME = 1 / 30
STANDING, FALLING = 0.5, 0.8
"""Seconds that the bars stand still, and that the drape takes."""
DAMPING = 10.0
"""Of non-rigid motion of yarns, and of the stretched cloth [1/s]."""
FALL_DAMPING = 2.0
"""Of the falling cloth, whose damping resists all motion [1/s]."""
BALL, ASIDE = 0.2, 0.05
"""Radius of the ball, and how far it is aside, over the size of the sheet."""
BALL_FRICTION = 0.5
CLOTH_GAP = 0.75
"""Of cloth that lies on a ball: between a half and all of the distance at which they repel each other."""


@dataclass(frozen=True, eq=False)
class Scenario:
    """What both simulations are asked for; lengths [m], times [s].

    sheet: at rest, its middle at the origin. size: edge of the cloth. axis: of the pull, or of the way to the ball.
    """

    cell: PeriodicCell
    sheet: YarnSheet
    kind: str
    axis: int
    travel: float

    @property
    def size(self) -> float:
        return math.sqrt(self.sheet.size[0] * self.sheet.size[1])

    @property
    def moving(self) -> float:
        return bar_duration(self.travel) if self.kind == "stretch" else 0.0

    @property
    def duration(self) -> float:
        return self.moving + STANDING if self.kind == "stretch" else FALLING

    @property
    def aside(self) -> tuple[float, float]:
        return (ASIDE * self.size, 0.0) if self.axis == 0 else (0.0, ASIDE * self.size)

    @property
    def flat(self) -> Array:
        """Where the sheet's vertices lie about its middle (n, 2)."""
        return self.sheet.vertices[:, :2]


@dataclass(frozen=True, eq=False)
class Run:
    """One simulation: counts, processor seconds, and per frame the time, the pull [N] and the middle surface.

    places: of vertices in the end [m]. pieces: triangles of cloth, or the first vertex of every yarn and their number.
    passages: of yarns through each other, or frames in which cloth crosses itself.
    """

    vertices: int
    steps: int
    time_step: float
    seconds: float
    times: Array
    pulls: Array
    surfaces: Array
    places: Array
    pieces: NDArray[np.int64]
    passages: int = 0

    @property
    def per_frame(self) -> float:
        return self.seconds / (self.times[-1] / FRAME)


def scenario(name: str, kind: str, axis: int, size: float) -> Scenario:
    yarn = YarnMaterial.preset(library.structure(name).material)
    cell = PeriodicCell(settled(library.build(name), yarn).pattern, yarn)
    state = cell.relax()
    sheet = YarnSheet.filling(cell.pattern, size, size)
    places = cell.placement(state)(sheet.source, sheet.tile)
    middle = 0.5 * (places.min(axis=0) + places.max(axis=0))
    sheet = sheet.moved(places - middle, twist=state.twist[sheet.source])
    woven = library.structure(name).draft is not None
    travel = BAR_TRAVEL["basket" if woven else "stockinette"] / SHEET
    return Scenario(cell, sheet, kind, axis, travel * math.sqrt(sheet.size[0] * sheet.size[1]))


def scene_of_yarns(asked: Scenario) -> SheetScene:
    if asked.kind == "drape":
        return drape(asked.sheet, radius=BALL * asked.size, aside=asked.aside, friction=BALL_FRICTION)
    grips = [bar_points(asked.flat, asked.axis, side, asked.size) for side in (-1.0, 1.0)]
    down = (0.0, 0.0, -9.81)
    return pulled_apart(
        asked.sheet, (grips[0], grips[1]), asked.travel, axis=asked.axis, duration=asked.moving, gravity=down
    )


def by_yarns(asked: Scenario, options: argparse.Namespace) -> Run:
    """Every yarn."""
    sheet, scene = asked.sheet, scene_of_yarns(asked)
    energy = FabricEnergy(sheet, asked.cell.material, springs=glue(sheet, asked.cell.materials[0]))
    surface = MiddleSurface.of(asked.flat, asked.size)
    friction = YarnFriction(options.friction) if options.friction else None
    settings = MotionSettings(scene.gravity, DAMPING, friction)
    pushes = scene.pushes(energy)
    times, pulls, surfaces = [], [], []

    def frame(_: int, motion: FabricMotion) -> None:
        times.append(motion.time)
        pulls.append(scene.force(energy, motion.x, motion.time))
        surfaces.append(surface.at(energy.positions(motion.x) * sheet.radius))

    dynamics = FabricDynamics(energy, settings, scene.holds, pushes)
    dynamics.step(dynamics.start(), 1e-4)  # compiles
    energy.anchor(energy.start())
    count = PassageCount(energy, energy.start())
    dynamics = FabricDynamics(energy, settings, scene.holds, pushes, count)
    schedule = Schedule(asked.duration, options.time_step, to_rest=False, frame_interval=FRAME)
    began = time.process_time()
    run = simulate(dynamics, dynamics.start(), schedule, on_frame=frame)
    seconds = time.process_time() - began
    places = energy.positions(run.state.x) * sheet.radius
    return Run(
        sheet.vertex_count, run.steps, options.time_step, seconds, np.array(times), np.array(pulls),
        np.array(surfaces), places, sheet.offsets, count.passages,
    )  # fmt: skip


def cloth_of(asked: Scenario, material: ElementMaterial, spacing: float) -> Cloth:
    if asked.kind == "stretch":
        direction = ("course", "wale")[asked.axis]
        made = stretch(
            material, direction=direction, travel=asked.travel, duration=asked.moving, size=asked.size,
            spacing=spacing, air_drag=0.0,
        )  # fmt: skip
        return replace(made.cloth, damping=DAMPING)
    mesh = rectangle(asked.size, asked.size, spacing)
    contact = ContactSettings(cloth_thickness(material, mesh), friction=BALL_FRICTION)
    # Both middle surfaces begin at height 0 over the same ball, and lie on it at the same distance.
    (ball,) = scene_of_yarns(asked).obstacles
    relief = float(-asked.sheet.vertices[:, 2].min()) + asked.sheet.radius - CLOTH_GAP * contact.thickness
    assert isinstance(ball, Sphere)
    sphere = Sphere((*asked.aside, ball.centre[2]), ball.radius + relief)
    return Cloth(mesh, material, contact=contact, obstacles=(sphere,), damping=FALL_DAMPING)


def by_cloth(asked: Scenario, folder: Path, options: argparse.Namespace) -> Run:
    """The homogenized cloth."""
    path = folder / "material.json"
    if not path.exists():
        folder.mkdir(parents=True, exist_ok=True)
        write_material(path, homogenize(asked.cell, folder, resume=True).material)
    cloth = cloth_of(asked, read_material(path), options.spacing)
    start, states = ClothState.flat(cloth.mesh), []
    solver = ClothSolver(cloth)
    simulate(solver, start, Schedule(1e-4, 1e-4, to_rest=False))  # compiles
    began = time.process_time()
    run = simulate(
        solver,
        start,
        Schedule(asked.duration, options.cloth_step, to_rest=False, frame_interval=FRAME),
        on_frame=lambda _, state: states.append(state),
    )
    seconds = time.process_time() - began
    surface = MiddleSurface.of(cloth.mesh.panel, asked.size)

    def pull(state: ClothState) -> float:
        if not cloth.handles:
            return math.nan
        first, second = (float(solver.pull(bar, state)[asked.axis]) for bar in cloth.handles)
        return 0.5 * (second - first)

    return Run(
        cloth.mesh.vertex_count, run.steps, options.cloth_step, seconds, np.array([s.time for s in states]),
        np.array([pull(s) for s in states]), np.array([surface.at(s.positions) for s in states]),
        run.state.positions, cloth.mesh.triangles, run.faults.get("intersections", 0),
    )  # fmt: skip


def compared(asked: Scenario, yarns: Run, cloth: Run) -> dict:
    """Numbers of a pair of runs."""
    periods = np.round(np.array(asked.sheet.size) / asked.cell.pattern.period).astype(int)
    row: dict = {"size": asked.size, "periods": periods.tolist(), "radius": asked.sheet.radius}
    row["way"], row["moving"], row["ball"] = 2.0 * asked.travel, asked.moving, None
    for ball in scene_of_yarns(asked).obstacles:
        assert isinstance(ball, Sphere)
        row["ball"] = ball.centre, ball.radius
    for name, run in (("yarns", yarns), ("cloth", cloth)):
        row[name] = {
            "vertices": run.vertices, "steps": run.steps, "time_step": run.time_step,
            "seconds_per_step": run.seconds / run.steps, "seconds_per_frame": run.per_frame,
            "passages": run.passages, "force": float(run.pulls[-1]),
            **asdict(shape_of(run.surfaces[-1], asked.size, asked.axis)),
        }  # fmt: skip
    row["ratio"] = yarns.per_frame / cloth.per_frame
    row["top"] = asdict(difference(yarns.surfaces[-1], cloth.surfaces[-1], "top"))
    row["side"] = asdict(difference(yarns.surfaces[-1], cloth.surfaces[-1], "side"))
    if asked.kind == "stretch":
        moments = asked.moving * np.array([0.25, 0.5, 0.75, 1.0])
        pulls = [np.interp(moments, run.times, run.pulls) for run in (yarns, cloth)]
        row["pulls"] = {"yarns": pulls[0].tolist(), "cloth": pulls[1].tolist()}
    return row


def kept(path: Path, make: Callable[[], Run]) -> Run:
    """The run of an earlier time, or a new one, which is kept."""
    if not path.exists():
        np.savez_compressed(path, **asdict(make()))
    with np.load(path) as arrays:
        return Run(**{name: values if values.ndim else values.item() for name, values in arrays.items()})


def compare(name: str, axis: int, options: argparse.Namespace) -> dict:
    """Both simulations of a pattern in one orientation."""
    direction = ("course", "wale")[axis]
    asked = scenario(name, options.scene, axis, options.size)
    stem = options.out / f"{name}-{options.scene}-{direction}"
    cloth = kept(Path(f"{stem}-cloth.npz"), lambda: by_cloth(asked, options.out / name, options))
    yarns = kept(Path(f"{stem}-yarns.npz"), lambda: by_yarns(asked, options))
    row = {"pattern": name, "scene": options.scene, "direction": direction, **compared(asked, yarns, cloth)}
    Path(f"{stem}.json").write_text(json.dumps(row, indent=1))
    return row


HEAD = (
    "pattern      scene   along   vertices    step [ms]     s/step      s/frame   ratio   along       across      "
    "width [mm]   rise [mm]    lowest [mm]  force [N]   outline over, side; outline, same points apart [mm]"
)
"""Of pairs: yarns / cloth."""


def told(row: dict) -> str:
    """One line of the table: yarns / cloth."""
    yarns, cloth, top, side = row["yarns"], row["cloth"], row["top"], row["side"]
    units = {"along": 1, "across": 1, "width": 1e3, "rise": 1e3, "lowest": 1e3, "force": 1}
    shapes = "  ".join(f"{yarns[key] * unit:5.3g}/{cloth[key] * unit:<5.3g}" for key, unit in units.items())
    work = "  ".join(
        f"{yarns[key] * unit:5.3g}/{cloth[key] * unit:<5.3g}"
        for key, unit in (("time_step", 1e3), ("seconds_per_step", 1), ("seconds_per_frame", 1))
    )
    crossed = [f"{yarns['passages']} passages"] * bool(yarns["passages"])
    crossed += [f"{cloth['passages']} frames of cloth cross"] * bool(cloth["passages"])
    return (
        f"{row['pattern']:12s} {row['scene']:7s} {row['direction']:6s} {yarns['vertices']:5d}/{cloth['vertices']:<5d} "
        f"{work}  {row['ratio']:5.1f}  {shapes}  {top['overlap']:.2f}, {side['overlap']:.2f}; "
        f"{1e3 * top['outline']:.1f}, {1e3 * top['apart']:.1f}  {'; '.join(crossed)}"
    )


if __name__ == "__main__":
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("patterns", nargs="*", default=PATTERNS)
    parser.add_argument("--scene", choices=("stretch", "drape"), default="stretch")
    parser.add_argument("--size", type=float, default=0.09, help="edge of the sheet [m]")
    parser.add_argument("--spacing", type=float, default=0.004, help="edge of the triangles of cloth [m]")
    parser.add_argument("--friction", type=float, default=0.1, help="of yarns on each other")
    parser.add_argument("--time-step", type=float, default=1 / 60, help="of the yarns [s]")
    parser.add_argument("--cloth-step", type=float, default=1 / 60, help="of the cloth [s]")
    parser.add_argument("--out", type=Path, required=True)
    chosen = parser.parse_args()
    chosen.out.mkdir(parents=True, exist_ok=True)
    print(HEAD)
    for pattern in chosen.patterns:
        for pull in (0, 1):
            print(told(compare(pattern, pull, chosen)), flush=True)
