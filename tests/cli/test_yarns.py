"""The commands about yarns: what they write, print and return."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from yarnscale.cell import PeriodicCell, rest
from yarnscale.cell.energy import CellEnergy
from yarnscale.cell.rest import rest_stress_ratio
from yarnscale.cli import given_pattern, main
from yarnscale.cli.console import ProgressLine
from yarnscale.drawing import library
from yarnscale.files.patterns import read_pattern, structure_of
from yarnscale.kinematics import ShellStrain
from yarnscale.yarn.material import YarnMaterial


def test_a_written_pattern_is_at_rest(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "fabric.json"
    assert main(["pattern", "plain", "--out", str(out)]) == 0
    assert "at rest" in capsys.readouterr().out
    written = read_pattern(out)
    assert rest_stress_ratio(PeriodicCell(written, YarnMaterial.preset("hylc2020-basket"))).largest < 0.01


def test_a_chart_is_written_at_rest(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    chart, out = tmp_path / "plain.chart", tmp_path / "fabric.json"
    chart.write_text("kind = weave\nradius = 0.5 mm\nrows:\nx.\n.x\n")
    assert main(["pattern", str(chart), "--out", str(out)]) == 0
    assert "at rest" in capsys.readouterr().out
    assert rest_stress_ratio(PeriodicCell(read_pattern(out), YarnMaterial.preset("hylc2020-basket"))).largest < 0.01


def test_a_large_drawing_has_set_yarns_and_its_own_periods(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(given_pattern, "LARGE", 30)
    energies = []
    for more in ([], ["--as-drawn"]):
        assert main(["relax", "plain", "--json", *more]) == 0
        said = capsys.readouterr()
        assert ("periods stay as drawn" in said.err) == (not more)
        energies.append(json.loads(said.out)["energy_parts"]["bend_twist"])
    assert energies[0] < 0.2 * energies[1]


def test_a_solve_says_how_long_its_digits_will_take(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    now = 100.0
    monkeypatch.setattr("yarnscale.cli.console.time.monotonic", lambda: now)
    line = ProgressLine("relaxing")
    line.note_solve(0, 1.0)
    now = 110.0
    line.note_solve(7, 1e-2)
    assert "iteration 7, residual 1.0e-02, about 20 s left" in capsys.readouterr().err
    now = 120.0
    line.note_solve(8, 0.5)
    assert "residual 5.0e-01, about 40 s left" in capsys.readouterr().err


def test_a_pattern_can_be_written_as_drawn(tmp_path: Path) -> None:
    out = tmp_path / "drawing.json"
    assert main(["pattern", "rib-2x2", "--out", str(out), "--as-drawn"]) == 0
    assert read_pattern(out).content_hash() == library.build("rib-2x2").content_hash()


def test_an_unsettled_pattern_is_status_1(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def stalls(pattern, material, **options):  # type: ignore[no-untyped-def]
        return replace(rest.settled(pattern, material, **options), status=rest.RestStatus.STALLED)

    monkeypatch.setattr(given_pattern, "settled", stalls)
    assert main(["pattern", "plain", "--out", str(tmp_path / "fabric.pyp")]) == 1


def test_unknown_pattern_is_status_2(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["pattern", "tweed", "--out", str(tmp_path / "fabric.pyp")]) == 2
    assert "tweed" in capsys.readouterr().err


def test_relax_reports_an_equilibrium_of_a_chart(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    chart = tmp_path / "seed.chart"
    chart.write_text("kind = knit\nrows:\nkp\npk\n")
    arguments = [
        "relax",
        str(chart),
        "--as-drawn",
        "--material",
        "wool",
        "--strain",
        "-0.02,0,0.1,0,0",
        "--json",
    ]
    assert main(arguments) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["status"] == "converged" and found["material"] == "wool"
    assert found["energy_density"] > 0.0 and len(found["stress"]) == 6
    state = PeriodicCell(read_pattern(chart), YarnMaterial.preset("wool")).relax(ShellStrain(-0.02, 0.0, 0.1))
    assert found["energy_density"] == pytest.approx(state.energy_density, rel=1e-6)


def test_the_clock_of_relax_starts_when_all_is_compiled(monkeypatch: pytest.MonkeyPatch) -> None:
    seen = []
    relax, quadratic = PeriodicCell.relax, CellEnergy.quadratic
    monkeypatch.setattr(PeriodicCell, "relax", lambda *given: (seen.append("relax"), relax(*given))[1])
    monkeypatch.setattr(CellEnergy, "quadratic", lambda *given: (seen.append("quadratic"), quadratic(*given))[1])
    assert main(["relax", "plain", "--as-drawn"]) == 0
    assert seen[:2] == ["quadratic", "relax"]


def test_a_draft_is_written_at_rest_and_comes_back(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    first, again, chart = (tmp_path / name for name in ("first.wif", "again.wif", "again.chart"))
    assert main(["pattern", "twill-2x1", "--out", str(first), "--as-drawn", "--radius", "0.0002"]) == 0
    assert main(["pattern", str(first), "--out", str(again)]) == 0
    assert main(["pattern", str(again), "--out", str(chart)]) == 0
    assert "at rest" in capsys.readouterr().out
    drafts = [structure_of(source) for source in ("twill-2x1", first, again, chart)]
    for draft in drafts:
        assert draft is not None and np.array_equal(draft.draft, library.structure("twill-2x1").draft)
    assert read_pattern(first).radius == pytest.approx(2e-4)
    assert (read_pattern(again).period < read_pattern(first).period).any()


def test_structures_that_a_format_does_not_hold_are_status_2(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    native = tmp_path / "plain.json"
    assert main(["pattern", "plain", "--out", str(native), "--as-drawn"]) == 0
    for source, name in (("jersey", "a.wif"), ("plain", "a.k"), (str(native), "a.chart"), ("plain", "a.dtx")):
        capsys.readouterr()
        assert main(["pattern", source, "--out", str(tmp_path / name), "--as-drawn"]) == 2
        said = [line for line in capsys.readouterr().err.splitlines() if not line.startswith("yarn of")]
        assert len(said) == 1 and name in said[0] and not (tmp_path / name).exists()
