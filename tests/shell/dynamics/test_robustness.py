"""Steps from random and from extreme states: no NaN, no failed factorisation, a clear status.

A sample of what ``benchmarks/cloth_robustness.py`` does ten thousand times.
"""

from __future__ import annotations

import sys
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from yarnscale.files.material_json import read_material
from yarnscale.numerics.newton import Status
from yarnscale.shell.materials.material import ShellMaterial

BENCHMARKS = Path(__file__).resolve().parents[3] / "benchmarks"


@pytest.fixture(scope="module")
def robustness() -> ModuleType:
    sys.path.insert(0, str(BENCHMARKS))
    try:
        import cloth_robustness  # type: ignore[import-not-found]
    finally:
        sys.path.remove(str(BENCHMARKS))
    return cloth_robustness


@pytest.fixture(scope="module", params=["woven", "stock1", "satin1"])
def material(request: pytest.FixtureRequest, robustness: ModuleType) -> ShellMaterial:
    if request.param == "woven":
        return robustness.woven()
    shared = request.getfixturevalue("shared")
    return read_material(shared / "reference" / f"{request.param}.json")


def test_steps_from_small_deformations_converge(robustness: ModuleType, material: ShellMaterial) -> None:
    found, factors = robustness.outcomes(material, robustness.states((robustness.slightly,), 20))
    assert found == {Status.CONVERGED.value: 20}
    assert factors.positive > 0 and factors.failed == 0


def test_steps_from_extreme_states_end_with_a_clear_status(robustness: ModuleType, material: ShellMaterial) -> None:
    count = 2 * len(robustness.EXTREMES)
    found, factors = robustness.outcomes(material, robustness.states(robustness.EXTREMES, count))
    assert set(found) <= {status.value for status in Status} and sum(found.values()) == count
    assert factors.failed == 0
    assert found[Status.CONVERGED.value] >= 0.6 * count


def test_every_extreme_is_one(robustness: ModuleType) -> None:
    """No generator leaves the sheet as it is."""
    flat = next(robustness.states((lambda flat, rng: flat,), 1))
    for kind in robustness.EXTREMES:
        changed = next(robustness.states((kind,), 1))
        assert np.abs(changed - flat).max() > 1e-3
