"""One loading from the log of a testing machine, without slack, offset of the load cell, unloading and noise.

A log has force and length in the order of time, noisy, at any sampling rate, often with slack before the fabric is
taut, and with unloading, further cycles or a break after the loading. The length separates the branches: it falls only
where the swatch is unloaded. Force may fall by noise while the length grows; it is then averaged (monotone regression).
Readings are averaged in bins of equal progress in length and force, so that the curve does not depend on the sampling
rate.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import zip_longest
from typing import Literal

import numpy as np
from scipy.integrate import trapezoid
from scipy.optimize import isotonic_regression

from yarnscale.arrays import Array
from yarnscale.errors import InputError
from yarnscale.swatches.loading_start import at_zero_force, slack_and_offset
from yarnscale.swatches.measurements import POWER_LOAD, StretchRun, Unloading

Cycle = Literal["first", "last"]
CYCLES: tuple[Cycle, ...] = ("first", "last")

_USED = 1.1
"""Forces are used up to this multiple of the power range."""
_BINS = 200
"""Readings that are kept of a loading, at most."""
_BLOCKS = 2000
"""Averages of consecutive readings in which branches are looked for."""
_LEAST_FALL = 0.03
"""Share of the range by which length must fall to be unloading, and force to be a break."""
_REACHED = 0.9
"""Share of the largest force that a cycle must reach to count as the loading."""
_FARTHEST = 0.4
"""Longest extrapolation of a pretension to zero force, as a share of the extension; beyond, it was no pretension."""
_NOTABLE = 0.01
"""Share of the largest force from which an offset is reported."""


@dataclass(frozen=True, eq=False)
class Loading:
    """Force, which does not fall [N], length [m] and width [m] or None of one loading, all (n,), and remarks on it.

    unloading: the branch that follows, None where there is none.
    """

    force: Array
    length: Array
    width: Array | None
    remarks: tuple[str, ...] = ()
    unloading: Unloading | None = None


def loading(
    force: Array, length: Array, width: Array | None = None, *, largest_force: float = np.inf, cycle: Cycle = "first"
) -> Loading:
    """The loading in a log, every array (n,) in the order of time.

    force: of the load cell [N]; length: between the clamps [m]; width: at the middle [m], None where not measured.
    largest_force: end of the range that is used [N]. cycle: which of several loadings that reach 90 % of the largest
    force counts. Raises InputError where no loading of three readings is found.
    """
    begin, end, back, remarks = _branch(force, length, largest_force, cycle)
    unloading = _unloading(force[begin:back], length[begin:back], end - begin)
    if unloading is not None and unloading.lost_work is not None:
        remarks.append(f"unloading does not return {100 * unloading.lost_work:.0f} % of the work")
    columns = [column[begin:end] for column in (force, length, width) if column is not None]
    rising = isotonic_regression(columns[0]).x
    beyond = np.flatnonzero(rising > largest_force)
    if len(beyond):
        # One reading beyond the range, to which curves are interpolated.
        kept = int(beyond[0]) + max(1, len(rising) // (2 * _BINS))
        columns, rising = [column[:kept] for column in columns], rising[:kept]
    if len(rising) < 3 or not rising[-1] > rising[0] or not np.ptp(columns[1]) > 0:
        raise InputError(
            "loading",
            expected="three readings or more whose force and length grow",
            found=_fault(force, length, len(rising), largest_force),
        )
    longer = isotonic_regression(columns[1]).x
    columns, counts = _binned(columns, rising, longer)
    found, level = _from_zero(columns, counts, float(longer[0]), remarks)
    return replace(found, unloading=unloading and replace(unloading, force=unloading.force - level))


def _fault(force: Array, length: Array, count: int, largest_force: float) -> str:
    """What is wrong with readings that hold no loading."""
    if len(force) > 2 and not min(np.ptp(force), np.ptp(length)) > 0:
        return f"{len(force)} readings of one {'length' if np.ptp(force) > 0 else 'force'}"
    if force[np.argmin(length)] > force[np.argmax(length)]:
        return "a force that grows while the length falls"
    if force.max() > 10 * largest_force:
        return f"{count} up to {largest_force:.3g} N, then {force.max():.3g} N: grams taken for newtons?"
    return f"{count}"


def stretch_run(
    name: str, force: Array, length: Array, middle: Array | None, *, swatch_width: float, cycle: Cycle = "first"
) -> tuple[StretchRun, tuple[str, ...]]:
    """The loading up to the end of the power range of a swatch of some width [m], as a run, and remarks."""
    found = loading(force, length, middle, largest_force=_USED * POWER_LOAD * swatch_width, cycle=cycle)
    return StretchRun(name, found.force, found.length, found.width, found.unloading), found.remarks


def _unloading(force: Array, length: Array, top: int) -> Unloading | None:
    """The branch from the reading ``top`` on, and the work that is lost."""
    if len(force) - top < 3:
        return None
    up, down = slice(0, top), slice(top - 1, None)
    level = float(min(force[0], force[-1]))
    returned = length[top - 1] - length[-1] > 0.5 * (length[top - 1] - length[0])
    lost = None
    if returned and force[-1] - level <= 0.2 * (force[top - 1] - level):
        work, back = (float(trapezoid(force[part] - level, length[part])) for part in (up, down))
        lost = min(max(1.0 + back / work, 0.0), 1.0) if work > 0 else None
    every = max(1, (len(force) - top) // _BINS)
    return Unloading(force[top::every], length[top::every], lost)


def _branch(force: Array, length: Array, largest_force: float, cycle: Cycle) -> tuple[int, int, int, list[str]]:
    """First reading and end of the loading, end of the unloading that follows, and what is said of the rest."""
    edges = np.unique(np.linspace(0, len(force), min(len(force), _BLOCKS) + 1).astype(int))
    sizes = np.diff(edges)
    force, length = (np.add.reduceat(values, edges[:-1]) / sizes for values in (force, length))
    turns = _turns(length, _least_fall(length, 0.1))
    found, backs = [], []
    for low, high, back in zip_longest(turns[::2], turns[1::2], turns[2::2]):
        if high is None:
            continue
        peak = low + int(np.argmax(force[low : high + 1]))
        broken = force[peak] - force[low : high + 1][-1] > _least_fall(force, 0.25)
        found.append((low, peak if broken else high))
        # A swatch that tore does not unload.
        backs.append(high if back is None or force[high] < 0.75 * force[peak] else back)
    tops = np.array([min(force[low : high + 1].max(), largest_force) for low, high in found])
    # A log may begin with the swatch extended, and unload first: a loading begins below half of the force.
    begins = np.array([force[low] < 0.5 * tops.max() for low, _ in found])
    full = np.flatnonzero((tops >= _REACHED * tops.max()) & (begins | ~begins.any()))
    full = full if len(full) else np.flatnonzero(tops == tops.max())
    chosen = int(full[0 if cycle == "first" else -1])
    low, high = found[chosen]
    begin, end = int(edges[low]), int(edges[high + 1])
    back = max(end, int(edges[backs[chosen] + 1]))
    remarks = []
    if len(found) > 1 and (np.diff(found, axis=1) > 1).sum() > 1:
        ordinal = ("first", "second", "third")[chosen] if chosen < 3 else f"{chosen + 1}th"
        remarks.append(f"of {len(found)} loadings the {ordinal} is used ({cycle} one to the full force)")
    elif high + 1 < len(force) and force[high + 1 :].min() < _REACHED * tops[chosen]:
        remarks.append(f"{edges[-1] - end} readings after the loading (unloading or break) are left out")
    return begin, end, back, remarks


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
    progress = np.add(*((values - values[0]) / max(values[-1] - values[0], 1e-300) for values in (rising, longer)))
    _, place, counts = np.unique((progress * (_BINS / 2.0001)).astype(int), return_inverse=True, return_counts=True)
    return [np.bincount(place, column) / counts for column in columns], counts.astype(np.float64)


def _from_zero(columns: list[Array], counts: Array, begin: float, remarks: list[str]) -> tuple[Loading, float]:
    """The loading without slack and offset of the load cell, its force monotone; and that offset [N]."""
    force, length, *width = columns
    offset, start = slack_and_offset(force, length, counts, begin)
    slack = start - begin
    if abs(offset) > _NOTABLE * force[-1] or slack > 0:
        remarks.append(f"{1e3 * slack:.2g} mm of slack and {offset:.2g} N of offset are taken off")
    if slack > 0 or offset:
        taut = length > start
        width = [np.append(np.interp(start, length, column), column[taut]) for column in width]
        force, length = np.append(0.0, force[taut] - offset), np.append(start, length[taut])
        counts = np.append(max(counts[~taut].sum(), 1.0), counts[taut])
    force = np.maximum(isotonic_regression(force, weights=counts).x, 0.0)
    if force[0] > 0 and begin - at_zero_force(force, length) > _FARTHEST * (length[-1] - begin):
        remarks.append(
            f"force begins at {force[0]:.2g} N, too much for a pretension of so soft a fabric: taken for an offset"
        )
        offset, force = offset + float(force[0]), force - force[0]
    return Loading(force, length, width[0] if width else None, tuple(remarks)), offset
