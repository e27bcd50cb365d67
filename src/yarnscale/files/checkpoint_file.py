"""A checkpoint of a run as a file, tied to the scene that it belongs to."""

from __future__ import annotations

import dataclasses
import json
import os
import time
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from yarnscale import __version__
from yarnscale.errors import InputError
from yarnscale.files.array_file import read_arrays, read_names, write_arrays
from yarnscale.files.fingerprint import fingerprint
from yarnscale.numerics.newton import Status
from yarnscale.shell.dynamics.checkpoint import Checkpoint
from yarnscale.shell.scenes.scene import Scene
from yarnscale.shell.state import ClothState, Earlier, Slips
from yarnscale.unfulfilled import Unfulfilled, plain

NAME = "checkpoint.npz"
_INNER = {"state": ClothState, "before": Earlier, "slips": Slips}
"""Fields that are dataclasses themselves."""
INTERVAL = 5.0
"""Seconds between two checkpoints with no frame between them."""


class CheckpointFile:
    """The file that a run goes on from; pass ``write`` as ``on_checkpoint``.

    It is replaced after every frame and every few seconds, in one step each. It bears the fingerprint of the scene:
    mesh, material, handles, contact, obstacles, start, schedule and options.
    """

    def __init__(self, path: str | os.PathLike[str], scene: Scene) -> None:
        self.path, self._scene = Path(path), scene_fingerprint(scene)
        self._frames, self._written = -1, -np.inf

    def write(self, checkpoint: Checkpoint) -> None:
        """Write it where that is due. Raises InputError where the file cannot be written."""
        now = time.monotonic()
        new = checkpoint.frames != self._frames or checkpoint.status is not None
        if not new and now - self._written < INTERVAL:
            return
        arrays = _flat(checkpoint, "")
        write_arrays(self.path, scene=np.array(self._scene), version=np.array(__version__), **arrays)
        self._frames, self._written = checkpoint.frames, now

    def read(self) -> Checkpoint | None:
        """The checkpoint to go on from, None where there is no file; InputError where it is of another scene."""
        if not self.path.exists():
            return None
        what = "checkpoint of a run"
        names = read_names(self.path, what=what)
        arrays = read_arrays(self.path, *{*names, "scene", "version", "state.positions", "begin"}, what=what)
        for name, wanted in (("version", __version__), ("scene", self._scene)):
            if str(arrays.pop(name)) != wanted:
                other = "another version of yarnscale" if name == "version" else "another scene"
                raise InputError(
                    "run cannot be resumed",
                    where=self.path,
                    expected="the scene, material and options that it began with",
                    found=other,
                )
        try:
            values = _nested(arrays)
            if "status" in values:
                values["status"] = Status[str(values["status"])]
            found = json.loads(str(values.get("unfulfilled", "[]")))
            values["unfulfilled"] = tuple(Unfulfilled(**entry) for entry in found)
            return Checkpoint(**values)  # type: ignore[arg-type]
        except (TypeError, ValueError, KeyError) as error:
            raise InputError(f"file is no {what}", where=self.path, found=str(error)[:80]) from None


def scene_fingerprint(scene: Scene) -> str:
    """What all that shapes a run comes to; not its name, nor what is measured at the end."""
    return fingerprint(scene.cloth, scene.start, scene.schedule, scene.options)


def _flat(value: Checkpoint | ClothState | Earlier | Slips, prefix: str) -> dict[str, NDArray]:
    """Fields by name, those of an inner dataclass with its name and a dot before them; None is left out."""
    found: dict[str, NDArray] = {}
    for field in dataclasses.fields(value):
        content, name = getattr(value, field.name), prefix + field.name
        if isinstance(content, (ClothState, Earlier, Slips)):
            found |= _flat(content, f"{name}.")
        elif isinstance(content, Status):
            found[name] = np.array(content.name)
        elif isinstance(content, tuple):
            found[name] = np.array(json.dumps(plain(content)))
        elif content is not None:
            found[name] = np.asarray(content)
    return found


def _nested(arrays: dict[str, NDArray]) -> dict[str, object]:
    """The reverse of ``_flat``: names with a dot make inner dataclasses."""
    plain: dict[str, object] = {}
    inner: dict[str, dict[str, NDArray]] = {}
    for name, array in arrays.items():
        first, _, rest = name.partition(".")
        if rest:
            inner.setdefault(first, {})[rest] = array
        else:
            plain[name] = array.item() if array.ndim == 0 else array
    return plain | {name: _INNER[name](**_nested(part)) for name, part in inner.items()}  # type: ignore[arg-type]
