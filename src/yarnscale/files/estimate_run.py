"""Estimate the yarn of a fabric in one call; with a folder, evaluations are kept, and a killed run can continue."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from pathlib import Path

from yarnscale.checked import checked
from yarnscale.errors import InputError, notify
from yarnscale.estimate.evaluations import Evaluations
from yarnscale.estimate.measurements import Direction, SwatchMeasurements
from yarnscale.estimate.membrane_constants import ShellModel
from yarnscale.estimate.objective import ErrorWeights
from yarnscale.estimate.yarn_estimate import UNKNOWN_STIFFNESS, FabricEstimate, Follow, fit_fabric
from yarnscale.estimate.yarn_fit import FitOptions
from yarnscale.estimate.yarn_model import YarnModel, yarn_model
from yarnscale.files.estimate_folder import EstimateFolder, evaluation_folder
from yarnscale.files.measurements import read_measurements
from yarnscale.files.patterns import is_drawing, read_pattern, stitches_of
from yarnscale.yarn.pattern import YarnPattern

EVALUATIONS = "evaluations"
"""Folder of finished evaluations within that of an estimate."""
DRAWN_RADIUS = 0.4e-3
"""Radius of the yarn of a drawing of unknown size [m]: a hand-knitting yarn of about 400 tex in the fabric. Line loads
of fabrics of all sizes behave alike, so it changes the values of parameters and not the errors."""

Source = str | os.PathLike[str]


@checked
def estimate_yarn(
    measurements: SwatchMeasurements | Source,
    pattern: YarnModel | YarnPattern | Source,
    folder: Source | None = None,
    *,
    resume: bool = False,
    directions: Sequence[Direction] | None = None,
    holdout: Direction | None = None,
    follow: Follow = "measured",
    shell_model: ShellModel = "stiffening",
    options: FitOptions | None = None,
    weights: ErrorWeights | None = None,
    executor: Executor | None = None,
    progress: Callable[[Evaluations], None] | None = None,
) -> FabricEstimate:
    """Estimate the yarn with which a pattern has the measured tensile curves: fit a shell, remove the effect of the
    clamps, fit the yarn.

    pattern: see ``fabric_model``, which is called with its defaults unless a model is given. folder: for evaluations;
    resume: continue with those in it. executor: runs evaluations side by side. progress: called after every evaluation.
    Other arguments: see ``fit_fabric``. Raises InputError. Source: EST22.
    """
    if not isinstance(measurements, SwatchMeasurements):
        measurements = read_measurements(measurements)
    model = pattern if isinstance(pattern, YarnModel) else fabric_model(measurements, pattern)
    kept = None if folder is None else evaluation_folder(Path(folder) / EVALUATIONS, resume=resume)
    return fit_fabric(
        measurements, model, directions=directions, holdout=holdout, follow=follow, shell_model=shell_model,
        options=options, weights=weights, executor=executor, progress=progress,
        store=None if kept is None else lambda objective: EstimateFolder(kept, objective),
    )  # fmt: skip


@checked
def fabric_model(
    measurements: SwatchMeasurements,
    pattern: YarnPattern | Source,
    *,
    radius: float | None = None,
    yarn_length: float | None = None,
    stiffness: float | None = None,
    free_shape: bool | None = None,
) -> YarnModel:
    """The model of a measured fabric's yarn.

    pattern: as measured, or by name or file. radius: of the yarn of a built-in pattern or chart, whose size is unknown
    otherwise [m]; or yarn_length: of one period [m]. stiffness: k_s2 [N], by default as measured. free_shape: whether
    width over height, tightness and draw-in are estimated too, by default for built-in patterns and charts.
    What has to be assumed is an ``InputNotice``. Raises InputError.
    """
    named = not isinstance(pattern, YarnPattern)
    drawn, chart = named and is_drawing(pattern), stitches_of(pattern) if named else None
    shape = read_pattern(pattern) if named else pattern
    if radius is not None:
        if yarn_length is not None:
            raise InputError("radius", expected="none beside a yarn length, which decides the size")
        if not drawn:
            expected = "a built-in pattern, a chart or a draft, which are drawings"
            raise InputError("radius", expected=expected, found=shape.name)
        shape = shape.scaled(radius / shape.radius)
    elif drawn and yarn_length is None:
        shape = shape.scaled(DRAWN_RADIUS / shape.radius)
        notify(
            f"size of the fabric unknown: {shape.name} is drawn with a yarn of {1e3 * DRAWN_RADIUS:g} mm radius"
        )
    stiffness = stiffness or measurements.stiffest_yarn
    if stiffness is None:
        stiffness = UNKNOWN_STIFFNESS
        notify(f"stiffness of the yarn unknown: k_s2 is taken as {stiffness:g} N")
    return yarn_model(
        shape, stiffness, yarn_length=yarn_length, free_shape=drawn if free_shape is None else free_shape,
        stitches=None if chart is None else (chart.wales, chart.courses),
    )  # fmt: skip
