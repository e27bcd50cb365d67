"""What a yarn model is to reproduce: stress and contraction of fabric stretched uniformly (EST22 eq. 3 and §7.3.1).

Swatches are not uniform, periodic cells are. The fitted shell translates: ``uniform_data`` takes its stress in
uniform uniaxial stretch over the measured range, as EST22 does. Real fabric stiffens more than the shell can, and so do
cells of yarn; ``corrected_data`` takes from the shell only the ratio of uniform to swatch and applies it to
what was measured.

Stress is the first Piola–Kirchhoff stress σ along the stretch [N/m]; errors and weights are of σ/(1 + s).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from yarnscale.arrays import Array, Flags
from yarnscale.errors import InputError
from yarnscale.swatches.bend_fit import BendFit
from yarnscale.swatches.measurements import COMFORT_LOAD, POWER_LOAD, Direction, StretchTest, SwatchMeasurements
from yarnscale.swatches.shell_fit import FittedCurve, ShellFit
from yarnscale.swatches.uniaxial import uniaxial

SAMPLES = 20
"""Stretches per direction (EST22 §7.3.3)."""


@dataclass(frozen=True, eq=False)
class UniformCurve:
    """Uniform uniaxial stretch along one direction, free across; arrays (n,).

    stretch s, contraction c: F = U diag(1 + s, 1 − c) Uᵀ. stress: first Piola–Kirchhoff [N/m].
    comfort_stretch: the largest stretch of the comfort range. contraction_measured: whether c was measured;
    contraction_weight: of its errors in a fit.
    """

    direction: Direction
    stretch: Array
    contraction: Array
    stress: Array
    comfort_stretch: float
    contraction_measured: bool = True
    contraction_weight: float = 1.0

    @property
    def second_stress(self) -> Array:
        """Second Piola–Kirchhoff stress σ/(1 + s) [N/m], (n,)."""
        return self.stress / (1.0 + self.stretch)

    @property
    def comfort(self) -> Flags:
        """Which samples lie in the comfort range, (n,)."""
        return self.stretch <= self.comfort_stretch * (1 + 1e-9)

    @property
    def stress_decay(self) -> Array:
        """Weight of the stress: one in the comfort range, falling as the stress rises beyond (EST22 §7.3.1), (n,)."""
        return _decay(self.second_stress, self.stretch, self.comfort_stretch)

    @property
    def contraction_decay(self) -> Array:
        """Weight of the contraction, likewise; zero where it was not measured, (n,)."""
        weight = self.contraction_weight if self.contraction_measured else 0.0
        return weight * _decay(self.contraction, self.stretch, self.comfort_stretch)


@dataclass(frozen=True)
class UniformBend:
    """Cylindrical bending along one direction: energy k κ² per area, moment dψ/dκ = 2 k κ [N] (EST22 §5.2).

    stiffness: k [J], half of the rigidity B.
    """

    direction: Direction
    stiffness: float


ERRORS = {"comfort": "comfort range", "full": "full range", "compression": "contraction"}
"""Fields of ``UniformErrors`` and what they are called."""


@dataclass(frozen=True)
class UniformErrors:
    """Mean errors over the largest target of the comfort range (EST22 §7.3.1, Fig. 15), as fractions.

    comfort, full: of σ/(1 + s) in the comfort range and in all of it. compression: of c; None where not measured.
    directions: the same of every direction by itself, over the same largest targets; empty within.
    """

    comfort: float
    full: float
    compression: float | None
    directions: dict[Direction, UniformErrors] = field(default_factory=dict)

    def summary(self) -> dict[str, object]:
        """Numbers by name; None where no state is at rest."""
        numbers = {name: getattr(self, name) for name in ERRORS}
        values: dict[str, object] = {
            name: value if value is not None and np.isfinite(value) else None for name, value in numbers.items()
        }
        if self.directions:
            values["directions"] = {along.value: part.summary() for along, part in self.directions.items()}
        return values


@dataclass(frozen=True, eq=False)
class UniformData:
    """Uniform curves of one fabric, one per direction, and its bending along directions where that was measured."""

    name: str
    curves: tuple[UniformCurve, ...]
    bending: tuple[UniformBend, ...] = ()

    @property
    def stress_scale(self) -> float:
        """Largest σ/(1 + s) of the comfort ranges [N/m], by which errors of stress are divided."""
        return max(float(np.interp(c.comfort_stretch, c.stretch, c.second_stress)) for c in self.curves)

    @property
    def contraction_scale(self) -> float:
        """Largest measured contraction of the comfort ranges (of all where none is), by which errors are divided."""
        measured = [c for c in self.curves if c.contraction_measured] or self.curves
        largest = [float(np.interp(c.comfort_stretch, c.stretch, np.abs(c.contraction))) for c in measured]
        return max([1e-3, *largest])

    def only(self, *directions: Direction) -> UniformData:
        """The curves along these directions alone. Raises InputError where none is left."""
        chosen = tuple(curve for curve in self.curves if curve.direction in directions)
        if not chosen:
            raise InputError(
                f"directions of '{self.name}'", expected=[c.direction.value for c in self.curves], found="none"
            )
        bending = tuple(bend for bend in self.bending if bend.direction in directions)
        return UniformData(self.name, chosen, bending)

    def errors(self, stresses: Sequence[Array], contractions: Sequence[Array]) -> UniformErrors:
        """Errors of another model's first Piola–Kirchhoff stress [N/m] and contraction at the same stretches.

        Values that are not finite, of states that are not at rest, are left out.
        """
        parts = []
        for curve, stress, contraction in zip(self.curves, stresses, contractions, strict=True):
            difference = np.abs(stress / (1.0 + curve.stretch) - curve.second_stress) / self.stress_scale
            across = np.empty(0)
            if curve.contraction_measured:
                across = np.abs(contraction - curve.contraction) / self.contraction_scale
            parts.append((difference[curve.comfort], difference, across))
        directions = {curve.direction: _means(*part) for curve, part in zip(self.curves, parts, strict=True)}
        together = _means(*(np.concatenate(column) for column in zip(*parts, strict=True)))
        return replace(together, directions=directions)


def uniform_data(fit: ShellFit, measurements: SwatchMeasurements) -> UniformData:
    """Uniform curves of the fitted shell over the measured stretches (EST22 eq. 3), for every direction measured."""
    return _data(measurements, lambda test, stretch: uniaxial(fit.material, test.direction.angle, stretch))


def swatch_data(measurements: SwatchMeasurements) -> UniformData:
    """The measured curves as they are, the effect of the clamps included."""

    def measured(test: StretchTest, stretch: Array) -> tuple[Array, Array]:
        across = test.curve.contraction_at(stretch)
        return test.curve.load_at(stretch), np.zeros(len(stretch)) if across is None else across

    return _data(measurements, measured)


def corrected_data(fit: ShellFit, measurements: SwatchMeasurements) -> UniformData:
    """The measured curves, times the fitted shell's ratio of uniform to swatch response at the same stretch."""
    fitted_along = {curve.direction: curve for curve in fit.curves}

    def corrected(test: StretchTest, stretch: Array) -> tuple[Array, Array]:
        if (fitted := fitted_along.get(test.direction)) is None:
            raise InputError("shell fit", expected=f"a fit along {test.direction.value}", found="none")
        stress, contraction = uniaxial(fit.material, test.direction.angle, fitted.stretch)
        load = test.curve.load_at(stretch) * _without_clamps(fitted, stress, stretch)
        width = test.curve.contraction_at(stretch)
        if width is None:
            return load, uniaxial(fit.material, test.direction.angle, stretch)[1]
        ratio = contraction / np.where(np.abs(fitted.contraction) > 1e-4, fitted.contraction, contraction)
        return load, width * np.interp(stretch, fitted.stretch, ratio)

    return _data(measurements, corrected)


def _data(
    measurements: SwatchMeasurements, response: Callable[[StretchTest, Array], tuple[Array, Array]]
) -> UniformData:
    """Curves of a response, stress [N/m] and contraction, at stretches up to the power load, evenly spaced."""
    curves = []
    for test in measurements.stretch:
        stretch = float(test.curve.up_to(POWER_LOAD).stretch[-1]) * np.arange(1, SAMPLES + 1) / SAMPLES
        stress, across = response(test, stretch)
        comfort, measured = test.curve.stretch_at(COMFORT_LOAD), test.curve.contraction is not None
        curves.append(UniformCurve(test.direction, stretch, across, stress, comfort, measured))
    return UniformData(measurements.name, tuple(curves))


def _without_clamps(fitted: FittedCurve, uniform: Array, stretch: Array) -> Array:
    """Ratio of the shell's uniform stress to that of its swatch, from the stretches whose swatches bear load, (n,)."""
    good = np.isfinite(fitted.load) & (fitted.load > 0) & (uniform > 0)
    if not good.any():
        return np.ones(len(stretch))
    return np.interp(stretch, fitted.stretch[good], uniform[good] / fitted.load[good])


def uniform_bending(fit: BendFit) -> tuple[UniformBend, ...]:
    """Bending stiffness of the fitted shell along every direction whose loops were measured."""
    stiffness = {
        Direction.WEFT: fit.material.bend_weft,
        Direction.BIAS: fit.material.bend_bias,
        Direction.WARP: fit.material.bend_warp,
    }
    return tuple(UniformBend(loop.direction, stiffness[loop.direction]) for loop in fit.loops)


def _means(comfort: Array, full: Array, compression: Array) -> UniformErrors:
    def mean(values: Array) -> float:
        known = values[np.isfinite(values)]
        return float(known.mean()) if len(known) else float("nan")

    return UniformErrors(mean(comfort), mean(full), mean(compression) if len(compression) else None)


def _decay(values: Array, stretch: Array, comfort_stretch: float) -> Array:
    limit = max(float(np.interp(comfort_stretch, stretch, values)), 1e-12)
    return limit / np.maximum(limit, values)
