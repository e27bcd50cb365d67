"""A checkpoint of a run as a file, tied to the settings that the run began with."""

from __future__ import annotations

import dataclasses
import json
import os
import time
import typing
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Generic

import numpy as np
from numpy.typing import NDArray

from yarnscale.errors import InputError
from yarnscale.files.array_file import read_arrays, read_names, write_arrays
from yarnscale.files.fingerprint import fingerprint
from yarnscale.motion.body import State
from yarnscale.motion.run import Run
from yarnscale.motion.unfulfilled import Unfulfilled, plain
from yarnscale.numerics.newton import Status
from yarnscale.version import __version__

NAME = "checkpoint.npz"
INTERVAL = 5.0
"""Seconds between two checkpoints with no frame between them."""
_STATE = "state."
_WHAT = "checkpoint of a run"


class CheckpointFile(Generic[State]):
    """The checkpoint from which a run is resumed; pass ``write`` as ``on_checkpoint``.

    It is replaced after every frame and every ``interval`` seconds, in one step each. kind: of the states, a dataclass
    of arrays and of such dataclasses. settings: all that shapes the run, by name; their fingerprints go along.
    """

    def __init__(
        self,
        path: str | os.PathLike[str],
        kind: type[State],
        settings: Mapping[str, object],
        *,
        interval: float = INTERVAL,
    ) -> None:
        self.path, self._kind, self._interval = Path(path), kind, interval
        self._settings = {name: fingerprint(value) for name, value in settings.items()}
        self._settings["version of yarnscale"] = __version__
        self._frames, self._written = -1, -np.inf

    def write(self, run: Run[State]) -> None:
        """Write it where that is due. Raises InputError where the file cannot be written."""
        now = time.monotonic()
        new = run.frames != self._frames or run.status is not None
        if not new and now - self._written < self._interval:
            return
        content = {field.name: getattr(run, field.name) for field in dataclasses.fields(run)}
        arrays = _flat(content.pop("state"), _STATE)
        content["status"] = None if run.status is None else run.status.name
        content["unfulfilled"] = plain(run.unfulfilled)
        write_arrays(self.path, settings=json.dumps(self._settings), run=json.dumps(content), **arrays)
        self._frames, self._written = run.frames, now

    def read(self) -> Run[State]:
        """The run to resume; InputError where there is none, or one that began with other settings."""
        if not self.path.exists():
            raise InputError("nothing to resume", where=self.path, expected=_WHAT)
        names = {*read_names(self.path, what=_WHAT), "settings", "run"}
        arrays = read_arrays(self.path, *names, what=_WHAT)
        try:
            settings = json.loads(str(arrays.pop("settings")))
            content = json.loads(str(arrays.pop("run")))
            self._check(settings)
            content["status"] = None if content["status"] is None else Status[content["status"]]
            content["unfulfilled"] = tuple(Unfulfilled(**entry) for entry in content["unfulfilled"])
            run = Run(_nested(self._kind, arrays, _STATE), **content)
            self._frames, self._written = run.frames, time.monotonic()
            return run
        except (TypeError, ValueError, KeyError, AttributeError) as error:
            if isinstance(error, InputError):
                raise
            raise InputError(f"file is no {_WHAT}", where=self.path, found=str(error)[:80]) from None

    def _check(self, settings: Mapping[str, str]) -> None:
        names = list(dict.fromkeys([*self._settings, *settings]))
        other = [name for name in names if settings.get(name) != self._settings.get(name)]
        if other:
            raise InputError(
                "run cannot be resumed",
                where=self.path,
                expected="the settings that it began with",
                found="another " + ", another ".join(other),
            )


def _flat(value: Any, prefix: str) -> dict[str, NDArray[Any]]:
    """Fields by name, those of an inner dataclass with its name and a dot before them; None is left out."""
    found: dict[str, NDArray[Any]] = {}
    for field in dataclasses.fields(value):
        content, name = getattr(value, field.name), prefix + field.name
        if dataclasses.is_dataclass(content):
            found |= _flat(content, f"{name}.")
        elif content is not None:
            found[name] = np.asarray(content)
    return found


def _nested(kind: type[Any], arrays: Mapping[str, NDArray[Any]], prefix: str) -> Any:
    """The reverse of ``_flat``."""
    values: dict[str, object] = {}
    for name, hint in typing.get_type_hints(kind).items():
        inner = next((k for k in (hint, *typing.get_args(hint)) if dataclasses.is_dataclass(k)), None)
        if inner is not None and any(key.startswith(f"{prefix}{name}.") for key in arrays):
            values[name] = _nested(inner, arrays, f"{prefix}{name}.")  # type: ignore[arg-type]
        elif prefix + name in arrays:
            array = arrays[prefix + name]
            values[name] = array if array.ndim else array.item()
    return kind(**values)
