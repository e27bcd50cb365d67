"""Tables of a scene file: sizes of numbers, vectors, motions, and values with what a table says of their fields."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TypeVar

import numpy as np

from yarnscale.arrays import Array
from yarnscale.errors import InputError
from yarnscale.files.fields import Fields
from yarnscale.motion.rigid import Motion

Built = TypeVar("Built")
Vector = tuple[float, float, float]

SMALLEST, LARGEST = 1e-12, 1e12
"""Accepted sizes of numbers other than 0, in SI units or degrees."""
MOTION = ("displacement", "start", "duration", "rotation", "pivot", "ease")
"""Keys of a motion."""
REGION = {"box": (2, 2), "vertex": (2,), "region": (2, 3)}
"""Keys of what a handle holds, and the shapes of their numbers."""


class SceneTable(Fields):
    """A table of the file."""

    def numbers(self, key: str, *, shape: tuple[int, ...] | None = None) -> Array:
        found = super().numbers(key, shape=shape)
        size = np.abs(found)
        if (wrong := (size > LARGEST) | ((size > 0.0) & (size < SMALLEST))).any():
            expected = f"0, or from {SMALLEST:g} to {LARGEST:g} in size"
            raise self.fault(key, expected=expected, found=found[wrong][0])
        return found

    def vector_or(self, key: str, default: Vector) -> Vector:
        return self.vector(key) if key in self.content else default

    def vector(self, key: str) -> Vector:
        x, y, z = self.numbers(key, shape=(3,))
        return float(x), float(y), float(z)

    def beside(self, name: str) -> Path:
        """A file named in the scene, relative to the scene's folder."""
        return Path(self.path).parent / name

    def region(self) -> Array:
        """Ends of a box of the fabric (2, 2) or of space (2, 3), low and high, or a point of the fabric (2,) [m]."""
        given = [key for key in REGION if key in self.content]
        if len(given) != 1:
            raise self.fault(
                "box", expected="one of 'box' or 'vertex' or 'region'", found=" and ".join(given) or "none"
            )
        found = self.numbers(given[0], shape=REGION[given[0]])
        return np.sort(found, axis=0) if found.ndim == 2 else found

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

    def changed(self, usual: Built, *keys: str, **renamed: str) -> Built:
        """A dataclass with what the table says of its fields ``keys``, of the kind of what they hold.

        renamed: fields that have another name in the table.
        """
        given = {}
        for field, key in {**dict(zip(keys, keys, strict=True)), **renamed}.items():
            if key in self.content:
                given[field] = self._like(key, getattr(usual, field))
        return self.build(lambda: replace(usual, **given))  # type: ignore[type-var]

    def _like(self, key: str, usual: object) -> object:
        if isinstance(usual, bool):
            return self.flag(key)
        if isinstance(usual, int):
            return self.integer(key)
        if isinstance(usual, str):
            return self.text(key)
        return self.vector(key) if isinstance(usual, tuple) else self.number(key)

    def build(self, make: Callable[[], Built]) -> Built:
        """What ``make`` returns; its errors get the file and the section."""
        try:
            return make()
        except InputError as error:
            if error.where is not None:
                raise
            what = f"[{self.name}] {error.what}" if self.name else error.what
            raise InputError(what, where=self.path, expected=error.expected, found=error.found) from None
