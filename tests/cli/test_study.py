"""``study``, and cells of several tiles in ``relax``."""

from __future__ import annotations

import json

import pytest


def test_study_prints_a_table(run) -> None:
    outcome = run("study", "plain", "--strain", "0.1,0,0,0,0", "--sizes", "1x1,2x1", "--starts", "1")
    assert outcome.status == 0
    assert "settling plain to its rest shape" in outcome.err
    lines = outcome.out.splitlines()
    assert [line.split()[0] for line in lines[2:]] == ["1x1", "2x1"]


def test_study_prints_one_object(run) -> None:
    outcome = run("study", "plain", "--strain", "0.1,0,0,0,0", "--sizes", "1x1,2x1", "--starts", "1", "--json")
    one, two = json.loads(outcome.out)["sizes"]
    assert (one["size"], two["size"]) == ("1x1", "2x1")
    assert two["vertices"] == 2 * one["vertices"]
    assert two["energy_density"] == pytest.approx(one["energy_density"], rel=1e-6)
    assert {"drop", "iterations", "seconds", "status"} <= set(two)


def test_relax_takes_tiles_and_starts(run) -> None:
    small, large = (
        json.loads(run("relax", "plain", "--strain", "0.1,0,0,0,0", "--size", size, "--json").out)
        for size in ("1x1", "1x2")
    )
    assert large["energy_density"] == pytest.approx(small["energy_density"], rel=0.01)
    several = json.loads(run("relax", "plain", "--strain", "-0.1,0,0,0,0", "--starts", "3", "--json").out)
    assert several["status"] == "converged"


@pytest.mark.parametrize("sizes", ["2y1", "0x1", "", "1x1,"])
def test_wrong_sizes_are_refused(refused, sizes: str) -> None:
    assert "2x1" in refused("study", "plain", "--sizes", sizes)


def test_a_size_that_is_too_large_is_refused(refused) -> None:
    assert "500x500" in refused("study", "plain", "--sizes", "500x500")
