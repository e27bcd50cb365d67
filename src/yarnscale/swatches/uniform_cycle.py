"""Fabric stretched uniformly along one direction and let go again, measured or simulated: loading and unloading."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from yarnscale.arrays import Array
from yarnscale.errors import InputError
from yarnscale.swatches.loading_start import at_zero_force
from yarnscale.swatches.measurements import POWER_LOAD, Direction, StretchRun, StretchTest, SwatchMeasurements
from yarnscale.swatches.uniform_data import SAMPLES, UniformCurve, UniformData

_FARTHEST = 1.5 * POWER_LOAD
"""Largest line load of a cycle that counts [N/m]: yarns are fitted up to the power range."""


@dataclass(frozen=True, eq=False)
class UniformCycle:
    """One cycle, free across; arrays (n,) at stretches from zero to the largest.

    loading, unloading: first Piola–Kirchhoff stress along the stretch [N/m]; negative where fabric is pushed, as it is
    at the end of unloading if it has become longer. contraction: on loading, None where it was not measured.
    """

    direction: Direction
    stretch: Array
    loading: Array
    unloading: Array
    contraction: Array | None = None

    @property
    def work(self) -> float:
        """Work of loading [J/m²]."""
        return float(np.trapezoid(np.maximum(self.loading, 0.0), self.stretch))

    @property
    def returned(self) -> float:
        """Share of the work that unloading returns."""
        return float(np.trapezoid(np.maximum(self.unloading, 0.0), self.stretch)) / self.work

    @property
    def stretch_left(self) -> float:
        """Stretch at which no stress is left in unloading."""
        slack = np.flatnonzero(self.unloading[:-1] <= 0.0)
        k = int(slack[-1]) if len(slack) else 0
        return float(np.interp(0.0, self.unloading[k : k + 2], self.stretch[k : k + 2]))


def measured_cycles(measurements: SwatchMeasurements, data: UniformData) -> tuple[UniformCycle, ...]:
    """The directions of ``data`` whose unloading was measured, both branches without the effect of the clamps.

    data: curves of loading without that effect; their ratio to the measured ones is taken for unloading, too.
    """
    curves = {curve.direction: curve for curve in data.curves}
    tests = [test for test in measurements.stretch if test.direction in curves and has_unloading(test)]
    return tuple(_measured(test, curves[test.direction]) for test in tests)


def check_unloading(measurements: SwatchMeasurements) -> None:
    """InputError where no direction was unloaded so that the friction of yarns can be fitted."""
    if any(has_unloading(test) for test in measurements.stretch):
        return
    peaks = [_peak(run)[1] / test.swatch_width for test in measurements.stretch for run in _complete(test)]
    begun = any(run.unloading is not None for test in measurements.stretch for run in test.runs)
    found = f"none from less than {min(peaks):.0f} N/m" if peaks else "none to its end" if begun else "none measured"
    expected = f"unloading to its end after loading up to at most {_FARTHEST:.0f} N/m"
    raise InputError("friction", where=measurements.name, expected=expected, found=found)


def has_unloading(test: StretchTest) -> bool:
    """Whether unloading was measured to its end, from a load that the estimated yarn can have."""
    return bool(_unloaded(test))


def _unloaded(test: StretchTest) -> list[StretchRun]:
    """The runs with such an unloading."""
    return [run for run in _complete(test) if _peak(run)[1] / test.swatch_width <= _FARTHEST]


def _complete(test: StretchTest) -> list[StretchRun]:
    return [run for run in test.runs if run.unloading is not None and run.unloading.lost_work is not None]


def _peak(run: StretchRun) -> tuple[float, float]:
    """Largest length [m] and force [N]; the loading of a run ends at the power range, its unloading begins higher."""
    assert run.unloading is not None
    top = int(np.argmax(run.unloading.length))
    reached = float(run.unloading.length[top]), float(run.unloading.force[top])
    return max((float(run.length[-1]), float(run.force[-1])), reached)


def _measured(test: StretchTest, target: UniformCurve) -> UniformCycle:
    """Mean of the runs at equal shares of their largest stretch."""
    share = np.arange(SAMPLES + 1) / SAMPLES
    parts = np.array([_branches(run, share) for run in _unloaded(test)]).mean(axis=0)
    stretch, loading, unloading = parts[0], *(parts[1:] / test.swatch_width)
    ratio = np.interp(stretch, target.stretch, target.stress / test.curve.load_at(target.stretch))
    across = None
    if target.contraction_measured:
        across = np.interp(stretch, np.append(0.0, target.stretch), np.append(0.0, target.contraction))
    return UniformCycle(test.direction, stretch, ratio * loading, ratio * unloading, across)


def _branches(run: StretchRun, share: Array) -> Array:
    """Stretch, force of loading and of unloading [N] at shares of the largest stretch, (3, n)."""
    assert run.unloading is not None
    length, force = _peak(run)
    peak = length / run.rest_length - 1.0
    stretch, loading = run.stretch, run.force
    if peak > stretch[-1]:
        stretch, loading = np.append(stretch, peak), np.append(loading, force)
    at = share * peak
    branches = ((np.append(0.0, stretch[stretch > 0]), np.append(0.0, loading[stretch > 0])), _back(run))
    return np.array([at, *(np.interp(at, *branch, left=0.0) for branch in branches)])


def _back(run: StretchRun) -> tuple[Array, Array]:
    """Stretch and force [N] of unloading in rising order, from zero force, to which the last readings are extrapolated.

    A log counts as complete with up to a fifth of the force left.
    """
    from scipy.optimize import isotonic_regression

    assert run.unloading is not None
    order = np.argsort(run.unloading.length)
    length, force = run.unloading.length[order], run.unloading.force[order]
    rising = isotonic_regression(force).x
    if 0.0 < rising[0] < rising[-1] and (start := at_zero_force(rising, length)) < length[0]:
        length, force = np.append(start, length), np.append(0.0, force)
    return length / run.rest_length - 1.0, force
