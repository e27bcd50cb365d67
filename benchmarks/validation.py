"""One scenario, two simulations: every yarn of a sheet, and its homogenized cloth (HYLC20 Fig. 16 and Table 2).

python benchmarks/validation.py [PATTERN ...] --scene stretch|drape --size 0.15 --friction 0.3 0.02 --out DIR
python benchmarks/validation.py [PATTERN ...] --friction --cloth-friction 0.1 --out DIR
python benchmarks/validation.py --out DIR --table

stretch: two bars move apart and stand still, gravity through the thickness, at the proportions of the published test.
drape: the sheet falls on a ball that lies a little aside of its middle, along the courses or the wales: under the
middle a quarter turn of the sheet would change nothing. The sheet has the whole periods that come nearest to the
size, the cloth is the square of the same area. Cloth has no friction inside, or that of the cell (--cloth-friction).

Every run is kept in a folder of its own, DIR/PATTERN/CASE, with its frames and a checkpoint after each: a killed run
goes on where it was, a finished one is not repeated. DIR/PATTERN holds the pattern at rest, its samples and the
material. Delete ``material.json`` to fit the samples again, ``samples`` and ``unseen`` too to sample again; ``--visit``
adds samples where the cloth of all kept cases went. Cloth is then simulated again, yarns are not. ``--table`` prints
what is kept, finished or not, in the form of the published table, in processor seconds without compilation;
``validation_pictures.py`` draws it.
"""

from __future__ import annotations

import argparse
import json
import math
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from itertools import product
from pathlib import Path
from typing import Generic

import numpy as np
from numpy.typing import NDArray
from validation_shapes import MiddleSurface
from validation_table import printed

from yarnscale.cell import PeriodicCell
from yarnscale.cell.rest import settled
from yarnscale.drawing import library
from yarnscale.errors import InputError
from yarnscale.fabric.boundary import glue
from yarnscale.fabric.direct_energy import FabricEnergy
from yarnscale.fabric.direct_motion import FabricDynamics, FabricMotion, MotionSettings
from yarnscale.fabric.sheet import YarnSheet
from yarnscale.fabric.sheet_scene import SheetScene, drape, pulled_apart
from yarnscale.files.checkpoint_file import NAME as CHECKPOINT
from yarnscale.files.checkpoint_file import CheckpointFile
from yarnscale.files.cloth_frames import FrameFolder, FrameWriter
from yarnscale.files.curve_frames import CurveFolder, CurveSet
from yarnscale.files.material_json import read_material, write_material
from yarnscale.files.pattern_json import read_pattern_json, write_pattern_json
from yarnscale.files.visited import visited_strains
from yarnscale.homogenize.friction_fit import with_friction
from yarnscale.homogenize.friction_paths import friction_paths
from yarnscale.homogenize.homogenize import homogenize
from yarnscale.homogenize.rays import largest_load
from yarnscale.motion.body import Body, State
from yarnscale.motion.handles import Handle
from yarnscale.motion.obstacles import Sphere
from yarnscale.motion.rigid import Motion
from yarnscale.motion.run import RunProgress, simulate
from yarnscale.motion.schedule import Schedule
from yarnscale.shell.contact.cloth_contact import ContactSettings
from yarnscale.shell.dynamics.cloth import Cloth
from yarnscale.shell.dynamics.solver import ClothSolver
from yarnscale.shell.materials.compact import CompactMaterial
from yarnscale.shell.materials.material import ShellMaterial
from yarnscale.shell.mesh import TriangleMesh, rectangle
from yarnscale.shell.scenes.scene import BAR_GAP, BAR_TRAVEL, BAR_WIDTH, SHEET, bar_duration, bar_points
from yarnscale.shell.scenes.thickness import cloth_thickness
from yarnscale.shell.state import ClothState
from yarnscale.yarn.friction import YarnFriction
from yarnscale.yarn.material import YarnMaterial

Array = NDArray[np.float64]
OUTCOME = "outcome.json"
PATTERNS = ("stockinette", "cartridge-belt-rib", "honeycomb", "basket-2x2", "satin-5")
DIRECTIONS = ("course", "wale")
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


@dataclass(frozen=True)
class Case:
    """One simulation: a pattern, scene, direction of the pull or of the ball, and the size asked for [m].

    friction: of yarns on each other, or of those from which cloth is homogenized. spacing: of the triangles of cloth
    [m]; None: every yarn.
    """

    pattern: str
    scene: str
    direction: str
    size: float
    friction: float | None = None
    spacing: float | None = None

    @property
    def name(self) -> str:
        kinds = [f"cloth-{1e3 * self.spacing:g}mm"] if self.spacing else []
        kinds += [f"friction-{self.friction:g}"] if self.friction is not None else []
        return "-".join([self.scene, self.direction, f"{1e3 * self.size:g}mm", *kinds])


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

    @cached_property
    def scene(self) -> SheetScene:
        """Of the yarns."""
        if self.kind == "drape":
            return drape(self.sheet, radius=BALL * self.size, aside=self.aside, friction=BALL_FRICTION)
        grips = [bar_points(self.flat, self.axis, side, self.size) for side in (-1.0, 1.0)]
        return pulled_apart(
            self.sheet, (grips[0], grips[1]), self.travel, axis=self.axis, duration=self.moving,
            gravity=(0.0, 0.0, -9.81),
        )  # fmt: skip

    @property
    def ball(self) -> Sphere | None:
        for ball in self.scene.obstacles:
            assert isinstance(ball, Sphere)
            return ball
        return None


def scenario(case: Case, folder: Path) -> Scenario:
    """Of a case, of the pattern at rest that the folder keeps."""
    structure, path = library.structure(case.pattern), folder / "pattern.json"
    yarn = YarnMaterial.preset(structure.material)
    if not path.exists():
        folder.mkdir(parents=True, exist_ok=True)
        write_pattern_json(settled(library.build(case.pattern), yarn).pattern, path)
    cell = PeriodicCell(read_pattern_json(path), yarn)
    state = cell.relax()
    sheet = YarnSheet.filling(cell.pattern, case.size, case.size)
    places = cell.placement(state)(sheet.source, sheet.tile)
    middle = 0.5 * (places.min(axis=0) + places.max(axis=0))
    sheet = sheet.moved(places - middle, twist=state.twist[sheet.source])
    travel = BAR_TRAVEL["basket" if structure.woven else "stockinette"] / SHEET
    size = math.sqrt(sheet.size[0] * sheet.size[1])
    return Scenario(cell, sheet, case.scene, DIRECTIONS.index(case.direction), travel * size)


class KeptRun(Generic[State]):
    """Runs a case, or goes on with it, in a folder; frames hold time, pull [N], middle surface and work until then."""

    def __init__(self, case: Case, asked: Scenario, folder: Path, kind: type[State], step: float, **parts: object):
        self.case, self.asked, self.folder = case, asked, folder
        self.schedule = Schedule(asked.duration, step, to_rest=False, frame_interval=FRAME)
        # Plain values alone: the package may change its classes while runs of days go on.
        settings = {"case": asdict(case), "schedule": [asked.duration, step], **parts}
        folder.mkdir(parents=True, exist_ok=True)
        # Between frames yarns go on from lists of contacts that no checkpoint holds.
        self._file = CheckpointFile(folder / CHECKPOINT, kind, settings, interval=math.inf)
        self.place = self._file.read() if (folder / CHECKPOINT).exists() else None
        self.kept = self.place.frames if self.place else 0
        self.steps, self.seconds, self.faults = 0, 0.0, 0
        if self.kept:
            with np.load(folder / f"frame_{self.kept - 1:04d}.npz") as frame:
                self.steps, self.seconds = int(frame["steps"]), float(frame["seconds"])
                self.faults = int(frame["faults"])

    @property
    def finished(self) -> bool:
        return self.place is not None and self.place.status is not None

    def describe(self, vertices: int) -> None:
        """Write what the table and the pictures have to know."""
        asked, ball = self.asked, self.asked.ball
        periods = np.round(np.array(asked.sheet.size) / asked.cell.pattern.period).astype(int)
        row = {
            **asdict(self.case), "edge": asked.size, "axis": asked.axis, "periods": periods.tolist(),
            "radius": asked.sheet.radius, "moving": asked.moving, "duration": asked.duration,
            "way": 2.0 * asked.travel, "ball": None if ball is None else (ball.centre, ball.radius),
            "time_step": self.schedule.time_step, "vertices": vertices,
        }  # fmt: skip
        (self.folder / "case.json").write_text(json.dumps(row, indent=1))

    def go_on(
        self, body: Body[State], start: State, frames: FrameWriter, seen: Callable[[State], dict[str, object]]
    ) -> None:
        """Run to the end; seen: arrays of a frame."""
        began = time.process_time() - self.seconds

        def step(progress: RunProgress) -> None:
            self.steps = progress.steps

        def frame(number: int, state: State) -> None:
            seconds = time.process_time() - began
            frames.write_arrays(number, state.time, steps=self.steps, seconds=seconds, **seen(state))  # type: ignore[arg-type]

        run = simulate(
            body, start, self.schedule, on_step=step, on_frame=frame, on_checkpoint=self._file.write,
            resume=self.place,
        )  # fmt: skip
        (self.folder / OUTCOME).write_text(json.dumps({**run.summary(), "steps": run.steps}, indent=1))


def by_yarns(case: Case, asked: Scenario, folder: Path, options: argparse.Namespace) -> None:
    """Every yarn."""
    sheet, scene, material = asked.sheet, asked.scene, asked.cell.material
    friction = YarnFriction(case.friction) if case.friction else None
    settings = MotionSettings(scene.gravity, DAMPING, friction)
    parts = {"sheet": [sheet.vertices, sheet.offsets, sheet.rest_length], "damping": DAMPING}
    run = KeptRun(case, asked, folder, FabricMotion, options.time_step, **parts)
    if run.finished:
        return
    run.describe(sheet.vertex_count)
    energy = FabricEnergy(sheet, material, springs=glue(sheet, asked.cell.materials[0]))
    surface = MiddleSurface.of(asked.flat, asked.size)
    pushes = scene.pushes(energy)
    dynamics = FabricDynamics(energy, settings, scene.holds, pushes)
    dynamics.step(dynamics.start(), 1e-4)  # compiles
    energy.anchor(energy.start())
    energy.count_passages()
    curves = CurveSet(sheet.offsets, sheet.yarn_radii, closed=sheet.closed, yarn=sheet.yarn)

    def seen(state: FabricMotion) -> dict[str, object]:
        places = energy.positions(state.x) * sheet.radius
        pull = scene.force(energy, state.x, state.time)
        return {
            "positions": places,
            "surface": surface.at(places),
            "pull": pull,
            "faults": energy.passage_count,
        }

    run.go_on(dynamics, dynamics.start(), CurveFolder(folder, curves, keep=run.kept), seen)


def barred_mesh(size: float, spacing: float, axis: int) -> TriangleMesh:
    """A square whose rows of vertices across an axis lie along the edges of the bars, which hold whole triangles."""
    mesh = rectangle(size, size, spacing)
    rows = np.unique(mesh.panel[:, 1].round(12))
    inner = 0.5 * size / SHEET * BAR_GAP
    edges = np.array([inner, inner + size / SHEET * BAR_WIDTH])
    first = int(np.abs(rows - inner).argmin())
    count = max(1, round((edges[1] - inner) / (rows[1] - rows[0])))
    known = np.array([0.0, rows[first], rows[first + count], 0.5 * size])
    height = np.interp(np.abs(mesh.panel[:, 1]), known, [0.0, *edges, 0.5 * size])
    panel = np.column_stack([mesh.panel[:, 0], np.sign(mesh.panel[:, 1]) * height])
    if axis == 1:
        return TriangleMesh(panel, mesh.triangles)
    return TriangleMesh(panel[:, ::-1].copy(), mesh.triangles[:, ::-1].copy())


def cloth_of(asked: Scenario, material: ShellMaterial, spacing: float) -> Cloth:
    if asked.kind == "stretch":
        mesh = barred_mesh(asked.size, spacing, asked.axis)
        start, bars = ClothState.flat(mesh).positions, []
        for name, side in (("first bar", -1.0), ("second bar", 1.0)):
            held = bar_points(mesh.panel, asked.axis, side, asked.size)
            way = tuple(side * asked.travel * float(k == asked.axis) for k in range(3))
            motion = Motion(way, 0.0, asked.moving, ease=False)  # type: ignore[arg-type]
            bars.append(Handle(name, held, start[held], motion))
        contact = ContactSettings(cloth_thickness(material, mesh))
        return Cloth(mesh, material, tuple(bars), contact=contact, damping=DAMPING)
    mesh = rectangle(asked.size, asked.size, spacing)
    contact = ContactSettings(cloth_thickness(material, mesh), friction=BALL_FRICTION)
    # Both middle surfaces begin at height 0 over the same ball, and lie on it at the same distance.
    ball = asked.ball
    assert ball is not None
    relief = float(-asked.sheet.vertices[:, 2].min()) + asked.sheet.radius - CLOTH_GAP * contact.thickness
    sphere = Sphere((*asked.aside, ball.centre[2]), ball.radius + relief)
    return Cloth(mesh, material, contact=contact, obstacles=(sphere,), damping=FALL_DAMPING)


def material_file(asked: Scenario, folder: Path, *, visit: bool = False) -> Path:
    """The homogenized material that a pattern's folder keeps; visit: sampled too where the cloth of its cases went."""
    path = folder / "material.json"
    if visit or not path.exists():
        runs = [place.parent for place in folder.glob("*/mesh.npz")] if visit else []
        visited = np.concatenate([visited_strains(run) for run in runs]) if runs else None
        found = homogenize(asked.cell, folder, resume=True, visited=visited, workers=1)
        write_material(path, found.material)
        print(f"{folder.name}: {found.summary.states} states, {found.errors}", flush=True)
    return path


def with_sliders(asked: Scenario, elastic: Path, friction: float) -> Path:
    """The same with the friction of yarns, which lies beside it; made anew where the elastic one was fitted anew."""
    folder = elastic.parent
    path = folder / f"material-friction-{friction:g}.json"
    if not path.exists() or path.stat().st_mtime < elastic.stat().st_mtime:
        material = read_material(elastic)
        assert isinstance(material, CompactMaterial)
        kept, limit = folder / f"friction-{friction:g}", largest_load(asked.cell)
        found = with_friction(
            material, friction_paths(asked.cell, YarnFriction(friction), limit=limit, folder=kept), friction
        )
        write_material(path, found)
        print(f"{folder.name}, friction {friction:g}: {found.provenance['friction']}", flush=True)
    return path


def by_cloth(case: Case, asked: Scenario, folder: Path, options: argparse.Namespace) -> None:
    """The homogenized cloth."""
    assert case.spacing is not None
    path = material_file(asked, folder.parent)
    if case.friction is not None:
        path = with_sliders(asked, path, case.friction)
    cloth = cloth_of(asked, read_material(path), case.spacing)
    parts = case, asked, folder, ClothState, options.cloth_step
    text = path.read_text(encoding="utf-8")
    try:
        run = KeptRun(*parts, material=text)
    except InputError as error:
        print(f"{case.pattern} {case.name} again: {error}")
        for name in (CHECKPOINT, OUTCOME):
            (folder / name).unlink(missing_ok=True)
        run = KeptRun(*parts, material=text)
    if run.finished:
        return
    run.describe(cloth.mesh.vertex_count)
    solver, start = ClothSolver(cloth), ClothState.flat(cloth.mesh)
    simulate(solver, start, Schedule(1e-4, 1e-4, to_rest=False))  # compiles
    surface = MiddleSurface.of(cloth.mesh.panel, asked.size)
    crossed = run.faults

    def seen(state: ClothState) -> dict[str, object]:
        nonlocal crossed
        crossed += solver.faults(state).get("intersections", 0)
        pulls = [float(solver.pull(bar, state)[asked.axis]) for bar in cloth.handles]
        pull = 0.5 * (pulls[1] - pulls[0]) if pulls else math.nan
        return {
            "positions": state.positions, "velocities": state.velocities, "surface": surface.at(state.positions),
            "pull": pull, "faults": crossed,
        }  # fmt: skip

    run.go_on(solver, start, FrameFolder(folder, cloth.mesh, keep=run.kept), seen)


def cases(options: argparse.Namespace) -> list[Case]:
    """All that the options ask for, cloth before yarns."""
    found = []
    for pattern, direction in product(options.patterns, options.directions):
        case = Case(pattern, options.scene, direction, options.size)
        found += [replace(case, spacing=spacing) for spacing in options.spacing]
        found += [
            replace(case, spacing=spacing, friction=friction)
            for spacing, friction in product(options.spacing, options.cloth_friction)
        ]
        found += [replace(case, friction=friction) for friction in options.friction]
    return found


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("patterns", nargs="*", default=PATTERNS)
    parser.add_argument("--scene", choices=("stretch", "drape"), default="stretch")
    parser.add_argument("--directions", nargs="+", choices=DIRECTIONS, default=DIRECTIONS)
    parser.add_argument("--size", type=float, default=0.15, help="edge of the sheet [m]")
    parser.add_argument("--spacing", type=float, nargs="*", default=[0.004], help="edges of the triangles of cloth [m]")
    parser.add_argument("--friction", type=float, nargs="*", default=[0.3, 0.02], help="of yarns on each other")
    parser.add_argument("--cloth-friction", type=float, nargs="*", default=[], help="cloth with friction of yarns, too")
    parser.add_argument("--time-step", type=float, default=1 / 60, help="of the yarns [s]")
    parser.add_argument("--cloth-step", type=float, default=1 / 60, help="of the cloth [s]")
    parser.add_argument("--table", action="store_true", help="print what is kept, simulate nothing")
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--visit", action="store_true", help="sample where the kept cloth went, fit again")
    chosen = parser.parse_args()
    asked_for = [] if chosen.table else cases(chosen)
    for one in {one.pattern: one for one in asked_for if chosen.visit}.values():
        place = chosen.out / one.pattern
        material_file(scenario(one, place), place, visit=True)
    for one in asked_for:
        place = chosen.out / one.pattern
        began = time.perf_counter()
        (by_cloth if one.spacing else by_yarns)(one, scenario(one, place), place / one.name, chosen)
        print(f"{one.pattern} {one.name}: {time.perf_counter() - began:.0f} s", flush=True)
    print(printed(chosen.out))
