"""Commands that simulate cloth: ``stretch``, ``drape``, ``simulate``."""

from __future__ import annotations

import argparse
import time
from pathlib import Path

import numpy as np

from yarnscale.cli.console import ProgressLine, print_json, writable_folder
from yarnscale.files.atomic import write_text
from yarnscale.files.cloth_frames import FrameFolder
from yarnscale.files.material_json import read_material
from yarnscale.shell.scene import Scene, SceneResult, run_scene
from yarnscale.shell.scene import drape as drape_scene
from yarnscale.shell.scene import stretch as stretch_scene
from yarnscale.shell.simulate import Progress
from yarnscale.shell.state import ClothState

FRAMES = 6
"""Moments that a contact sheet shows."""


def stretch(options: argparse.Namespace) -> int:
    """Stretch a sheet between two bars."""
    material = read_material(options.material)
    scene = stretch_scene(material, direction=options.direction, amount=options.amount, frame_interval=0.1)
    return _run(scene, options)


def drape(options: argparse.Namespace) -> int:
    """Drape a sheet over a sphere."""
    return _run(drape_scene(read_material(options.material), frame_interval=0.1), options)


def simulate(options: argparse.Namespace) -> int:
    """Simulate a scene file."""
    from yarnscale.files.scene_toml import read_scene

    return _run(read_scene(options.scene), options)


def _run(scene: Scene, options: argparse.Namespace) -> int:
    folder = writable_folder(options.out)
    result = simulate_into(scene, folder)
    summary = result.summary()
    if options.json:
        print_json(summary)
    else:
        for name, value in summary.items():
            print(f"{name:<18} {value:.6g}" if isinstance(value, float) else f"{name:<18} {value}")
        print(f"{folder}: frames and pictures")
    return 0 if result.converged else 1


def simulate_into(scene: Scene, folder: Path) -> SceneResult:
    """Run a scene; frames are written as they finish, pictures and numbers at the end."""
    from yarnscale.files.obj import obj_text

    frames = FrameFolder(folder / "frames", scene.cloth.mesh)
    line = ProgressLine(scene.name)
    kept: list[ClothState] = []
    triangles = scene.cloth.mesh.triangles

    def on_frame(number: int, state: ClothState) -> None:
        frames.write(number, state)
        kept.append(state)

    began = time.perf_counter()

    def on_step(progress: Progress) -> None:
        seconds = time.perf_counter() - began
        left = seconds / progress.share - seconds if progress.share > 0 else float("nan")
        line.show(round(100 * progress.share), 100, seconds, left, f"{progress.iterations} iterations")

    result = run_scene(scene, on_step=on_step, on_frame=on_frame)
    mesh = scene.cloth.mesh
    write_text(folder / "last.obj", obj_text(result.state.positions, triangles, mesh.material, mesh.corners))
    draw_cloth(scene, kept, folder)
    return result


def draw_cloth(scene: Scene, states: list[ClothState], folder: Path) -> list[Path]:
    """A contact sheet of moments and a large picture of the last one."""
    from yarnscale.shell.obstacles import Sphere
    from yarnscale.show.cloth import ClothFrame, Solid, cloth_picture, contact_sheet

    solids = [
        Solid.sphere(obstacle.centre, obstacle.radius)
        for obstacle in scene.cloth.obstacles
        if isinstance(obstacle, Sphere)
    ]
    chosen = [states[round(i)] for i in np.linspace(0, len(states) - 1, min(FRAMES, len(states)))]
    frames = [ClothFrame(s.positions, solids=solids, title=f"{s.time:.2f} s") for s in chosen]
    triangles = scene.cloth.mesh.triangles
    paths = [folder / "frames.png", folder / "last.png"]
    contact_sheet(paths[0], triangles, frames, columns=3)
    cloth_picture(paths[1], triangles, ClothFrame(chosen[-1].positions, solids=solids))
    return paths
