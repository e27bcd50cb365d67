"""From the measurements of a fabric and its pattern to an estimated yarn, in one call (EST22 as a whole)."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from dataclasses import replace

import numpy as np

from yarnscale.errors import InputError
from yarnscale.swatches.cloth_check import check_cloth, without_own_clamps
from yarnscale.swatches.evaluations import Evaluations, Store, evaluate
from yarnscale.swatches.fabric_shell import fit_shell
from yarnscale.swatches.measurements import Direction, SwatchMeasurements
from yarnscale.swatches.membrane_constants import ShellModel
from yarnscale.swatches.objective import ErrorWeights, Evaluation, YarnObjective
from yarnscale.swatches.uniform_cycle import check_unloading, measured_cycles
from yarnscale.swatches.uniform_data import UniformData, swatch_data
from yarnscale.swatches.yarn_estimate import FabricEstimate, Follow
from yarnscale.swatches.yarn_fit import FitOptions, YarnFit, fit_yarn
from yarnscale.swatches.yarn_friction import USUAL, fit_friction
from yarnscale.swatches.yarn_model import YarnModel

_ROUNDS, _STILL = 3, 0.03
"""How often a yarn is fitted again without the friction that was found, and change of it, relative, that is none."""
_WORK = ("evaluations", "solves", "cpu_seconds", "seconds")
"""Of a fit."""


def fit_fabric(
    measurements: SwatchMeasurements,
    model: YarnModel,
    *,
    directions: Sequence[Direction] | None = None,
    holdout: Direction | None = None,
    follow: Follow = "measured",
    shell_model: ShellModel = "stiffening",
    friction: bool = False,
    options: FitOptions | None = None,
    weights: ErrorWeights | None = None,
    executor: Executor | None = None,
    store: Callable[[YarnObjective], Store] | None = None,
    progress: Callable[[Evaluations], None] | None = None,
    on_cycle: Callable[[float], None] | None = None,
) -> FabricEstimate:
    """Fit the shell, translate to uniform data, fit the yarn, and predict the direction that was held out.

    directions: those to fit, all measured ones by default, but for ``holdout``. follow: what the yarn follows, see
    ``FabricShell.uniform_data``; shell_model: see ``fit_shell``. friction: whether that of the yarns is fitted, too
    (``fit_with_friction``). on_cycle: called with the coefficient before every simulated cycle with friction.

    Raises InputError for directions that were not measured, for a weight of bending
    where neither loops nor strips were bent, and for friction where nothing was unloaded.
    """
    fitted = fitted_directions(measurements, directions, holdout)
    check_bending(measurements, weights)
    if friction:
        check_unloading(measurements.only(*fitted))
    shell = fit_shell(measurements.only(*fitted), model=shell_model)
    data = shell.uniform_data(follow=follow)
    fit = fit_yarn(model, data, options=options, weights=weights, executor=executor, store=store, progress=progress)
    measured = shell.uniform_data(follow="measured")
    held_out = None
    if holdout is not None:
        held_out = fit_shell(measurements, model=shell_model).uniform_data(follow="measured").only(holdout)
    prediction = _predicted(fit, held_out)
    short = None
    if shell.measurements.short:
        strips = replace(shell.measurements, stretch=shell.measurements.short)
        short = check_cloth(shell.membrane.material, strips)
    found = FabricEstimate(measurements, follow, shell, fit, measured, held_out, prediction, short)
    if not friction:
        return found
    return fit_with_friction(
        found, weights=weights, executor=executor, store=store, progress=progress, on_cycle=on_cycle
    )


def fit_with_friction(
    estimate: FabricEstimate,
    *,
    guess: float | None = None,
    weights: ErrorWeights | None = None,
    executor: Executor | None = None,
    store: Callable[[YarnObjective], Store] | None = None,
    progress: Callable[[Evaluations], None] | None = None,
    on_cycle: Callable[[float], None] | None = None,
) -> FabricEstimate:
    """The estimate with friction of its yarn, from loading and unloading together.

    In turn the cell of the yarn gets the friction with which it returns as much work as was measured, and the yarn is
    fitted, from the last one by Gauss–Newton, to the measured curves times the cell's ratio of stress without friction
    to that with it on loading; until the coefficient changes by less than 3 %. guess: the coefficient without whose
    part the yarn was fitted, if any. on_cycle: see ``fit_fabric``. Where the cell cannot follow the measured cycle, the
    last estimate whose cell can is returned, or else this one, with a remark.
    """
    measured, last, kept = measured_cycles(estimate.measurements, estimate.measured), guess, None
    for rounds in range(_ROUNDS + 1):
        began = time.process_time(), time.perf_counter()
        evaluation, ahead, found = estimate.fit.evaluation, estimate.prediction, None
        if evaluation.rested.relaxed:
            elastic = (*evaluation.curves, *(() if ahead is None else ahead.curves))
            found = fit_friction(
                evaluation.rested.cell, measured, elastic, guess=USUAL if last is None else last, on_cycle=on_cycle
            )
        cycling = time.process_time() - began[0], time.perf_counter() - began[1]
        spent = replace(
            estimate.fit, cpu_seconds=estimate.fit.cpu_seconds + cycling[0], seconds=estimate.fit.seconds + cycling[1]
        )
        estimate = replace(estimate, fit=spent)
        if found is None:
            return _without_cycle(estimate, kept)
        kept = replace(estimate, friction=replace(found, rounds=rounds))
        change = np.inf if last is None else abs(found.coefficient / last - 1.0)
        if change <= _STILL or rounds == _ROUNDS:
            break
        last = found.coefficient
        fit = fit_yarn(
            estimate.fit.model, found.removed_from(estimate.target), options=estimate.fit.options, weights=weights,
            executor=executor, store=store, progress=progress, start=evaluation.unknowns,
        )  # fmt: skip
        fit = _with_work_of(fit, estimate.fit)
        estimate = replace(estimate, fit=fit, prediction=_predicted(fit, estimate.held_out))
    assert kept is not None
    return kept


def _without_cycle(estimate: FabricEstimate, kept: FabricEstimate | None) -> FabricEstimate:
    """What is returned where the cell of an estimate cannot follow the measured cycle; kept: the last that could."""
    what = "the cell of the yarn cannot follow the measured cycle with friction"
    if kept is None:
        remark = f"{what}: friction was not fitted, and is a part of the yarn's stiffness"
        return replace(estimate, remarks=(*estimate.remarks, remark))
    remark = f"{what} after the yarn was fitted again without it: yarn and friction are those before"
    fit = replace(kept.fit, **{name: getattr(estimate.fit, name) for name in _WORK})
    return replace(kept, fit=fit, remarks=(*kept.remarks, remark))


def _with_work_of(fit: YarnFit, before: YarnFit) -> YarnFit:
    """A fit that counts the work of the ones before, too."""
    return replace(fit, **{name: getattr(fit, name) + getattr(before, name) for name in _WORK})


def refitted(
    estimate: FabricEstimate,
    *,
    weights: ErrorWeights | None = None,
    executor: Executor | None = None,
    store: Callable[[YarnObjective], Store] | None = None,
    progress: Callable[[Evaluations], None] | None = None,
    on_cycle: Callable[[float], None] | None = None,
) -> FabricEstimate:
    """The yarn fitted again, with the effect of the clamps that its own cloth has: Gauss–Newton from the first fit.

    The effect of the clamps of short, wide swatches on a shell depends on constants that swatches do not determine.
    Raises InputError without cloth.
    """
    if estimate.cloth is None:
        raise InputError("refitted yarn", expected="an estimate with cloth", found="none")
    first, friction = estimate.fit, estimate.friction
    clean = without_own_clamps(estimate.cloth, swatch_data(estimate.measurements))
    data = replace(
        clean.only(*(curve.direction for curve in estimate.measured.curves)), bending=estimate.measured.bending
    )
    run = {"weights": weights, "executor": executor, "store": store, "progress": progress}
    target = data if friction is None else friction.removed_from(data)
    fit = fit_yarn(first.model, target, options=first.options, start=first.evaluation.unknowns, **run)
    held = estimate.held_out and clean.only(*(curve.direction for curve in estimate.held_out.curves))
    found = replace(
        estimate, fit=fit, measured=data, held_out=held, prediction=_predicted(fit, held), cloth=None, tests=None,
        clamps="cloth", friction=None, remarks=estimate.remarks if friction is None else (),
    )  # fmt: skip
    if friction is None:
        return found
    return fit_with_friction(found, guess=friction.coefficient, on_cycle=on_cycle, **run)


def _predicted(fit: YarnFit, held_out: UniformData | None) -> Evaluation | None:
    """What the yarn does in the directions that were held out."""
    if held_out is None:
        return None
    return evaluate(YarnObjective(fit.model, held_out), fit.evaluation.unknowns, None)


def fitted_directions(
    measurements: SwatchMeasurements, directions: Sequence[Direction] | None, holdout: Direction | None
) -> list[Direction]:
    """The directions that ``fit_fabric`` would fit. InputError where one was not measured or none is left."""
    measured = [test.direction for test in measurements.stretch]
    wanted = list(measured if directions is None else directions)
    for direction in wanted + ([] if holdout is None else [holdout]):
        if direction not in measured:
            raise InputError(
                "direction", expected="measured: " + ", ".join(d.value for d in measured), found=direction.value
            )
    left = [direction for direction in wanted if direction is not holdout]
    if not left:
        raise InputError("directions to fit", expected="one that is not held out", found="none")
    return left


def check_bending(measurements: SwatchMeasurements, weights: ErrorWeights | None) -> None:
    """InputError where bending is to weigh but no pear loops were measured."""
    if weights is not None and weights.bending > 0 and not (measurements.bend or measurements.rigidity):
        expected = "measured pear loops or bent strips"
        raise InputError("weight of bending", where=measurements.name, expected=expected, found="none")
