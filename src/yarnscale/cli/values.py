"""Values of options, checked as they are read; imports nothing heavy."""

from __future__ import annotations

import argparse
import math
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from yarnscale.errors import InputError, quoted
from yarnscale.files.source_text import finite_number


def numbers(count: int, names: str) -> Callable[[str], tuple[float, ...]]:
    """A parser of ``count`` finite numbers with commas between them."""

    def parse(text: str) -> tuple[float, ...]:
        values = tuple(finite_number(part.strip()) for part in text.split(","))
        if len(values) != count or any(map(math.isnan, values)):
            raise argparse.ArgumentTypeError(f"expected {count} numbers {names}; found {text!r}")
        return values

    return parse


def number_list(text: str) -> tuple[float, ...]:
    """Any count of finite numbers with commas between them."""
    return tuple(number(part) for part in text.split(","))


def whole(what: str, low: int, high: float = math.inf) -> Callable[[str], int]:
    """A parser of whole numbers from ``low`` to ``high``; what: these, for the error."""

    def parse(text: str) -> int:
        if not (text.isascii() and text.isdecimal() and low <= int(text) <= high):
            raise argparse.ArgumentTypeError(f"expected {what}; found {quoted(text)}")
        return int(text)

    return parse


positive_integer = whole("a positive whole number", 1)
port = whole("a port, 1 to 65535", 1, 65535)


def size(text: str) -> tuple[int, int]:
    """Numbers of tiles along x and y, such as 2x1."""
    match = re.fullmatch(r"([1-9]\d{0,3})x([1-9]\d{0,3})", text.strip())
    if match is None:
        raise argparse.ArgumentTypeError(f"expected numbers of tiles such as 2x1; found {text!r}")
    return int(match[1]), int(match[2])


def sizes(text: str) -> list[tuple[int, int]]:
    """Sizes with commas between them."""
    return [size(part) for part in text.split(",")]


@dataclass(frozen=True)
class FrameChoice:
    """Frames from a first to a last one, both among them, in steps; negative numbers count from the end."""

    first: int | None = None
    last: int | None = None
    step: int = 1

    def of(self, numbers: Sequence[int]) -> list[int]:
        """Those of the frames with these numbers, increasing; InputError where there is none."""
        end = numbers[-1] + 1
        low = numbers[0] if self.first is None else self.first + (end if self.first < 0 else 0)
        high = numbers[-1] if self.last is None else self.last + (end if self.last < 0 else 0)
        chosen = [n for n in numbers if low <= n <= high and (n - low) % self.step == 0]
        if not chosen:
            found = f"{low} to {high} in steps of {self.step}"
            raise InputError("--frames", expected=f"some of {numbers[0]} to {numbers[-1]}", found=found)
        return chosen


def frames(text: str) -> FrameChoice:
    """FIRST:LAST:STEP, each of which may be left out, or the number of one frame."""
    match = re.fullmatch(r"(-?\d{1,6})?(:(-?\d{1,6})?(:([1-9]\d{0,5})?)?)?", text.strip())
    if match is None or not text.strip():
        raise argparse.ArgumentTypeError(f"expected FIRST:LAST:STEP or a number; found {text!r}")
    first, last = (None if match[k] is None else int(match[k]) for k in (1, 3))
    return FrameChoice(first, first if match[2] is None else last, int(match[5] or 1))


def two_lengths(text: str) -> tuple[float, float]:
    """Two lengths [m] of a text such as 100x50, in mm."""
    number = r"(\d+(?:\.\d+)?|\.\d+)"
    match = re.fullmatch(rf"{number}[x×]{number}(?:mm)?", text.replace(" ", ""))
    if match is None or not float(match[1]) or not float(match[2]):
        raise argparse.ArgumentTypeError(f"expected WxH in mm, such as 100x50; found {quoted(text)}")
    return 1e-3 * float(match[1]), 1e-3 * float(match[2])


def refuse(options: argparse.Namespace, names: Sequence[str], expected: str) -> None:
    """InputError for the first of some options, by their names in Python, that is given and not at its default."""
    for name in names:
        if (value := getattr(options, name)) != options.default(name):
            raise InputError(f"--{name.replace('_', '-')}", expected=expected, found=value)


def _real(what: str, fits: Callable[[float], bool]) -> Callable[[str], float]:
    """A parser of finite numbers; NaN fits none."""

    def parse(text: str) -> float:
        if not fits(value := finite_number(text)):
            raise argparse.ArgumentTypeError(f"expected {what}; found {text!r}")
        return value

    return parse


number = _real("a number", math.isfinite)
positive = _real("a positive number", lambda value: value > 0)
not_negative = _real("zero or a positive number", lambda value: value >= 0)
