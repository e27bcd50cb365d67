"""The command ``estimate``: from measured swatches to the parameters of the yarn."""

from __future__ import annotations

import argparse
import json
import math
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path

from yarnscale.cli.console import ProgressLine, report, say
from yarnscale.cli.materials import PATTERN, worker_count
from yarnscale.errors import InputError
from yarnscale.files.atomic import write_text
from yarnscale.files.estimate_folder import check_resumable
from yarnscale.files.estimate_run import EVALUATIONS, fabric_model
from yarnscale.files.estimate_run import estimate as estimate_yarn
from yarnscale.files.material_json import write_material
from yarnscale.files.material_toml import write_material as write_yarn
from yarnscale.files.measurements import read_measurements
from yarnscale.files.measurements_swatches import LogSettings
from yarnscale.files.patterns import write_pattern
from yarnscale.files.run_folder import RunFolder
from yarnscale.homogenize.executors import dask_workers, local_workers
from yarnscale.homogenize.rays import FEWEST
from yarnscale.swatches.cloth_check import ClothCheck, homogenized_swatches
from yarnscale.swatches.construction import KnownConstruction
from yarnscale.swatches.evaluations import Evaluations
from yarnscale.swatches.measurements import Direction
from yarnscale.swatches.objective import ErrorWeights
from yarnscale.swatches.yarn_estimate import FabricEstimate, check_bending, fitted_directions
from yarnscale.swatches.yarn_fit import FitOptions, work_ahead
from yarnscale.swatches.yarn_model import PUBLISHED_CONTACT

HOMOGENIZED = "homogenized"
"""Folder of the homogenized yarn within that of the report."""
YARN = "yarn.toml"
"""The estimated yarn material."""
COUNTS = {"wales": 1e2, "courses": 1e2, "loop_length": 1e-3, "tex": 1e-6, "area_density": 1e-3}
"""Option → factor to SI."""
MAKES = (
    f"{EVALUATIONS}/*.json", "estimate.json", "index.html", "curves.png", "spread.png", "cell-*.png", PATTERN, YARN,
    f"{HOMOGENIZED}/",
)  # fmt: skip
"""All that the command writes."""


def estimate(options: argparse.Namespace) -> int:
    """Estimate a yarn and write the report."""
    length, width = options.swatch or (None, None)
    settings = LogSettings(swatch_length=length, swatch_width=width)
    measurements = read_measurements(options.measurements, sample=options.sample, settings=settings)
    given = {
        name: value * factor
        for name, factor in COUNTS.items()
        if (value := getattr(options, name)) is not None
    }
    measurements = measurements.knowing(
        KnownConstruction(**{"yarn_count" if name == "tex" else name: value for name, value in given.items()})
    )
    for note in measurements.notes:
        _say(note)
    published = options.solver == "paper"
    if published:
        options.follow, options.shell_model, options.shape = "shell", "stvk", "drawn"
    model = fabric_model(
        measurements, options.pattern, radius=options.radius, yarn_length=options.yarn_length,
        stiffness=options.stiffness, free_shape=None if options.shape is None else options.shape == "free",
    )  # fmt: skip
    if published:
        model = replace(model, stiffest_contact=PUBLISHED_CONTACT)
    search = FitOptions(
        options.solver, options.seed, options.starts, options.refined, iterations=options.iterations
    )
    weights = ErrorWeights(bending=options.bending_weight)
    chosen = None if options.directions is None else [Direction(name) for name in options.directions]
    holdout = None if options.holdout is None else Direction(options.holdout)
    if options.homogenize is not None and options.homogenize < FEWEST:
        raise InputError("--homogenize", expected=f"at least {FEWEST}", found=options.homogenize)
    fitted_directions(measurements, chosen, holdout)
    check_bending(measurements, weights)
    if options.resume:
        check_resumable(options.out / EVALUATIONS)
    results = RunFolder(
        options.out, "estimate", MAKES, overwrite=options.overwrite, resume=options.resume,
        goes_on_from=(f"{EVALUATIONS}/*.json", f"{HOMOGENIZED}/"),
    )  # fmt: skip
    with ExitStack() as stack:
        # Before the folder, which stays untouched where there are no workers.
        executor = None
        if options.dask is not None:
            executor = stack.enter_context(dask_workers(options.dask, on_notice=_say))
        elif worker_count(options) > 1:
            executor = stack.enter_context(local_workers(worker_count(options)))
        folder = stack.enter_context(results)
        found = estimate_yarn(
            measurements, model, folder, resume=options.resume, directions=chosen, holdout=holdout,
            follow=options.follow, shell_model=options.shell_model, options=search, weights=weights,
            executor=executor,
            progress=_progress(measurements.name, work_ahead(search, len(model.names))),
        )  # fmt: skip
        write_pattern(found.cell.pattern, folder / PATTERN, yarns=found.cell.material)
        write_yarn(found.cell.materials[0], folder / YARN)
        _write(folder, found)  # before what takes long and may fail
        if options.homogenize is not None:
            found = replace(found, cloth=_homogenized(options, folder / HOMOGENIZED, found))
            _write(folder, found)
        report(options, found.summary(), *_lines(folder, found))
        if not options.json:
            for warning in found.warnings:
                _say(f"warning: {warning}")
    return 0 if found.fit.evaluation.failed == 0 else 1


def _homogenized(options: argparse.Namespace, folder: Path, found: FabricEstimate) -> ClothCheck | None:
    """The swatches as cloth of the estimated yarn; None where that has no rest shape."""
    if not found.fit.evaluation.rested.relaxed:
        _say("the estimated yarn has no fabric at rest: it is not homogenized")
        return None
    folder.mkdir(exist_ok=True)
    check = homogenized_swatches(
        found.cell, found.measurements, folder, solves=options.homogenize, workers=worker_count(options),
        dask=options.dask, resume=options.resume,
        progress=ProgressLine(f"sampling yarn of {found.measurements.name}").sampled,
    )  # fmt: skip
    write_material(folder / "material.json", check.material)
    return check


def _progress(name: str, ahead: int) -> Callable[[Evaluations], None]:
    line = ProgressLine(f"yarn of {name}")

    def show(evaluations: Evaluations) -> None:
        best = "" if evaluations.best is None else f"objective {evaluations.best[0]:.4f}"
        line.show(evaluations.count, max(ahead, evaluations.count + 1), best)

    return show


def _write(folder: Path, found: FabricEstimate) -> None:
    """Page and numbers."""
    try:
        from yarnscale.show.canvas import PicturesUnavailable
        from yarnscale.show.estimate import write_estimate_report

        try:
            write_estimate_report(folder, found)
        except PicturesUnavailable as error:
            _say(f"no pictures of the cell: {error}")
            write_estimate_report(folder, found, pictures=False)
    finally:
        write_text(folder / "estimate.json", json.dumps(found.summary(), indent=1) + "\n")


def _lines(folder: Path, found: FabricEstimate) -> Iterator[str]:
    """What the console says of an estimate."""
    fit = found.fit
    yield f"yarn of {found.measurements.name}, {fit.evaluations} tried with {fit.solves} equilibria:"
    for name in fit.model.names:
        value = found.parameters[name]
        yield f"  {name:<12}{value:.4g}{'   at the end of its range' if name in fit.at_bounds else ''}"
    for name, errors, failed in found.error_rows():
        values = {
            "comfort range": errors.comfort,
            "full range": errors.full,
            "contraction": errors.compression,
        }
        said = ", ".join(f"{what} {_percent(value)}" for what, value in values.items())
        yield f"  {name}: {said}" + (f", without {failed} states that are not at rest" if failed else "")
    if (deviation := found.deviation) is not None:
        yield f"  {deviation}"
    for direction, (own, measured) in found.bending.items():
        yield f"bending rigidity along {direction.value}: {1e6 * own:.3g} µN m, measured {1e6 * measured:.3g}"
    if found.fit.evaluation.rested.relaxed:
        yield f"{folder / PATTERN}: the fabric at rest with this yarn; {folder / YARN}: the yarn alone"
    yield f"{folder / 'index.html'}: the report"


def _percent(value: float | None) -> str:
    if value is None:
        return "not measured"
    return f"{100 * value:.1f} %" if math.isfinite(value) else "unknown"


def _say(said: str) -> None:
    say(f"yarnscale: {said}")
