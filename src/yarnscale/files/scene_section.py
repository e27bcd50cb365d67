"""Tables of a scene file: checked access with defaults, errors that name file and field."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from yarnscale.errors import InputError
from yarnscale.files.json_fields import Fields
from yarnscale.motion.rigid import Motion

Built = TypeVar("Built")
Vector = tuple[float, float, float]

SMALLEST, LARGEST = 1e-12, 1e12
"""Sizes of numbers other than 0, in SI units or degrees; what lies outside is a slip."""
MOTION = ("displacement", "start", "duration", "rotation", "pivot", "ease")
"""Keys of a motion."""


class Section(Fields):
    """A table of the file; keys have defaults, and unknown keys are refused by ``known``."""

    def known(self, *names: str) -> Section:
        for key in self.content:
            if key not in names:
                raise InputError(
                    f"unknown key '{self.label(str(key))}'", where=self.path, expected=", ".join(names)
                )
        return self

    def section(self, key: str) -> Section:
        return Section(self.content.get(key, {}), self.path, self.label(key))

    def sections(self, key: str) -> list[Section]:
        if key not in self.content:
            return []
        return [Section(item.content, item.path, item.name) for item in self.items(key)]

    def numbers(self, key: str, *, shape: tuple[int, ...] | None = None) -> NDArray[np.float64]:
        found = super().numbers(key, shape=shape)
        size = np.abs(found)
        if (wrong := (size > LARGEST) | ((size > 0.0) & (size < SMALLEST))).any():
            raise self.fault(
                key, expected=f"0, or from {SMALLEST:g} to {LARGEST:g} in size", found=found[wrong][0]
            )
        return found

    def number_or(self, key: str, default: float) -> float:
        return self.number(key) if key in self.content else default

    def vector_or(self, key: str, default: Vector) -> Vector:
        return self.vector(key) if key in self.content else default

    def vector(self, key: str) -> Vector:
        x, y, z = self.numbers(key, shape=(3,))
        return float(x), float(y), float(z)

    def flag_or(self, key: str, default: bool) -> bool:
        value = self.content.get(key, default)
        if not isinstance(value, bool):
            raise self.fault(key, expected="true or false", found=repr(value)[:60])
        return value

    def choice_or(self, key: str, default: str, choices: tuple[str, ...]) -> str:
        value = self.text(key) if key in self.content else default
        if value not in choices:
            raise self.fault(key, expected=" or ".join(choices), found=repr(value)[:60])
        return value

    def text_or(self, key: str, default: str) -> str:
        return self.text(key) if key in self.content else default

    def integer_or(self, key: str, default: int) -> int:
        return self.integer(key) if key in self.content else default

    def beside(self, name: str) -> Path:
        """A file named in the scene, which lies beside it."""
        return Path(self.path).parent / name

    def motion(self) -> Motion:
        """The keys ``MOTION`` as a motion; angles in degrees."""
        turn = self.vector_or("rotation", (0.0, 0.0, 0.0))
        return self.build(
            lambda: Motion(
                self.vector_or("displacement", (0.0, 0.0, 0.0)),
                self.number_or("start", 0.0),
                self.number_or("duration", 0.0),
                rotation=(math.radians(turn[0]), math.radians(turn[1]), math.radians(turn[2])),
                pivot=self.vector_or("pivot", (0.0, 0.0, 0.0)),
                ease=self.flag_or("ease", True),
            )
        )

    def build(self, make: Callable[[], Built]) -> Built:
        """What ``make`` returns; an InputError of it is told with file and section."""
        try:
            return make()
        except InputError as error:
            if error.where is not None:
                raise
            what = f"[{self.name}] {error.what}" if self.name else error.what
            raise InputError(what, where=self.path, expected=error.expected, found=error.found) from None
