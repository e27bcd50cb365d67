"""A hash of values: nested dataclasses, arrays, lists and plain values."""

from __future__ import annotations

import dataclasses
import hashlib
from collections.abc import Mapping
from enum import Enum
from functools import cache
from importlib.resources import files

import numpy as np


def fingerprint(*values: object) -> str:
    """SHA-256 of values, as 64 hexadecimal digits; functions count by their names.

    Equal values of equal types have the same one, in every process. Raises TypeError for unknown kinds.
    """
    digest = hashlib.sha256()
    for value in values:
        _feed(digest, value)
    return digest.hexdigest()


@cache
def code_fingerprint(*parts: str) -> str:
    """SHA-256 of the sources of parts of the package: results of other code are not those of this.

    parts: names of rooms (``cell``) and of single files (``kinematics.py``). A package without sources, as compiled
    ones are, has one for all versions of itself. Raises FileNotFoundError for parts that are not there.
    """
    digest = hashlib.sha256()
    for part in sorted(parts):
        place = files("yarnscale").joinpath(part)
        entries = [place] if part.endswith(".py") else sorted(place.iterdir(), key=lambda entry: entry.name)
        for source in entries:
            if source.name.endswith(".py"):
                digest.update(f"{part}/{source.name}:".encode() + source.read_bytes())
    return digest.hexdigest()


def _feed(digest: hashlib._Hash, value: object) -> None:
    name = f"{type(value).__module__}.{type(value).__qualname__}"
    if isinstance(value, Enum):
        digest.update(f"{name}:{value.name};".encode())
    elif value is None or isinstance(value, (bool, int, float, str)):
        digest.update(f"{name}:{value!r};".encode())
    elif isinstance(value, (np.ndarray, np.generic)):
        array = np.ascontiguousarray(value)
        digest.update(f"array {array.dtype.str} {array.shape}:".encode() + array.tobytes())
    elif dataclasses.is_dataclass(value) and not isinstance(value, type):
        digest.update(f"{name}(".encode())
        for field in dataclasses.fields(value):
            digest.update(f"{field.name}=".encode())
            _feed(digest, getattr(value, field.name))
        digest.update(b")")
    elif isinstance(value, Mapping):
        digest.update(f"map {len(value)}:".encode())
        for key in sorted(value, key=repr):
            _feed(digest, key)
            _feed(digest, value[key])
    elif isinstance(value, (tuple, list)):
        digest.update(f"list {len(value)}:".encode())
        for item in value:
            _feed(digest, item)
    elif callable(value):
        digest.update(f"function {getattr(value, '__qualname__', name)};".encode())
    else:
        raise TypeError(f"no fingerprint of {name}")
