"""Commands about shell materials: ``homogenize``, ``evaluate``."""

from __future__ import annotations

import argparse
import os
import sys
from itertools import combinations
from pathlib import Path

import numpy as np

from yarnscale.cell import PeriodicCell
from yarnscale.cli.console import ProgressLine, print_json, writable_folder
from yarnscale.cli.yarn_choice import yarn_for
from yarnscale.cli.yarns import pattern_of, settled_drawing
from yarnscale.errors import InputError
from yarnscale.files.material_json import read_material, write_material
from yarnscale.files.patterns import is_drawing, read_pattern, read_yarns, write_pattern
from yarnscale.files.run_folder import RunFolder
from yarnscale.homogenize.executors import reach_workers
from yarnscale.homogenize.homogenize import Homogenization
from yarnscale.homogenize.homogenize import homogenize as run_homogenize
from yarnscale.homogenize.observations import InPlane, strains_of
from yarnscale.homogenize.plan import StrainRange
from yarnscale.homogenize.refine import Round
from yarnscale.homogenize.states import SampledStates
from yarnscale.homogenize.store import SampleStore
from yarnscale.kinematics import COMPONENTS, ShellStrain
from yarnscale.show.report import Picture, Section, Table, write_report

PATTERN = "pattern.json"
"""In the folder of a homogenized pattern: what was sampled, a drawing as fabric at rest, with its yarn."""
SAMPLED = ("s_x", "s_a", "s_y", "II11", "II22")
"""Strain components behind the columns of sampled states."""


def worker_count(options: argparse.Namespace) -> int:
    """Processes to use: as asked, else one per core that this process may use."""
    if options.workers is not None:
        return options.workers
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def reach_dask(options: argparse.Namespace) -> None:
    """Wait for the workers of ``--dask``, if it is given; InputError where they cannot be reached."""
    if options.dask is not None:
        reach_workers(
            options.dask, tell=lambda text: print(f"yarnscale: {text}", file=sys.stderr, flush=True)
        )


def evaluate(options: argparse.Namespace) -> int:
    """Energy density and stress at one strain."""
    strain = ShellStrain.from_vector(list(options.strain)).vector[None]
    material = read_material(options.material)
    energy, stress = float(material.energy_density(strain)[0]), material.stress(strain)[0]
    if options.json:
        print_json({"energy_density": energy, "stress": stress})
        return 0
    print(f"energy density {energy:.9g} J/m²")
    for name, value in zip(COMPONENTS, stress, strict=True):
        print(f"d/d{name:<5} {value:.9g} {'N/m' if name.startswith('s') else 'N'}")
    return 0


def _range(options: argparse.Namespace) -> StrainRange:
    given = {"stretch": options.stretch, "shear": options.shear, "curvature": options.curvature}
    return StrainRange(**{name: value for name, value in given.items() if value is not None})


def homogenize(options: argparse.Namespace) -> int:
    """Sample, fit, draw, report."""
    box = _range(options)
    drawn = pattern_of(options.pattern, options.radius)
    kept = options.out / PATTERN
    begun = options.resume and kept.is_file()
    yarn = yarn_for(options.pattern, drawn, options.material, kept=read_yarns(kept) if begun else None)
    results = results_of_homogenize(options.out, overwrite=options.overwrite, resume=options.resume)
    if options.resume and (options.out / "samples").exists():
        SampleStore(options.out / "samples")  # refuses what is no store before anything is settled
    if begun and read_pattern(kept).name != drawn.name:
        raise InputError(
            "cannot resume: another pattern", where=kept, expected=drawn.name, found=read_pattern(kept).name
        )
    reach_dask(options)
    yarn.say()
    with results as folder:
        if not begun:
            if is_drawing(options.pattern) and not options.as_drawn:
                drawn = settled_drawing(drawn, yarn.materials)
            write_pattern(drawn, kept, yarns=yarn.materials)
        cell = PeriodicCell(read_pattern(kept), yarn.materials)
        outcome = homogenize_into(
            cell, folder, solves=options.solves, box=box, workers=worker_count(options), resume=options.resume,
            in_plane=options.in_plane, budget=options.budget, target_error=options.target_error,
            dask=options.dask,
        )  # fmt: skip
    failed = outcome.summary.states - outcome.summary.converged
    if options.json:
        report = outcome.report
        print_json(
            {
                **yarn.summary, "states": outcome.summary.states, "converged": outcome.summary.converged,
                "seconds": outcome.summary.seconds, "density": outcome.material.density,
                "energy_error_median": report.energy_median, "energy_error_95": report.energy_95,
                "material_file": str(folder / "material.json"),
            }
        )  # fmt: skip
        return 1 if failed else 0
    print(
        f"{folder / 'material.json'}: {outcome.summary.converged} of {outcome.summary.states} states converged"
    )
    print(f"{folder / 'index.html'}: pictures and numbers")
    return 1 if failed else 0


def results_of_homogenize(path: Path, *, overwrite: bool = False, resume: bool = False) -> RunFolder:
    """The folder of a homogenized pattern."""
    stores = ("samples/", "unseen/")
    pictures = ("axes", "plane_*", "errors")
    makes = (*stores, PATTERN, "material.json", "index.html", *(f"pictures/{name}.png" for name in pictures))
    return RunFolder(
        path, "homogenize", makes, overwrite=overwrite, resume=resume, goes_on_from=(*stores, PATTERN)
    )


def homogenize_into(
    cell: PeriodicCell, folder: Path, *, solves: int, box: StrainRange, workers: int, resume: bool,
    in_plane: InPlane = "full", budget: int | None = None, target_error: float | None = None,
    dask: str | None = None,
) -> Homogenization:  # fmt: skip
    """Run the job; write ``material.json``, pictures and ``index.html`` into the folder."""
    line = ProgressLine(f"sampling {cell.pattern.name}")
    outcome = run_homogenize(
        cell, folder, solves=solves, range=box, workers=workers, resume=resume, in_plane=in_plane,
        budget=budget, target_error=target_error, judged=_tell_round, dask=dask,
        progress=lambda p: line.show(p.done, p.total, p.seconds, p.seconds_left, f"{p.converged} converged"),
    )  # fmt: skip
    write_material(folder / "material.json", outcome.material)
    pictures = draw_material(outcome, folder / "pictures")
    write_report(
        folder / "index.html",
        f"{cell.pattern.name}, homogenized",
        [*material_sections(outcome, pictures)],
        summary=f"Yarn material {cell.material_name}; {outcome.summary.states} states solved.",
        facts={
            "states": outcome.summary.states,
            "converged": outcome.summary.converged,
            "solve time [s]": outcome.summary.seconds,
            "workers": outcome.summary.workers,
            "density [kg/m²]": outcome.material.density,
        },
    )
    return outcome


def _tell_round(found: Round) -> None:
    print(
        f"{found.states} states: estimated errors of 95 % below {100 * found.energy_95:.2g} % in energy, "
        f"{100 * found.stress_95:.2g} % in stress",
        file=sys.stderr, flush=True,
    )  # fmt: skip


def draw_material(outcome: Homogenization, folder: Path) -> list[Picture]:
    """Energy and stress along each axis, energy over the planes, errors on unseen states."""
    from yarnscale.show.plots import AxisSamples, axis_plots, error_histogram, plane_plot

    folder = writable_folder(folder)
    material, samples = outcome.material, outcome.samples
    acting = samples.strains != 0
    axes = []
    for k, component in enumerate(SAMPLED):
        on = acting[:, k] & (acting.sum(axis=1) == 1) | ~acting.any(axis=1)
        order = np.flatnonzero(on)[np.argsort(samples.strains[on, k])]
        axes.append(
            AxisSamples(
                component, samples.strains[order, k], samples.energies[order], samples.stresses[order, k],
                samples.converged[order],
            )
        )  # fmt: skip
    axis_plots(folder / "axes.png", axes, material.energy_density, material.stress)
    pictures = [
        Picture(folder / "axes.png", "Energy and stress along each axis: samples and fit.", wide=True)
    ]
    for i, j in combinations(range(5), 2):
        others = np.delete(acting, [i, j], axis=1).any(axis=1)
        if (i, j) == (3, 4) or (~others & acting[:, i] & acting[:, j]).sum() < 4:
            continue
        on, name = ~others, f"plane_{SAMPLED[i]}_{SAMPLED[j]}.png"
        plane_plot(
            folder / name, (SAMPLED[i], SAMPLED[j]), samples.strains[on][:, [i, j]], samples.energies[on],
            material.energy_density, converged=samples.converged[on], scale="log",
        )  # fmt: skip
        pictures.append(
            Picture(folder / name, f"Energy over {SAMPLED[i]} and {SAMPLED[j]}: fit and samples.")
        )
    errors = {"unseen states": _errors(outcome, outcome.unseen), "fitted states": _errors(outcome, samples)}
    error_histogram(folder / "errors.png", errors, label="error of Ψ over the largest Ψ − Ψ(0) [%]")
    pictures.append(Picture(folder / "errors.png", "Error of the fitted energy."))
    return pictures


def _errors(outcome: Homogenization, states: SampledStates) -> np.ndarray:
    good = states.converged
    fitted = outcome.material.energy_density(strains_of(states.strains[good]))
    rest = float(outcome.material.energy_density(np.zeros((1, 6)))[0])
    return np.abs(fitted - states.energies[good]) / max(
        float(np.abs(states.energies[good] - rest).max()), 1e-300
    )


def material_sections(outcome: Homogenization, pictures: list[Picture]) -> list[Section]:
    """What a page says about a homogenized material."""
    report = outcome.report
    rows = [["Ψ", 100 * report.energy_median, 100 * report.energy_95]]
    rows += [
        [f"d/d{name}", 100 * float(report.stress_median[k]), 100 * float(report.stress_95[k])]
        for k, name in enumerate(SAMPLED)
    ]
    table = Table(
        ["quantity", "median error [%]", "95th percentile [%]"],
        rows,
        f"Errors on {report.states} random states that the fit has not seen, over the largest value among them.",
    )
    text = ["A sum of one- and two-dimensional splines (HYLC20 eq. 31–32), fitted to energies and stresses."]
    if outcome.material.inside is not None:
        text.append("Splines of all three in-plane strains add what pairs of strains do not say.")
    return [Section("Shell material", text, [table], pictures)]
