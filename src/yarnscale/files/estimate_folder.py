"""Finished evaluations of an estimate in a folder, one small file each, so that a killed run can continue."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path

import numpy as np

from yarnscale.arrays import Array
from yarnscale.errors import InputError
from yarnscale.files.atomic import write_text
from yarnscale.files.fingerprint import code_fingerprint, fingerprint
from yarnscale.files.run_folder import writable_folder
from yarnscale.swatches.evaluations import Residuals
from yarnscale.swatches.objective import YarnObjective

EVALUATING = ("numerics", "yarn", "cell", "swatches", "kinematics.py")
"""Code that an evaluation depends on."""


class EstimateFolder:
    """Evaluations of one objective by this code; those of others in the same folder are not mistaken for its own."""

    def __init__(self, folder: Path, objective: YarnObjective) -> None:
        self.folder = folder
        self._mark = (fingerprint(objective) + code_fingerprint(*EVALUATING)).encode()

    def find(self, key: bytes) -> Residuals | None:
        """The evaluation of a key, None where it is not there or cannot be read."""
        try:
            entry = json.loads(self._path(key).read_text())
            return Residuals(np.array(entry["residuals"], float), int(entry["solves"]), float(entry["seconds"]))
        except (OSError, ValueError, KeyError, TypeError):
            return None

    def keep(self, key: bytes, unknowns: Array, found: Residuals) -> None:
        """Write an evaluation in one step. InputError where the folder cannot be written."""
        entry = {"unknowns": unknowns.tolist(), "residuals": found.residuals.tolist(), "solves": found.solves,
                 "seconds": found.seconds}  # fmt: skip
        write_text(self._path(key), json.dumps(entry))

    def _path(self, key: bytes) -> Path:
        return self.folder / f"{hashlib.sha256(self._mark + key).hexdigest()[:24]}.json"


def check_evaluations(folder: Path) -> None:
    """InputError where a folder has no evaluations of an earlier run."""
    if not folder.is_dir():
        raise InputError("nothing to resume", where=folder, expected="evaluations of an earlier run")


def evaluation_folder(folder: Path, *, resume: bool) -> Path:
    """The folder for evaluations. InputError where there is nothing to resume."""
    if resume:
        check_evaluations(folder)
    return writable_folder(folder)
