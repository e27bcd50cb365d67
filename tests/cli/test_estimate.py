"""The command ``estimate``: its numbers and report, going on where it stopped, and what it refuses."""

import importlib
import json
import math
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from types import SimpleNamespace

import pytest

from yarnscale.cli import main
from yarnscale.cli.arguments import parser
from yarnscale.files.material_toml import read_yarn_material as read_yarn
from yarnscale.files.patterns import read_pattern, read_yarns
from yarnscale.homogenize.compact_fit import CompactOptions
from yarnscale.laboratory.programme import Programme, run_tests
from yarnscale.swatches.yarn_fit import FitOptions
from yarnscale.yarn.material import YarnMaterial

QUICK = [
    "--solver",
    "local",
    "--iterations",
    "1",
    "--shape",
    "drawn",
    "--directions",
    "weft",
    "--workers",
    "1",
]
ERRORS = ("comfort", "full", "compression")


@pytest.fixture(scope="module")
def measured(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Swatches that stretch by a tenth, with a contraction of a third of the stretch."""
    path = tmp_path_factory.mktemp("measured") / "curves.csv"
    rows = ["direction,run,force_N,clamp_distance_mm,mid_width_mm,swatch_width_mm"]
    for direction, stiffness in (("weft", 800.0), ("warp", 900.0)):
        for run, factor in (("1", 1.0), ("2", 1.05)):
            for force in (0.0, 1.0, 2.0, 3.0, 4.0, 5.0):
                stretch = factor * force / 0.06 / stiffness
                length, width = 100 * (1 + stretch), 60 * (1 - stretch / 3)
                rows.append(f"{direction},{run},{force},{length:.4f},{width:.4f},60")
    path.write_text("\n".join(rows) + "\n")
    return path


@pytest.mark.slow
def test_swatch_to_yarn_to_cloth_to_swatch_with_a_report_and_goes_on(
    measured: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    out = tmp_path / "out"
    arguments = ["estimate", str(measured), "--pattern", "stockinette", "--out", str(out), *QUICK]
    # The yarn of so short a search is not fitted again.
    monkeypatch.setattr("yarnscale.cli.estimate.OTHER_CLAMPS", math.inf)
    # Few tests of the fabric, and a fit of few numbers.
    programme = Programme(directions=(0.0, 45.0), loads=(1.0, 5.0))
    monkeypatch.setattr("yarnscale.cli.estimate.run_tests", partial(run_tests, programme=programme))
    few = partial(CompactOptions, steps=6, springs=16, rounds=10, iterations=40, starts=1)
    monkeypatch.setattr("yarnscale.homogenize.compact_fit.CompactOptions", few)
    main([*arguments, "--json", "--homogenize", "30"])
    first = json.loads(capsys.readouterr().out)
    assert {"error", "stages", "warnings", "parameters", "bending_error", "solves", "seconds"} <= set(first)
    assert first["tests"]["bending"][0]["B"] > 0 and first["biaxial_error"] is None
    assert set(first["parameters"]) == {"k_s1", "knee", "k_b", "R_1", "k_c1", "k_s2", "R_est"}
    assert first["bending_error"] is None
    for errors in (first["error"], first["error"]["directions"]["weft"], first["stages"]["yarn"]):
        assert all(errors[name] > 0 for name in ERRORS)
    assert first["stages"]["yarn"]["follows"] == "measured"
    assert first["error"]["largest"]["direction"] == "weft"
    page = (out / "index.html").read_text()
    assert "The fabric at rest" in page and "What the data do not tell" in page
    assert page.count('data-pane="pane-') == 1 and '<div class="stage">\n<img' in page and len(page) < 10_000_000
    assert "Parameters" in page and "error against the measurement" in page and "shell alone" in page
    found = read_yarns(out / "pattern.json")
    assert isinstance(found, YarnMaterial)
    radius = read_pattern(out / "pattern.json").radius
    assert found.bending_stiffness(radius) == pytest.approx(first["parameters"]["k_b"])
    material = read_yarn(out / "yarn.toml")
    assert material == found
    fabric, period = first["fabric"], read_pattern(out / "pattern.json").period
    assert (fabric["wales_per_cm"], fabric["courses_per_cm"]) == pytest.approx(tuple(0.01 / period))
    assert fabric["tex"] == pytest.approx(1e6 * material.mass_per_length(radius))

    # The same swatches of cloth of that yarn, weft and warp, and commands that take what was written.
    cloth = first["cloth_error"]["directions"]
    assert set(cloth) == {"weft", "warp"}
    assert 0 < cloth["weft"]["comfort"] < first["error"]["directions"]["weft"]["comfort"] + 0.3
    main(["relax", str(out / "pattern.json"), "--json"])
    assert json.loads(capsys.readouterr().out)["material_from"] == "of the file"
    tested = ["test", str(out / "homogenized" / "material.json"), "--loads", "1", "--directions", "0"]
    assert main([*tested, "--curvatures", "5", "--out", str(tmp_path / "test")]) == 0
    capsys.readouterr()
    kept = {path: path.read_bytes() for path in (out / "evaluations").glob("*.json")}
    assert kept

    # A run that was killed: some evaluations are there, one is torn.
    lost = sorted(kept)[::2]
    for path in lost[1:]:
        path.unlink()
    lost[0].write_text(lost[0].read_text()[:20])
    monkeypatch.setattr("yarnscale.show.estimate.write_estimate_report", lambda *_, **__: None)
    monkeypatch.setattr("yarnscale.cli.estimate.run_tests", lambda *_, **__: None)
    main([*arguments, "--json", "--resume"])
    second = json.loads(capsys.readouterr().out)
    for name in ("error", "parameters", "solves", "evaluations"):
        assert second[name] == first[name]
    assert {path for path in (out / "evaluations").glob("*.json")} == set(kept)


def test_the_usual_search_of_the_command_is_that_of_the_library() -> None:
    given = parser().parse_args(["estimate", "curves.csv", "--pattern", "stockinette", "--out", "out"])
    usual = FitOptions()
    for name in ("solver", "seed", "starts", "refined", "iterations"):
        assert getattr(given, name) == getattr(usual, name), name


def test_refuses_what_cannot_be(measured: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "out"
    start = ["estimate", str(measured), "--pattern", "stockinette", "--out", str(out)]
    cases = {
        ("--resume",): "nothing to resume",
        ("--holdout", "bias"): "measured: weft, warp",
        ("--homogenize", "20"): "at least 30",
        ("--directions", "weft", "--holdout", "weft"): "not held out",
        ("--fit-friction",): "friction; expected unloading to its end",
    }
    for extra, said in cases.items():
        assert main([*start, *extra]) == 2
        error = capsys.readouterr().err
        assert said in error and error.count("\n", error.index(said)) == 1
    with pytest.raises(SystemExit):
        main([*start, "--solver", "guess"])
    assert main(["estimate", "none.csv", *start[2:]]) == 2
    assert not out.exists()


def test_the_published_search_refuses_what_it_would_replace(measured: Path, tmp_path: Path, run) -> None:
    command = ("estimate", measured, "--pattern", "stockinette", "--solver", "paper", "--out", tmp_path / "out")
    outcome = run(*command, "--shape", "free")
    assert outcome.status == 2 and "--shape; expected drawn" in outcome.err
    assert not (tmp_path / "out").exists()


def test_every_fabric_of_a_folder_with_a_page_that_compares_them(
    measured: Path, tmp_path: Path, run, monkeypatch: pytest.MonkeyPatch
) -> None:
    fabrics, out = tmp_path / "fabrics", tmp_path / "out"
    (fabrics / "B").mkdir(parents=True)
    for folder, name, pattern in ((fabrics, "A.toml", "garter"), (fabrics / "B", "fabric.toml", "own.chart")):
        (folder / "curves.csv").write_text(measured.read_text())
        (folder / name).write_text(f'stretch = "curves.csv"\npattern = "{pattern}"\n')
    (fabrics / "B" / "own.chart").write_text("kind = knit\nradius = 0.4 mm\nrows:\nkp\npk\n")
    begun = []

    def estimated(options, measurements, model):
        begun.append((options.out, options.resume, model.pattern.name))
        share = 0.05 * len(begun)
        errors = {"comfort": share, "full": 2 * share, "compression": None}
        summary = {
            "error": errors, "stages": {"shell": errors}, "cloth_error": None, "failed_states": 0, "solves": 7,
            "warnings": ["too good"],
            "cpu_seconds": 1.0, "parameters": {"k_s1": 0.5}, "fabric": {"tex": 20.0},
        }  # fmt: skip
        (options.out / "evaluations").mkdir(parents=True, exist_ok=True)
        (options.out / "estimate.json").write_text(json.dumps(summary))
        return SimpleNamespace(summary=lambda: summary)

    monkeypatch.setattr("yarnscale.cli.estimate._estimated", estimated)
    outcome = run("estimate", fabrics, "--out", out, "--json")
    assert outcome.status == 0
    assert [(folder, name) for folder, _, name in begun] == [(out / "A", "garter"), (out / "B", "own")]
    found = json.loads(outcome.out)["fabrics"]
    assert {name: part["error"]["comfort"] for name, part in found.items()} == {"A": 0.05, "B": 0.1}
    page = (out / "index.html").read_text()
    assert ">mean<" in page and ">7.5<" in page and "data:image/png" in page

    # What is finished is not estimated again; a broken file is found before anything begins.
    assert run("estimate", fabrics, "--out", out, "--resume").status == 0 and len(begun) == 2
    assert "warning: A: too good" in run("estimate", fabrics, "--out", out, "--resume").err
    # What is asked in another way, or measured anew, is.
    assert run("estimate", fabrics, "--out", out, "--resume", "--directions", "weft").status == 0 and len(begun) == 4
    curves = fabrics / "B" / "curves.csv"
    curves.write_text("\n".join(curves.read_text().splitlines()[:-1]) + "\n")
    assert run("estimate", fabrics, "--out", out, "--resume", "--directions", "weft").status == 0
    assert begun[4:] == [(out / "B", True, "own")]
    assert "output exists" in run("estimate", fabrics, "--out", out).err
    (fabrics / "C.toml").write_text('stretch = "curves.csv"\n')
    refusal = run("estimate", fabrics, "--out", tmp_path / "other")
    assert refusal.status == 2 and "C.toml: --pattern" in refusal.err and len(begun) == 5
    assert not (tmp_path / "other").exists()


@dataclass(frozen=True)
class Estimate:
    """What the command asks of an estimate before it fits the yarn again."""

    clamp_difference: float
    cloth: object = None
    tests: object = None
    measurements = SimpleNamespace(name="fabric")
    fit = SimpleNamespace(options=FitOptions(), model=SimpleNamespace(names=("k_s1",)))


@pytest.mark.parametrize(
    ("difference", "second", "expected"), [(0.3, 0.07, "second"), (0.3, 0.2, "first"), (0.01, 0.07, "first")]
)
def test_the_yarn_is_fitted_again_where_clamps_hold_its_cloth_otherwise_and_the_nearer_cloth_counts(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, difference: float, second: float, expected: str
) -> None:
    command = importlib.import_module("yarnscale.cli.estimate")
    cloths = {
        "homogenized": SimpleNamespace(material="first", errors=SimpleNamespace(comfort=0.1)),
        "refitted": SimpleNamespace(material="second", errors=SimpleNamespace(comfort=second)),
    }
    written = []
    monkeypatch.setattr(command, "_homogenized", lambda options, folder, found: cloths[folder.name])
    monkeypatch.setattr(command, "refitted", lambda found, **_: Estimate(0.0))
    monkeypatch.setattr(command, "_tested", lambda found: "numbers")
    monkeypatch.setattr(command, "write_material", lambda path, material: written.append((path.name, material)))
    options = SimpleNamespace(out=tmp_path, follow="measured", bending_weight=0.0)
    found = command._as_cloth(options, Estimate(difference), None)
    assert found.cloth.material == expected
    assert written == ([("material.json", "second")] if expected == "second" else [])
    assert found.tests == ("numbers" if expected == "second" else None)


def test_units_of_loads() -> None:
    pytest.importorskip("matplotlib")
    from yarnscale.show.estimate import load_factor

    # 50 N/m are 2.5 N per 5 cm, 3 N on 6 cm, and 0.025 cN/tex of 200 g/m².
    found = [50 * load_factor(units, 0.06, 0.2) for units in ("N/m", "N/5cm", "N", "cN/tex")]
    assert found == pytest.approx([50, 2.5, 3, 0.025])


def test_faults_leave_the_results_of_an_earlier_run(measured: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    (out / "evaluations").mkdir(parents=True)
    earlier = [out / "evaluations" / "0123.json", out / "estimate.json"]
    for path in earlier:
        path.write_text("{}")
    start = ["estimate", str(measured), "--pattern", "stockinette", "--out", str(out)]
    faults = (
        ["--holdout", "bias"],
        ["--directions", "bias"],
        ["--pattern", "none.pyp"],
        ["--sample", "none"],
    )
    for extra in faults:
        assert main([*start, *extra]) == 2
    assert all(path.read_text() == "{}" for path in earlier)
