"""``fabric --method compare``: LOD03's experiments with all spline yarns, the published and the homogenized volume."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from yarnscale.arrays import Array
from yarnscale.cli.console import ProgressLine, report
from yarnscale.cli.fabric_options import COMPARED, ONLY_RODS
from yarnscale.cli.values import refuse
from yarnscale.errors import InputError, misspelt
from yarnscale.fabric.fabric_scene import fabric_schedule
from yarnscale.fabric.imposed import AMOUNTS, AXES, imposed_shapes
from yarnscale.fabric.spline_knit import SplineFabric
from yarnscale.fabric.spline_motion import SplineMotion
from yarnscale.fabric.spline_scene import SplineScene
from yarnscale.fabric.volume import BoundingVolume
from yarnscale.files.run_folder import RunFolder
from yarnscale.motion.scene import run_scene
from yarnscale.show.report import Table
from yarnscale.show.spline_models import TITLES, ModelPage, drop_curves, side_by_side

_FOR_ONE_MODEL = (
    "explicit", "adaptive", "model", "integrator", "resume", "count", "reduction", "format", "may_give_way", "unit",
    "weld", "amount", "direction", "ball_friction",
)  # fmt: skip
_MOMENTS = 3
"""Of what hangs, in the picture."""
_MEASURES = ("penetration", "extension", "passages")


def check_comparison(options: argparse.Namespace) -> None:
    """InputError for options that a comparison of models does not take."""
    if options.scene not in COMPARED:
        expected = "with --method compare " + " or ".join(COMPARED)
        raise InputError("--scene", expected=expected, found=misspelt(options.scene, COMPARED))
    refuse(options, (*ONLY_RODS, *_FOR_ONE_MODEL), "another --method")
    if options.scene == "imposed":
        refuse(options, ("duration", "time_step", "damping"), "--scene hang")


def compare_models(options: argparse.Namespace, knitted: SplineFabric) -> int:
    """Write pictures, numbers and a page of a scene with three models into a folder."""
    volume = BoundingVolume.around(knitted.control, options.volume)
    scene = _hanging if options.scene == "hang" else _imposed
    pictures = [_picture(kind, axis) for kind in AMOUNTS for axis in AXES]
    makes = ["index.html", "hanging.png", "drops.png", *pictures]
    with RunFolder(options.out, "fabric", makes, overwrite=options.overwrite) as folder:
        page = ModelPage(folder, f"{options.pattern}, {options.rows} × {options.columns}: {options.scene}")
        numbers, lines, fine = scene(options, knitted, volume, page)
        page.write()
    report(options, {"scene": options.scene, **numbers}, *lines, f"{folder}: pictures and a page")
    return 0 if fine else 1


Compared = tuple[dict[str, Any], list[str], bool]
"""Numbers, lines of text, and whether all models converged."""


def _picture(kind: str, axis: str) -> str:
    return f"{kind}-{axis}.png"


def _imposed(options: argparse.Namespace, knitted: SplineFabric, volume: BoundingVolume, page: ModelPage) -> Compared:
    entries, rows, progress = [], [], ProgressLine("fabric")
    for kind, amount in AMOUNTS.items():
        for axis, name in enumerate(AXES):
            shapes = imposed_shapes(knitted, volume, kind, axis)
            found = {model: shape.measures(knitted) for model, shape in shapes.items()}
            entries.append({"kind": kind, "axis": name, "amount": amount, "models": found})
            what = f"{kind} along the {name}"
            rows += [[what, TITLES[model], *of.values()] for model, of in found.items()]
            titles = [
                f"{TITLES[model]}: {of['penetration']:.2f}" + f", {of['passages']} passages" * bool(of["passages"])
                for model, of in found.items()
            ]
            control = [shape.control for shape in shapes.values()]
            page.draw(
                _picture(kind, name), f"{what}, {amount:g}; with the penetration.", _beside(knitted, control, titles)
            )
            progress.show(len(entries), 2 * len(AMOUNTS), what)
    heads = ["", "model", "penetration", "extension", "mean extension", "passages", "converged"]
    page.tables.append(Table(heads, rows))
    page.text.append(
        "Penetration: 1 − distance over diameter of the closest yarns. Extension: the largest of a segment of yarn, "
        "and the mean. Amounts: angle over the size [rad] of flexion and torsion, share of traction and shear. Of "
        "all yarns one point a stitch along the borders is moved, and the rest relaxes; volumes take the shape as a "
        "whole, and the cells of the homogenized one relax."
    )
    lines = [
        f"{row[0]}, {row[1]}: {_said(dict(zip(_MEASURES, (row[2], row[3], row[5]), strict=True)))}" for row in rows
    ]
    return {"deformations": entries}, lines, all(row[-1] for row in rows)


class _Fall(NamedTuple):
    """How a model hangs: numbers, moments as titles and control points, times, and numbers over time; whether well."""

    numbers: dict[str, Any]
    moments: list[tuple[str, Array]]
    times: Array
    over_time: dict[str, Array]
    fine: bool


def _fall(options: argparse.Namespace, knitted: SplineFabric, model: str, **inside: Any) -> _Fall:
    schedule, states = fabric_schedule(options.duration, options.time_step), []
    scene = SplineScene(knitted, schedule=schedule, damping=options.damping, **inside)
    body = scene.body
    assert isinstance(body, SplineMotion)
    progress = ProgressLine(f"fabric, {TITLES[model]}").show_step
    result = run_scene(scene, on_frame=lambda _, state: states.append(state), on_step=progress)
    drops = [scene.drops(state) for state in states]
    over_time = {name: np.array([drop[name] for drop in drops], np.float64) for name in drops[0]}
    over_time["energy"] = np.array([sum(body.energies(state).values()) for state in states])
    chosen = [states[round(k)] for k in np.linspace(0, len(states) - 1, _MOMENTS + 1)[1:]]
    moments = [(f"{TITLES[model]}, {state.time:.2f} s", body.yarns(state).positions) for state in chosen]
    return _Fall(
        result.summary(), moments, np.array([state.time for state in states]), over_time, result.succeeded
    )  # fmt: skip


def _hanging(options: argparse.Namespace, knitted: SplineFabric, volume: BoundingVolume, page: ModelPage) -> Compared:
    reductions = {model: {"volume": volume, "reduction": model} for model in ("published", "homogenized")}
    falls = {model: _fall(options, knitted, model, **reductions.get(model, {})) for model in TITLES}
    rows, lines = [], []
    for model, fall in falls.items():
        of, full = fall.numbers, falls["splines"].over_time
        for name, error in (("centre_drop", "centre_error"), ("lower_edge_drop", "lower_edge_error")):
            of[error] = float(np.abs(fall.over_time[name] - full[name]).max() / np.abs(full[name]).max())
        centre, lower = 1e3 * of["centre_drop"], 1e3 * of["lower_edge_drop"]
        lost = 1e6 * float(fall.over_time["energy"][0] - fall.over_time["energy"][-1])
        work = (of[name] for name in ("steps", "newton_iterations", "seconds"))
        measured = (of[name] for name in _MEASURES)
        rows.append([TITLES[model], centre, of["centre_error"], lower, of["lower_edge_error"], *measured, lost, *work])
        lines.append(
            f"{TITLES[model]}: {of['status']}, centre {centre:.3g} mm, lower edge {lower:.3g} mm, errors "
            f"{of['centre_error']:.2g} and {of['lower_edge_error']:.2g}, {_said(of)}"
        )
    heads = ["model", "centre drop [mm]", "its error", "lower edge drop [mm]", "its error", *_MEASURES,
             "energy lost [µJ]", "steps", "Newton iterations", "seconds"]  # fmt: skip
    page.tables.append(Table(heads, rows))
    page.text.append("Errors: the largest difference from all yarns at any time, over their largest drop.")
    times, over_time = falls["splines"].times, {model: fall.over_time for model, fall in falls.items()}
    caption = "Fall of the centre of mass and of the lower edge."
    page.draw("drops.png", caption, lambda to: drop_curves(to, times, over_time))
    shown = [moment for row in zip(*(fall.moments for fall in falls.values()), strict=True) for moment in row]
    titles, control = zip(*shown, strict=True)
    page.draw(
        "hanging.png", "Moments, seen from the front.", _beside(knitted, control, titles, camera=(0.0, -0.3, 1.0))
    )
    numbers = {"models": {model: fall.numbers for model, fall in falls.items()}}
    return numbers | {"over_time": {"time": times, **over_time}}, lines, all(fall.fine for fall in falls.values())


def _beside(knitted: SplineFabric, control: Any, titles: Any, **look: Any) -> Callable[[Path], None]:
    return lambda to: side_by_side(to, knitted, control, titles, len(TITLES), **look)


def _said(found: Mapping[str, Any]) -> str:
    return ", ".join(f"{name} {found[name]:.3g}" for name in _MEASURES)
