"""Commands about shell materials: ``homogenize``, ``evaluate``."""

from __future__ import annotations

import argparse
import subprocess
from contextlib import suppress
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from yarnscale.cell import PeriodicCell
from yarnscale.cli.console import ProgressLine, print_notice, report
from yarnscale.cli.given_pattern import draw_cell, pattern_of, settled_drawing
from yarnscale.cli.values import refuse
from yarnscale.cli.workers import reach_dask, worker_count
from yarnscale.cli.yarn_choice import yarn_for
from yarnscale.errors import InputError
from yarnscale.files.material_json import read_material, write_material
from yarnscale.files.patterns import is_drawing, read_pattern, read_yarns, write_pattern
from yarnscale.files.run_folder import RunFolder, writable_folder
from yarnscale.files.visited import visited_strains
from yarnscale.homogenize.compact_problem import STRESS_FLOOR, stress_errors
from yarnscale.homogenize.homogenize import FRICTION, Homogenization
from yarnscale.homogenize.homogenize import homogenize as run_homogenize
from yarnscale.homogenize.plan import StrainRange
from yarnscale.homogenize.published_fit import PublishedOptions
from yarnscale.homogenize.rays import load_rays
from yarnscale.homogenize.store import SampleStore
from yarnscale.kinematics import COMPONENTS, ShellStrain, strain_units
from yarnscale.shell.materials.compact import CompactMaterial
from yarnscale.shell.materials.spline_material import SplineMaterial
from yarnscale.shell.materials.spline_patches import PLANES
from yarnscale.show.report import Picture, Section, Table, write_report
from yarnscale.yarn.friction import YarnFriction

PATTERN = "pattern.json"
"""In the folder of a homogenized pattern: what was sampled, a drawing as fabric at rest, with its yarn."""


def evaluate(options: argparse.Namespace) -> int:
    """Energy density and stress at one strain."""
    strain = ShellStrain.from_vector(list(options.strain)).vector[None]
    material = read_material(options.material)
    energy, stress = float(material.energy_density(strain)[0]), material.stress(strain)[0]
    lines = [f"energy density {energy:.9g} J/m²"]
    for name, value in zip(COMPONENTS, stress, strict=True):
        lines.append(f"d/d{name:<5} {value:.9g} {'N/m' if name.startswith('s') else 'N'}")
    if material.remembers:
        print_notice("note: energy and stress are without friction")
    report(options, {"energy_density": energy, "stress": stress}, *lines)
    return 0


_LOADS, _RANGES = ("limit", "visited"), ("stretch", "shear", "curvature")
_ABLATIONS = ("one_dimensional", "smoothing", "even_knots")
"""Options of one form alone."""


def _settings(options: argparse.Namespace) -> dict[str, object]:
    """Arguments of ``homogenize`` from the options of its form; InputError for an option of the other form."""
    solves, loads, ranges = (
        {name: value for name in names if (value := getattr(options, name)) is not None}
        for names in (("solves",), _LOADS, _RANGES)
    )
    if options.friction is not None:
        loads["friction"] = YarnFriction(options.friction)
    if options.form == "compact":
        refuse(options, (*_RANGES, *_ABLATIONS), "--form hylc2020 with it")
    else:
        refuse(options, (*_LOADS, "friction"), "--form compact with it")
        settings = {"pairs": not options.one_dimensional, "even_knots": options.even_knots}
        if options.smoothing is not None:
            settings["smoothing"] = options.smoothing
        fit = {"range": StrainRange(**ranges), "options": PublishedOptions(**settings)}
        return {"form": "hylc2020", "solves": 400, **solves, **fit}
    if "visited" in loads:
        if not options.resume:
            raise InputError("--visited", expected="--resume with it")
        loads["visited"] = visited_strains(options.visited)
    return solves | loads


def homogenize(options: argparse.Namespace) -> int:
    """Sample, fit, draw, report."""
    settings = _settings(options)
    drawn = pattern_of(options.pattern, options.radius)
    kept = options.out / PATTERN
    begun = options.resume and kept.is_file()
    yarn = yarn_for(options.pattern, drawn, options.material, kept=read_yarns(kept) if begun else None)
    if options.friction is None and options.form == "compact" and yarn.friction:
        settings["friction"] = YarnFriction(yarn.friction)
        print_notice(f"friction {yarn.friction:g} is that of the yarn; --friction 0 leaves it out")
    results = results_of_homogenize(options.out, overwrite=options.overwrite, resume=options.resume)
    if options.resume and (options.out / "samples").exists():
        SampleStore(options.out / "samples")  # refuses what is no store before anything is settled
    if begun and read_pattern(kept).name != drawn.name:
        raise InputError(
            "cannot resume: another pattern", where=kept, expected=drawn.name, found=read_pattern(kept).name
        )
    reach_dask(options)
    if options.form == "compact":  # refuses impossible loads before anything is written
        plan = {name: settings[name] for name in ("solves", "limit") if name in settings}
        load_rays(PeriodicCell(drawn, yarn.materials), **plan)  # type: ignore[arg-type]
    yarn.print_status()
    with results as folder:
        if not begun:
            if is_drawing(options.pattern) and not options.as_drawn:
                drawn = settled_drawing(drawn, yarn.materials)
            write_pattern(drawn, kept, yarns=yarn.materials)
        cell = PeriodicCell(read_pattern(kept), yarn.materials)
        outcome, _ = homogenize_into(
            cell, folder, workers=worker_count(options), resume=options.resume, dask=options.dask, **settings
        )  # fmt: skip
    summary, errors = outcome.summary, outcome.errors
    failed = summary.states - summary.converged + summary.pending
    lines = [
        f"{folder / 'material.json'}: {summary.converged} of {summary.states} states converged",
        f"  error of the stress at {errors.states} unseen states, each over its own size: median "
        f"{100 * errors.median:.2g} %, 95th percentile {100 * errors.high:.2g} %",
    ]
    missed = _friction_error(outcome)
    if missed is not None:
        lines.append(f"  friction {missed[0]:g}: its stress in cycles differs by {100 * missed[1]:.0f} % of its size")
    if summary.ended:
        lines.append(f"  {summary.ended} rays of loads ended early, where the fabric is unstable or rolls up")
    if summary.pending:
        lines.append(f"  {summary.pending} levels of load are left, since their workers died; --resume continues")
    found = {
        "states": summary.states, "converged": summary.converged, "pending": summary.pending,
        "rays_ended_early": summary.ended, "seconds": summary.seconds, "density": outcome.material.density,
        "stress_error_median": errors.median, "stress_error_95": errors.high,
        "material_file": str(folder / "material.json"),
    }  # fmt: skip
    if missed is not None:
        found |= {"friction": missed[0], "friction_error": missed[1]}
    report(options, yarn.summary | found, *lines, f"{folder / 'index.html'}: pictures and numbers")
    return 1 if failed else 0


def _friction_error(outcome: Homogenization) -> tuple[float, float] | None:
    """Coefficient of friction and error of its stress in cycles; None where the material has none."""
    material = outcome.material
    if not material.remembers:
        return None
    record: Any = material.provenance["friction"]
    return float(record["coefficient"]), float(record["error"])


def results_of_homogenize(path: Path, *, overwrite: bool = False, resume: bool = False) -> RunFolder:
    """The folder of a homogenized pattern."""
    stores = ("samples/", "unseen/", f"{FRICTION}/")
    pictures = ("cell", "tension", "bending", "terms", "stress", "errors")
    makes = (*stores, PATTERN, "material.json", "index.html", *(f"pictures/{name}.png" for name in pictures))
    return RunFolder(path, "homogenize", makes, overwrite=overwrite, resume=resume, goes_on_from=(*stores, PATTERN))


def homogenize_into(
    cell: PeriodicCell, folder: Path, *, workers: int, resume: bool, **settings: Any
) -> tuple[Homogenization, Section]:
    """Run the job; write ``material.json``, pictures and ``index.html`` into the folder. Also what its page says."""
    progress = ProgressLine(f"sampling {cell.pattern.name}").sampled
    outcome = run_homogenize(cell, folder, workers=workers, resume=resume, progress=progress, **settings)
    made = {"date": datetime.now(UTC).date().isoformat()} | _commit()
    provenance = {**outcome.material.provenance, "made": made}
    write_material(folder / "material.json", replace(outcome.material, provenance=provenance))
    pictures = [_view_of_cell(cell, folder), *draw_material(outcome, folder / "pictures")]
    section = _section(outcome, pictures)
    write_report(
        folder / "index.html",
        f"{cell.pattern.name}, homogenized",
        [section],
        summary=f"Yarn material {cell.material_name}; {outcome.summary.states} states solved.",
        facts={
            "states": outcome.summary.states,
            "converged": outcome.summary.converged,
            "solve time [s]": outcome.summary.seconds,
            "workers": outcome.summary.workers,
            "density [kg/m²]": outcome.material.density,
        },
    )
    return outcome, section


def _view_of_cell(cell: PeriodicCell, folder: Path) -> Picture:
    """The cell between its samples, and a picture of it at rest where the machine can draw."""
    from yarnscale.show.canvas import PicturesUnavailable
    from yarnscale.show.strained_pane import States, cell_pane

    states = States.stored(SampleStore(folder / "samples"), cell.pattern.woven)
    pane, still = cell_pane(cell, states, cell.pattern.name), writable_folder(folder / "pictures") / "cell.png"
    try:
        draw_cell(still, cell, None)
    except PicturesUnavailable:
        still = None
    return Picture(still, "The cell between its equilibria; drag to turn.", wide=True, pane=pane)


def _commit() -> dict[str, str]:
    """The commit of the checkout that the package is run from, if it is run from one."""
    root = Path(__file__).parents[3]
    if not (root / ".git").exists():
        return {}
    asked = ["git", "-C", str(root), "describe", "--always", "--dirty", "--abbrev=12"]
    with suppress(OSError):
        found = subprocess.run(asked, capture_output=True, text=True, check=False)
        return {"commit": found.stdout.strip()} if found.returncode == 0 else {}
    return {}


def draw_material(outcome: Homogenization, folder: Path) -> list[Picture]:
    """Tension and bending beside the samples; errors of the stress at unseen and at fitted states."""
    from yarnscale.show.material import PICTURES, TERMS, draw_curves, draw_terms
    from yarnscale.show.plots import error_histogram, stress_scatter

    folder = writable_folder(folder)
    scale = strain_units(outcome.samples.radius)
    groups, shares = {}, {}
    for name, states in (("fitted states", outcome.samples), ("unseen states", outcome.unseen)):
        if len(states.energies) == 0:
            continue
        norms, shares[name] = stress_errors(outcome.material.stress(states.strains), states.stresses, scale)
        groups[name] = norms, shares[name] * (norms + STRESS_FLOOR)
    stress_scatter(folder / "stress.png", groups, floor=STRESS_FLOOR)
    error_histogram(folder / "errors.png", shares, label="error of the stress over its size [%]")
    pictures = []
    if (outcome.samples.kinds == "tension").any():
        draw_curves(outcome.material, outcome.samples, folder)
        pictures = [Picture(folder / name, text, wide=True) for name, text in PICTURES.items()]
    if isinstance(outcome.material, SplineMaterial) and set(PLANES[:3]) & set(outcome.material.planes):
        draw_terms(outcome.material, outcome.samples, folder / TERMS)
        pictures = [Picture(folder / TERMS, "Terms of two in-plane strains (HYLC20 Fig. 13).", wide=True)]
    return [
        *pictures,
        Picture(folder / "stress.png", "Error of the stress over its size; lines at 1 and 6 %."),
        Picture(folder / "errors.png", "Relative error of the stress."),
    ]


def _section(outcome: Homogenization, pictures: list[Picture]) -> Section:
    """What a page says about a homogenized material."""
    errors = outcome.errors
    table = Table(
        ["unseen states", "median error [%]", "95th percentile [%]"],
        [[errors.states, 100 * errors.median, 100 * errors.high]],
        f"Error of the stress over its own size plus {STRESS_FLOOR:g} N/m (strains over 0.5, curvatures over 0.1 by "
        "the yarn radius), at states that the fit has not seen.",
    )
    text = ["One energy of one-sided springs, fitted to energies, stresses and moduli of cells under loads."]
    missed = _friction_error(outcome)
    if missed is not None:
        text.append(
            f"Friction of yarns {missed[0]:g}: its stress in cycles differs by {100 * missed[1]:.0f} % of its size."
        )
    if not isinstance(outcome.material, CompactMaterial):
        text = ["A sum of one- and two-dimensional splines (HYLC20 eq. 31–32)."]
    return Section("Shell material", text, [table], pictures)
