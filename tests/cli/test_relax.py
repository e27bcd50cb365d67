"""``relax``, ``pattern``, ``patterns`` and ``evaluate``: what they print and write."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

import yarnscale.cli.yarns as yarns
from yarnscale.cell.equilibrium import EquilibriumOptions
from yarnscale.files.patterns import read_pattern
from yarnscale.numerics.newton import Status

FIELDS = {
    "status", "energy_density", "stress", "iterations", "seconds", "contacts", "min_distance_over_diameter",
}  # fmt: skip


def test_relax_prints_one_object_and_writes_the_state(run, tmp_path: Path) -> None:
    out = tmp_path / "state.npz"
    outcome = run("relax", "plain", "--as-drawn", "--strain", "-0.05,0.02,0.1,0,0", "--out", out, "--json")
    assert outcome.status == 0
    assert "settling" not in outcome.err
    found = json.loads(outcome.out)
    assert set(found) >= FIELDS
    assert found["status"] == "converged"
    assert len(found["stress"]) == 6 and all(isinstance(v, float) for v in found["stress"])
    assert isinstance(found["iterations"], int) and isinstance(found["contacts"], int)
    assert 0.5 < found["min_distance_over_diameter"] < 1.1
    n = len(read_pattern("plain").edges)
    with np.load(out, allow_pickle=False) as state:
        assert {"edges", "positions", "twist", "strain", "fluctuation", "pattern"} <= set(state)
        assert state["positions"].shape == (n, 3) and np.isfinite(state["positions"]).all()
        assert state["twist"].shape == (n,) and np.isfinite(state["twist"]).all()
        assert state["edges"].shape == (n, 4)
        assert np.array_equal(state["edges"], read_pattern("plain").edges)


def test_a_drawing_is_brought_to_rest_first(run) -> None:
    """Then nothing pulls on it in its plane, as nothing does on fabric on a table."""
    settled, drawn = (json.loads(run("relax", "plain", "--json", *more).out) for more in ((), ("--as-drawn",)))
    stress = [np.abs(found["stress"][:3]).max() for found in (settled, drawn)]
    assert settled["status"] == "converged"
    assert stress[0] < 0.01 * stress[1]


def test_relax_tells_people_too(run) -> None:
    outcome = run("relax", "plain", "--strain=0,0,0,20,0", "--material", "hylc2020-basket")
    assert outcome.status == 0
    assert "energy density" in outcome.out and "hylc2020-basket" in outcome.out


def test_published_cells_have_their_published_energies(run, shared: Path) -> None:
    for name, energy in (("stockinette", 0.0553), ("satin", 0.00381)):
        outcome = run("relax", shared / "reference" / f"{name}.pyp", "--json")
        assert outcome.status == 0
        assert json.loads(outcome.out)["energy_density"] == pytest.approx(energy, rel=5e-3)


def test_a_solve_that_does_not_converge_ends_with_1(run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    class Stopped(yarns.PeriodicCell):
        def __init__(self, *arguments: object, **options: object) -> None:
            once = EquilibriumOptions(max_iterations=1)
            super().__init__(*arguments, **{**options, "options": once})  # type: ignore[arg-type]

    monkeypatch.setattr(yarns, "PeriodicCell", Stopped)
    outcome = run("relax", "plain", "--as-drawn", "--json", "--out", tmp_path / "state.npz")
    assert outcome.status == 1
    assert json.loads(outcome.out)["status"] == Status.ITERATION_LIMIT.name.lower()
    assert (tmp_path / "state.npz").exists()


def test_the_published_materials_give_the_check_values(run, shared: Path) -> None:
    for name, energy in (("stock1", 1.17430886), ("satin1", 0.66167915)):
        path = shared / "reference" / f"{name}.json"
        outcome = run("evaluate", path, "--strain", ".2,.1,-.05,15,-8,-20", "--json")
        assert outcome.status == 0
        found = json.loads(outcome.out)
        assert found["energy_density"] == pytest.approx(energy, abs=1e-8)
        assert len(found["stress"]) == 6


def test_patterns_are_listed_and_written(run, tmp_path: Path) -> None:
    listed = json.loads(run("patterns", "--json").out)
    assert {"stockinette", "plain"} <= set(listed["patterns"])
    assert {"hylc2020-" + name for name in (
        "stockinette", "rib", "honeycomb", "basket", "satin", "satin-small", "stockinette-small",
    )} <= set(listed["materials"])  # fmt: skip
    assert run("patterns").status == 0
    outcome = run("pattern", "plain", "--out", tmp_path / "plain.pyp", "--radius", "0.0005")
    assert outcome.status == 0
    assert read_pattern(tmp_path / "plain.pyp").radius == 0.0005
    assert run("relax", tmp_path / "plain.pyp", "--json").status == 0
