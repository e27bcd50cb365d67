"""Read a JSON object that a user names, and its fields, with errors that name file and field."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import NoReturn

import numpy as np
from numpy.typing import NDArray

from yarnscale.errors import InputError
from yarnscale.files.source_text import read_source

Array = NDArray[np.float64]


def read_json(path: str | Path) -> dict[str, object]:
    """The JSON object in a file; InputError where it is missing, binary, empty, not JSON or holds NaN."""
    text = read_source(path)
    try:
        content = json.loads(text, parse_constant=_refuse_constant)
    except json.JSONDecodeError as error:
        raise InputError("file is not JSON", where=f"{path}:{error.lineno}", found=error.msg) from None
    except (ValueError, RecursionError) as error:
        raise InputError("file is not usable JSON", where=path, found=error) from None
    if not isinstance(content, dict):
        raise InputError(
            "file is not an object", where=path, expected="a JSON object", found=type(content).__name__
        )
    return content


def _refuse_constant(text: str) -> NoReturn:
    raise ValueError(f"the value {text}, which is not a number")


class Fields:
    """Checked access to the fields of a parsed JSON object; errors name file and field."""

    def __init__(self, content: object, path: str | Path, name: str = "") -> None:
        self.path, self.name = path, name
        if not isinstance(content, Mapping):
            raise self.fault("", expected="an object", found=type(content).__name__)
        self.content = content

    def fault(self, key: str, *, expected: object = None, found: object = None) -> InputError:
        """The error of a field, ready to raise."""
        return InputError(f"field '{self.label(key)}'", where=self.path, expected=expected, found=found)

    def label(self, key: str) -> str:
        """Full name of a field, as errors show it."""
        return ".".join(part for part in (self.name, key) if part)

    def get(self, key: str) -> object:
        """A field that must be there."""
        if key not in self.content:
            raise InputError(f"missing field '{self.label(key)}'", where=self.path)
        return self.content[key]

    def fields(self, key: str) -> Fields:
        """A field that is an object."""
        return Fields(self.get(key), self.path, self.label(key))

    def items(self, key: str) -> list[Fields]:
        """A field that is a list of objects."""
        found = self.get(key)
        if not isinstance(found, list):
            raise self.fault(key, expected="a list", found=type(found).__name__)
        return [Fields(item, self.path, f"{self.label(key)}[{i}]") for i, item in enumerate(found)]

    def text(self, key: str) -> str:
        """A string."""
        value = self.get(key)
        if not isinstance(value, str):
            raise self.fault(key, expected="a string", found=repr(value)[:60])
        return value

    def integer(self, key: str) -> int:
        """A whole number."""
        value = self.get(key)
        if not isinstance(value, int) or isinstance(value, bool):
            raise self.fault(key, expected="an integer", found=repr(value)[:60])
        return value

    def number(self, key: str, *, positive: bool = False) -> float:
        """A finite number, positive if asked for."""
        value = float(self.numbers(key, shape=()))
        if positive and value <= 0:
            raise self.fault(key, expected="a positive number", found=value)
        return value

    def numbers(self, key: str, *, shape: tuple[int, ...] | None = None) -> Array:
        """Finite numbers of the given shape, or a flat list of any length."""
        value = self.get(key)
        if not _is_numeric(value):
            raise self.fault(key, expected="numbers", found=repr(value)[:60])
        try:
            array = np.array(value, dtype=np.float64)
        except (ValueError, TypeError, OverflowError):
            raise self.fault(
                key, expected="an even array of numbers", found="rows of different lengths"
            ) from None
        if (array.ndim != 1) if shape is None else (array.shape != shape):
            wanted = "a list of numbers" if shape is None else _shape(shape)
            raise self.fault(key, expected=wanted, found=_shape(array.shape))
        if not np.all(np.isfinite(array)):
            raise self.fault(key, expected="finite numbers", found="NaN or infinity")
        return array

    def knots(self, key: str) -> Array:
        """At least two strictly increasing numbers."""
        knots = self.numbers(key)
        if len(knots) < 2 or not np.all(np.diff(knots) > 0):
            raise self.fault(key, expected="two or more increasing knots", found=str(knots.tolist())[:80])
        return knots


def _is_numeric(value: object) -> bool:
    if isinstance(value, list):
        return all(_is_numeric(item) for item in value)
    return isinstance(value, (int, float)) and not isinstance(value, bool)


def _shape(shape: tuple[int, ...]) -> str:
    if not shape:
        return "one number"
    return " × ".join(str(n) for n in shape) + " numbers"
