"""Estimate the yarn of a fabric in one call; with a folder, evaluations are kept, one small file each, and a killed run
can continue."""

from __future__ import annotations

import hashlib
import json
import math
import os
from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from dataclasses import replace
from pathlib import Path

import numpy as np

from yarnscale.arrays import Array
from yarnscale.checked import checked
from yarnscale.errors import InputError, notify
from yarnscale.files.atomic import write_text
from yarnscale.files.fingerprint import code_fingerprint, fingerprint
from yarnscale.files.measurements import read_measurements
from yarnscale.files.patterns import is_drawing, read_pattern, stitches_of
from yarnscale.files.run_folder import writable_folder
from yarnscale.swatches.evaluations import Evaluations, Residuals
from yarnscale.swatches.fabric_fit import fit_fabric
from yarnscale.swatches.measurements import POWER_LOAD, Direction, SwatchMeasurements
from yarnscale.swatches.membrane_constants import ShellModel
from yarnscale.swatches.objective import ErrorWeights, YarnObjective
from yarnscale.swatches.yarn_estimate import UNKNOWN_STIFFNESS, FabricEstimate, Follow
from yarnscale.swatches.yarn_fit import FitOptions
from yarnscale.swatches.yarn_model import YarnModel, yarn_model
from yarnscale.yarn.pattern import YarnPattern

EVALUATING = ("numerics", "yarn", "cell", "swatches", "kinematics.py")
"""Code that an evaluation depends on."""
EVALUATIONS = "evaluations"
"""Folder of finished evaluations within that of an estimate."""
_LEAST_LOAD, _LEAST_STRETCH = 1.0, 0.02
"""Smallest largest load of a test [N/m], and smallest stretch of a knit at the end of the power range."""
DRAWN_RADIUS = 0.4e-3
"""Radius of the yarn of a drawing of unknown size [m]: a hand-knitting yarn of about 400 tex in the fabric. Line loads
of fabrics of all sizes behave alike, so it changes the values of parameters and not the errors."""

Source = str | os.PathLike[str]


@checked
def estimate(
    measurements: SwatchMeasurements | Source,
    pattern: YarnModel | YarnPattern | Source,
    folder: Source | None = None,
    *,
    resume: bool = False,
    directions: Sequence[Direction] | None = None,
    holdout: Direction | None = None,
    follow: Follow = "measured",
    shell_model: ShellModel = "stiffening",
    friction: bool = False,
    options: FitOptions | None = None,
    weights: ErrorWeights | None = None,
    executor: Executor | None = None,
    progress: Callable[[Evaluations], None] | None = None,
    on_cycle: Callable[[float], None] | None = None,
) -> FabricEstimate:
    """Estimate the yarn with which a pattern has the measured tensile curves: fit a shell, remove the effect of the
    clamps, fit the yarn.

    pattern: see ``fabric_model``, which is called with its defaults unless a model is given. folder: for evaluations;
    those of the same problem that are there are used. resume: refuse a folder without any. executor: runs evaluations
    side by side. progress: called after every evaluation. Other arguments: see ``fit_fabric``. Raises InputError.
    Source: EST22.
    """
    if not isinstance(measurements, SwatchMeasurements):
        measurements = read_measurements(measurements)
    model = pattern if isinstance(pattern, YarnModel) else fabric_model(measurements, pattern)
    kept = None if folder is None else evaluation_folder(Path(folder) / EVALUATIONS, resume=resume)
    return fit_fabric(
        measurements, model, directions=directions, holdout=holdout, follow=follow, shell_model=shell_model,
        friction=friction, options=options, weights=weights, executor=executor, progress=progress, on_cycle=on_cycle,
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
    check_forces(measurements, woven=shape.woven)
    known = replace(measurements.known, area_density=measurements.area_density, yarn_count=measurements.yarn_count)
    if (known.wales is None) != (known.courses is None):
        raise InputError("wales and courses per length", expected="both, which fix the size", found="one")
    yarn, area, decides = known.yarn_in_stitch, known.stitch_area, False
    if radius is not None:
        if yarn_length is not None:
            raise InputError("radius", expected="none beside a yarn length, which decides the size")
        if not drawn:
            expected = "a built-in pattern, a chart or a draft, which are drawings"
            raise InputError("radius", expected=expected, found=shape.name)
        shape = shape.scaled(radius / shape.radius)
    elif drawn and yarn_length is None and chart is not None and yarn is not None:
        yarn_length = yarn * chart.wales * chart.courses
    elif drawn and yarn_length is None and chart is not None and area is not None:
        shape = shape.scaled(math.sqrt(area * chart.wales * chart.courses / float(np.prod(shape.period))))
        decides = stiffness is None and measurements.stiffest_yarn is None and measurements.yarn_bending is None
    elif drawn and yarn_length is None:
        shape = shape.scaled(DRAWN_RADIUS / shape.radius)
        notify(f"size of the fabric unknown: {shape.name} is drawn with a yarn of {1e3 * DRAWN_RADIUS:g} mm radius")
    stiffness = measurements.stiffest_yarn if stiffness is None else stiffness
    if stiffness is None:
        stiffness = UNKNOWN_STIFFNESS
        notify(f"stiffness of the yarn unknown: k_s2 is taken as {stiffness:g} N")
    return yarn_model(
        shape, stiffness, yarn_length=yarn_length, free_shape=drawn if free_shape is None else free_shape,
        stitches=None if chart is None else (chart.wales, chart.courses), stitch_area=area if decides else None,
        bending=measurements.yarn_bending,
    )  # fmt: skip


def check_forces(measurements: SwatchMeasurements, *, woven: bool) -> None:
    """InputError for loads of no fabric: units of force that were mistaken."""
    for test in measurements.stretch:
        curve, where = test.curve, f"{measurements.name}, {test.direction.value}"
        if curve.load[-1] < _LEAST_LOAD:
            found = f"{curve.load[-1]:.2g} N/m: newtons taken for grams?"
            raise InputError("force", where=where, expected=f"{_LEAST_LOAD:g} N/m or more", found=found)
        stretch = curve.stretch_at(POWER_LOAD)
        if not woven and curve.load[-1] >= 0.9 * POWER_LOAD and stretch < _LEAST_STRETCH:
            expected = f"a knit that stretches by {100 * _LEAST_STRETCH:g} % or more at {POWER_LOAD:.0f} N/m"
            found = f"{100 * stretch:.2g} %: grams taken for newtons?"
            raise InputError("force", where=where, expected=expected, found=found)


class EstimateFolder:
    """Evaluations of one objective by this code; those of others in the same folder are not mistaken for its own."""

    def __init__(self, folder: Path, objective: YarnObjective) -> None:
        self.folder = folder
        self._mark = (fingerprint(objective) + code_fingerprint(*EVALUATING)).encode()

    def find(self, key: bytes) -> Residuals | None:
        """The evaluation of a key, None where it is not there or cannot be read."""
        try:
            entry = json.loads(self._path(key).read_text())
            return Residuals(np.array(entry["residuals"], float), int(entry["solves"]), float(entry["seconds"]))
        except (OSError, ValueError, KeyError, TypeError):
            return None

    def keep(self, key: bytes, unknowns: Array, found: Residuals) -> None:
        """Write an evaluation in one step. InputError where the folder cannot be written."""
        entry = {"unknowns": unknowns.tolist(), "residuals": found.residuals.tolist(), "solves": found.solves,
                 "seconds": found.seconds}  # fmt: skip
        write_text(self._path(key), json.dumps(entry))

    def _path(self, key: bytes) -> Path:
        return self.folder / f"{hashlib.sha256(self._mark + key).hexdigest()[:24]}.json"


def check_evaluations(folder: Path) -> None:
    """InputError where a folder has no evaluations of an earlier run."""
    if not folder.is_dir():
        raise InputError("nothing to resume", where=folder, expected="evaluations of an earlier run")


def evaluation_folder(folder: Path, *, resume: bool) -> Path:
    """The folder for evaluations. InputError where there is nothing to resume."""
    if resume:
        check_evaluations(folder)
    return writable_folder(folder)
