"""The command ``fabric``."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from yarnscale.cli import fabric_models, main
from yarnscale.files.curve_frames import read_curve_frames


def test_counts_of_figure_9(capsys: pytest.CaptureFixture[str]) -> None:
    count = ["fabric", "jersey", "--rows", "15", "--columns", "30", "--volume", "5,5,2", "--count", "--json"]
    assert main([*count, "--reduction", "published"]) == 0
    counts = json.loads(capsys.readouterr().out)
    assert main(count) == 0
    rows = 3 * 729  # the held row, the one below it and the first one are full yarns
    cells = 36 * 24  # nine Gauss points in each of four patches
    homogenized = {"reduced_unknowns": 75 + rows, "row_unknowns": rows, "cell_unknowns": cells}
    assert json.loads(capsys.readouterr().out) == counts | homogenized
    assert counts == {
        "control_points_per_yarn": 243,
        "dofs_per_yarn": 729,
        "control_points": 3645,
        "dofs": 10935,
        "constraints": 2700,
        "unknowns": 13635,
        "reduced_unknowns": 150,
    }


@pytest.mark.parametrize("method", ["splines", "volume"])
def test_hangs_and_writes_frames(method: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    arguments = [
        "fabric",
        "jersey",
        "--rows",
        "3",
        "--columns",
        "3",
        "--method",
        method,
        "--duration",
        "0.05",
    ]
    assert main([*arguments, "--out", str(tmp_path), "--json"]) == 0
    summary = json.loads(capsys.readouterr().out)
    assert summary["simulated_seconds"] == pytest.approx(0.05)
    assert summary["status"] == "converged" and summary["steps"] > 0
    assert summary["extension"] < (0.01 if method == "splines" else 0.3)
    frames = read_curve_frames(tmp_path)
    assert len(frames.curves) == 3
    assert summary["method"] == method and summary["model"] == "splines" and summary["centre_drop"] > 0.0
    assert {"frames.png", "last.png", "last.obj", "index.html"} <= {path.name for path in tmp_path.iterdir()}
    page = (tmp_path / "index.html").read_text()
    assert "centre_drop [m]" in page
    assert "centre_drop" in page and page.count("data:image/") == 2


def test_the_model_in_a_volume_is_said_and_chosen(capsys: pytest.CaptureFixture[str]) -> None:
    volume = ["fabric", "jersey", "--rows", "3", "--columns", "3", "--count", "--json"]
    sizes = []
    for model in ("splines", "rods"):
        assert main([*volume, "--model", model]) == 0
        said = capsys.readouterr()
        assert f"yarns in the volume: {model}" in said.err
        sizes.append(json.loads(said.out))
    assert "control_points" in sizes[0] and "vertices" in sizes[1]
    assert sizes[0]["reduced_unknowns"] - sizes[0]["row_unknowns"] == 75 and sizes[1]["reduced_unknowns"] == 150
    for refused in (["--model", "rods"], ["--explicit"], ["--adaptive"], ["--method", "splines"]):
        assert main([*volume, "--reduction", "homogenized", *refused]) == 2
        assert "reduction" in capsys.readouterr().err
    assert main(volume) == 0 and "--model rods takes rods" in capsys.readouterr().err
    assert main([*volume, "--method", "direct", "--model", "splines"]) == 2
    assert "--method volume, or rods with direct" in capsys.readouterr().err


def test_splines_of_a_rib_have_sixteen_segments_a_stitch(capsys: pytest.CaptureFixture[str]) -> None:
    size = ["--rows", "4", "--columns", "3", "--method", "splines", "--count", "--json"]
    assert main(["fabric", "rib-1x1", *size]) == 0
    counts = json.loads(capsys.readouterr().out)
    assert counts["control_points_per_yarn"] == 16 * 6 + 3 and counts["control_points"] == 4 * 99
    assert counts["constraints"] == 3 * 6 * (2 + 4 * 3)
    assert main(["fabric", "honeycomb", *size]) == 2
    assert "row 2 column 2" in capsys.readouterr().err


def test_handles_leave_out_the_contacts_that_close_the_first_row(capsys: pytest.CaptureFixture[str]) -> None:
    counted = ["fabric", "jersey", "--rows", "3", "--columns", "4", "--method", "splines", "--count", "--json"]
    found = []
    for scene in ("hang", "stretch"):
        assert main([*counted, "--scene", scene]) == 0
        found.append(json.loads(capsys.readouterr().out)["constraints"])
    assert found == [3 * 2 * 4 * 3, 3 * 2 * 4 * 2]


def test_refuses_what_it_has_no_splines_for(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["fabric", "satin", "--rows", "3", "--columns", "3", "--out", str(tmp_path)]) == 2
    assert "jersey" in capsys.readouterr().err
    assert main(["fabric", "jersey", "--rows", "3", "--columns", "3"]) == 2
    assert "--out" in capsys.readouterr().err
    for method in ("splines", "direct"):
        size = ["--rows", "3", "--columns", "3", "--method", method, "--count"]
        assert main(["fabric", "rib-1x1", *size, "--adaptive"]) == 2
        assert "--adaptive" in capsys.readouterr().err


COMPARED = ["fabric", "jersey", "--rows", "3", "--columns", "3", "--volume", "4,4,2", "--method", "compare"]


def test_three_models_hang_side_by_side(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    hung = [*COMPARED, "--duration", "0.06", "--damping", "20", "--out", str(tmp_path)]
    assert main([*hung, "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    models, over_time = found["models"], found["over_time"]
    assert list(models) == ["splines", "published", "homogenized"] and found["scene"] == "hang"
    assert over_time["time"] == pytest.approx([0.0, 1 / 30, 0.06])
    fall = {model: np.array(over_time[model]["centre_drop"]) for model in models}
    for model, of in models.items():
        assert of["status"] == "converged" and fall[model][-1] == of["centre_drop"]
        energy = over_time[model]["energy"]
        assert energy[-1] < energy[0] and of["passages"] == 0
        error = np.abs(fall[model] - fall["splines"]).max() / fall["splines"].max()
        assert of["centre_error"] == pytest.approx(error)
    assert 2.0 * fall["published"][-1] < fall["homogenized"][-1] < fall["splines"][-1]
    assert {path.name for path in tmp_path.iterdir()} == {".yarnscale.json", "drops.png", "hanging.png", "index.html"}
    page = (tmp_path / "index.html").read_text()
    assert "all yarns" in page and "centre drop [mm]" in page and page.count("data:image/") == 2
    assert main(hung) == 2 and "--overwrite" in capsys.readouterr().err


def test_imposed_deformations_side_by_side(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(fabric_models, "AMOUNTS", {"shear": 0.3})
    monkeypatch.setattr(fabric_models, "AXES", ("rows",))
    assert main([*COMPARED, "--scene", "imposed", "--out", str(tmp_path), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    (shear,) = found["deformations"]
    assert (shear["kind"], shear["axis"], shear["amount"]) == ("shear", "rows", 0.3)
    extensions = {model: of["extension"] for model, of in shear["models"].items()}
    assert extensions["published"] > 10.0 * max(extensions["splines"], extensions["homogenized"])
    assert {"shear-rows.png", "index.html"} <= {path.name for path in tmp_path.iterdir()}
    assert "shear along the rows" in (tmp_path / "index.html").read_text()


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ("--scene stretch", "hang or imposed"), ("--scene hong", "did you mean hang"), ("--explicit", "--explicit"),
        ("--count", "--count"), ("--format png", "--format"), ("--amount 0.3", "--amount"), ("--tube", "--tube"),
        ("--scene imposed --duration 1", "--duration"), ("--scene imposed --damping 2", "--damping"),
        ("--reduction published", "--reduction"), ("--volume 3,4,2", "control points"),
        ("--method splines --scene imposed", "--method compare"),
    ],
)  # fmt: skip
def test_comparisons_refuse_what_they_do_not_take(
    options: str, said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([*COMPARED, "--out", str(tmp_path / "out"), *options.split()]) == 2
    assert said in capsys.readouterr().err and not (tmp_path / "out").exists()
