"""Checks of generated patterns: sizes, vertex counts, distance of the yarns."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from numbers import Real

import numpy as np

from yarnscale.errors import InputError, positive
from yarnscale.yarn.clearance import closest_approach
from yarnscale.yarn.pattern import YarnPattern

LEAST_CLEARANCE = 0.8
"""Generated centre lines stay at least this share of the diameter apart."""
EDGE_LENGTH = 1.05
"""Default length of an edge [radii].

Shorter edges than about 0.7 radii would let a straight yarn touch itself beyond the third neighbour."""
LARGEST_DRAWING = 100_000
"""Vertices of a drawing."""
RANGES = {
    "radius": (1e-9, 1.0),
    "tightness": (0.1, 10.0),
    "half_thickness": (0.1, 100.0),
    "overhang": (1e-3, 1000.0),
    "vertices_per_stitch": (0.1, 200.0),
}
"""Least and largest value of a size, radii in metres; all others 0.1 to 1000 (radii)."""


def checked_size(name: str, value: object) -> float:
    """A finite positive number; InputError naming the parameter otherwise."""
    if isinstance(value, bool) or not isinstance(value, Real):
        raise InputError(f"{name} must be a number", expected="> 0", found=repr(value))
    number = positive(f"{name} must be positive", float(value), "> 0")
    least, most = RANGES.get("radius" if name.startswith("radius") else name, (0.1, 1000.0))
    if not least <= number <= most:
        unit = " m" if name.startswith("radius") else ""
        raise InputError(f"{name} is out of range", expected=f"{least:g} to {most:g}{unit}", found=f"{number:g}{unit}")
    return number


def drawable(count: float) -> None:
    """InputError where a drawing would have more than ``LARGEST_DRAWING`` vertices."""
    if count > LARGEST_DRAWING:
        expected = f"at most {LARGEST_DRAWING} vertices"
        raise InputError("drawing is too large", expected=expected, found=f"about {count:.3g}")


def vertex_count(length: float, stitches: int, per_stitch: float | None, radius: float) -> int:
    """Number of vertices of a yarn of `length` [m] over `stitches` stitches, at least 3."""
    if per_stitch is None:
        return max(3, round(length / (EDGE_LENGTH * radius)))
    return max(3, round(stitches * checked_size("vertices_per_stitch", per_stitch)))


def yarn_letters(field: str, letters: Sequence[str] | None, count: int, *, most: int) -> list[tuple[int, ...]]:
    """Kinds of yarn as numbers, for each of `count` courses, picks or ends one (or up to `most`, plated).

    letters: a text of one or more letters for each; kinds are numbered in the order of the letters. None: all 0.
    """
    if letters is None:
        return [(0,)] * count
    texts = list(letters)
    if len(texts) != count:
        raise InputError(f"{field} has the wrong length", expected=f"{count} kinds of yarn", found=len(texts))
    for place, text in enumerate(texts, start=1):
        if not isinstance(text, str) or not 1 <= len(text) <= most or not text.isalpha() or not text.isascii():
            expected = "a letter" if most == 1 else f"1 to {most} letters"
            raise InputError(f"{field} entry {place} is no kind of yarn", expected=expected, found=repr(text))
    known = sorted(set("".join(texts)))
    return [tuple(known.index(letter) for letter in text) for text in texts]


def relative_radii(letters: Sequence[str], radius: float, given: Mapping[str, float] | None) -> np.ndarray:
    """Radius of each yarn over ``radius`` [m], from the letters of their kinds and the radii given for some [m]."""
    for letter, value in (given or {}).items():
        checked_size(f"radius_{letter}", value)
        if letter not in letters:
            expected = ", ".join(sorted(set(letters)))
            raise InputError(f"radius_{letter} belongs to no yarn", expected=expected, found=letter)
    return np.array([(given or {}).get(letter, radius) / radius for letter in letters])


def has_room(pattern: YarnPattern) -> bool:
    """Whether the yarns keep `LEAST_CLEARANCE`."""
    return closest_approach(pattern).distance >= 2.0 * LEAST_CLEARANCE * pattern.radius


def check_drawn(pattern: YarnPattern) -> YarnPattern:
    """The pattern itself, or InputError where its yarns overlap."""
    approach = closest_approach(pattern)
    share = approach.distance / (2.0 * pattern.radius)
    if share < LEAST_CLEARANCE:
        raise InputError(
            f"the yarns of {pattern.name} overlap at this stitch size",
            expected=f"centre lines at least {LEAST_CLEARANCE:g} diameters apart (a larger spacing)",
            found=f"{share:.2g} diameters between segments {approach.first} and {approach.second}",
        )
    return pattern
