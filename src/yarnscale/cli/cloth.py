"""Commands that simulate cloth: ``stretch``, ``drape``, ``simulate``."""

from __future__ import annotations

import argparse
import hashlib
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

from yarnscale.cli.console import ProgressLine, outcome_lines, report, show_notices
from yarnscale.cli.values import refuse
from yarnscale.errors import InputError, misspelt
from yarnscale.files.checkpoint_file import NAME as CHECKPOINT
from yarnscale.files.material_json import read_material, write_material
from yarnscale.files.run_folder import PAGE, RunFolder
from yarnscale.files.scene_run import checkpoint, run
from yarnscale.motion.unfulfilled import sentences
from yarnscale.shell.materials.material import ShellMaterial
from yarnscale.shell.scenes.scene import Scene, SceneResult
from yarnscale.shell.scenes.scene import drape as drape_scene
from yarnscale.shell.scenes.scene import stretch as stretch_scene
from yarnscale.shell.state import ClothState

MATERIAL = "cloth_material.json"
"""In the folder of a run: the shell material of its cloth."""
MAKES = ("frames/frame_*.npz", "frames/mesh.npz", "frames/bodies.npz", CHECKPOINT, MATERIAL, *PAGE)
"""All that a run writes, but for converted frames."""
GOES_ON_FROM = ("frames/*.npz", CHECKPOINT)


def stretch(options: argparse.Namespace) -> int:
    """Stretch a sheet between two bars."""
    material = read_material(options.material)
    if (options.amount is None) == (options.travel is None):
        found = "neither" if options.amount is None else "both"
        raise InputError("displacement of the bars", expected="--amount or --travel", found=found)
    given = {name: getattr(options, name) for name in ("amount", "travel", "duration", "air_drag", "spacing")}
    given = {name: value for name, value in given.items() if value is not None}
    return _run(stretch_scene(material, direction=options.direction, frame_interval=0.1, **given), options)


def drape(options: argparse.Namespace) -> int:
    """Drape a sheet over a sphere."""
    given = {} if options.spacing is None else {"spacing": options.spacing}
    return _run(drape_scene(read_material(options.material), frame_interval=0.1, **given), options)


def simulate(options: argparse.Namespace) -> int:
    """Simulate a scene file or a ready scene."""
    return _run(_scene(options), options)


def _scene(options: argparse.Namespace) -> Scene:
    from yarnscale.files.scene_toml import read_scene
    from yarnscale.shell.scenes.plausible import sizes_line
    from yarnscale.shell.scenes.ready import READY, ready_scene

    if options.scene in READY:
        if options.shell is None:
            expected = "--shell, a name of the library or a file"
            raise InputError("ready scene", where=options.scene, expected=expected, found="none")
        scene = ready_scene(options.scene, read_material(options.shell), spacing=options.spacing)
        return replace(scene, notices=(sizes_line(scene.cloth),))
    if not Path(options.scene).exists():
        expected = "a scene file or one of " + ", ".join(READY)
        raise InputError("no such scene", expected=expected, found=misspelt(options.scene, READY))
    refuse(options, ("shell", "spacing"), "it in the scene file")
    return read_scene(options.scene)


def _run(scene: Scene, options: argparse.Namespace) -> int:
    from yarnscale.cli.convert import NAMES, made_by, require, write
    from yarnscale.files.animation import read_animation

    for kind in options.format:
        require(kind)
    scene = replace(scene, notices=(*scene.notices, *_notes(scene)))
    if options.animation:
        scene = replace(scene, schedule=scene.schedule.animated())
    makes = [*MAKES, *(name for kind in options.format for name in made_by(kind, NAMES[kind]))]
    results = RunFolder(
        options.out, "cloth", makes, overwrite=options.overwrite, resume=options.resume,
        goes_on_from=GOES_ON_FROM, valued=("frames/frame_*.npz",),
    )  # fmt: skip
    if options.resume:
        checkpoint(options.out, ClothState, scene.settings).read()
    with results as folder:
        show_notices(scene.notices)
        result = simulate_into(scene, folder, resume=options.resume)
        for kind in options.format:
            write(read_animation(folder / "frames"), kind, folder / NAMES[kind])
    digest = hashlib.sha256((folder / MATERIAL).read_bytes()).hexdigest()
    summary = result.summary() | {"material_hash": digest}
    lines = outcome_lines(_flat(summary), _unfulfilled(result))
    report(options, summary, *lines, f"{folder}: frames, pictures and a page")
    return 0 if result.succeeded else 1


def _flat(summary: Mapping[str, object]) -> dict[str, object]:
    """A summary with one entry for every share out of range, none where they are not known."""
    shares = summary.get("out_of_range")
    rest = {name: value for name, value in summary.items() if name != "out_of_range"}
    if isinstance(shares, Mapping):
        rest |= {f"out_of_range {name}": value for name, value in shares.items()}
    return rest


def _notes(scene: Scene) -> list[str]:
    """Which surfaces can touch, and so are tested for crossings; motions that continue beyond the end."""
    contact, obstacles = scene.cloth.contact, bool(scene.cloth.obstacles)
    if contact is not None and contact.self_contact:
        thick = f"{1e3 * contact.thickness:.3g} mm"
        notes = [f"the cloth meets itself{' and obstacles' * obstacles}, from a thickness of {thick}"]
    elif contact is not None and obstacles:
        notes = ["the cloth meets obstacles but not itself: crossings of the cloth with itself are not tested"]
    else:
        notes = ["nothing may touch, so crossings are not tested ([contact] in a scene file)"]
    end = scene.start.time + scene.schedule.duration
    for name, motion in scene.cloth.motions():
        if motion.moves and motion.end > end + 1e-9:
            notes.append(f"{name} moves until {motion.end:.4g} s, and the run ends at {end:.4g} s")
    return notes


def _unfulfilled(result: SceneResult) -> list[str]:
    given = result.scene.may_give_way
    return sentences(result.unfulfilled, "as the scene allows" if given else "may_give_way = true in a scene allows it")


def simulate_into(scene: Scene, folder: Path, *, resume: bool = False) -> SceneResult:
    """Run a scene, or continue a run; frames are written as they finish, pictures and numbers at the end."""
    from yarnscale.show.run_page import write_run_page

    if isinstance(scene.cloth.material, ShellMaterial):
        write_material(folder / MATERIAL, scene.cloth.material)
    result = run(scene, folder, resume=resume, on_step=ProgressLine(scene.name).show_step)
    notes = [*(f"Note: {notice}." for notice in scene.notices), *_unfulfilled(result)]
    numbers = _flat(result.summary())
    title, frames, material = f"Cloth: {scene.name}", folder / "frames", scene.cloth.material
    write_run_page(folder, title, result.run, numbers, frames=frames, text=notes, material=material)
    return result
