"""``estimate --dask``: the same yarn on a cluster as in one process, and nothing touched where none answers."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator
from pathlib import Path

import pytest

import yarnscale
from yarnscale.cli import main

distributed = pytest.importorskip("distributed", reason="the extra 'dask' is not installed")
pytestmark = pytest.mark.slow

HEADER = "direction,run,force_N,clamp_distance_mm,swatch_width_mm"


@pytest.fixture(scope="module")
def cluster() -> Iterator[str]:
    """Address of a scheduler with one worker on this machine."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PYTHONPATH", str(Path(yarnscale.__file__).parents[1]))
        with distributed.LocalCluster(
            n_workers=1, threads_per_worker=1, processes=True, host="127.0.0.1", scheduler_port=0,
            dashboard_address=":0", silence_logs="CRITICAL",
        ) as started:  # fmt: skip
            yield started.scheduler_address


@pytest.fixture
def command(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """A short estimate of a fabric that stretches by 10 %, without laboratory numbers and report."""
    monkeypatch.setattr("yarnscale.cli.estimate.run_tests", lambda *_, **__: None)
    monkeypatch.setattr("yarnscale.show.estimate.write_estimate_report", lambda *_, **__: None)
    table = tmp_path / "curves.csv"
    rows = [
        f"weft,{run},{force},{100 * (1 + factor * force / 48)},60"
        for run, factor in (("1", 1.0), ("2", 1.05))
        for force in (0.0, 1.0, 2.0, 3.0, 4.0, 5.0)
    ]
    table.write_text("\n".join([HEADER, *rows]) + "\n")
    search = ["--solver", "local", "--iterations", "1", "--shape", "drawn", "--json"]
    return ["estimate", str(table), "--pattern", "stockinette", *search]


def test_a_cluster_finds_the_same_yarn(
    command: list[str], cluster: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    found = []
    for name, where in (("there", ["--dask", cluster]), ("here", ["--workers", "1"])):
        main([*command, "--out", str(tmp_path / name), *where])
        found.append(json.loads(capsys.readouterr().out))
    for name in ("parameters", "error", "solves", "evaluations"):
        assert found[0][name] == found[1][name]
    kept = [sorted(os.listdir(tmp_path / name / "evaluations")) for name in ("there", "here")]
    assert kept[0] == kept[1] and len(kept[0]) >= 8


def test_without_a_scheduler_nothing_is_touched(
    command: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("yarnscale.homogenize.executors.CONNECT", 1.0)
    assert main([*command, "--out", str(tmp_path / "out"), "--dask", "127.0.0.1:9"]) == 2
    assert "no Dask scheduler" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()
