"""From the measurements of a fabric and its pattern to an estimated yarn, in one call (EST22 as a whole)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from yarnscale.errors import InputError
from yarnscale.estimate.evaluations import Evaluations, Store, evaluate
from yarnscale.estimate.fabric_shell import FabricShell, fit_shell
from yarnscale.estimate.measurements import Direction, SwatchMeasurements
from yarnscale.estimate.objective import ErrorWeights, Evaluation, YarnObjective
from yarnscale.estimate.uniform_data import UniformBend, UniformData
from yarnscale.estimate.yarn_bending import bending_stiffness
from yarnscale.estimate.yarn_fit import FitOptions, YarnFit, fit_yarn
from yarnscale.estimate.yarn_model import YarnModel
from yarnscale.estimate.yarn_rest import RestRule

Array = NDArray[np.float64]

UNKNOWN_STIFFNESS = 60.0
"""k_s2 where the yarn's stiffness at 5 cN was not measured [N]: a spun hand-knitting yarn, to a factor of three.
Fabrics stretch by their loops' bending and sliding long before such a yarn gives, so that little depends on it."""


@dataclass(frozen=True, eq=False)
class FabricEstimate:
    """The estimated yarn of a fabric.

    shell: fitted to the directions that the yarn was fitted to. held_out: data of the others, and what the yarn does
    there; None where there are none. bending: errors of the bending stiffness by direction, as fractions.
    """

    measurements: SwatchMeasurements
    shell: FabricShell
    fit: YarnFit
    held_out: UniformData | None
    prediction: Evaluation | None
    bending: dict[Direction, float]

    def summary(self) -> dict[str, object]:
        """The numbers that the command prints."""
        errors, fit = self.fit.evaluation.errors, self.fit
        found: dict[str, object] = {
            "parameters": dict(zip(fit.model.names, fit.values.tolist(), strict=True))
            | {"k_s2": fit.model.stiffness, "R_est": fit.model.pattern.radius},
            "comfort_error": errors.comfort,
            "power_error": errors.full,
            "compression_error": errors.compression,
            "bending_error": float(np.mean(list(self.bending.values()))) if self.bending else None,
            "shell_error": self.shell.membrane.load_error,
            "solves": fit.solves,
            "seconds": fit.seconds + self.shell.membrane.seconds,
            "evaluations": fit.evaluations,
            "cpu_seconds": fit.cpu_seconds,
            "failed_states": fit.evaluation.failed,
            "at_bounds": list(fit.at_bounds),
            "period": fit.evaluation.rested.cell.pattern.period.tolist(),
        }
        if self.prediction is not None and self.held_out is not None:
            ahead = self.prediction.errors
            found["held_out"] = {
                "directions": [curve.direction.value for curve in self.held_out.curves],
                "comfort_error": ahead.comfort,
                "power_error": ahead.full,
                "compression_error": ahead.compression,
            }
        return found


def estimate_yarn(
    measurements: SwatchMeasurements,
    model: YarnModel,
    *,
    directions: Sequence[Direction] | None = None,
    holdout: Direction | None = None,
    follow: Literal["shell", "measured"] = "shell",
    options: FitOptions | None = None,
    rule: RestRule | None = None,
    weights: ErrorWeights | None = None,
    executor: Executor | None = None,
    store: Callable[[YarnObjective], Store] | None = None,
    told: Callable[[Evaluations], None] | None = None,
) -> FabricEstimate:
    """Fit the shell, translate to uniform data, fit the yarn, and predict the direction that was held out.

    directions: those to fit, all measured ones by default, but for ``holdout``. follow: what the yarn follows, see
    ``FabricShell.uniform_data``. Raises InputError for directions that were not measured, and for a weight of bending
    where no loops were.
    """
    fitted = fitted_directions(measurements, directions, holdout)
    check_bending(measurements, weights)
    shell = fit_shell(measurements.only(*fitted))
    data = shell.uniform_data(follow=follow)
    fit = fit_yarn(
        model, data, options=options, rule=rule, weights=weights, executor=executor, store=store, told=told
    )
    held_out, prediction = None, None
    if holdout is not None:
        held_out = fit_shell(measurements).uniform_data(follow=follow).only(holdout)
        unknowns = fit.evaluation.unknowns
        prediction = evaluate(YarnObjective(model, held_out, rule or RestRule()), unknowns, None)
    return FabricEstimate(measurements, shell, fit, held_out, prediction, _bending(fit, data.bending))


def fitted_directions(
    measurements: SwatchMeasurements, directions: Sequence[Direction] | None, holdout: Direction | None
) -> list[Direction]:
    """The directions that ``estimate_yarn`` would fit. InputError where one was not measured or none is left."""
    measured = [test.direction for test in measurements.stretch]
    wanted = list(measured if directions is None else directions)
    for direction in wanted + ([] if holdout is None else [holdout]):
        if direction not in measured:
            raise InputError(
                "direction",
                expected="measured: " + ", ".join(d.value for d in measured),
                found=direction.value,
            )
    left = [direction for direction in wanted if direction is not holdout]
    if not left:
        raise InputError("directions to fit", expected="one that is not held out", found="none")
    return left


def check_bending(measurements: SwatchMeasurements, weights: ErrorWeights | None) -> None:
    """InputError where bending is to weigh but no pear loops were measured."""
    if weights is not None and weights.bending > 0 and not measurements.bend:
        raise InputError(
            "weight of bending", where=measurements.name, expected="measured pear loops", found="none"
        )


def _bending(fit: YarnFit, measured: Sequence[UniformBend]) -> dict[Direction, float]:
    """|stiffness of the cell / measured − 1| by direction."""
    if not measured or not fit.evaluation.rested.relaxed:
        return {}
    stiffness = bending_stiffness(fit.evaluation.rested.cell, [bend.direction for bend in measured])
    return {
        bend.direction: abs(float(k) / bend.stiffness - 1.0)
        for bend, k in zip(measured, stiffness, strict=True)
        if np.isfinite(k)
    }
