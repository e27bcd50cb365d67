"""The command ``view``: what it shows, and what it refuses."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest

from yarnscale.cell import PeriodicCell
from yarnscale.cli import main
from yarnscale.cli.arguments import parser
from yarnscale.cli.view import view_of
from yarnscale.drawing import library
from yarnscale.files.equilibrium_file import read_equilibrium
from yarnscale.files.material_json import write_material
from yarnscale.files.patterns import write_pattern
from yarnscale.homogenize.plan import scattered_axes
from yarnscale.homogenize.sample import create_store
from yarnscale.homogenize.worker import record, strain_of
from yarnscale.shell.materials.orthotropic import OrthotropicMaterial
from yarnscale.yarn.material import YarnMaterial


def _exported(thing: Path | str, folder: Path, *more: str) -> dict:
    page = folder / "page.html"
    assert main(["view", str(thing), "--export", str(page), *more]) == 0
    text = page.read_text(encoding="utf-8")
    assert len(text.encode()) < 2_000_000
    # Nothing is fetched: what looks like an address in the library names a namespace or its source.
    assert not re.search(r"""(src|href)=["'](?!data:)""", text.split("<script>")[0])
    found = re.search(r'<script type="application/json" id="pane-0">(.*?)</script>', text, re.DOTALL)
    assert found is not None
    return json.loads(found[1])


def test_a_state_and_a_material_become_pages(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    state = tmp_path / "state.npz"
    main(["relax", "plain", "--as-drawn", "--strain", "0.1,0,0,0,0", "--out", str(state)])
    cell, found = read_equilibrium(state)
    pane = _exported(state, tmp_path)
    assert pane["start"] == found["strain"].tolist() and pane["states"] == 1 and pane["varying"] == []
    assert pane["period"] == cell.pattern.period.tolist()
    write_material(tmp_path / "cloth.json", OrthotropicMaterial(10.0, 1.0, 10.0, 0.2, bend_weft=1e-5, bend_warp=1e-5))
    capsys.readouterr()
    pane = _exported(tmp_path / "cloth.json", tmp_path, "--json")
    assert json.loads(capsys.readouterr().out)["panes"] == ["shell material cloth.json"]
    assert pane["states"] > 100 and len(pane["paths"]) > 5


def test_names_of_the_package_come_first_and_it_says_so(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "stockinette-wool").mkdir()
    assert view_of(parser().parse_args(["view", "stockinette-wool"])).title == "shell material stockinette-wool"
    assert "./stockinette-wool is your own" in capsys.readouterr().err
    assert main(["view", "./stockinette-wool"]) == 2
    assert "folder holds nothing to view" in capsys.readouterr().err
    assert main(["view", "stokinette-wool"]) == 2
    assert "did you mean stockinette-wool?" in capsys.readouterr().err


def test_an_estimate_shows_the_samples_of_its_yarn(tmp_path: Path) -> None:
    folder, states = tmp_path / "found", np.array([[0.0] * 5, [0.1, 0.0, 0.0, 0.0, 0.0]])
    for place, scale in (("samples", 1.0), ("refitted/samples", 1.1)):
        cell = PeriodicCell(library.build("plain").scaled(scale), YarnMaterial.preset("wool"))
        store = create_store(folder / "homogenized" / place, cell, scattered_axes(states), scattered=True)
        for number, state in enumerate(states):
            store.write(number, record(cell.relax(strain_of(state))))
        write_pattern(cell.pattern, folder / "pattern.json")
    (folder / "estimate.json").write_text('{"parameters": {"k_b": 1e-9}}')
    pane = _exported(folder, tmp_path)
    assert pane["states"] == 2 and pane["range"][0] == [0.0, 0.1]
    assert pane["period"][0] == pytest.approx(1.1 * library.build("plain").period[0])
    assert "k_b" in (tmp_path / "page.html").read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("name", "content", "said"),
    [
        ("missing.json", None, "nothing to view"),
        ("stockinete", None, "did you mean stockinette"),
        ("folder", "", "folder holds nothing to view"),
        ("text.txt", b"hello", "file is nothing to view"),
        ("broken.json", b"{", "broken.json"),
        ("other.json", b"[1]", "other.json"),
        ("state.npz", b"PK", "file is no relaxed cell"),
        ("folder/estimate.json", b'{"parameters": 3}', "field 'parameters'"),
        ("folder/zarr.json", b"{}", "not a sample store"),
        ("folder/frames/mesh.npz", b"", "mesh of a cloth"),
        ("folder/curves.npz", b"PK", "set of curves"),
        ("folder/pattern.json", b'{"format": "other"}', "field 'format'"),
    ],
)
def test_other_things_are_refused_in_one_line(
    name: str, content: bytes | str | None, said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path, thing = tmp_path / name, tmp_path / Path(name).parts[0]
    if isinstance(content, bytes):
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content)
    elif content == "":
        path.mkdir()
    before = sorted(tmp_path.rglob("*"))
    thing = Path(name) if name == "stockinete" else thing
    assert main(["view", str(thing), "--export", str(tmp_path / "page.html")]) == 2
    told = capsys.readouterr().err.strip().splitlines()
    assert len(told) == 1 and said in told[0], told
    assert sorted(tmp_path.rglob("*")) == before


def test_states_that_lack_a_part_are_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    state = tmp_path / "state.npz"
    main(["relax", "plain", "--as-drawn", "--out", str(state)])
    with np.load(state) as stored:
        whole = dict(stored)
    for name, value, said in (
        ("fluctuation", np.zeros((2, 3)), "fluctuation; expected shape"),
        ("stress", np.full(6, np.nan), "stress; expected finite"),
        ("pattern", np.array("{}"), "missing field"),
        ("pattern", np.array("x"), "expected JSON"),
        ("pattern", np.array("[" * 100_000), "expected JSON"),
    ):
        np.savez(state, **(whole | {name: value}))
        capsys.readouterr()
        assert main(["view", str(state), "--export", str(tmp_path / "page.html")]) == 2
        assert said in capsys.readouterr().err and not (tmp_path / "page.html").exists()
    np.savez_compressed(state, **(whole | {"stress": np.zeros(20_000_000)}))
    assert main(["view", str(state), "--export", str(tmp_path / "page.html")]) == 2
    assert "0.2 GB once unpacked" in capsys.readouterr().err
