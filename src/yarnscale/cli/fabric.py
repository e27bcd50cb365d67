"""The command ``fabric``: finite fabrics, yarn by yarn or in a bounding volume."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

from yarnscale.cli import convert
from yarnscale.cli.console import ProgressLine, outcome_lines, print_status, report
from yarnscale.cli.fabric_models import check_comparison, compare_models
from yarnscale.cli.fabric_options import IN_SCENE_FILES, OF_SCENES, ONLY_RODS, SCENES, SHAPING
from yarnscale.cli.given_pattern import pattern_of, settled_drawing
from yarnscale.cli.values import refuse
from yarnscale.cli.yarn_choice import YarnChoice, yarn_for
from yarnscale.detail.yarn_sheet import rods_on_mesh
from yarnscale.errors import InputError, misspelt
from yarnscale.fabric.direct_motion import FabricMotion
from yarnscale.fabric.fabric_scene import USUAL_STEP, FabricResult, FabricScene, fabric_schedule
from yarnscale.fabric.rod_fabric import RodFabric
from yarnscale.fabric.rod_scene import USUAL_FRICTION, RodScene, rod_counts
from yarnscale.fabric.sheet import YarnSheet
from yarnscale.fabric.sheet_scene import PlannedScene, SheetScene, drape, hang, stretch
from yarnscale.fabric.spline_knit import JERSEYS, SplineFabric, jersey, spline_fabric
from yarnscale.fabric.spline_motion import YarnMotion
from yarnscale.fabric.spline_points import SplinePoints
from yarnscale.fabric.spline_scene import SplineScene, reduction_for
from yarnscale.fabric.volume import BoundingVolume
from yarnscale.fabric.volume_rows import spline_counts
from yarnscale.files.animation import read_animation
from yarnscale.files.fabric_scene import read_fabric_scene
from yarnscale.files.material_toml import read_yarn_material
from yarnscale.files.obj_garment import read_garment
from yarnscale.files.patterns import is_drawing, stitches_of
from yarnscale.files.run_folder import PAGE, RunFolder
from yarnscale.files.scene_run import MAKES, checkpoint, run
from yarnscale.files.source_text import read_source
from yarnscale.motion.unfulfilled import sentences
from yarnscale.yarn.material import YarnMaterial
from yarnscale.yarn.pattern import YarnPattern

_FILES = {"gltf": "fabric.glb", "usd": "fabric.usdc", "mp4": "fabric.mp4"}


def fabric(options: argparse.Namespace) -> int:
    """Simulate a finite fabric, or count its unknowns."""
    if not options.count and options.out is None:
        raise InputError("--out", expected="a folder for frames and pictures", found="none")
    for kind in options.format:
        convert.require(kind)
    _check_sizes(options)
    if options.method == "compare":
        check_comparison(options)
        return compare_models(options, _spline_yarns(options)[0])
    if options.scene == "imposed":
        raise InputError("--scene imposed", expected="--method compare", found=options.method)
    options.model = _model(options)
    return (_splines if options.model == "splines" else _rods)(options)


def _check_sizes(options: argparse.Namespace) -> None:
    for name in ("rows", "columns"):
        given = getattr(options, name)
        if options.on is None and given is None:
            raise InputError(f"--{name}", expected="a whole number from 2 to 1000", found="none")
    if options.on is not None:
        refuse(options, ("rows", "columns"), "none, as a mesh has its own size")
    if options.adaptive and options.method != "volume":
        raise InputError("--adaptive", expected="--method volume", found=options.method)
    if options.reduction is not None and options.method != "volume":
        raise InputError("--reduction", expected="--method volume", found=options.method)
    for name in ("adaptive", "explicit"):
        if getattr(options, name) and options.reduction == "homogenized":
            raise InputError(f"--{name}", expected="--reduction published", found="homogenized")


def _model(options: argparse.Namespace) -> str:
    """Of the yarns: ``rods`` or ``splines``. InputError for options that it does not have."""
    model = {"direct": "rods", "splines": "splines"}.get(options.method)
    if model is None:
        hanging_jersey = options.pattern in JERSEYS and options.scene == "hang"
        model = options.model or ("splines" if hanging_jersey else "rods")
        other = "rods" if model == "splines" else "splines"
        chosen = "" if options.model else f" (--model {other} takes {other})"
        print_status(f"yarns in the volume: {model}{chosen}")
        if model == "rods":
            refuse(options, ("adaptive", "explicit"), "--model splines, or --method direct")
            if options.reduction == "homogenized":
                raise InputError("--reduction of rods in a volume", expected="published", found="homogenized")
    elif options.model not in (None, model):
        raise InputError("--model", expected=f"--method volume, or {model} with {options.method}", found=options.model)
    return model


def _method(options: argparse.Namespace) -> dict[str, Any]:
    """Arguments of every scene."""
    return {
        "schedule": fabric_schedule(options.duration, options.time_step), "damping": options.damping,
        "method": "explicit" if options.explicit else "implicit", "integrator": options.integrator,
        "may_give_way": options.may_give_way,
    }  # fmt: skip


def _timed(method: dict[str, Any], plan: PlannedScene | None) -> dict[str, Any]:
    """Arguments of a scene, as its file has them if there is one."""
    if plan is None:
        return method
    allowed = plan.may_give_way or method["may_give_way"]
    return method | {"schedule": plan.schedule, "damping": plan.damping, "may_give_way": allowed}


# --- splines ------------------------------------------------------------------------------------------


def _splines(options: argparse.Namespace) -> int:
    refuse(options, ONLY_RODS, "--method direct")
    plan = _planned(options)
    if options.scene != "hang":
        refuse(options, ("explicit",), "--scene hang")
    knitted, yarn = _spline_yarns(options)
    knitted = knitted if options.scene == "hang" else knitted.unclosed()
    volume = BoundingVolume.around(knitted.control, options.volume) if options.method == "volume" else None
    method = _method(options)
    reduction = reduction_for(options.reduction, method["method"], options.adaptive)
    if options.count:
        held = knitted.top if options.scene == "hang" else None
        return _counted(options, spline_counts(knitted, volume, reduction, held))

    def scene() -> SplineScene:
        settings = _timed(method, plan) | {"volume": volume, "reduction": reduction, "adaptive": options.adaptive}
        if plan is not None:
            return SplineScene.in_place(knitted, plan, **settings)
        loads = None if options.scene == "hang" else _loads(options, SplinePoints(knitted).sheet)
        return SplineScene(knitted, loads, **settings)

    return _simulated(options, YarnMotion, scene, pattern=knitted.control, yarn=yarn, file=plan)


def _spline_yarns(options: argparse.Namespace) -> tuple[SplineFabric, YarnMaterial]:
    if len(options.material or ()) > 1:
        raise InputError("--material", expected="one, or --method direct", found=len(options.material))
    material = read_yarn_material(options.material[0] if options.material else "wool")
    origin = "--material" if options.material else "default of spline yarns"
    YarnChoice(options.pattern, material, origin).print_status()
    size = options.rows, options.columns
    if options.pattern in JERSEYS:
        radius = 1e-3 if options.radius is None else options.radius
        return jersey(*size, material, radius=radius), material
    chart = stitches_of(options.pattern)
    if chart is None:
        expected = "for spline yarns jersey, a built-in knit, a .chart or .k file"
        raise InputError("pattern", expected=expected, found=repr(options.pattern))
    return spline_fabric(pattern_of(options.pattern, options.radius), chart, *size, material), material


# --- rods ---------------------------------------------------------------------------------------------


def _rods(options: argparse.Namespace) -> int:
    pattern = pattern_of(options.pattern, options.radius)
    yarn = yarn_for(options.pattern, pattern, options.material)
    yarn.print_status()
    plan = _planned(options)

    if options.count:
        sheet = _laid(options, pattern, yarn).sheet
        return _counted(options, rod_counts(sheet, _volume(options, sheet)))

    def scene() -> RodScene:
        fabric, method = _laid(options, pattern, yarn), _timed(_method(options), plan)
        if plan is not None:
            fabric = replace(fabric, sheet=plan.laid(fabric.sheet))
        loads = _loads(options, fabric.sheet) if plan is None else plan.of(fabric.sheet)
        friction = options.friction if options.friction is not None else yarn.friction
        friction = USUAL_FRICTION if friction is None else friction
        return RodScene(fabric, loads, friction=friction, volume=_volume(options, fabric.sheet), **method)

    mesh = None if options.on is None else read_source(options.on, any_encoding=True)
    parts = {"pattern": pattern, "yarn": yarn.materials, "mesh": mesh, "file": plan}
    return _simulated(options, FabricMotion, scene, **parts)


def _laid(options: argparse.Namespace, pattern: YarnPattern, yarn: YarnChoice) -> RodFabric:
    """The fabric of the options; drawings are brought to rest before they are cut, unless ``--as-drawn``."""
    relax, material = not options.count, yarn.materials
    if options.border == "knitted" and (options.tube or options.on is not None):
        raise InputError("--border knitted", expected="a flat piece", found="--tube or --on")
    if options.tube and options.on is not None:
        raise InputError("--tube", expected="a sheet of --rows and --columns", found="--on")
    if options.border == "knitted":
        size, chart = (options.columns, options.rows), stitches_of(options.pattern)
        return RodFabric.knitted(pattern, material, *size, chart=chart, relax=relax)
    if is_drawing(options.pattern) and relax and not options.as_drawn:
        pattern = settled_drawing(pattern, material)
    if options.on is not None:
        mesh = read_garment(options.on, unit=options.unit, weld=options.weld)
        return rods_on_mesh(pattern, material, mesh, relax=relax)
    make = RodFabric.tube if options.tube else RodFabric.cut
    return make(pattern, material, options.columns, options.rows, relax=relax)


def _planned(options: argparse.Namespace) -> PlannedScene | None:
    """The scene file, if any. InputError for options that it replaces."""
    if options.scene in SCENES:
        for scene, names in OF_SCENES.items():
            if options.scene != scene:
                refuse(options, names, f"--scene {scene} with it")
        return None
    if not Path(options.scene).is_file():
        expected = "a scene file or " + ", ".join(SCENES)
        raise InputError("--scene", expected=expected, found=misspelt(options.scene, SCENES))
    refuse(options, IN_SCENE_FILES, "it in the scene file")
    return read_fabric_scene(options.scene)


def _loads(options: argparse.Namespace, sheet: YarnSheet) -> SheetScene:
    if options.scene == "stretch":
        axis = 0 if options.direction == "course" else 1
        return stretch(sheet, amount=options.amount, axis=axis, duration=options.duration)
    return drape(sheet, friction=options.ball_friction) if options.scene == "drape" else hang(sheet)


def _volume(options: argparse.Namespace, sheet: YarnSheet) -> BoundingVolume | None:
    return BoundingVolume.around(sheet.vertices, options.volume) if options.method == "volume" else None


# --- results ------------------------------------------------------------------------------------------


def _simulated(options: argparse.Namespace, kind: type, scene: Callable[[], FabricScene[Any]], **parts: object) -> int:
    """Run a scene into the folder of results; parts: contents of files and names in the options, for the checkpoint."""
    settings = {f"--{name.replace('_', '-')}": getattr(options, name) for name in SHAPING} | parts
    formats = [name for made in options.format for name in convert.made_by(made, _name(made))]
    results = RunFolder(
        options.out, "fabric", [*MAKES, *PAGE, *formats], overwrite=options.overwrite, resume=options.resume,
        goes_on_from=MAKES,
    )  # fmt: skip
    if options.resume:
        checkpoint(options.out, kind, settings).read()
    made = scene()
    with results as folder:
        result = run(made, folder, resume=options.resume, settings=settings, on_step=ProgressLine("fabric").show_step)
        numbers: dict[str, object] = {
            "method": options.method, "model": options.model, **result.summary(),
        }  # fmt: skip
        # Without gravity nothing falls.
        shown = {name: value for name, value in numbers.items() if value is not None}
        said = sentences(result.run.unfulfilled, "--may-give-way allows it")
        long = _long_steps(options, made)
        for sentence in long:
            print_status(sentence)
        _write_page(folder, options, result, shown, [*said, *long])
        for format_ in options.format:
            convert.write(read_animation(folder), format_, folder / _name(format_))
    report(options, numbers, *outcome_lines(shown, said), f"{folder}: frames, pictures and a page")
    return 0 if result.succeeded else 1


def _long_steps(options: argparse.Namespace, made: FabricScene[Any]) -> list[str]:
    """A sentence on steps in which Newton's method ends before light fabric has moved as far as it would."""
    schedule, other = made.schedule, options.method != "direct" or options.explicit
    if other or not schedule.duration or schedule.time_step <= 1.001 * USUAL_STEP:
        return []
    return [
        f"steps of {schedule.time_step:.3g} s are longer than {USUAL_STEP:.3g} s: light, soft fabric falls too "
        "slowly in them (half as far in 0.0167 s); take a shorter --time-step for motion"
    ]


def _write_page(
    folder: Path, options: argparse.Namespace, result: FabricResult[Any], numbers: dict[str, object],
    text: list[str],
) -> None:  # fmt: skip
    from yarnscale.show.run_page import write_run_page

    # Horizontal fabric is seen obliquely, other fabric from the front.
    gravity = result.scene.gravity
    level = abs(gravity[2]) > abs(gravity[1])
    write_run_page(
        folder, f"Fabric: {options.pattern}, {Path(options.scene).stem}", result.run, numbers, frames=folder,
        text=text, camera="oblique" if level else (0.0, -0.5, 1.0),
    )  # fmt: skip


def _counted(options: argparse.Namespace, counts: dict[str, int]) -> int:
    report(options, counts, *outcome_lines(counts))
    return 0


def _name(kind: str) -> str:
    """File or folder of a format within that of the fabric."""
    return _FILES.get(kind, kind)
