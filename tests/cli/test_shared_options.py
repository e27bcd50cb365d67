"""One option, one name: what several commands take is called alike, and means the same."""

from __future__ import annotations

import argparse
import json
from pathlib import Path

import pytest

from yarnscale.cli.arguments import parser
from yarnscale.files.patterns import read_pattern


def commands() -> dict[str, argparse.ArgumentParser]:
    (group,) = (a for a in parser()._actions if isinstance(a, argparse._SubParsersAction))
    return dict(group.choices)


def names(command: argparse.ArgumentParser) -> set[str]:
    return {name for action in command._actions for name in action.option_strings}


@pytest.mark.parametrize("name", sorted(set(commands()) - {"help", "samples"}))
def test_every_command_prints_json(name: str) -> None:
    assert "--json" in names(commands()[name])


@pytest.mark.parametrize(
    "name", ["pattern", "relax", "study", "homogenize", "sample", "test", "detail", "fabric", "estimate"]
)
def test_every_drawing_has_a_radius(name: str) -> None:
    assert "--radius" in names(commands()[name])


def test_folders_of_results_may_be_overwritten_and_sweeps_go_to_clusters() -> None:
    for name, command in commands().items():
        out = next((a for a in command._actions if "--out" in a.option_strings), None)
        if out is not None and out.metavar in ("DIR", "STORE"):
            assert "--overwrite" in names(command), name
        if "--workers" in names(command) and name != "gallery":
            assert {"--dask", "--resume"} <= names(command), name


def test_one_name_has_one_kind_of_value() -> None:
    """Such as a share in one command and a range in another; shells have one material, exports one format."""
    kinds: dict[str, set[object]] = {}
    for command in commands().values():
        for action in command._actions:
            for name in action.option_strings:
                kinds.setdefault(name, set()).add((action.nargs, action.const, type(action).__name__))
    assert {name for name, kind in kinds.items() if len(kind) > 1} <= {"--format", "--material"}
    assert "--stretch" not in names(commands()["fabric"])


def test_a_radius_scales_drawings_and_is_refused_for_yarn_geometry(run, refused, tmp_path: Path) -> None:
    chart = tmp_path / "own.chart"
    chart.write_text("kind = knit\nradius = 1 mm\nrows:\nkk\npp\n")
    for source in ("rib-1x1", chart):
        arguments = (source, "--as-drawn", "--radius", 2e-4, "--out", tmp_path / "p.json", "--json")
        outcome = run("pattern", *arguments)
        assert outcome.status == 0 and json.loads(outcome.out)["radius"] == pytest.approx(2e-4)
        scaled, drawn = read_pattern(tmp_path / "p.json"), read_pattern(source)
        assert scaled.period / drawn.period == pytest.approx(2e-4 / drawn.radius)
    line = refused("relax", tmp_path / "p.json", "--radius", 1e-3)
    assert "--radius; expected a built-in pattern, a chart or a draft" in line
    assert "positive number" in refused("relax", "plain", "--radius", 0)


def test_notices_are_printed_and_in_json(run, tmp_path: Path) -> None:
    (tmp_path / "thick.chart").write_text("kind = knit\nradius = 6 mm\nrows:\nk\n")
    arguments = (tmp_path / "thick.chart", "--as-drawn", "--out", tmp_path / "p.json", "--json")
    outcome = run("pattern", *arguments)
    (notice,) = json.loads(outcome.out)["notices"]
    assert "unusual size" in notice and f"yarnscale: note: {notice}" in outcome.err
    assert "notices" not in json.loads(run("patterns", "--json").out)
