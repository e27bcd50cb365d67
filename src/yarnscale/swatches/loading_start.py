"""The beginning of a loading: slack, the offset of the load cell that it shows, and lengths at zero force.

Two models of the toe are compared, over several ranges of force: a line to which a parabola or a cubic is added from
some length on, and one cubic. The swatch was slack where the first fits clearly better, its line is flat, and what
follows is much stiffer than the line. The force of the slack swatch is the offset of the load cell.
No clamp can be set to zero force, so lengths there are extrapolated (EST22 §4).
"""

from __future__ import annotations

import numpy as np

from yarnscale.arrays import Array

_TOES = (0.0125, 0.05, 0.2)
"""Ranges of force in which slack is looked for, as shares of the largest force."""
_LEAST_READINGS = 12
_STARTS = 100
"""Lengths that are tried as the end of slack."""
_CLEAR = 25.0
"""Decrease of the squared residuals, over the variance of noise, from which a model is clearly better."""
_KINK = 4.0
"""How much stiffer the fabric is than the line of slack."""
_LARGEST_DRIFT = 0.005
"""Of the load cell during slack, as a share of the largest force; what rises more is fabric."""
_LEAST_SLACK = 0.005
"""Shortest slack that is found, as a share of the length."""
_NOISE = 2e-3
"""Share of the largest force that is no pretension."""

_STEP, _FIRST_STEPS = 0.01, 5
"""Steps of force that the extrapolation to zero force uses: size as a share of the largest force, and number."""


def at_zero_force(force: Array, value: Array) -> float:
    """Value at zero force of readings whose force does not fall, (n,) both.

    The last reading at zero force is taken as it is: those before are slack. Without one, readings are averaged in
    steps of a hundredth of the largest force, and a parabola through the first five steps is extrapolated; a line where
    the parabola is curved the wrong way: fabric stiffens, so that length grows ever less with force.
    """
    if (at_rest := np.flatnonzero(force == 0)).size:
        return float(value[at_rest[-1]])
    step = ((force - force[0]) / (_STEP * force[-1])).astype(int)
    _, place, counts = np.unique(step, return_inverse=True, return_counts=True)
    force = (np.bincount(place, force) / counts)[:_FIRST_STEPS]
    value = (np.bincount(place, value) / counts)[:_FIRST_STEPS]
    scaled = force / force[-1]
    if len(force) > 3:
        bend, slope, start = np.polyfit(scaled, value, 2)
        # The slope must keep its sign from zero force to the last of these steps while it shrinks.
        if bend * slope < 0 and abs(slope) >= 2 * abs(bend):
            return float(start)
    return float(np.polyfit(scaled, value, 1)[-1])


def slack_and_offset(force: Array, length: Array, counts: Array, begin: float) -> tuple[float, float]:
    """Offset of the load cell [N], and length at which the swatch becomes taut [m]: ``begin`` if it is so at once.

    force, length: averages of ``counts`` readings of a loading, all (n,); force may fall by noise. begin: length of the
    first reading. Where the swatch is taut at once, a first force that is negative or no more than noise is an offset.
    """
    largest, extension, first = force[-1] - force[0], length[-1] - begin, None
    for share in _TOES:
        end = np.flatnonzero(force <= force[0] + share * largest)[-1] + 1
        if end < _LEAST_READINGS or not length[end - 1] > begin:
            continue
        toe = _Toe((length[:end] - begin) / extension, force[:end], counts[:end])
        found = toe.slack(_LARGEST_DRIFT * largest)
        if found is not None and found[1] * extension > _LEAST_SLACK * begin:
            return found[0], begin + found[1] * extension
        first = first or toe.level(_NOISE * largest)
    if first is None:
        level, taut = _of_few_readings(force, length)
        if taut > begin:
            return level, taut
        first = level, level > 0
    level, pulled = first
    return 0.0 if pulled else level, begin


class _Toe:
    """Readings below some force; x: extension since the first reading, as a share of the whole."""

    def __init__(self, x: Array, force: Array, counts: Array) -> None:
        self.x, self.force, self.counts = x, force, counts
        self.weights = np.sqrt(counts)

    def fitted(self, *functions: Array) -> tuple[Array, float, float]:
        """Coefficients, squared residuals, and standard deviation of the first coefficient."""
        matrix = self.weights[:, None] * np.stack(functions, axis=1)
        coefficients = np.asarray(np.linalg.lstsq(matrix, self.weights * self.force)[0], np.float64)
        left = float(((matrix @ coefficients - self.weights * self.force) ** 2).sum())
        first = float(np.linalg.pinv(matrix.T @ matrix)[0, 0])
        return coefficients, left, float(np.sqrt(left / (len(self.x) - len(functions)) * first))

    def smooth(self) -> tuple[Array, float, float]:
        """The fit of one cubic."""
        x = self.x
        return self.fitted(x**0, x, x**2, x**3)

    def level(self, least: float) -> tuple[float, bool]:
        """Force at the first reading [N], and whether it is more than noise and than ``least``."""
        (level, *_), _, deviation = self.smooth()
        return float(level), bool(level > max(4.0 * deviation, least))

    def slack(self, largest_drift: float) -> tuple[float, float] | None:
        """Force at the end of slack [N] and where that is, None where the swatch was taut at once."""
        x, smooth = self.x, self.smooth()[1]
        for powers in ((1, 2), (1, 2, 3)):
            starts = np.linspace(x[1], x[-len(powers) - 2], _STARTS)
            tries = []
            for start in starts:
                beyond = np.maximum(x - start, 0.0)
                tries.append(self.fitted(x**0, x, *(beyond**power for power in powers)))
            best = int(np.argmin([residual for _, residual, _ in tries]))
            (level, drift, rise, *_), residual, _ = tries[best]
            start = float(starts[best])
            noise = np.sqrt(residual / (len(x) - len(powers) - 3))
            uncertain = 2.0 * noise * np.sqrt(12.0 / max(self.counts[x < start].sum(), 1.0))
            flat = abs(drift) * start < max(largest_drift, uncertain) and rise > _KINK * abs(drift)
            if flat and smooth - residual > _CLEAR * noise**2:
                return float(level + drift * start), start
        return None


def _of_few_readings(force: Array, length: Array) -> tuple[float, float]:
    """Slack of a toe of few readings: where three or more read no more than the first."""
    last = int(np.flatnonzero(force <= force[0])[-1])
    if last >= 2 and length[last] - length[0] > _LEAST_SLACK * length[0]:
        return float(force[: last + 1].mean()), float(length[last])
    return float(force[0]), float(length[0])
