"""Bad input on the command line: one line that names the fault, status 2, nothing left behind."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from yarnscale.drawing import library
from yarnscale.files.patterns import write_pattern


@pytest.fixture(scope="module")
def pyp(tmp_path_factory: pytest.TempPathFactory) -> str:
    path = tmp_path_factory.mktemp("drawn") / "plain.pyp"
    write_pattern(library.build("plain"), path)
    return path.read_text()


def nothing_left(folder: Path, *names: str) -> None:
    assert sorted(p.name for p in folder.iterdir()) == sorted(names)


@pytest.mark.parametrize(
    ("strain", "message"),
    [
        ("-1,0,0,0,0", "strain s_x; expected more than -1; found -1"),
        ("0,0,-2,0,0", "strain s_y"),
        ("0,1,0,0,0", "strain s_a"),
        ("0,-1.5,0,0,0", "strain s_a"),
        ("nan,0,0,0,0", "--strain: expected 5 numbers sx,sa,sy,lx,ly"),
        ("0,0,0,inf,0", "--strain"),
        ("0,0,0", "--strain"),
        ("a,b,c,d,e", "--strain"),
        ("", "--strain"),
    ],
)
def test_impossible_strains(refused, tmp_path: Path, strain: str, message: str) -> None:
    assert message in refused("relax", "plain", "--strain", strain, "--out", tmp_path / "s.npz")
    nothing_left(tmp_path)


@pytest.mark.parametrize("strain", ["-1,0,0,0,0,0", "0,1,0,0,0,0", "0,0,0,0,0,nan", "0,0,0,0,0"])
def test_impossible_strains_of_a_shell(refused, shared: Path, strain: str) -> None:
    assert "strain" in refused("evaluate", shared / "reference" / "stock1.json", "--strain", strain)


@pytest.mark.parametrize("name", ["nonsense", "hylc2021-rib", "missing.toml"])
def test_unknown_yarn_materials(refused, name: str) -> None:
    assert name in refused("relax", "plain", "--material", name)


def test_unknown_patterns(refused, tmp_path: Path) -> None:
    assert "unknown pattern" in refused("pattern", "nonsense", "--out", tmp_path / "a.pyp")
    assert "nonsense" in refused("relax", "nonsense")
    assert "missing.pyp" in refused("relax", tmp_path / "missing.pyp")
    assert str(tmp_path) in refused("relax", tmp_path)
    nothing_left(tmp_path)


@pytest.mark.parametrize("radius", ["-0.001", "0", "nan", "inf", "thick"])
def test_impossible_radii(refused, tmp_path: Path, radius: str) -> None:
    assert "radius" in refused("pattern", "plain", "--out", tmp_path / "a.pyp", f"--radius={radius}")
    nothing_left(tmp_path)


def with_nan(text: str) -> str:
    lines = text.splitlines()
    row = next(i for i, line in enumerate(lines) if line.startswith("*Q")) + 3
    lines[row] = " ".join(["nan", *lines[row].split()[1:]])
    return "\n".join(lines)


def with_radius(text: str, radius: str) -> str:
    lines = text.splitlines()
    row = next(i for i, line in enumerate(lines) if line.startswith("*pattern")) + 1
    px, py, _, n = lines[row].split()
    lines[row] = f"{px} {py} {radius} {n}"
    return "\n".join(lines)


def with_broken_edge(text: str) -> str:
    lines = text.splitlines()
    row = next(i for i, line in enumerate(lines) if line.startswith("*E")) + 2
    lines[row] = "0 " + " ".join(lines[row].split()[1:])
    return "\n".join(lines)


@pytest.mark.parametrize(
    "change",
    [
        lambda text: "",
        lambda text: "\0\1\2",
        lambda text: text[: len(text) // 2],
        with_nan,
        with_broken_edge,
        lambda text: with_radius(text, "-0.001"),
        lambda text: with_radius(text, "0.1"),
        lambda text: text.replace("*E", "*X"),
    ],
    ids=["empty", "binary", "truncated", "nan", "topology", "negative radius", "run through", "no edges"],
)
def test_bad_patterns(refused, tmp_path: Path, pyp: str, change) -> None:
    path = tmp_path / "bad.pyp"
    path.write_text(change(pyp))
    assert str(path) in refused("relax", path, "--out", tmp_path / "s.npz", "--json")
    nothing_left(tmp_path, "bad.pyp")


def test_patterns_of_random_bytes(refused, tmp_path: Path) -> None:
    path = tmp_path / "bad.pyp"
    path.write_bytes(bytes(range(256)) * 4)
    assert str(path) in refused("relax", path)


BAD_JSON = {
    "empty": b"",
    "binary": bytes(range(256)),
    "cut": b'{"format": "yarnscale-material", "version": 1, "axes": [',
    "list": b"[1, 2]",
    "nan": b'{"format": "yarnscale-material", "version": 1, "density": NaN}',
    "nested": b'{"a": ' + b"[" * 100_000 + b"]" * 100_000 + b"}",
    "other": b'{"format": "something"}',
    "new": b'{"format": "yarnscale-material", "version": 99}',
    "bare": b'{"format": "yarnscale-material", "version": 1}',
    "hylc": b'{"strain scale": [1, 1, 1, 1, 1], "density": 0.3, "coeffs": {}}',
    "scale": b'{"strain scale": [1, -1, 1, 1, 1], "density": 0.3, "coeffs": {}}',
    "huge": b'{"strain scale": [1, 1, 1, 1, 1e999], "density": 1' + b"0" * 5000 + b"}",
}


@pytest.mark.parametrize("kind", BAD_JSON)
@pytest.mark.parametrize("command", ["evaluate", "drape", "stretch"])
def test_bad_shell_materials(refused, tmp_path: Path, kind: str, command: str) -> None:
    path = tmp_path / "bad.json"
    path.write_bytes(BAD_JSON[kind])
    options = {
        "evaluate": ["--strain", "0,0,0,0,0,0"],
        "drape": ["--out", tmp_path / "out"],
        "stretch": ["--direction", "wale", "--amount", "0.1", "--out", tmp_path / "out"],
    }
    assert str(path) in refused(command, path, *options[command])
    nothing_left(tmp_path, "bad.json")


@pytest.mark.parametrize("amount", ["nan", "inf", "much", "-1", "-3"])
def test_impossible_stretches(refused, shared: Path, tmp_path: Path, amount: str) -> None:
    material = shared / "reference" / "stock1.json"
    line = refused("stretch", material, "--direction", "wale", f"--amount={amount}", "--out", tmp_path / "out")
    assert "amount" in line
    nothing_left(tmp_path)


@pytest.mark.parametrize(
    "text",
    [
        "",
        "\0",
        "material = ",
        "material = 'missing.json'",
        "mesh = 3",
        "[mesh]\nwidth = 0.1",
        "x = " + "[" * 9999,
    ],
)
def test_bad_scenes(refused, tmp_path: Path, text: str) -> None:
    path = tmp_path / "scene.toml"
    path.write_text(text)
    assert str(tmp_path) in refused("simulate", path, "--out", tmp_path / "out")
    nothing_left(tmp_path, "scene.toml")


def test_bad_grids(refused, tmp_path: Path) -> None:
    path = tmp_path / "grid.toml"
    for text in ("", "s_x = [nan]", "s_z = [0]", "s_x = 'a'", "s_x = [0"):
        path.write_text(text)
        assert str(path) in refused("sample", "plain", "--grid", path, "--out", tmp_path / "store")
    nothing_left(tmp_path, "grid.toml")


def test_unwritable_outputs(refused, tmp_path: Path) -> None:
    file = tmp_path / "file"
    file.write_text("keep")
    grid = tmp_path / "grid.toml"
    grid.write_text("s_x = [0]")
    store = tmp_path / "store"
    for arguments in (
        ["relax", "plain", "--out", file / "s.npz"],
        ["relax", "plain", "--picture", file / "s.png"],
        ["relax", "plain", "--out", tmp_path / "missing" / "s.npz"],
        ["relax", "plain", "--out", tmp_path / "state.txt"],
        ["relax", "plain", "--out", tmp_path],
        ["pattern", "plain", "--out", file / "a.pyp"],
        ["sample", "plain", "--grid", grid, "--out", file / "store"],
        ["sample", "plain", "--grid", grid, "--out", file],
        ["homogenize", "plain", "--out", file / "out"],
        ["homogenize", "plain", "--out", file],
        ["fit", store, "--out", file / "material.json"],
    ):
        line = refused(*arguments)
        assert str(arguments[-1]) in line or ".npz" in line
    assert file.read_text() == "keep"
    nothing_left(tmp_path, "file", "grid.toml")


def test_folders_of_cloth_that_cannot_be_written(refused, shared: Path, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("keep")
    line = refused("drape", shared / "reference" / "stock1.json", "--out", tmp_path / "file" / "out")
    assert "output cannot be written" in line


def test_existing_results_are_not_overwritten(refused, tmp_path: Path) -> None:
    (tmp_path / "out" / "samples").mkdir(parents=True)
    (tmp_path / "out" / "samples" / "mine").write_text("keep")
    grid = tmp_path / "grid.toml"
    grid.write_text("s_x = [0]")
    assert "--resume" in refused("homogenize", "plain", "--out", tmp_path / "out")
    assert "--resume" in refused("sample", "plain", "--grid", grid, "--out", tmp_path / "out" / "samples")
    assert "no sample store" in refused("homogenize", "plain", "--out", tmp_path / "out", "--resume")
    assert (tmp_path / "out" / "samples" / "mine").read_text() == "keep"


@pytest.mark.parametrize(
    ("option", "value"),
    [("--solves", "0"), ("--solves", "many"), ("--workers", "-1"), ("--stretch", "0.1,0.5"), ("--stretch", "nan,1"),
     ("--shear", "2"), ("--curvature", "-1")],
)  # fmt: skip
def test_impossible_ranges(refused, tmp_path: Path, option: str, value: str) -> None:
    form = ("--form", "hylc2020")
    assert option.strip("-") in refused("homogenize", "plain", "--out", tmp_path / "out", *form, option, value)
    nothing_left(tmp_path)


def test_what_is_no_store_is_not_fitted(refused, tmp_path: Path) -> None:
    (tmp_path / "empty").mkdir()
    for name in ("missing", "empty"):
        line = refused("fit", tmp_path / name, "--out", tmp_path / "material.json")
        assert f"{tmp_path / name}: no sample store" in line
    nothing_left(tmp_path, "empty")


def test_bad_yarn_materials(refused, tmp_path: Path) -> None:
    path = tmp_path / "yarn.toml"
    for text in (
        "",
        "\0",
        "young_modulus = ",
        "young_modulus = -1",
        "young_modulus = nan",
        "a = " + "[" * 9999,
    ):
        path.write_text(text)
        assert str(path) in refused("relax", "plain", "--material", path)


def test_a_program_shows_no_traceback(program, tmp_path: Path) -> None:
    path = tmp_path / "bad.pyp"
    path.write_bytes(b"\x80\x04.")
    outcome = program("relax", path)
    assert outcome.status == 2
    assert outcome.err.count("\n") == 1 and str(path) in outcome.err
    assert json.loads(json.dumps(outcome.out)) == ""
