"""The command ``fabric``: finite fabrics, yarn by yarn or in a bounding volume."""

from __future__ import annotations

import argparse
from contextlib import AbstractContextManager, nullcontext
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from yarnscale.cli import convert
from yarnscale.cli.console import outcome_lines, report
from yarnscale.cli.fabric_run import MAKES, FabricRun
from yarnscale.cli.yarn_choice import YarnChoice
from yarnscale.cli.yarns import pattern_of
from yarnscale.errors import InputError
from yarnscale.fabric.adaptive_volume import AdaptiveVolume
from yarnscale.fabric.measures import fibre_extension, penetration
from yarnscale.fabric.spline_knit import SplineFabric, jersey, spline_fabric
from yarnscale.fabric.spline_motion import SplineMotion, YarnMotion
from yarnscale.fabric.volume import BoundingVolume
from yarnscale.files.animation import read_animation
from yarnscale.files.curve_frames import CurveSet
from yarnscale.files.material_toml import read_material
from yarnscale.files.patterns import stitches_of
from yarnscale.files.run_folder import RunFolder
from yarnscale.motion.run import Run
from yarnscale.motion.unfulfilled import sentences
from yarnscale.yarn.material import YarnMaterial

JERSEYS = ("jersey", "single-jersey", "stockinette")
_POINTS_PER_SEGMENT = 3
_FILES = {"gltf": "fabric.glb", "usd": "fabric.usdc", "mp4": "fabric.mp4"}


def fabric(options: argparse.Namespace) -> int:
    """Simulate a finite fabric, or count its unknowns."""
    if options.count:
        return _fabric(options, nullcontext())
    if options.out is None:
        raise InputError("--out", expected="a folder for frames and pictures", found="none")
    for kind in options.format:
        convert.require(kind)
    formats = [name for kind in options.format for name in convert.made_by(kind, _name(kind))]
    results = RunFolder(
        options.out, "fabric", [*MAKES, *formats], overwrite=options.overwrite, resume=options.resume,
        goes_on_from=MAKES,
    )  # fmt: skip
    return _fabric(options, results)


def _fabric(options: argparse.Namespace, results: AbstractContextManager[Path | None]) -> int:
    for name in ("rows", "columns"):
        given = getattr(options, name)
        if options.on is None and given is None:
            raise InputError(f"--{name}", expected="a whole number from 2 to 1000", found="none")
        if options.on is not None and given is not None:
            raise InputError(f"--{name}", expected="none, as a mesh has its own size", found=given)
    if options.adaptive and options.method != "volume":
        raise InputError("--adaptive", expected="--method volume", found=options.method)
    if options.method == "direct" or _rods_in_a_volume(options):
        return _direct(options, results)
    if options.scene != "hang":
        raise InputError("--scene", expected="hang, or --method direct or volume", found=options.scene)
    plain = {
        "border": "glued", "on": None, "tube": False, "as_drawn": False, "friction": None, "ball_friction": 0.0,
    }  # fmt: skip
    for name, value in plain.items():
        if getattr(options, name) != value:
            option = f"--{name.replace('_', '-')}"
            raise InputError(option, expected="--method direct", found=options.method)
    knitted, yarn = _spline_yarns(options)
    volume = BoundingVolume.around(knitted.control, options.volume) if options.method == "volume" else None
    if options.count:
        counts: dict[str, object] = {**knitted.counts()}
        if volume is not None:
            counts["reduced_unknowns"] = 3 * volume.count
        return _end(options, counts, None)
    moving = SplineMotion(
        knitted, volume=volume, held=knitted.top, damping=options.damping,
        method="explicit" if options.explicit else "implicit",
    )  # fmt: skip
    about = FabricRun(options, results, YarnMotion, pattern=knitted.control, yarn=yarn)
    body = AdaptiveVolume(moving) if options.adaptive else moving
    lines = knitted.lines(knitted.control, _POINTS_PER_SEGMENT)
    curves = CurveSet(np.arange(knitted.yarn_count + 1) * lines.shape[1], knitted.radius)

    def points(state: YarnMotion) -> NDArray[np.float64]:
        return knitted.lines(body.yarns(state).positions, _POINTS_PER_SEGMENT).reshape(-1, 3)

    run = about.simulate(body, moving.start, curves, points)
    control = body.yarns(run.state).positions
    numbers: dict[str, object] = {
        **body.counts(), **run.summary(), "seconds": about.seconds, "penetration": penetration(knitted, control),
        "extension": fibre_extension(knitted, control)[0],
    }  # fmt: skip
    return _end(options, numbers, run)


def _spline_yarns(options: argparse.Namespace) -> tuple[SplineFabric, YarnMaterial]:
    if len(options.material or ()) > 1:
        raise InputError("--material", expected="one, or --method direct", found=len(options.material))
    material = read_material(options.material[0] if options.material else "wool")
    origin = "--material" if options.material else "default of spline yarns"
    YarnChoice(options.pattern, material, origin).say()
    size = options.rows, options.columns
    if options.pattern in JERSEYS:
        radius = 1e-3 if options.radius is None else options.radius
        return jersey(*size, material, radius=radius), material
    chart = stitches_of(options.pattern)
    if chart is None:
        raise InputError(
            "pattern",
            expected="for spline yarns jersey, a built-in knit or a .chart file",
            found=repr(options.pattern),
        )
    pattern = pattern_of(options.pattern, options.radius)
    return spline_fabric(pattern, chart, *size, material), material


def _rods_in_a_volume(options: argparse.Namespace) -> bool:
    """Whether what the volume holds are elastic rods: anything but hanging jersey, which has yarns of splines."""
    splines = options.pattern in JERSEYS and options.scene == "hang"
    if options.method != "volume" or splines:
        return False
    for name in ("adaptive", "explicit"):
        if getattr(options, name):
            raise InputError(
                f"--{name}", expected="hanging jersey, or --method direct", found="rods in a volume"
            )
    return True


def _direct(options: argparse.Namespace, results: AbstractContextManager[Path | None]) -> int:
    numbers, run = import_module("yarnscale.cli.direct_fabric").simulate_direct(options, results)
    return _end(options, numbers, run)


def _end(options: argparse.Namespace, numbers: dict[str, object], run: Run[Any] | None) -> int:
    """Convert frames and print numbers; the exit status. run: None where unknowns were counted."""
    if run is not None:
        _convert(options)
    found = () if run is None else run.unfulfilled
    report(options, numbers, *outcome_lines(numbers, sentences(found, "--may-give-way allows it")))
    return 0 if run is None or (run.converged and (options.may_give_way or not run.unfulfilled)) else 1


def _name(kind: str) -> str:
    """File or folder of a format within that of the fabric."""
    return _FILES.get(kind, kind)


def _convert(options: argparse.Namespace) -> None:
    for kind in options.format:
        convert.write(read_animation(options.out), kind, options.out / _name(kind))
