"""Seconds per 1/30 s frame of whole fabrics, every yarn, against their homogenized cloth (HYLC20 Table 2).

python benchmarks/direct_fabric.py [PATTERN ...] --size 0.3 --frames 3 [--scene drape] [--materials DIR]

Times the parts of an implicit step, runs some frames of a scene with implicit steps, and one explicit step. A pattern
begins no step after ``--limit`` seconds; a frame's seconds are those of the steps made. DIR has NAME/material.json or
NAME.json for every pattern, as ``yarnscale homogenize`` and benchmarks/validation.py write them; the cloth runs the
same frames. Each pattern has a process of its own, so that memory is that of the pattern; what it is at is told on the
error stream, and its line of the table as soon as it is known.
"""

from __future__ import annotations

import argparse
import math
import resource
import sys
import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from multiprocessing import get_context
from pathlib import Path
from typing import TypeVar

from yarnscale.cell import PeriodicCell
from yarnscale.cell.rest import settled
from yarnscale.drawing import library
from yarnscale.fabric.boundary import glue
from yarnscale.fabric.direct_energy import FabricEnergy
from yarnscale.fabric.direct_motion import FabricDynamics, FabricMotion, MotionSettings
from yarnscale.fabric.direct_static import rod_equilibrium
from yarnscale.fabric.sheet import YarnSheet
from yarnscale.fabric.sheet_scene import SheetScene, drape, stretch
from yarnscale.files.material_json import read_material
from yarnscale.motion.scene import run_scene
from yarnscale.motion.schedule import Schedule
from yarnscale.numerics.factor import Factorisation
from yarnscale.numerics.newton import Status
from yarnscale.shell.scenes import scene as cloth_scene
from yarnscale.yarn.friction import YarnFriction
from yarnscale.yarn.material import YarnMaterial

PATTERNS = ("stockinette", "cartridge-belt-rib", "honeycomb", "basket-2x2", "satin-5")
FRAME = 1 / 30
AMOUNT, PULL = 0.2, 0.4
"""Stretch along the courses, and seconds that it takes."""
DAMPING = 5.0
SETTLING = 15
"""Newton iterations before the scene begins."""
T = TypeVar("T")


def timed(function: Callable[[], T]) -> tuple[float, T]:
    begin = time.perf_counter()
    result = function()
    return time.perf_counter() - begin, result


def sheet_of(name: str, size: float) -> FabricEnergy:
    """A cut sheet of fabric at rest: as drawn, weaves and ribs spring by a tenth as soon as they are let go."""
    material = YarnMaterial.preset(library.structure(name).material)
    pattern = settled(library.build(name), material).pattern
    cell = PeriodicCell(pattern, material)
    state = cell.relax()
    sheet = YarnSheet.filling(pattern, size, size)
    sheet = sheet.moved(cell.placement(state)(sheet.source, sheet.tile), twist=state.twist[sheet.source])
    return FabricEnergy(sheet, material, springs=glue(sheet, material))


def scene_of(sheet: YarnSheet, name: str) -> SheetScene:
    # The grips of the scene go for seven tenths of its time.
    return drape(sheet) if name == "drape" else stretch(sheet, amount=AMOUNT, duration=PULL / 0.7)


def cloth_seconds(name: str, options: argparse.Namespace) -> float:
    """Seconds a frame of the homogenized cloth; NaN without a material."""
    if options.materials is None:
        return float("nan")
    paths = (options.materials / name / "material.json", options.materials / f"{name}.json")
    path = next((path for path in paths if path.exists()), None)
    if path is None:
        return float("nan")
    material = read_material(path)
    if options.scene == "drape":
        made = cloth_scene.drape(material)
    else:
        made = cloth_scene.stretch(material, amount=AMOUNT, duration=PULL, size=options.size)
    for duration in (1e-3, options.frames * FRAME):  # the first time kernels are compiled
        schedule = Schedule(duration, FRAME, to_rest=False)
        result = run_scene(replace(made, schedule=schedule))
    return result.seconds / ((result.state.time - made.start.time) / FRAME)


def parts(energy: FabricEnergy) -> tuple[float, float, float]:
    """Seconds of a Hessian, of the analysis of its pattern, and of a factor."""
    x = energy.start()
    energy.hessian(x)
    hessian, (_, _, block, entries) = timed(lambda: energy.hessian(x))
    entries = entries + 1e-2 * energy.ties(x)
    entries[block.pattern.diagonal] += 1e-2 * abs(entries[block.pattern.diagonal]).mean()
    analysis, factor = timed(lambda: Factorisation(block.pattern))
    return hessian, analysis, timed(lambda: factor.factor(entries))[0]


@dataclass
class Steps:
    """Implicit steps of a run: how many, seconds by the clock and of processors, iterations, factors; converged."""

    motion: FabricMotion
    made: int = 0
    seconds: float = 0.0
    processor: float = 0.0
    iterations: int = 0
    factorisations: int = 0
    met: int = 0


def run(name: str, dynamics: FabricDynamics, start: FabricMotion, options: argparse.Namespace) -> Steps:
    """Steps of the frames asked for, at least one and none after the limit."""
    steps, wanted = Steps(start), max(1, math.ceil(options.frames * FRAME / options.time_step - 1e-9))
    while steps.made < wanted and (steps.made == 0 or steps.seconds < options.limit):
        before = time.process_time()
        seconds, step = timed(lambda: dynamics.step(steps.motion, options.time_step))
        steps.processor += time.process_time() - before
        steps.motion, steps.made, steps.seconds = step.state, steps.made + 1, steps.seconds + seconds
        steps.iterations += step.iterations
        steps.factorisations += step.factorisations
        steps.met += step.status is Status.CONVERGED
        told(
            f"{name}: step {steps.made} of {wanted}, {seconds:.1f} s, {step.iterations} iterations, {step.status.value}"
        )
    return steps


def told(line: str) -> None:
    print(line, file=sys.stderr, flush=True)


def measure(name: str, options: argparse.Namespace) -> str:
    """One row of the table."""
    energy = sheet_of(name, options.size)
    sheet, x = energy.sheet, energy.start()
    told(f"{name}: {sheet.vertex_count} vertices, {len(energy.springs)} springs of glue")
    hessian, analysis, factor = parts(energy)
    scene = scene_of(sheet, options.scene)
    energy.count_passages()
    friction = YarnFriction(options.friction) if options.friction else None
    settings = MotionSettings(scene.gravity, DAMPING, friction, iterations=options.iterations)
    around = scene.holds, scene.pushes(energy)
    dynamics = FabricDynamics(energy, settings, *around)
    # Borders that were just glued snap together; that is no part of the scene.
    rest = rod_equilibrium(energy, x, scene.holds(0.0), tolerance=1e-2, max_iterations=SETTLING)
    told(f"{name}: borders at rest after {rest.iterations} iterations, {rest.seconds:.1f} s")
    steps = run(name, dynamics, FabricMotion(rest.x, 0.0 * rest.x), options)
    stable = dynamics.stable_step(steps.motion)
    led = FabricDynamics(energy, replace(settings, method="explicit"), *around)
    explicit, _ = timed(lambda: led.step(steps.motion, stable))
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20
    each, cloth = steps.seconds / steps.made, cloth_seconds(name, options)
    frame = each * FRAME / options.time_step
    return (
        f"{name:18s} {sheet.vertex_count:8d} {hessian:7.2f} {analysis:8.2f} {factor:6.2f} {memory:5.1f} {each:7.1f} "
        f"{steps.processor / steps.made:6.1f} {steps.iterations / steps.made:6.1f} "
        f"{steps.factorisations / steps.made:7.1f} {steps.met:4d}/{steps.made:<4d} {frame:8.1f} "
        f"{explicit / stable * FRAME:8.0f} {cloth:8.2f} {frame / cloth:6.0f} {energy.passage_count:5d}"
    )


HEAD = (
    "pattern            vertices Hessian analysis factor    GB  a step    CPU Newton factors  met    s/frame explicit"
    "    cloth  ratio passages"
)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("patterns", nargs="*", default=PATTERNS)
    parser.add_argument("--size", type=float, default=0.1, help="edge of the sheet [m]")
    parser.add_argument("--frames", type=float, default=1.0, help="frames of 1/30 s to run")
    parser.add_argument("--time-step", type=float, default=1 / 240, help="of implicit steps [s]")
    parser.add_argument("--iterations", type=int, default=30, help="most Newton iterations of a step")
    parser.add_argument("--friction", type=float, default=0.0, help="of yarns on each other")
    parser.add_argument("--limit", type=float, default=600.0, help="seconds of steps a pattern may take")
    parser.add_argument("--scene", choices=("stretch", "drape"), default="stretch")
    parser.add_argument("--materials", type=Path, help="folder of homogenized materials")
    options = parser.parse_args()
    print(HEAD, flush=True)
    with ProcessPoolExecutor(1, mp_context=get_context("spawn"), max_tasks_per_child=1) as pool:
        for name in options.patterns:
            print(pool.submit(measure, name, options).result(), flush=True)


if __name__ == "__main__":
    main()
