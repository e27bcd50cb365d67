"""What a file of a structure says (a chart, a weaving draft, a machine file), before it is drawn, and its repeat."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from yarnscale.drawing.library import Structure
from yarnscale.drawing.proportions import check_proportions
from yarnscale.drawing.stitches import StitchChart
from yarnscale.errors import InputError, located, notify
from yarnscale.yarn.pattern import YarnPattern


@dataclass(frozen=True, eq=False)
class StructureFile:
    """A structure as a file has it; ``place`` finds the file and line of a fault of the structure."""

    path: Path
    structure: Structure
    place: Callable[[InputError], object]

    def pattern(self) -> YarnPattern:
        """The pattern drawn; InputError with file and line for what cannot be knitted or woven."""
        with located(self.place):
            pattern = self.structure.build()
        check_proportions(pattern, where=self.path)
        return pattern

    def stitches(self) -> StitchChart | None:
        """The stitches of a knit, None of a weave; InputError as ``pattern``."""
        if self.structure.woven:
            return None
        with located(self.place):
            return StitchChart.read(self.structure.chart)


def one_repeat(path: Path, what: str, items: Sequence[Hashable], largest: int, margin: int) -> slice:
    """``repeat_of`` the threads, courses or wales of a file; a notice if some lie outside, InputError without one."""
    found = repeat_of(items, largest, margin)
    if found is None:
        raise InputError(f"the {len(items)} {what} have no repeat", where=path, expected=f"one of at most {largest}")
    repeat, outside = found
    if outside:
        notify(f"{path}: {outside} of {len(items)} {what} lie outside the repeat and are left off")
    return repeat


def repeat_of(items: Sequence[Hashable], largest: int, margin: int = 0) -> tuple[slice, int] | None:
    """One repeat of at most ``largest`` items, and how many items lie outside of what it repeats; None without one.

    The shortest period that holds throughout for one and a half repeats; else one that holds over half of the items
    for two repeats (three of one or two items) but for up to ``margin`` at either end; else all items together.
    """
    known = {item: number for number, item in enumerate(dict.fromkeys(items))}
    numbers = np.array([known[item] for item in items])
    count, inner = len(numbers), None
    for period in range(1, min(largest, count - 1) + 1):
        # The longest run of items that are alike one period apart.
        edges = np.flatnonzero(np.diff(np.pad(numbers[:-period] == numbers[period:], 1).astype(int)))
        runs = edges.reshape(-1, 2) + np.array([0, period])
        start, stop = runs[np.argmax(np.ptp(runs, axis=1))].tolist() if len(runs) else (0, 0)
        length, repeats = stop - start, 3 if period < 3 else 2
        if length == count and 3 * period <= 2 * count:
            return slice(0, period), 0
        inside = max(start, count - stop) <= margin and length >= repeats * period and 2 * length > count
        if inner is None and inside:
            inner = slice(start, start + period), count - length
    return inner or ((slice(0, count), 0) if count <= largest else None)
