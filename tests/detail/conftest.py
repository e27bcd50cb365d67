"""A small sampled cell, and cloth to lay it on."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from yarnscale.cell import PeriodicCell
from yarnscale.detail.fluctuations import FluctuationTable
from yarnscale.drawing import library
from yarnscale.homogenize.plan import StrainGrid, bends_twice
from yarnscale.homogenize.sample import create_store
from yarnscale.homogenize.store import SampleStore
from yarnscale.homogenize.worker import CODE_OF, solve
from yarnscale.yarn.material import PRESETS

# Out of order, as a user may write them.
GRID = StrainGrid((0.2, 0.05), (0.15, 0.0), (0.1, 0.25), (0.0, 40.0), (-40.0, 0.0))


@pytest.fixture(scope="session")
def cell() -> PeriodicCell:
    return PeriodicCell(library.build("stockinette"), PRESETS["hylc2020-stockinette"])


@pytest.fixture(scope="session")
def store(cell: PeriodicCell, tmp_path_factory: pytest.TempPathFactory) -> SampleStore:
    path = tmp_path_factory.mktemp("detail") / "store"
    store = create_store(Path(path), cell, GRID.axes, scattered=False)
    twice = bends_twice(store.states)
    for number, state in enumerate(store.states):
        if not twice[number]:
            result, _ = solve(cell, state, None)
            assert result["status"] == CODE_OF["converged"]
            store.write(number, result)
    return store


@pytest.fixture(scope="session")
def table(store: SampleStore, cell: PeriodicCell) -> FluctuationTable:
    return FluctuationTable.from_store(store, cell.pattern)


@pytest.fixture(scope="session")
def made_up(cell: PeriodicCell) -> FluctuationTable:
    """Random fluctuations of a tenth of the yarn radius, wherever geometry alone is tested."""
    axes = tuple(np.array(a) for a in ([-0.2, 0.1, 0.5], [-0.3, 0.3], [-0.2, 0.4], [-50.0, 0.0, 50.0], [0.0]))
    pattern = cell.pattern
    shape = (3, 2, 2, 5, len(pattern.vertices), 3)
    values = np.random.default_rng(5).normal(size=shape) * 0.1 * pattern.radius
    values[..., 2, :, :] = values[..., 4, :, :] = 0.0
    return FluctuationTable(pattern, axes, values)  # type: ignore[arg-type]
