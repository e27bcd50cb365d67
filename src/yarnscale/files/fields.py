"""Checked access to the contents of JSON and TOML files, with errors that name file, line and field."""

from __future__ import annotations

import json
import math
import re
import tomllib
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NoReturn, Self, TypeVar

import numpy as np

from yarnscale.arrays import Array, Integers
from yarnscale.errors import InputError, misspelt, quoted
from yarnscale.files.source_text import read_source

Default = TypeVar("Default")


class Fields:
    """A JSON object or TOML table of a file; ``name`` is its own place there, empty for the whole file."""

    def __init__(self, content: object, path: str | Path, name: str = "") -> None:
        self.path, self.name = path, name
        if not isinstance(content, Mapping):
            raise self.fault("", expected="a table of fields", found=quoted(content))
        self.content = content

    def fault(self, key: str, *, expected: object = None, found: object = None) -> InputError:
        """The error of a field, ready to raise."""
        return InputError(f"field '{self.label(key)}'", where=self.path, expected=expected, found=found)

    def label(self, key: str) -> str:
        """Full name of a field, as errors show it."""
        return ".".join(part for part in (self.name, key) if part)

    def known(self, *names: str) -> Self:
        """These fields; InputError where there is another."""
        for key in self.content:
            if key not in names:
                what = f"unknown field '{self.label(str(key)):.60}'"
                found = misspelt(key, names)
                raise InputError(what, where=self.path, expected=", ".join(names), found=found)
        return self

    def get(self, key: str) -> object:
        """A field that must be there."""
        if key not in self.content:
            raise InputError(f"missing field '{self.label(key)}'", where=self.path)
        return self.content[key]

    def fields(self, key: str, *, optional: bool = False) -> Self:
        """A field that is a table itself; an optional one may be missing and is empty then."""
        content = self.content.get(key, {}) if optional else self.get(key)
        return type(self)(content, self.path, self.label(key))

    def items(self, key: str, *, optional: bool = False) -> list[Self]:
        """A field that is a list of tables; an optional one may be missing and is empty then."""
        found = self.content.get(key, []) if optional else self.get(key)
        if not isinstance(found, list):
            raise self.fault(key, expected="a list", found=quoted(found))
        return [type(self)(item, self.path, f"{self.label(key)}[{i}]") for i, item in enumerate(found)]

    def text(self, key: str) -> str:
        """A string."""
        value = self.get(key)
        if not isinstance(value, str):
            raise self.fault(key, expected="a string", found=quoted(value))
        return value

    def flag(self, key: str) -> bool:
        """True or false."""
        value = self.get(key)
        if not isinstance(value, bool):
            raise self.fault(key, expected="true or false", found=quoted(value))
        return value

    def choice(self, key: str, choices: tuple[str, ...]) -> str:
        """One of several strings."""
        value = self.text(key)
        if value not in choices:
            raise self.fault(key, expected=" or ".join(choices), found=misspelt(value, choices))
        return value

    def integer(self, key: str) -> int:
        """A whole number."""
        return int(self.integers(key, shape=()))

    def number(self, key: str, *, positive: bool = False) -> float:
        """A finite number; positive: above zero."""
        value = float(self.numbers(key, shape=()))
        if positive and value <= 0:
            raise self.fault(key, expected="a positive number", found=value)
        return value

    def flag_or(self, key: str, default: bool) -> bool:
        """``flag``, or a default where it is missing."""
        return self.flag(key) if key in self.content else default

    def choice_or(self, key: str, default: Default, choices: tuple[str, ...]) -> str | Default:
        """``choice``, or a default where it is missing."""
        return self.choice(key, choices) if key in self.content else default

    def text_or(self, key: str, default: Default) -> str | Default:
        """``text``, or a default where it is missing."""
        return self.text(key) if key in self.content else default

    def integer_or(self, key: str, default: Default) -> int | Default:
        """``integer``, or a default where it is missing."""
        return self.integer(key) if key in self.content else default

    def number_or(self, key: str, default: Default) -> float | Default:
        """``number``, or a default where it is missing."""
        return self.number(key) if key in self.content else default

    def integers(self, key: str, *, shape: tuple[int, ...] | None = None) -> Integers:
        """Whole numbers of the given shape, or a flat list of any length."""
        return self._array(key, shape, int).astype(np.int64)

    def numbers(self, key: str, *, shape: tuple[int, ...] | None = None) -> Array:
        """Finite numbers of the given shape, or a flat list of any length."""
        return self._array(key, shape, (int, float))

    def knots(self, key: str) -> Array:
        """At least two strictly increasing numbers."""
        knots = self.numbers(key)
        if len(knots) < 2 or not np.all(np.diff(knots) > 0):
            raise self.fault(key, expected="two or more increasing knots", found=str(knots.tolist())[:80])
        return knots

    def _array(self, key: str, shape: tuple[int, ...] | None, kind: type | tuple[type, ...]) -> Array:
        value, what = self.get(key), "an integer" if kind is int else "a number"
        for place, entry in _entries(value):
            if isinstance(entry, bool) or not isinstance(entry, kind):
                raise self.fault(key + place, expected=what, found=quoted(entry))
            if isinstance(entry, float) and not math.isfinite(entry):
                raise self.fault(key + place, expected="a finite number", found=entry)
        if shape is not None and len(shape) == 2 and isinstance(value, list):
            for row, entries in enumerate(value):
                if isinstance(entries, list) and len(entries) != shape[1]:
                    raise self.fault(f"{key}[{row}]", expected=f"{shape[1]} numbers", found=len(entries))
        try:
            array = np.array(value, dtype=np.float64)
        except OverflowError:
            raise self.fault(key, expected="a finite number", found="one beyond all floats") from None
        except (ValueError, TypeError):
            raise self.fault(key, expected=f"an even array, {what} each", found="rows that differ") from None
        if (array.ndim != 1) if shape is None else (array.shape != shape):
            wanted = "a list of numbers" if shape is None else _shape(shape)
            raise self.fault(key, expected=wanted, found=_shape(array.shape))
        if kind is int and np.abs(array).max(initial=0.0) > 2**53:
            raise self.fault(key, expected="small integers", found=f"{np.abs(array).max():g}")
        return array


@contextmanager
def json_file(path: str | Path) -> Iterator[Fields]:
    """The object in a JSON file; InputError as ``read_json``, and with the line of the field that a fault names."""
    with json_text(path, read_source(path)) as table:
        yield table


@contextmanager
def json_text(path: str | Path, text: str) -> Iterator[Fields]:
    """The object in a JSON text; errors as of ``json_file``, with this name in place of the file's."""
    with _lines_of(path, text, _json_line):
        yield Fields(_json_object(path, text), path)


@contextmanager
def toml_file(path: str | Path) -> Iterator[Fields]:
    """The tables of a TOML file; InputError where it is none, and with the line of the field that a fault names."""
    text = read_source(path)
    try:
        content = tomllib.loads(text)
    except (tomllib.TOMLDecodeError, RecursionError, ValueError) as error:
        line = re.search(r"at line (\d+)", str(error))
        number = int(line.group(1)) if line else text.rstrip().count("\n") + 1
        raise InputError("file is not TOML", where=f"{path}:{number}", found=str(error)) from None
    with _lines_of(path, text, _toml_line):
        yield Fields(content, path)


def read_json(path: str | Path) -> dict[str, Any]:
    """The object in a JSON file; InputError where it is no JSON, no object, holds NaN, or a field twice."""
    return _json_object(path, read_source(path))


def _json_object(path: str | Path, text: str) -> dict[str, Any]:
    def no_constant(token: str) -> NoReturn:
        where = f"{path}:{text.count(chr(10), 0, text.find(token)) + 1}"
        raise InputError("number is not finite", where=where, expected="a finite number", found=token)

    def once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
        fields = dict(pairs)
        if len(fields) < len(pairs):
            keys = [key for key, _ in pairs]
            twice = next(key for key in keys if keys.count(key) > 1)
            raise InputError(f"field {quoted(twice)} occurs twice", where=path, expected="every field once")
        return fields

    try:
        content = json.loads(text, parse_constant=no_constant, object_pairs_hook=once)
    except InputError:
        raise
    except json.JSONDecodeError as error:
        raise InputError("file is not JSON", where=f"{path}:{error.lineno}", found=error.msg) from None
    except (RecursionError, ValueError) as error:
        raise InputError("file is not JSON", where=path, found=error) from None
    if not isinstance(content, dict):
        raise InputError("file is not an object", where=path, expected="a JSON object", found=type(content).__name__)
    return content


@contextmanager
def _lines_of(path: str | Path, text: str, line_of: Callable[[str, str], int | None]) -> Iterator[None]:
    """Faults without a place, or with no more than the file, get the line of the field that they name."""
    try:
        yield
    except InputError as error:
        if error.where is not None and str(error.where) != str(path):
            raise
        line = line_of(text, error.what)
        raise error.at(path if line is None else f"{path}:{line}") from None


def _json_line(text: str, what: str) -> int | None:
    """The line of the first field that a message names; of a field in others, below theirs."""
    if (path := re.search(r"'([\w.\[\]]+)'", what)) is not None:
        place, names = 0, re.findall(r"[A-Za-z_]\w*", path[1])
        for name in names:
            found = re.compile(rf'"{name}"\s*:').search(text, place)
            place = place if found is None else found.start()
        if place:
            return text.count("\n", 0, place) + 1
    for word in re.findall(r"[A-Za-z_]\w*", what):
        if (found := re.search(rf'"{word}"\s*:', text)) is not None:
            return text.count("\n", 0, found.start()) + 1
    return None


def _toml_line(text: str, what: str) -> int | None:
    """The first line whose key or table a message names, such as ``[contact] friction`` or ``obstacles[1].radius``."""
    lines = _toml_lines(text)
    section = re.match(r"\[([\w.\[\]-]+)\] ", what)
    words = re.findall(r"[A-Za-z_][\w.-]*(?:\[\d+\][\w.-]*)*", what)
    names = [f"{section[1]}.{word}" for word in words] if section else []
    for name in [*names, *words]:
        if (line := lines.get(name, lines.get(name.partition("[")[0]))) is not None:
            return line
    return lines.get(section[1]) if section else None


_HEADER = re.compile(r"\s*(\[\[?)\s*([^\[\]#]+?)\s*\]\]?")
_KEY = re.compile(r"\s*([A-Za-z0-9_.\"' -]+?)\s*=")


def _toml_lines(text: str) -> dict[str, int]:
    """Line of every key and table, by its full name."""
    lines: dict[str, int] = {}
    section, counts = "", dict[str, int]()
    for number, line in enumerate(text.splitlines(), start=1):
        if header := _HEADER.match(line):
            section = header[2].replace(" ", "")
            if header[1] == "[[":
                counts[section] = counts.get(section, -1) + 1
                section += f"[{counts[section]}]"
            lines.setdefault(section, number)
        elif key := _KEY.match(line):
            name = re.sub(r"[ \"']", "", key[1])
            lines.setdefault(f"{section}.{name}" if section else name, number)
    return lines


def _entries(value: object, place: str = "") -> Iterator[tuple[str, object]]:
    """What lists within lists hold, with the place of each, such as ``[3][0]``."""
    if not isinstance(value, list):
        yield place, value
        return
    for number, entry in enumerate(value):
        yield from _entries(entry, f"{place}[{number}]")


def _shape(shape: tuple[int, ...]) -> str:
    if not shape:
        return "one number"
    return " × ".join(str(n) for n in shape) + " numbers"
