"""A sweater of 20 000 triangles on a body that moves: time a frame, memory, and that nothing ever crosses.

    python benchmarks/sweater.py [--material M.json] [--triangles 20000] [--frames 60] [--picture FILE.png]

Prints a line per frame and a summary. Without a material file it takes a jersey-like orthotropic one. Every frame is
tested as a whole for crossings of the cloth with itself and with the body. Times are those of the machine as it is.
"""

from __future__ import annotations

import argparse
import math
import resource
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from yarnscale.files.body_surface import BodySurface
from yarnscale.files.material_json import read_material
from yarnscale.motion.run import RunProgress, simulate
from yarnscale.shell.dynamics.solver import ClothSolver
from yarnscale.shell.materials.material import ShellMaterial
from yarnscale.shell.materials.orthotropic import JERSEY
from yarnscale.shell.scenes.body_scenes import FRAME, sweater
from yarnscale.shell.scenes.scene import Scene
from yarnscale.shell.state import ClothState


def main() -> None:
    """Run it as the command line says."""
    parser = argparse.ArgumentParser(description="A large sweater on a body that moves.")
    parser.add_argument("--material", type=Path, help="shell material file")
    parser.add_argument("--triangles", type=int, default=20_000)
    parser.add_argument("--frames", type=int, default=60)
    parser.add_argument("--picture", type=Path, help="contact sheet to draw")
    options = parser.parse_args()
    material: ShellMaterial = read_material(options.material) if options.material else JERSEY
    scene = sized(material, options.triangles)
    scene = replace(scene, schedule=replace(scene.schedule, duration=options.frames * FRAME))
    states = run(scene)
    if options.picture:
        draw(scene, states, options.picture)


def sized(material: ShellMaterial, triangles: int) -> Scene:
    """The scene with at least so many triangles."""
    spacing = 0.01 * math.sqrt(21_000 / triangles)
    while True:
        scene = sweater(material, spacing=spacing)
        if len(scene.cloth.mesh.triangles) >= triangles:
            return scene
        spacing *= 0.99


def run(scene: Scene) -> list[ClothState]:
    """Simulate and print; the frames."""
    mesh, body = scene.cloth.mesh, scene.cloth.obstacles[0]
    print(f"{len(mesh.triangles)} triangles, {mesh.vertex_count} vertices; body {len(body.points(0.0))} vertices")
    solver = ClothSolver(scene.cloth, scene.options)
    states: list[ClothState] = []
    seconds: list[float] = []
    iterations: list[int] = []
    crossings, began = 0, time.perf_counter()

    def on_step(progress: RunProgress) -> None:
        iterations.append(progress.iterations)

    def on_frame(number: int, state: ClothState) -> None:
        nonlocal began, crossings
        spent = time.perf_counter() - began
        crosses = solver.intersects(state)
        crossings += crosses
        if number:
            seconds.append(spent)
        print(
            f"frame {number:3d} at {state.time:.3f} s: {spent:6.2f} s, closest {1e3 * solver.closest(state):.3f} mm"
            + (", CROSSES" if crosses else ""),
            flush=True,
        )
        states.append(state)
        began = time.perf_counter()

    result = simulate(solver, scene.start, scene.schedule, on_step=on_step, on_frame=on_frame)
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    print(
        f"{result.outcome}; {len(states)} frames, {crossings} with crossings; a frame takes "
        f"{np.mean(seconds):.1f} s (median {np.median(seconds):.1f}, longest {max(seconds):.1f}); "
        f"{np.mean(iterations):.1f} Newton iterations a step, {result.loose_steps} of {result.steps} steps loose; "
        f"peak memory {memory:.0f} MB"
    )
    return states


def draw(scene: Scene, states: list[ClothState], path: Path) -> None:
    """Eight moments side by side."""
    from yarnscale.files.animation import Animation, Moment, Surface
    from yarnscale.show.run_page import frames_picture

    bodies = BodySurface(scene.cloth.obstacles)
    chosen = [states[round(k)] for k in np.linspace(0, len(states) - 1, min(8, len(states)))]

    def moment(index: int) -> Moment:
        state = chosen[index]
        body = bodies.vertices(state.time, state.obstacles)
        return Moment(state.time, cloth=state.positions, bodies=body)

    times = np.array([state.time for state in chosen])
    drawn = Animation(times, moment, Surface(scene.cloth.mesh.triangles), bodies=Surface(bodies.triangles))
    frames_picture(path, drawn, columns=4, camera=(0.5, -2.0, 0.4))


if __name__ == "__main__":
    main()
