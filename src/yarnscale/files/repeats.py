"""The repeat of a sequence of threads, courses or wales."""

from __future__ import annotations

from collections.abc import Hashable, Sequence

import numpy as np


def repeat_of(items: Sequence[Hashable], largest: int, margin: int = 0) -> slice | None:
    """One repeat of at most `largest` items; None where there is none.

    A period that holds throughout for one and a half repeats or more comes first, the shortest of them. The next is
    one that holds but for up to `margin` items at either end, over half of the items, for two repeats (three of one
    or two items). Otherwise all items together are the repeat.
    """
    known = {item: number for number, item in enumerate(dict.fromkeys(items))}
    numbers = np.array([known[item] for item in items])
    count, inner = len(numbers), None
    for period in range(1, min(largest, count - 1) + 1):
        start, stop = _longest_run(numbers[:-period] == numbers[period:])
        stop += period
        if stop - start == count and 3 * period <= 2 * count:
            return slice(0, period)
        repeats = 3 if period < 3 else 2
        if (
            inner is None
            and max(start, count - stop) <= margin
            and stop - start >= max(repeats * period, count // 2 + 1)
        ):
            inner = slice(start, start + period)
    if inner is not None:
        return inner
    return slice(0, count) if count <= largest else None


def _longest_run(alike: np.ndarray) -> tuple[int, int]:
    """Start and stop of the longest run of True; both 0 where there is none."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], alike, [False]])))
    starts, stops = edges[::2], edges[1::2]
    if not len(starts):
        return 0, 0
    longest = int(np.argmax(stops - starts))
    return int(starts[longest]), int(stops[longest])
