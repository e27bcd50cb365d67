"""Evaluations kept in a folder: found again by the same objective and code, by no other."""

from pathlib import Path

import numpy as np
import pytest

from yarnscale.drawing.library import build
from yarnscale.files import estimate_run
from yarnscale.files.estimate_run import EVALUATING, EstimateFolder
from yarnscale.files.fingerprint import code_fingerprint
from yarnscale.swatches.evaluations import Residuals
from yarnscale.swatches.measurements import Direction
from yarnscale.swatches.objective import ErrorWeights, YarnObjective
from yarnscale.swatches.uniform_data import UniformCurve, UniformData
from yarnscale.swatches.yarn_model import yarn_model


def objective(**weights: float) -> YarnObjective:
    curve = UniformCurve(Direction.WEFT, np.array([0.1]), np.array([0.1]), np.array([1.0]), 0.1)
    model = yarn_model(build("stockinette"), 60.0)
    return YarnObjective(model, UniformData("line", (curve,)), weights=ErrorWeights(**weights))


def test_evaluations_belong_to_their_objective_and_to_the_code_that_made_them(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    kept = Residuals(np.array([0.25, -1.5]), 7, 0.5)
    EstimateFolder(tmp_path, objective()).keep(b"key", np.zeros(5), kept)
    found = EstimateFolder(tmp_path, objective()).find(b"key")
    assert found is not None and (found.solves, found.seconds) == (7, 0.5)
    np.testing.assert_array_equal(found.residuals, kept.residuals)
    assert EstimateFolder(tmp_path, objective(contraction=0.5)).find(b"key") is None
    monkeypatch.setattr(estimate_run, "code_fingerprint", lambda *_: "of other code")
    assert EstimateFolder(tmp_path, objective()).find(b"key") is None


def test_code_tells_rooms_apart() -> None:
    whole = code_fingerprint(*EVALUATING)
    assert whole == code_fingerprint(*reversed(EVALUATING))
    assert len({whole, *(code_fingerprint(room) for room in EVALUATING)}) == 1 + len(EVALUATING)
    with pytest.raises(FileNotFoundError):
        code_fingerprint("kinematic.py")
