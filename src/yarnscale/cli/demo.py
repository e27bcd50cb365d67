"""The command ``demo``: from a drawn stockinette to a shell material, a stretched and a draped cloth, on one page."""

from __future__ import annotations

import argparse
import time
from pathlib import Path

import numpy as np

from yarnscale.cell import PeriodicCell
from yarnscale.cell.rest import settled
from yarnscale.cli.cloth import MAKES, simulate_into
from yarnscale.cli.console import print_json, writable_folder
from yarnscale.cli.materials import PATTERN as REST
from yarnscale.cli.materials import homogenize_into, material_sections, results_of_homogenize
from yarnscale.cli.yarns import draw_cell
from yarnscale.files.patterns import write_pattern
from yarnscale.files.run_folder import RunFolder
from yarnscale.homogenize.plan import StrainRange
from yarnscale.kinematics import ShellStrain
from yarnscale.shell.scenes.scene import drape, stretch
from yarnscale.show.report import Picture, Section, Table, write_report
from yarnscale.yarn import library
from yarnscale.yarn.material import YarnMaterial

PATTERN, MATERIAL = "stockinette", "hylc2020-stockinette"
SOLVES, WORKERS = 240, 2
AMOUNT = 0.3


def demo(options: argparse.Namespace) -> int:
    """Run everything; a few minutes."""
    began = time.perf_counter()
    makes = ("index.html", "yarns/*.png", "homogenized/", "stretch/", "drape/")
    with RunFolder(options.out, "demo", makes, overwrite=options.overwrite) as folder:
        return _demo(folder, began)


def _demo(folder: Path, began: float) -> int:
    rest = settled(library.build(PATTERN), YarnMaterial.preset(MATERIAL))
    cell = PeriodicCell(rest.pattern, YarnMaterial.preset(MATERIAL))
    yarns, all_converged = _yarn_section(cell, folder / "yarns")
    with results_of_homogenize(folder / "homogenized") as homogenized:
        write_pattern(rest.pattern, homogenized / REST, yarns=cell.material)
        outcome = homogenize_into(
            cell, homogenized, solves=SOLVES, box=StrainRange(), workers=WORKERS, resume=False
        )
    material_section = material_sections(outcome, _embedded(folder / "homogenized" / "pictures"))
    cloth, measures, cloth_converged = _cloth_section(outcome.material, folder)
    seconds = time.perf_counter() - began
    write_report(
        folder / "index.html",
        "From yarn to cloth: stockinette",
        [yarns, *material_section, cloth],
        summary=f"Yarn material {MATERIAL}. Everything on this page was computed in {seconds:.0f} s.",
        facts={
            "yarn states solved": outcome.summary.states,
            "converged": outcome.summary.converged,
            "solve time [s]": outcome.summary.seconds,
            "cloth vertices": measures["vertices"],
        },
    )
    print_json({"page": str(folder / "index.html"), "seconds": seconds, **measures})
    return (
        0 if all_converged and cloth_converged and outcome.summary.states == outcome.summary.converged else 1
    )


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


def _embedded(folder: Path) -> list[Picture]:
    names = {"axes.png": ("Energy and stress along each axis: samples and fit.", True)}
    names |= {"plane_s_x_s_y.png": ("Energy over the two stretches.", False)}
    names |= {"errors.png": ("Error of the fitted energy.", False)}
    return [Picture(folder / name, text, wide) for name, (text, wide) in names.items()]


def _cloth_section(material, folder: Path) -> tuple[Section, dict[str, float | int], bool]:  # type: ignore[no-untyped-def]
    scenes = {
        "stretch": stretch(material, direction="course", amount=AMOUNT, frame_interval=0.1),
        "drape": drape(material, frame_interval=0.1),
    }
    results = []
    for name, scene in scenes.items():
        with RunFolder(folder / name, "cloth", MAKES) as place:
            results.append(simulate_into(scene, place))
    pulled, draped = results
    rows = [
        [result.scene.name, result.status.value, result.steps, result.newton_iterations, result.seconds]
        for result in (pulled, draped)
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
        Picture(folder / "stretch" / "frames.png", "A 30 × 30 cm sheet stretched along its courses.", True),
        Picture(folder / "drape" / "frames.png", "The same sheet falling over a ball.", True),
        Picture(folder / "drape" / "last.png", "At the end.", True),
    ]
    measures = {f"stretch_{k}": float(v) for k, v in pulled.measures.items() if np.isfinite(v)}
    measures["vertices"] = pulled.scene.cloth.mesh.vertex_count
    text = [
        "Simulated as a thin shell with the material above, implicit time steps, self-contact in the drape."
    ]
    return Section("Cloth", text, tables, pictures), measures, pulled.succeeded and draped.succeeded
