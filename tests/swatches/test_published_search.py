"""The published search: a swarm that leaves local minima, then COBYLA."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from yarnscale.swatches.search import cobyla, swarm

LOWEST = np.array([0.8, 0.3, 0.55])


class Waves:
    """A bowl about ``LOWEST`` with waves, whose local minima are 0.25 apart."""

    def __init__(self) -> None:
        self.objective = SimpleNamespace(model=SimpleNamespace(names=("a", "b", "c")))
        self.count = 0

    def many(self, points, *, near=None):
        self.count += len(points)
        assert all(((point >= 0) & (point <= 1)).all() for point in points)
        away = [np.asarray(point) - LOWEST for point in points]
        values = [float(4 * (d @ d) + 0.15 * (1 - np.cos(8 * np.pi * d)).sum()) for d in away]
        return [SimpleNamespace(objective=value) for value in values]


@pytest.mark.parametrize("seed", range(3))
def test_a_swarm_and_cobyla_find_the_lowest_of_many_minima(seed: int) -> None:
    waves = Waves()
    start = swarm(waves, seed=seed)  # pyright: ignore[reportArgumentType]
    assert waves.count == 640
    assert np.abs(start - LOWEST).max() < 0.125
    end = cobyla(waves, start)  # pyright: ignore[reportArgumentType]
    assert np.abs(end - LOWEST).max() < 2e-3
    # From the middle of the ranges COBYLA alone ends in another minimum.
    stuck = cobyla(waves, np.full(3, 0.5))  # pyright: ignore[reportArgumentType]
    assert np.abs(stuck - LOWEST).max() > 0.2
