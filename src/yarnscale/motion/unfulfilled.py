"""Prescribed motions of obstacles and handles that were not carried out."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace


@dataclass(frozen=True)
class Unfulfilled:
    """A prescribed motion that was not carried out.

    what: obstacle, handle or grip; first: time at which it was first off its place [s]; distance: of its farthest point
    from its place, the largest of the run [m]; remaining: the same at the end of the run [m].
    """

    what: str
    first: float
    distance: float
    remaining: float

    def __str__(self) -> str:
        back = "" if self.remaining > 0.5 * self.distance else f", {self.remaining:.3g} m at the end"
        return f"{self.what} is off its prescribed place from {self.first:.3g} s, by up to {self.distance:.3g} m{back}"


def updated(
    found: Iterable[Unfulfilled], time: float, distances: Mapping[str, float], tolerance: float
) -> tuple[Unfulfilled, ...]:
    """What was found so far, with the distances [m] at another time [s]; those up to ``tolerance`` [m] do not count."""
    known = {entry.what: entry for entry in found}
    for what, distance in distances.items():
        entry = known.get(what)
        if entry is not None:
            known[what] = replace(entry, distance=max(entry.distance, distance), remaining=distance)
        elif not distance <= tolerance:
            known[what] = Unfulfilled(what, time, distance, distance)
    return tuple(known.values())


def sentences(found: Sequence[Unfulfilled], remark: str) -> list[str]:
    """What was not carried out, a sentence each, and a remark on that; none where all was."""
    return [f"not carried out: {entry}" for entry in found] + [f"({remark})"] * bool(found)


def plain(found: Sequence[Unfulfilled]) -> list[dict[str, str | float]]:
    """For JSON: one object for each."""
    return [dict(vars(entry)) for entry in found]
