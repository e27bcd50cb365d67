"""The command ``estimate``: from measured swatches to the parameters of the yarn."""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable, Iterator
from concurrent.futures import Executor
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import Any

from yarnscale.cli.console import ProgressLine, plain_json, print_notice, report
from yarnscale.cli.materials import PATTERN
from yarnscale.cli.workers import worker_count
from yarnscale.errors import InputError
from yarnscale.files.atomic import write_text
from yarnscale.files.estimate_run import EVALUATING, EVALUATIONS, EstimateFolder, check_evaluations, fabric_model
from yarnscale.files.estimate_run import estimate as estimate_yarn
from yarnscale.files.fields import read_json
from yarnscale.files.fingerprint import code_fingerprint, fingerprint
from yarnscale.files.material_json import write_material
from yarnscale.files.material_toml import write_yarn_material
from yarnscale.files.measurements import fabric_files, read_measurements
from yarnscale.files.measurements_swatches import LogSettings
from yarnscale.files.patterns import write_pattern
from yarnscale.files.run_folder import RunFolder
from yarnscale.homogenize.executors import dask_workers, local_workers
from yarnscale.homogenize.rays import FEWEST
from yarnscale.laboratory.programme import FabricTests, run_tests
from yarnscale.swatches.cloth_check import ClothCheck, homogenized_swatches
from yarnscale.swatches.construction import KnownConstruction
from yarnscale.swatches.evaluations import Evaluations
from yarnscale.swatches.fabric_fit import check_bending, fitted_directions, refitted
from yarnscale.swatches.measurements import Direction, SwatchMeasurements
from yarnscale.swatches.objective import ErrorWeights
from yarnscale.swatches.uniform_cycle import check_unloading
from yarnscale.swatches.uniform_data import ERRORS
from yarnscale.swatches.yarn_estimate import FabricEstimate
from yarnscale.swatches.yarn_fit import FitOptions, work_ahead
from yarnscale.swatches.yarn_model import PUBLISHED_CONTACT, YarnModel

HOMOGENIZED = "homogenized"
"""Folder of the homogenized yarn within that of the report."""
ESTIMATE = "estimate.json"
ASKED = f"{EVALUATIONS}/asked.json"
"""Fingerprint of what a finished estimate was asked for."""
_NO_MATTER = ("measurements", "out", "overwrite", "resume", "json", "workers", "dask", "run", "default", "command")
"""Options that change no result, and what the parser adds."""
YARN = "yarn.toml"
"""The estimated yarn material."""
OTHER_CLAMPS = 0.05
"""Difference of stress by another effect of the clamps from which the yarn is fitted again."""
PUBLISHED = {"follow": "shell", "shell_model": "stvk", "shape": "drawn"}
"""Options that ``--solver paper`` stands for."""
COUNTS = {"wales": 1e2, "courses": 1e2, "loop_length": 1e-3, "tex": 1e-6, "area_density": 1e-3}
"""Option → factor to SI."""
MAKES = (
    f"{EVALUATIONS}/*.json", ESTIMATE, "index.html", "curves.png", "spread.png", "cell-*.png", PATTERN, YARN,
    f"{HOMOGENIZED}/",
)  # fmt: skip
"""All that the command writes."""


def estimate(options: argparse.Namespace) -> int:
    """Estimate the yarn of a fabric, or of every fabric of a folder, and write reports."""
    for name, value in PUBLISHED.items() if options.solver == "paper" else ():
        if (given := getattr(options, name)) not in (value, options.default(name)):
            raise InputError(f"--{name.replace('_', '-')}", expected=f"{value}, as --solver paper has it", found=given)
    if options.measurements.is_dir():
        return _every(options)
    found = _estimated(options, *_prepared(options))
    summary = found.summary()
    report(options, summary, *_lines(options.out, found))
    if not options.json:
        for warning in found.warnings:
            print_notice(f"warning: {warning}")
    return _status(options, summary)


def _status(options: argparse.Namespace, summary: dict[str, Any]) -> int:
    """1 where the yarn has states without equilibrium, or its friction was asked for and not found."""
    return int(summary["failed_states"] > 0 or (options.fit_friction and summary["friction"] is None))


def _every(options: argparse.Namespace) -> int:
    """Estimate every fabric of a folder into a folder of its name, and write a page that compares them.

    All files are read before the first estimate begins.
    """
    from yarnscale.show.estimates import write_estimates_page

    page = options.out / "index.html"
    if page.exists() and not (options.overwrite or options.resume):
        raise InputError("output exists", where=page, expected="a new folder, or --overwrite or --resume")
    runs = []
    for name, path in fabric_files(options.measurements).items():
        own = argparse.Namespace(**vars(options) | {"measurements": path, "out": options.out / name})
        own.resume = options.resume and (own.out / EVALUATIONS).is_dir()
        runs.append((name, own, _prepared(own)))
    summaries: dict[str, dict[str, Any]] = {}
    for name, own, prepared in runs:
        asked = _asked(own, *prepared)
        if (done := _done(own, asked)) is None:
            done = _estimated(own, *prepared).summary()
            write_text(own.out / ASKED, f'"{asked}"')
        summaries[name] = done
        write_estimates_page(page, summaries)
    lines = [
        f"{name}: comfort range {_percent(done['error']['comfort'])}, contraction "
        f"{_percent(done['error']['compression'])}"
        for name, done in summaries.items()
    ]
    report(options, {"fabrics": summaries}, *lines, f"{page}: all fabrics side by side")
    if not options.json:
        for name, done in summaries.items():
            for warning in done["warnings"]:
                print_notice(f"warning: {name}: {warning}")
    return max(_status(options, done) for done in summaries.values())


def _asked(options: argparse.Namespace, measurements: SwatchMeasurements, model: YarnModel) -> str:
    """What decides an estimate: curves, model, options and code."""
    chosen = {name: repr(value) for name, value in vars(options).items() if name not in _NO_MATTER}
    return fingerprint(measurements, model, chosen) + code_fingerprint(
        *EVALUATING, "homogeneous", "homogenize", "shell"
    )


def _done(options: argparse.Namespace, asked: str) -> dict[str, Any] | None:
    """What an earlier run of the same came to its end with, where it is resumed."""
    path, mark = options.out / ESTIMATE, options.out / ASKED
    if not (options.resume and path.is_file() and mark.is_file()):
        return None
    return read_json(path) if mark.read_text(encoding="utf-8") == f'"{asked}"' else None


def _prepared(options: argparse.Namespace) -> tuple[SwatchMeasurements, YarnModel]:
    """What was measured, and the model of the yarn; all that can be wrong with either is found here."""
    length, width = options.swatch or (None, None)
    settings = LogSettings(swatch_length=length, swatch_width=width)
    measurements = read_measurements(options.measurements, sample=options.sample, settings=settings)
    given = {name: value * factor for name, factor in COUNTS.items() if (value := getattr(options, name)) is not None}
    measurements = measurements.knowing(
        KnownConstruction(**{"yarn_count" if name == "tex" else name: value for name, value in given.items()})
    )
    for note in measurements.notes:
        print_notice(note)
    published = options.solver == "paper"
    if published:
        vars(options).update(PUBLISHED)
    model = fabric_model(
        measurements, _pattern(options, measurements), radius=options.radius, yarn_length=options.yarn_length,
        stiffness=options.stiffness, free_shape=None if options.shape is None else options.shape == "free",
    )  # fmt: skip
    if published:
        model = replace(model, stiffest_contact=PUBLISHED_CONTACT)
    if options.homogenize is not None and options.homogenize < FEWEST:
        raise InputError("--homogenize", expected=f"at least {FEWEST}", found=options.homogenize)
    fitted = fitted_directions(measurements, *_directions(options))
    if options.fit_friction:
        check_unloading(measurements.only(*fitted))
    check_bending(measurements, ErrorWeights(bending=options.bending_weight))
    return measurements, model


def _directions(options: argparse.Namespace) -> tuple[list[Direction] | None, Direction | None]:
    """Those to fit, None for all, and the one that is held out."""
    chosen = None if options.directions is None else [Direction(name) for name in options.directions]
    return chosen, None if options.holdout is None else Direction(options.holdout)


def _pattern(options: argparse.Namespace, measurements: SwatchMeasurements) -> str:
    """The pattern of the command line, else of the fabric file: a file beside it, or a name."""
    if options.pattern is not None:
        return options.pattern
    if measurements.pattern is None:
        expected = "a pattern here or in the fabric file"
        raise InputError("--pattern", where=options.measurements, expected=expected, found="none")
    beside = options.measurements.parent / measurements.pattern
    return str(beside) if beside.is_file() else measurements.pattern


def _estimated(options: argparse.Namespace, measurements: SwatchMeasurements, model: YarnModel) -> FabricEstimate:
    """Estimate the yarn into its folder."""
    search = FitOptions(options.solver, options.seed, options.starts, options.refined, iterations=options.iterations)
    chosen, holdout = _directions(options)
    if options.resume:
        check_evaluations(options.out / EVALUATIONS)
    results = RunFolder(
        options.out, "estimate", MAKES, overwrite=options.overwrite, resume=options.resume,
        goes_on_from=(f"{EVALUATIONS}/*.json", f"{HOMOGENIZED}/"),
    )  # fmt: skip
    with ExitStack() as stack:
        # Before the folder, which stays untouched where there are no workers.
        executor = None
        if options.dask is not None:
            executor = stack.enter_context(dask_workers(options.dask, on_notice=print_notice))
        elif worker_count(options) > 1:
            executor = stack.enter_context(local_workers(worker_count(options)))
        folder = stack.enter_context(results)
        found = estimate_yarn(
            measurements, model, folder, resume=options.resume, directions=chosen, holdout=holdout,
            follow=options.follow, shell_model=options.shell_model, friction=options.fit_friction, options=search,
            weights=ErrorWeights(bending=options.bending_weight),
            executor=executor,
            progress=_progress(measurements.name, work_ahead(search, len(model.names))),
            on_cycle=_cycling(measurements.name),
        )  # fmt: skip
        found = replace(found, tests=_tested(found))
        _write(options, found)  # before what takes long and may fail
        if options.homogenize is not None:
            found = _as_cloth(options, found, executor)
            _write(options, found)
    return found


def _as_cloth(options: argparse.Namespace, found: FabricEstimate, executor: Executor | None) -> FabricEstimate:
    """The estimate with the swatches as cloth; of a yarn fitted again where clamps hold that cloth in another way.

    The better cloth counts.
    """
    place = options.out / HOMOGENIZED
    found = replace(found, cloth=_homogenized(options, place, found))
    if found.cloth is None or options.follow != "measured" or found.clamp_difference < OTHER_CLAMPS:
        return found
    print_notice(
        f"in cloth of this yarn clamps change the force by up to {100 * found.clamp_difference:.0f} % more or less "
        "than the shell said: the yarn is fitted again"
    )
    ahead = work_ahead(replace(found.fit.options, solver="local"), len(found.fit.model.names))
    again = refitted(
        found, weights=ErrorWeights(bending=options.bending_weight), executor=executor,
        store=lambda objective: EstimateFolder(options.out / EVALUATIONS, objective),
        progress=_progress(found.measurements.name, ahead), on_cycle=_cycling(found.measurements.name),
    )  # fmt: skip
    again = replace(again, cloth=_homogenized(options, place / "refitted", again))
    if again.cloth is None or not again.cloth.errors.comfort < found.cloth.errors.comfort:
        print_notice("its cloth is no nearer to the measured swatches: the first yarn stays")
        return found
    write_material(place / "material.json", again.cloth.material)
    return replace(again, tests=_tested(again))


def _tested(found: FabricEstimate) -> FabricTests | None:
    """Laboratory numbers of the fabric at rest, if it has a rest shape."""
    if not found.fit.evaluation.rested.relaxed:
        return None
    name = found.measurements.name
    return run_tests(found.cell, name=name, progress=ProgressLine(f"testing {name}").show)


def _homogenized(options: argparse.Namespace, folder: Path, found: FabricEstimate) -> ClothCheck | None:
    """The swatches as cloth of the estimated yarn; None where that has no rest shape."""
    if not found.fit.evaluation.rested.relaxed:
        print_notice("the estimated yarn has no fabric at rest: it is not homogenized")
        return None
    folder.mkdir(exist_ok=True)
    check = homogenized_swatches(
        found.cell, found.measurements, folder, friction=found.friction, solves=options.homogenize,
        workers=worker_count(options),
        dask=options.dask, resume=options.resume and (folder / "samples").is_dir(),
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


def _cycling(name: str) -> Callable[[float], None]:
    line = ProgressLine(f"friction of {name}")
    return lambda coefficient: line.note(f"loading and unloading with {coefficient:.3g}")


def _write(options: argparse.Namespace, found: FabricEstimate) -> None:
    """The yarn, the page and the numbers."""
    folder, units = options.out, options.units
    write_pattern(found.cell.pattern, folder / PATTERN, yarns=found.cell.material)
    write_yarn_material(found.cell.materials[0], folder / YARN)
    try:
        from yarnscale.show.canvas import PicturesUnavailable
        from yarnscale.show.estimate import write_estimate_report

        try:
            write_estimate_report(folder, found, units=units)
        except PicturesUnavailable as error:
            print_notice(f"no pictures of the cell: {error}")
            write_estimate_report(folder, found, units=units, pictures=False)
    finally:
        write_text(folder / ESTIMATE, plain_json(found.summary(), indent=1) + "\n")


def _lines(folder: Path, found: FabricEstimate) -> Iterator[str]:
    """What the console says of an estimate."""
    fit = found.fit
    yield f"yarn of {found.measurements.name}, {fit.evaluations} tried with {fit.solves} equilibria:"
    for name in fit.model.names:
        value = found.parameters[name]
        yield f"  {name:<12}{value:.4g}{'   at the end of its range' if name in fit.at_bounds else ''}"
    for name, errors, failed in found.error_rows():
        said = ", ".join(f"{what} {_percent(getattr(errors, name))}" for name, what in ERRORS.items())
        yield f"  {name}: {said}" + (f", without {failed} states that are not at rest" if failed else "")
    if (deviation := found.deviation) is not None:
        yield f"  {deviation}"
    if (friction := found.friction) is not None:
        yield f"  friction {friction.coefficient:.3g} ± {friction.uncertainty:.2g}"
        for cycle, own in friction.pairs:
            yield (
                f"  work returned along {cycle.direction.value}: {_percent(own.returned)}, measured "
                f"{_percent(cycle.returned)}"
            )
    for direction, (own, measured) in found.bending.items():
        yield f"bending rigidity along {direction.value}: {1e6 * own:.3g} µN m, measured {1e6 * measured:.3g}"
    if found.fit.evaluation.rested.relaxed:
        yield f"{folder / PATTERN}: the fabric at rest with this yarn; {folder / YARN}: the yarn alone"
    yield f"{folder / 'index.html'}: the report"


def _percent(value: float | None) -> str:
    if value is None:
        return "not measured"
    return f"{100 * value:.1f} %" if math.isfinite(value) else "unknown"
