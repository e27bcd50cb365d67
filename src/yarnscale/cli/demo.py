"""The command ``demo``: from a drawn stockinette to a shell material, a stretched and a draped cloth, on one page."""

from __future__ import annotations

import argparse
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from yarnscale.cell import PeriodicCell
from yarnscale.cell.rest import settled
from yarnscale.cli.cloth import MAKES, simulate_into
from yarnscale.cli.console import report
from yarnscale.cli.detail import curve_set
from yarnscale.cli.given_pattern import draw_cell
from yarnscale.cli.materials import PATTERN as REST
from yarnscale.cli.materials import homogenize_into, results_of_homogenize
from yarnscale.detail.fluctuations import FluctuationTable
from yarnscale.detail.yarns import YarnDetail
from yarnscale.drawing import library
from yarnscale.files.animation import Animation, Moment, Surface, read_animation
from yarnscale.files.body_surface import BodySurface
from yarnscale.files.patterns import write_pattern
from yarnscale.files.run_folder import RunFolder, writable_folder
from yarnscale.homogenize.store import SampleStore
from yarnscale.kinematics import ShellStrain
from yarnscale.shell.materials.material import ShellMaterial
from yarnscale.shell.scenes.scene import SceneResult, drape, stretch
from yarnscale.show.detail import Solid, yarn_cloth_picture
from yarnscale.show.pane import Pane
from yarnscale.show.report import Picture, Section, Table, write_report
from yarnscale.show.run_pane import run_pane
from yarnscale.yarn.material import YarnMaterial

PATTERN, MATERIAL = "stockinette", "hylc2020-stockinette"
SOLVES, WORKERS = 240, 2
SPACING = 0.0105
"""Edge length of the demo's triangles [m], so that all of it takes a few minutes."""
AMOUNT = 0.3


def demo(options: argparse.Namespace) -> int:
    """Run everything; a few minutes."""
    began = time.perf_counter()
    makes = ("index.html", "yarns/*.png", "homogenized/", "stretch/", "drape/")
    with RunFolder(options.out, "demo", makes, overwrite=options.overwrite) as folder:
        summary, good = _demo(folder, began)
    report(options, summary, f"{summary['page']}: everything, in {summary['seconds']:.0f} s")
    return 0 if good else 1


def _demo(folder: Path, began: float) -> tuple[dict[str, object], bool]:
    rest = settled(library.build(PATTERN), YarnMaterial.preset(MATERIAL))
    cell = PeriodicCell(rest.pattern, YarnMaterial.preset(MATERIAL))
    yarns, all_converged = _yarn_section(cell, folder / "yarns")
    with results_of_homogenize(folder / "homogenized") as homogenized:
        write_pattern(rest.pattern, homogenized / REST, yarns=cell.material)
        outcome, material = homogenize_into(cell, homogenized, solves=SOLVES, workers=WORKERS, resume=False)
    cloth, measures, results = _cloth_section(outcome.material, folder)
    samples = SampleStore(folder / "homogenized" / "samples")
    detail = _detail_section(FluctuationTable.from_store(samples, cell.pattern), results, folder / "yarns")
    seconds = time.perf_counter() - began
    write_report(
        folder / "index.html",
        "From yarn to cloth: stockinette",
        [detail, yarns, material, cloth],
        summary=f"Yarn material {MATERIAL}. Everything on this page was computed in {seconds:.0f}\u00a0s.",
        facts={
            "yarn states solved": outcome.summary.states,
            "converged": outcome.summary.converged,
            "solve time [s]": outcome.summary.seconds,
            "cloth vertices": measures["vertices"],
        },
    )
    all_converged &= outcome.summary.states == outcome.summary.converged and not outcome.summary.pending
    good = all_converged and all(result.succeeded for result in results)
    return {"page": str(folder / "index.html"), "seconds": seconds, **measures}, good


def _yarn_section(cell: PeriodicCell, folder: Path) -> tuple[Section, bool]:
    folder = writable_folder(folder)
    rows, pictures, converged = [], [], True
    for name, strain in (
        ("at rest", ShellStrain()),
        ("stretched along the course", ShellStrain(s_x=AMOUNT)),
        ("stretched along the wale", ShellStrain(s_y=AMOUNT)),
        ("bent along the wale", ShellStrain(II22=60.0)),
    ):
        state = cell.relax(strain)
        converged &= state.converged
        path = folder / f"{name.replace(' ', '_')}.png"
        draw_cell(path, cell, state)
        pictures.append(Picture(path, f"The cell {name}, with its copies."))
        energy, closest = state.energy_density, state.min_distance_over_diameter
        rows.append([name, state.status.value, energy, closest, state.iterations, state.seconds])
    columns = ["state", "status", "Ψ [J/m²]", "closest / diameter", "iterations", "time [s]"]
    return Section(
        "Yarns", ["A periodic cell relaxed under macroscopic strain."], [Table(columns, rows)], pictures
    ), converged


def _detail_section(table: FluctuationTable, results: Sequence[SceneResult], folder: Path) -> Section:
    """The yarns of the cell on both sheets, as a whole and from near."""
    pictures, count = [], 0
    for result, (name, middle, captions) in zip(results, _ON_CLOTH, strict=True):
        cloth, positions = result.scene.cloth, result.state.positions
        yarns = YarnDetail.of(table, cloth.mesh)
        points, curves = yarns.curves(positions), curve_set(yarns)
        count += yarns.layout.vertex_count
        bodies = BodySurface(cloth.obstacles)
        time = result.state.time
        solids = [Solid(bodies.vertices(time), bodies.triangles)] if bodies else []
        moment = Moment(time, yarns=points, bodies=solids[0].vertices if solids else None)
        around = Surface(bodies.triangles) if bodies else None
        still = Animation(np.array([time]), lambda _, moment=moment: moment, yarns=curves, bodies=around)
        near = {"about": positions[middle(positions)], "width": 0.06}
        for number, (caption, view) in enumerate(zip(captions, ({}, near), strict=True)):
            path = folder / f"{name}_{number}.png"
            size = (1200, 900) if number == 0 else (800, 600)
            yarn_cloth_picture(path, curves, points, solids=solids, size=size, **view)
            pane = run_pane(still, f"yarns of the {name}") if number == 0 else None
            pictures.append(Picture(path, caption, wide=number == 0, pane=pane))
    text = [
        f"{count} yarn vertices on the two simulated sheets, each where the relaxed cell has it under the local strain "
        "and curvature of the cloth. The cell's states are those that the shell material below was fitted to."
    ]
    return Section("Yarns on cloth", text, [], [pictures[k] for k in (2, 0, 3, 1)])


_ON_CLOTH = (
    (
        "stretch",
        lambda positions: np.linalg.norm(positions - positions.mean(axis=0), axis=1).argmin(),
        ("The sheet stretched along its courses.", "Its middle: the loops are drawn wide and low."),
    ),
    ("drape", lambda positions: positions[:, 2].argmax(), ("The sheet on the ball.", "On top of the ball.")),
)
"""Of each sheet a name, the vertex in the middle of its near view, and captions of the whole and the near view."""


def _cloth_section(
    material: ShellMaterial, folder: Path
) -> tuple[Section, dict[str, float | int], tuple[SceneResult, SceneResult]]:
    scenes = {
        "stretch": stretch(material, direction="course", amount=AMOUNT, spacing=SPACING, frame_interval=0.1),
        "drape": drape(material, spacing=SPACING, frame_interval=0.1),
    }
    results = []
    for name, scene in scenes.items():
        with RunFolder(folder / name, "cloth", MAKES) as place:
            results.append(simulate_into(scene, place))
    pulled, draped = results
    rows = [
        [one.scene.name, one.run.outcome, one.run.steps, one.run.newton_iterations, one.seconds]
        for one in (pulled, draped)
    ]
    tables = [
        Table(["scene", "status", "steps", "Newton iterations", "time [s]"], rows),
        Table(
            ["λ along", "λ across", "bar force [N]"],
            [[float(pulled.measures[k]) for k in ("lambda_along", "lambda_across", "bar_force")]],
            "Stretch of the middle 6 × 6 cm when the bars' distance has grown by 30 %.",
        ),
    ]
    pictures = [
        Picture(folder / name / "frames.png", caption, True, _played(folder / name, material))
        for name, caption in (
            ("stretch", "A 30 × 30 cm sheet stretched along its courses."),
            ("drape", "The same sheet falling over a ball."),
        )
    ]
    pictures.append(Picture(folder / "drape" / "last.png", "At the end.", True))
    measures = {f"stretch_{k}": float(v) for k, v in pulled.measures.items() if np.isfinite(v)}
    measures["vertices"] = pulled.scene.cloth.mesh.vertex_count
    text = ["Simulated as a thin shell with the material above, implicit time steps, self-contact in the drape."]
    return Section("Cloth", text, tables, pictures), measures, (pulled, draped)


def _played(folder: Path, material: ShellMaterial) -> Pane:
    """The frames of a run."""
    return run_pane(read_animation(folder / "frames"), folder.name, material=material)
