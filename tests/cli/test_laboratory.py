"""The command ``test``."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

import yarnscale as ys
from yarnscale.cli import main
from yarnscale.files.material_toml import write_yarn_material
from yarnscale.shell.materials.compact import CompactMaterial, SpringNetwork, shapes_of
from yarnscale.shell.materials.friction import Sliders
from yarnscale.yarn.material import PRESETS


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
    assert (out / "tests.csv").read_text(encoding="utf-8").startswith("test,direction [degrees],given,at,unit,measured")
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


@pytest.mark.slow
def test_a_cell_with_friction_is_tested_in_cycles(tmp_path, capsys):
    out = tmp_path / "tested"
    options = ["--loads", "1,5", "--directions", "0", "--curvatures", "-20,20", "--as-drawn", "--json"]
    wool = PRESETS["hylc2020-stockinette"]
    write_yarn_material(replace(wool, contact=replace(wool.contact, friction=0.3)), tmp_path / "yarn.toml")
    options += ["--material", str(tmp_path / "yarn.toml")]  # whose friction it takes
    # The smallest cell: knits take several times as long.
    assert main(["test", "plain", *options, "--cycles", "1", "--out", str(out)]) == 0
    content = json.loads(capsys.readouterr().out)
    assert content["friction"] == 0.3
    (cycle,) = content["cycles"]["tension"]
    assert [p["load"] for p in cycle["unloading"]] == [5.0, 1.0, 0.0]
    assert 0 < cycle["work_returned"] < cycle["work"]
    assert content["summary"]["tension"][0]["RT"] == pytest.approx(100 * cycle["work_returned"] / cycle["work"])
    assert content["summary"]["shear"]["G"] > 0
    assert content["summary"]["shear"]["2HG"] > 0 and content["summary"]["shear"]["2HG5"] > 0
    assert all(bent["2HB"] > 0 for bent in content["summary"]["bending"])
    assert content["biaxial"] == [] and (out / "cycles.png").exists()


@pytest.mark.parametrize(
    ("options", "friction"),
    [(["--cycles", "1"], 0.3), (["--cycles", "1", "--friction", "0.1"], 0.1), (["--friction", "0.1"], 0.1), ([], None)],
)
def test_friction_is_that_of_the_option_or_in_cycles_that_of_the_yarn(tmp_path, monkeypatch, options, friction):
    wool, programmes = PRESETS["hylc2020-stockinette"], []
    write_yarn_material(replace(wool, contact=replace(wool.contact, friction=0.3)), tmp_path / "yarn.toml")

    def stopped(subject, *, programme, **_):
        programmes.append(programme)
        raise ys.InputError("enough")

    monkeypatch.setattr("yarnscale.cli.laboratory.run_tests", stopped)
    command = ["test", "stockinette", "--as-drawn", "--curvatures", "-20,20", "--out", str(tmp_path / "tested")]
    assert main([*command, "--material", str(tmp_path / "yarn.toml"), *options]) == 2
    (programme,) = programmes
    assert (None if programme.friction is None else programme.friction.coefficient) == friction


@pytest.mark.parametrize(
    ("options", "reason"),
    [
        (["stockinette", "--friction", "-0.1"], "friction"),
        (["stockinette", "--friction", "0.1", "--cycles", "0"], "cycles"),
        (["stockinette", "--cycles", "2"], "--cycles"),
        (["SHELL", "--friction", "0.1"], "shell material"),
        (["SHELL", "--cycles", "1"], "a shell material with friction"),
    ],
)
def test_friction_that_cannot_be_tested_is_refused_in_one_line(shell, tmp_path, capsys, options, reason):
    options = [str(shell) if option == "SHELL" else option for option in options]
    assert main(["test", *options, "--out", str(tmp_path / "tested")]) == 2
    (line,) = capsys.readouterr().err.strip().splitlines()
    assert reason in line and not (tmp_path / "tested").exists()


def test_a_shell_that_remembers_is_tested_in_cycles_and_exported_without_friction(tmp_path, capsys):
    none = SpringNetwork(*(np.zeros(tuple(shape)) for shape in shapes_of(1, 1, 1)))
    springs = none._replace(background=np.array([8.0, 8.0, 8.0, 0.1, 0.1, 0.1]))
    growth = 0.02 * np.eye(6)
    sliders = Sliders.checked(np.eye(6), np.zeros((6, 1)), np.full(6, 4.0), np.zeros(6), growth, growth)
    scale = np.array([0.5, 0.5, 0.5, 100.0, 100.0, 100.0])
    file, out = tmp_path / "felt.json", tmp_path / "tested"
    ys.write_material(file, CompactMaterial(0.0, scale, springs, density=0.2, sliders=sliders))
    options = ["--directions", "0", "--loads", "1,4", "--curvatures", "-20,20", "--cycles", "2", "--out", str(out)]
    assert main(["test", str(file), *options, "--json"]) == 0
    content = json.loads(capsys.readouterr().out)
    first, second = content["cycles"]["tension"]
    assert 0.5 < first["work_returned"] / first["work"] < 0.95 and second["dissipated"] > 0.0
    assert first["unloading"][-1]["stretch"] > 0.0 and "friction" not in content
    assert 0.0 < content["summary"]["tension"][0]["RT"] < 100.0 and content["summary"]["shear"]["2HG5"] > 0.0
    assert (out / "cycles.png").exists()
    assert main(["export", str(file), "--format", "c", "--out", str(tmp_path / "felt.c"), "--json"]) == 0
    assert "friction" in json.loads(capsys.readouterr().out)["lost"][0]
    assert main(["evaluate", str(file), "--strain", "0.01,0,0,0,0,0"]) == 0
    assert "without friction" in capsys.readouterr().err
    plain = ["--loads", "1", "--directions", "0", "--curvatures", "5", "--out", str(tmp_path / "plain")]
    main(["test", str(file), *plain])
    assert "is tested without its friction" in capsys.readouterr().err


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
