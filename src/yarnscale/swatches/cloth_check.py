"""The measured swatches simulated as cloth of the homogenized yarn: swatch → yarn → cloth → swatch."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from yarnscale.arrays import Array
from yarnscale.cell.periodic import PeriodicCell
from yarnscale.errors import notify
from yarnscale.homogenize.homogenize import homogenize
from yarnscale.homogenize.rays import SOLVES, doubling_load
from yarnscale.homogenize.sample import SamplingProgress
from yarnscale.shell.materials.compact import CompactMaterial
from yarnscale.shell.materials.material import ShellMaterial
from yarnscale.swatches.measurements import POWER_LOAD, SwatchMeasurements
from yarnscale.swatches.swatch import StretchResponse, StretchSwatch
from yarnscale.swatches.uniaxial import uniaxial
from yarnscale.swatches.uniform_data import UniformData, UniformErrors, swatch_data
from yarnscale.swatches.yarn_friction import YarnFrictionFit
from yarnscale.yarn.friction import YarnFriction

_DECIDED = 1.5
"""Ratio of contractions with and without clamps from which clamps decide what is measured."""
_LITTLE = 0.1
"""Weight of such a contraction beside 1 of the stress."""
_BEYOND = 1.25
"""Largest load of the samples over that of the swatches: corners at clamps bear more than the mean."""


@dataclass(frozen=True, eq=False)
class ClothCheck:
    """Measured swatches, and the same swatches of a shell material.

    measured: loads and contractions as read between the clamps, nothing taken out but the part of friction, where that
    is known. responses: of the simulated swatches without friction at the same stretches, in the same order.
    """

    material: ShellMaterial
    measured: UniformData
    responses: tuple[StretchResponse, ...]

    @property
    def loads(self) -> list[np.ndarray]:
        """Force over width of every swatch [N/m], NaN where it has no equilibrium, (n,) each."""
        return [np.where(r.converged, r.force / r.width, np.nan) for r in self.responses]

    @property
    def contractions(self) -> list[np.ndarray]:
        """Contraction of every swatch, NaN where it has no equilibrium, (n,) each."""
        return [np.where(r.converged, r.contraction, np.nan) for r in self.responses]

    @property
    def errors(self) -> UniformErrors:
        """Of the cloth against what was measured."""
        return self.measured.errors(self.loads, self.contractions)


def check_cloth(
    material: ShellMaterial, measurements: SwatchMeasurements, *, friction: YarnFrictionFit | None = None
) -> ClothCheck:
    """Simulate every measured swatch as cloth of a material, without its friction, if any.

    friction: of the yarns, whose part in the measured loads is taken out.
    """
    measured, responses = swatch_data(measurements), []
    measured = measured if friction is None else friction.removed_from(measured)
    elastic = replace(material, sliders=None) if isinstance(material, CompactMaterial) else material
    for test, curve in zip(measurements.stretch, measured.curves, strict=True):
        swatch = StretchSwatch(test.direction, test.swatch_length, test.swatch_width, gauge_width=test.gauge_width)
        responses.append(swatch.respond(elastic, curve.stretch))
    return ClothCheck(material, measured, tuple(responses))


def without_own_clamps(check: ClothCheck, measured: UniformData) -> UniformData:
    """Measured curves, times the simulated cloth's ratio of uniform to swatch response at the same stretch.

    Where clamps change contraction by more than a factor of ``_DECIDED``, it stays as measured between them and weighs
    little: clamps of the simulation hold short, wide swatches more than real ones do.
    """
    curves = []
    for raw, load, across in zip(measured.curves, check.loads, check.contractions, strict=True):
        stress, contraction = uniaxial(check.material, raw.direction.angle, raw.stretch)
        held = _filled(raw.stretch, load / stress)
        wider = _filled(raw.stretch, across / np.where(contraction > 1e-4, contraction, np.nan))
        free = bool(np.all((wider > 1.0 / _DECIDED) & (wider < _DECIDED)))
        curves.append(
            replace(
                raw, stress=raw.stress / held, contraction=raw.contraction / wider if free else raw.contraction,
                contraction_weight=1.0 if free else _LITTLE,
            )
        )  # fmt: skip
    return replace(measured, curves=tuple(curves))


def _filled(stretch: Array, ratio: Array) -> Array:
    """A ratio at every stretch, by those where it is known; one where it is known nowhere."""
    good = np.isfinite(ratio)
    return np.interp(stretch, stretch[good], ratio[good]) if good.any() else np.ones(len(stretch))


def homogenized_swatches(
    cell: PeriodicCell, measurements: SwatchMeasurements, folder: Path, *, friction: YarnFrictionFit | None = None,
    solves: int = SOLVES, workers: int = 2, dask: str | None = None, resume: bool = False,
    progress: Callable[[SamplingProgress], None] | None = None,
) -> ClothCheck:  # fmt: skip
    """Homogenize an estimated cell for the measured loads, and simulate the swatches with the material.

    folder: gets the samples. friction: of the yarns, which the material then has, too. The other arguments are those
    of ``homogenize``.
    """
    largest = _BEYOND * max(float(test.curve.up_to(POWER_LOAD).load[-1]) for test in measurements.stretch)
    if largest > (most := doubling_load(cell)):
        notify(f"the yarn is twice as long at {most:.3g} N/m: cloth is sampled up to there, not to {largest:.3g} N/m")
    outcome = homogenize(
        cell, folder, solves=solves, limit=min(largest, most), workers=workers, dask=dask,
        resume=resume, friction=None if friction is None else YarnFriction(friction.coefficient), progress=progress,
    )  # fmt: skip
    return check_cloth(outcome.material, measurements, friction=friction)
