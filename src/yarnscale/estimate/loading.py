"""One loading from the log of a testing machine, without slack, offset of the load cell, unloading and noise.

A log holds force and length in the order of time, noisy, at any sampling rate, often with slack before the fabric is
taut, and with unloading, further cycles or a break after the loading. The length separates the branches: it falls only
where the swatch is unloaded. Force may fall by noise while the length grows; it is then averaged (monotone regression).
Readings are averaged in bins of equal progress in length and force, so that the curve does not depend on the sampling
rate.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import isotonic_regression

from yarnscale.errors import InputError

Array = NDArray[np.float64]
Cycle = Literal["first", "last"]
CYCLES: tuple[Cycle, ...] = ("first", "last")

_BINS = 200
"""Readings that are kept of a loading, at most."""
_BLOCKS = 2000
"""Averages of consecutive readings in which branches are looked for."""
_LEAST_FALL = 0.03
"""Share of the range by which length must fall to be unloading, and force to be a break."""
_REACHED = 0.9
"""Share of the largest force that a cycle must reach to count as the loading."""
_TOE = 0.2
"""Share of the largest force below which slack is looked for."""
_LARGEST_DRIFT = 0.005
"""Of the load cell during slack, as a share of the largest force; what rises more is fabric."""
_NOTABLE = 0.01
"""Share of the largest force from which an offset is worth a remark."""
_LEAST_SLACK = 0.005
"""Shortest slack that is taken off, as a share of the length."""


@dataclass(frozen=True, eq=False)
class Loading:
    """Force, which does not fall [N], length [m] and width [m] or None of one loading, all (n,), and remarks on it."""

    force: Array
    length: Array
    width: Array | None
    remarks: tuple[str, ...] = ()


def loading(
    force: Array,
    length: Array,
    width: Array | None = None,
    *,
    largest_force: float = np.inf,
    cycle: Cycle = "first",
) -> Loading:
    """The loading in a log, every array (n,) in the order of time.

    force: of the load cell [N]; length: between the clamps [m]; width: at the middle [m], None where not measured.
    largest_force: end of the range that is used [N]. cycle: which of several loadings that reach 90 % of the largest
    force counts. Raises InputError where no loading of three readings is found.
    """
    begin, end, remarks = _branch(force, length, largest_force, cycle)
    columns = [column[begin:end] for column in (force, length, width) if column is not None]
    rising = isotonic_regression(columns[0]).x
    beyond = np.flatnonzero(rising > largest_force)
    if len(beyond):
        # One reading beyond the range, to which curves are interpolated.
        kept = int(beyond[0]) + max(1, len(rising) // (2 * _BINS))
        columns, rising = [column[:kept] for column in columns], rising[:kept]
    if len(rising) < 3 or not rising[-1] > rising[0]:
        raise InputError("loading", expected="three readings or more whose force grows", found=len(rising))
    longer = isotonic_regression(columns[1]).x
    columns, counts = _binned(columns, rising, longer)
    return _from_zero(columns, counts, float(longer[0]), remarks)


def _branch(force: Array, length: Array, largest_force: float, cycle: Cycle) -> tuple[int, int, list[str]]:
    """First reading and end of the loading, and what is said of the rest."""
    edges = np.unique(np.linspace(0, len(force), min(len(force), _BLOCKS) + 1).astype(int))
    sizes = np.diff(edges)
    force, length = (np.add.reduceat(values, edges[:-1]) / sizes for values in (force, length))
    turns = _turns(length, _least_fall(length, 0.1))
    found = []
    for low, high in zip(turns[::2], turns[1::2], strict=False):
        peak = low + int(np.argmax(force[low : high + 1]))
        broken = force[peak] - force[low : high + 1][-1] > _least_fall(force, 0.25)
        found.append((low, peak if broken else high))
    tops = np.array([min(force[low : high + 1].max(), largest_force) for low, high in found])
    full = np.flatnonzero(tops >= _REACHED * tops.max())
    chosen = int(full[0 if cycle == "first" else -1])
    low, high = found[chosen]
    begin, end = int(edges[low]), int(edges[high + 1])
    remarks = []
    if len(found) > 1 and (np.diff(found, axis=1) > 1).sum() > 1:
        remarks.append(
            f"of {len(found)} loadings the {_ordinal(chosen)} is used ({cycle} one to the full force)"
        )
    elif high + 1 < len(force) and force[high + 1 :].min() < _REACHED * tops[chosen]:
        remarks.append(f"{edges[-1] - end} readings after the loading (unloading or break) are left out")
    return begin, end, remarks


def _ordinal(k: int) -> str:
    return ("first", "second", "third")[k] if k < 3 else f"{k + 1}th"


def _least_fall(values: Array, largest: float) -> float:
    """What is more than noise: eight standard deviations of it, at least 3 % and at most ``largest`` of the range."""
    extent = float(np.ptp(values))
    noise = 0.0
    if len(values) >= 50:
        second = np.diff(values, 2)
        noise = 1.4826 * float(np.median(np.abs(second - np.median(second)))) / np.sqrt(6.0)
    return min(max(8.0 * noise, _LEAST_FALL * extent), largest * extent)


def _turns(values: Array, least: float) -> list[int]:
    """Places where values turn by more than ``least``: low, high, low, … from the first value on."""
    turns, rising, extreme = [0], True, 0
    for k, value in enumerate(values.tolist()):
        beyond = value - values[extreme] if rising else values[extreme] - value
        if beyond >= 0:
            extreme = k
        elif -beyond > least:
            turns.append(extreme)
            rising, extreme = not rising, k
    return [*turns, extreme]


def _binned(columns: list[Array], rising: Array, longer: Array) -> tuple[list[Array], Array]:
    """Averages of the columns in bins of equal progress, force first; few readings stay as they are."""
    if len(rising) <= _BINS:
        return columns, np.ones(len(rising))
    progress = np.add(
        *((values - values[0]) / max(values[-1] - values[0], 1e-300) for values in (rising, longer))
    )
    _, place, counts = np.unique(
        (progress * (_BINS / 2.0001)).astype(int), return_inverse=True, return_counts=True
    )
    return [np.bincount(place, column) / counts for column in columns], counts.astype(np.float64)


def _from_zero(columns: list[Array], counts: Array, begin: float, remarks: list[str]) -> Loading:
    """The loading without slack and offset of the load cell, its force monotone."""
    force, length, *width = columns
    offset, start = _toe(force, length, counts, begin)
    slack = start - begin
    if abs(offset) > _NOTABLE * force[-1] or slack > 0:
        remarks.append(f"{1e3 * slack:.2g} mm of slack and {offset:.2g} N of offset are taken off")
    if slack > 0 or offset:
        taut = length > start
        width = [np.append(np.interp(start, length, column), column[taut]) for column in width]
        force, length = np.append(0.0, force[taut] - offset), np.append(start, length[taut])
        counts = np.append(max(counts[~taut].sum(), 1.0), counts[taut])
    force = np.maximum(isotonic_regression(force, weights=counts).x, 0.0)
    return Loading(force, length, width[0] if width else None, tuple(remarks))


def _toe(force: Array, length: Array, counts: Array, begin: float) -> tuple[float, float]:
    """Offset of the load cell [N], and length at which the swatch becomes taut [m]: the first length if it is at once.

    Two models of the toe are compared: a line to which a cubic is added from some length on, and one cubic. The swatch
    was slack where the first fits clearly better, its line is flat, and what follows is much stiffer than the line.
    """
    largest, extent = force[-1] - force[0], length[-1] - begin
    toe = np.arange(len(force)) < np.flatnonzero(force <= force[0] + _TOE * largest)[-1] + 1
    if toe.sum() < 12 or not length[toe][-1] > length[0]:
        return _few_readings(force, length)
    x, weights = (length[toe] - begin) / extent, np.sqrt(counts[toe])

    def fitted(*functions: Array) -> tuple[Array, float, float]:
        """Coefficients, squared residuals, and standard deviation of the first coefficient."""
        matrix = weights[:, None] * np.stack(functions, axis=1)
        coefficients = np.asarray(np.linalg.lstsq(matrix, weights * force[toe])[0], np.float64)
        left = float(((matrix @ coefficients - weights * force[toe]) ** 2).sum())
        first = float(np.linalg.pinv(matrix.T @ matrix)[0, 0])
        return coefficients, left, float(np.sqrt(left / (len(x) - len(functions)) * first))

    (level, *_), smooth, deviation = fitted(x**0, x, x**2, x**3)
    starts = np.linspace(x[1], x[-5], 100)
    beyond = [np.maximum(x - start, 0.0) for start in starts]
    tries = [fitted(x**0, x, h, h**2, h**3) for h in beyond]
    best = int(np.argmin([residual for _, residual, _ in tries]))
    (at_start, drift, rise, *_), residual, _ = tries[best]
    start = float(starts[best])
    noise = np.sqrt(residual / (len(x) - 6))
    clear = smooth - residual > 16.0 * noise**2
    uncertain = 2.0 * noise * np.sqrt(12.0 / max(counts[toe][x < start].sum(), 1.0))
    flat = abs(drift) * start < max(_LARGEST_DRIFT * largest, uncertain) and rise > 4.0 * abs(drift)
    taut = float(begin + start * extent)
    if clear and flat and taut - begin > _LEAST_SLACK * begin:
        return float(at_start + drift * start), taut
    # A force that is no more than noise is zero; a negative one is none of fabric. More is a pretension.
    return (0.0 if level > max(4.0 * deviation, 2e-3 * largest) else float(level)), begin


def _few_readings(force: Array, length: Array) -> tuple[float, float]:
    """As ``_toe`` where the toe has few readings: slack is where three or more read no more than the first."""
    last = int(np.flatnonzero(force <= force[0])[-1])
    if last >= 2 and length[last] - length[0] > _LEAST_SLACK * length[0]:
        return float(force[: last + 1].mean()), float(length[last])
    return min(float(force[0]), 0.0), float(length[0])
