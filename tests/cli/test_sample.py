"""``sample`` of cells of several tiles and with several starts, and what they resume."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from yarnscale.homogenize.states import FabricStates
from yarnscale.homogenize.store import SampleStore


@pytest.fixture
def grid(tmp_path: Path) -> Path:
    path = tmp_path / "grid.toml"
    path.write_text("s_x = [0.0, 0.1]\n")
    return path


def test_tiles_and_starts_are_stored_and_must_agree(run, refused, grid: Path, tmp_path: Path) -> None:
    out = tmp_path / "store"
    command = ["sample", "plain", "--grid", grid, "--out", out, "--workers", "1"]
    outcome = run(*command, "--size", "2x1", "--starts", "2", "--json")
    assert (outcome.status, json.loads(outcome.out)["converged"]) == (0, 2)
    store = SampleStore(out)
    provenance = store.attributes["provenance"]
    assert (provenance["tiles"], provenance["starts"], provenance["seed"]) == ([2, 1], 2, 0)
    single = json.loads(run("relax", "plain", "--strain", "0.1,0,0,0,0", "--json").out)
    assert float(store.read(1, "energy_density")) == pytest.approx(single["energy_density"], rel=1e-3)
    assert "another number of tiles" in refused(*command, "--starts", "2", "--resume")
    assert "another number of starts" in refused(*command, "--size", "2x1", "--resume")
    assert run(*command, "--size", "2x1", "--starts", "2", "--resume").status == 0


def test_cells_that_are_too_large_are_refused_before_anything_is_written(refused, grid: Path, tmp_path: Path) -> None:
    out = tmp_path / "store"
    said = refused("sample", "plain", "--grid", grid, "--out", out, "--size", "999x999")
    assert "cell size 999x999; expected positive numbers of tiles" in said
    assert not out.exists()


def test_loads_are_sampled_without_a_grid(run, refused, tmp_path: Path) -> None:
    out = tmp_path / "store"
    outcome = run("sample", "plain", "--out", out, "--solves", "60", "--limit", "2", "--workers", "1", "--json")
    told = json.loads(outcome.out)
    states = FabricStates.of(SampleStore(out))
    assert told["converged"] == told["states"] == len(states.energies) > 30
    assert np.abs(states.stresses[states.kinds == "tension"][:, :3]).max() == pytest.approx(2.0, rel=0.3)
    assert "other loads" in refused("sample", "plain", "--out", out, "--solves", "61", "--limit", "3", "--resume")
    assert "--size" in refused("sample", "plain", "--out", tmp_path / "other", "--size", "2x1")
    assert "a positive number" in refused("sample", "plain", "--out", tmp_path / "other", "--limit", "-1")
    assert not (tmp_path / "other").exists()
