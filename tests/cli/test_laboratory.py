"""The command ``test``."""

from __future__ import annotations

import json

import pytest

import yarnscale as ys
from yarnscale.cli import main


@pytest.fixture
def shell(tmp_path):
    path = tmp_path / "shell.json"
    bends = {"bend_weft": 1e-5, "bend_bias": 1e-5, "bend_warp": 1e-5}
    ys.write_material(path, ys.OrthotropicMaterial(100.0, 20.0, 60.0, 15.0, **bends, density=0.15))
    return path


def test_a_shell_is_tested_and_compared(shell, tmp_path, capsys):
    out = tmp_path / "tested"
    options = [
        "--loads",
        "0.1,1,10",
        "--directions",
        "0,90",
        "--against",
        str(shell),
        "--out",
        str(out),
        "--json",
    ]
    assert main(["test", str(shell), *options]) == 0
    content = json.loads(capsys.readouterr().out)
    assert content["kind"] == "shell"
    assert [(p["direction"], p["load"]) for p in content["tension"]] == [
        (d, load) for d in (0.0, 90.0) for load in (0.1, 1.0, 10.0)
    ]
    assert len(content["natural_curvature"]) == 2
    assert content["difference"]["stretch"] == 0.0
    assert json.loads((out / "tests.json").read_text())["subject"] == str(shell)
    assert (
        (out / "tests.csv")
        .read_text(encoding="utf-8")
        .startswith("test,direction [degrees],given,at,unit,measured")
    )
    page = (out / "index.html").read_text()
    assert "Virtual tests" in page and "data:image/png" in page


@pytest.mark.slow
def test_a_cell_is_tested(tmp_path, capsys):
    out = tmp_path / "tested"
    options = ["--loads", "0.1,5", "--directions", "0", "--curvatures", "-40,40", "--out", str(out), "--json"]
    assert main(["test", "plain", *options]) == 0
    content = json.loads(capsys.readouterr().out)
    assert content["kind"] == "cell"
    weak, strong = content["tension"]
    assert 0 <= weak["stretch"] < strong["stretch"] < 0.5
    first, second = (p["moment"] for p in content["bending"] if p["direction"] == 0.0)
    assert first < 0 < second


def test_what_cannot_be_tested_is_refused(shell, tmp_path, capsys):
    out = str(tmp_path / "tested")
    assert main(["test", "stockinette", "--drape", "--out", out]) == 2
    assert main(["test", str(shell), "--material", "wool", "--out", out]) == 2
    assert main(["test", str(shell), "--loads", "5,1", "--out", out]) == 2
    with pytest.raises(SystemExit) as error:
        main(["test", str(shell), "--directions", "0,east", "--out", out])
    assert error.value.code == 2
    assert not (tmp_path / "tested").exists()
    assert "east" in capsys.readouterr().err
