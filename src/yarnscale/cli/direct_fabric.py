"""The command ``fabric`` for yarns that are elastic rods: every one by itself, or all of them in a bounding volume."""

from __future__ import annotations

import argparse
from contextlib import AbstractContextManager
from pathlib import Path

import numpy as np

from yarnscale.cell import PeriodicCell
from yarnscale.cli.fabric_options import IN_SCENE_FILES, SCENES
from yarnscale.cli.fabric_run import FabricRun
from yarnscale.cli.yarn_choice import yarn_for
from yarnscale.cli.yarns import pattern_of, settled_drawing
from yarnscale.detail.yarn_sheet import sheet_on_mesh
from yarnscale.errors import InputError
from yarnscale.fabric.boundary import SEWN, SEWN_WIDTH, Springs, glue
from yarnscale.fabric.direct_energy import FabricEnergy
from yarnscale.fabric.direct_motion import FabricDynamics, FabricMotion, MotionSettings
from yarnscale.fabric.direct_moves import PassageCount
from yarnscale.fabric.direct_static import eased
from yarnscale.fabric.knitted_sheet import knitted_sheet, woven_in
from yarnscale.fabric.rod_volume import RodVolume, VolumeDynamics
from yarnscale.fabric.sheet import YarnSheet
from yarnscale.fabric.sheet_scene import PlannedScene, SheetScene, drape, hang, stretch
from yarnscale.fabric.yarn_friction import YarnFriction
from yarnscale.files.curve_frames import CurveSet
from yarnscale.files.fabric_scene import read_fabric_scene
from yarnscale.files.obj_garment import read_garment
from yarnscale.files.patterns import is_drawing, stitches_of
from yarnscale.motion.run import Run
from yarnscale.yarn.material import YarnMaterial
from yarnscale.yarn.pattern import YarnPattern
from yarnscale.yarn.stiffness import Materials, materials_of

USUAL_FRICTION = 0.1
"""Of yarns on each other: with none cut yarns draw back and weaves come apart, with 0.3 fabric creeps and hardly curls
(docs/validation/fabric.md)."""
Laid = tuple[YarnSheet, Materials, Springs]
"""A sheet, its materials, and what keeps its borders."""


def sheet_at_rest(options: argparse.Namespace, pattern: YarnPattern, material: Materials) -> Laid:
    """The sheet asked for, its materials, and what keeps its borders.

    Loops of a cut sheet are those of the periodic cell at rest; drawings settle first, unless they shall stay as drawn.
    A knitted piece has come to ease as it was drawn.
    """
    if options.border == "knitted":
        if options.tube or options.on is not None:
            raise InputError("--border knitted", expected="a flat piece", found="--tube or --on")
        return _knitted(options, pattern, material)
    if is_drawing(options.pattern) and not (options.as_drawn or options.count):
        pattern = settled_drawing(pattern, material)
    if options.on is not None:
        if options.tube:
            raise InputError("--tube", expected="a sheet of --rows and --columns", found="--on")
        return _on_mesh(options, pattern, material)
    return _tube(options, pattern, material) if options.tube else _cut(options, pattern, material)


def _knitted(options: argparse.Namespace, pattern: YarnPattern, material: Materials) -> Laid:
    piece = knitted_sheet(pattern, options.columns, options.rows, chart=stitches_of(options.pattern))
    return _at_ease(options, piece, material, woven_in(piece, materials_of(pattern, material)[0]))


def _tube(options: argparse.Namespace, pattern: YarnPattern, material: Materials) -> Laid:
    tube = YarnSheet.of(pattern, options.columns, options.rows, tube=True)
    return _at_ease(options, tube, material, _ring_glue(tube, materials_of(pattern, material)[0]))


def _at_ease(options: argparse.Namespace, drawn: YarnSheet, material: Materials, borders: Springs) -> Laid:
    """What no cell has the shape of comes to ease by itself."""
    if options.count:
        return drawn, material, borders
    return eased(FabricEnergy(drawn, material, springs=borders)), material, borders


def _on_mesh(options: argparse.Namespace, pattern: YarnPattern, material: Materials) -> Laid:
    mesh = read_garment(options.on, unit=options.unit, weld=options.weld)
    state = None if options.count else PeriodicCell(pattern, material).relax()
    laid = sheet_on_mesh(pattern, mesh, state=state)
    first = materials_of(pattern, material)[0]
    # Seams are among the borders, and what is sewn holds firmly.
    springs = glue(
        laid.sheet, first, width=SEWN_WIDTH * pattern.radius, stiffness=SEWN, distance=laid.border_distance,
        normals=laid.normals,
    )  # fmt: skip
    return laid.sheet, material, springs


def _cut(options: argparse.Namespace, pattern: YarnPattern, material: Materials) -> Laid:
    sheet = YarnSheet.of(pattern, options.columns, options.rows)
    if options.count:
        return sheet, material, Springs.none()
    cell = PeriodicCell(pattern, material)
    state = cell.relax()
    sheet = sheet.moved(cell.placement(state)(sheet.source, sheet.tile), twist=state.twist[sheet.source])
    return sheet, material, glue(sheet, materials_of(pattern, material)[0])


def _ring_glue(tube: YarnSheet, material: YarnMaterial) -> Springs:
    """Glue along both open ends of a tube around the y axis."""
    place = tube.vertices[:, 1]
    normals = tube.vertices * [1.0, 0.0, 1.0]
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    return glue(
        tube, material, distance=np.minimum(place - place.min(), place.max() - place), normals=normals
    )


def simulate_direct(
    options: argparse.Namespace, results: AbstractContextManager[Path | None]
) -> tuple[dict[str, object], Run[FabricMotion] | None]:
    """Run the scene, into the folder of results, or count unknowns; numbers, and the run."""
    pattern = pattern_of(options.pattern, options.radius)
    yarn = yarn_for(options.pattern, pattern, options.material)
    yarn.say()
    about, file = None, scene_file(options)
    if not options.count:
        mesh = None if options.on is None else options.on.read_text(errors="replace")
        about = FabricRun(
            options, results, FabricMotion, pattern=pattern, yarn=yarn.materials, mesh=mesh, file=file
        )
    sheet, material, borders = sheet_at_rest(options, pattern, yarn.materials)
    counts: dict[str, object] = {
        "vertices": sheet.vertex_count,
        "yarns": len(sheet.closed),
        "dofs": sheet.unknowns,
        "unknowns": sheet.unknowns,
        "constraints": 0,
    }
    if options.method == "volume":
        counts["reduced_unknowns"] = 6 * options.volume[0] * options.volume[1]
    if about is None:
        return counts, None
    if file is not None:
        sheet = file.laid(sheet)
        options.may_give_way |= file.may_give_way
    energy = FabricEnergy(sheet, material, springs=borders)
    scene, dynamics = _moving(options, energy, file)
    # A colour for every yarn of the sheet, in a knitted piece for every kind of yarn.
    colour = sheet.yarn_material if options.border == "knitted" else None
    curves = CurveSet(sheet.offsets, sheet.yarn_radii, closed=sheet.closed, yarn=colour)
    run = about.simulate(
        dynamics,
        dynamics.start(),
        curves,
        lambda state: energy.positions(state.x) * sheet.radius,
        obstacles=scene.obstacles,
        schedule=None if file is None else file.schedule,
    )
    dynamics.take_up(run.state)
    x, passed = run.state.x, dynamics.count
    numbers = {
        **counts,
        **run.summary(),
        "seconds": about.seconds,
        "penetration": energy.penetration(x),
        "extension": float(np.abs(energy.extensions(x)).max()),
        "passages": 0 if passed is None else passed.passages,
    }
    if scene.pulled is not None:
        numbers["force"] = scene.force(energy, x, run.state.time, led=options.explicit)
    return numbers, run


def scene_file(options: argparse.Namespace) -> PlannedScene | None:
    """The scene file asked for, if any; what it says cannot be said by options too."""
    if options.scene in SCENES:
        return None
    if not Path(options.scene).is_file():
        expected = "a scene file or " + ", ".join(SCENES)
        raise InputError("--scene", expected=expected, found=repr(options.scene))
    for name, usual in IN_SCENE_FILES.items():
        if getattr(options, name) != usual:
            raise InputError(
                f"--{name.replace('_', '-')}", expected="it in the scene file", found=getattr(options, name)
            )
    return read_fabric_scene(options.scene)


def _moving(
    options: argparse.Namespace, energy: FabricEnergy, file: PlannedScene | None
) -> tuple[SheetScene, FabricDynamics]:
    scene = _scene(options, energy.sheet) if file is None else file.of(energy.sheet)
    damping = options.damping if file is None else file.damping
    coefficient = USUAL_FRICTION if options.friction is None else options.friction
    settings = MotionSettings(
        scene.gravity, damping, YarnFriction(coefficient) if coefficient else None,
        method="explicit" if options.explicit else "implicit",
    )  # fmt: skip
    parts = (
        energy, settings, scene.holds, scene.pushes(energy),
        PassageCount(energy, energy.start()),
    )  # fmt: skip
    if options.method == "volume":
        return scene, VolumeDynamics(*parts, volume=RodVolume(energy, options.volume))
    return scene, FabricDynamics(*parts)


def _scene(options: argparse.Namespace, sheet: YarnSheet) -> SheetScene:
    if options.scene == "stretch":
        axis = 0 if options.direction == "course" else 1
        return stretch(sheet, amount=options.amount, axis=axis, duration=options.duration)
    return drape(sheet, friction=options.ball_friction) if options.scene == "drape" else hang(sheet)
