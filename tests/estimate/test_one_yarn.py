"""One yarn in several fabrics: which unknowns belong to which, and what is evaluated again."""

from __future__ import annotations

from typing import Any, cast

import numpy as np

from yarnscale.estimate.evaluations import Evaluations, Residuals
from yarnscale.estimate.one_yarn import SharedEvaluations
from yarnscale.estimate.yarn_model import PARAMETERS, SHAPE


class _Fabric:
    """Its residuals are its unknowns; notes where it was evaluated."""

    def __init__(self, free_shape: bool) -> None:
        self.objective: Any = self
        self.model: Any = self
        self.free_shape = free_shape
        self.points: list[np.ndarray] = []

    def many(self, points: list[np.ndarray], *, near: np.ndarray | None = None) -> list[Residuals]:
        self.points += points
        return [Residuals(point, 1, 0.0) for point in points]


def _shared(*free: bool) -> tuple[SharedEvaluations, list[_Fabric]]:
    fabrics = [_Fabric(shape) for shape in free]
    return SharedEvaluations(tuple(cast(Evaluations, fabric) for fabric in fabrics)), fabrics


def test_each_fabric_gets_the_yarn_and_its_own_shape() -> None:
    shared, _ = _shared(True, False, True)
    n, k = len(PARAMETERS), len(SHAPE)
    whole = np.arange(n + 2 * k, dtype=np.float64)
    first, second, third = shared.split(whole)
    np.testing.assert_array_equal(first, whole[: n + k])
    np.testing.assert_array_equal(second, whole[:n])
    np.testing.assert_array_equal(third, np.concatenate([whole[:n], whole[n + k :]]))
    np.testing.assert_array_equal(shared.joined([first, second, third]), whole)


def test_residuals_are_of_all_fabrics_over_the_root_of_their_number() -> None:
    shared, _ = _shared(True, True)
    whole = np.linspace(0.1, 0.9, len(PARAMETERS) + 2 * len(SHAPE))
    expected = sum(float(part @ part) for part in shared.split(whole)) / 2
    assert np.isclose(shared.many([whole])[0].objective, expected)


def test_a_fabric_whose_unknowns_did_not_move_is_not_evaluated_again() -> None:
    shared, (first, second) = _shared(True, True)
    near = np.full(len(PARAMETERS) + 2 * len(SHAPE), 0.5)
    moved = near.copy()
    moved[-1] += 0.1
    found = shared.many([moved], near=near)[0]
    assert all(np.array_equal(point, shared.split(near)[0]) for point in first.points)
    assert any(np.array_equal(point, shared.split(moved)[1]) for point in second.points)
    np.testing.assert_allclose(found.residuals, shared.many([moved])[0].residuals)
