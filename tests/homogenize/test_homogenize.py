"""The first job as a whole, small: samples, material, pictures and page; killed halfway, resumed, without OpenGL."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest

from yarnscale.cli import main
from yarnscale.errors import InputError
from yarnscale.files.material_json import read_material
from yarnscale.homogenize.homogenize import fit
from yarnscale.homogenize.store import SampleStore


@pytest.fixture(scope="module")
def outcome(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, int]:
    """Folder and exit status of a small run, in which drawing failed at first."""
    folder = tmp_path_factory.mktemp("homogenized") / "out"
    patch = pytest.MonkeyPatch()

    def unavailable(*arguments: object) -> None:
        raise InputError("cannot draw pictures")

    patch.setattr("yarnscale.cli.materials.draw_material", unavailable)
    box = ["--stretch", "-0.05,0.2", "--shear", "0.15", "--curvature", "0.03"]
    command = ["homogenize", "plain", "--out", str(folder), "--solves", "40", *box, "--workers", "2"]
    assert main(command) == 2
    assert read_material(folder / "material.json").density > 0
    assert SampleStore(folder / "samples").status().all()
    before = (folder / "samples" / "energy_density" / "c" / "0").stat().st_mtime_ns
    patch.undo()
    status = main([*command, "--resume"])
    assert (folder / "samples" / "energy_density" / "c" / "0").stat().st_mtime_ns == before
    return folder, status


@pytest.mark.slow
def test_all_states_converge_and_the_folder_is_complete(outcome: tuple[Path, int]) -> None:
    folder, status = outcome
    assert status == 0
    found = {path.name for path in folder.iterdir()}
    assert found == {"samples", "unseen", "material.json", "pattern.json", "pictures", "index.html"}
    assert (SampleStore(folder / "samples").status() == 1).all()
    assert {"axes.png", "errors.png"} <= {path.name for path in (folder / "pictures").iterdir()}


@pytest.mark.slow
def test_the_page_stands_alone(outcome: tuple[Path, int]) -> None:
    page = (outcome[0] / "index.html").read_text()
    assert re.findall(r"(?:src|href)\s*=\s*[\"']?(?:https?:)?//", page) == []
    assert "http://" not in page.replace("http://www.w3.org", "") and "https://" not in page
    assert "<img" in page


@pytest.mark.slow
def test_the_material_reads_and_follows_the_samples(outcome: tuple[Path, int]) -> None:
    folder, _ = outcome
    store = SampleStore(folder / "samples")
    material = read_material(folder / "material.json")
    states = store.states
    strains = np.zeros((store.count, 6))
    strains[:, [0, 1, 2, 3, 5]] = states
    energies = np.array([float(store.read(i, "energy_density")) for i in range(store.count)])
    error = np.abs(material.energy_density(strains) - energies) / np.ptp(energies)
    assert np.median(error) < 0.01
    content = json.loads((folder / "material.json").read_text())
    assert content["provenance"]["pattern"] == "plain"
    again = fit(store)
    assert np.allclose(again.energy_density(strains), material.energy_density(strains), rtol=1e-9)


@pytest.mark.slow
def test_another_plan_does_not_resume(outcome: tuple[Path, int], capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["homogenize", "plain", "--out", str(outcome[0]), "--solves", "40", "--resume"]) == 2
    assert "cannot resume: other states" in capsys.readouterr().err


@pytest.mark.slow
def test_a_budget_goes_on_from_the_plan(
    outcome: tuple[Path, int], capsys: pytest.CaptureFixture[str]
) -> None:
    folder, _ = outcome
    before = SampleStore(folder / "samples")
    box = ["--stretch", "-0.05,0.2", "--shear", "0.15", "--curvature", "0.03"]
    command = [
        "homogenize",
        "plain",
        "--out",
        str(folder),
        "--solves",
        "40",
        *box,
        "--workers",
        "2",
        "--resume",
    ]
    budget = before.count + 10
    assert main([*command, "--budget", str(budget)]) == 0
    assert f"{before.count} states: estimated errors of 95 % below" in capsys.readouterr().err
    after = SampleStore(folder / "samples")
    assert after.count == budget
    assert np.array_equal(after.states[: before.count], before.states)
    assert (after.status() == 1).all()


def test_a_target_needs_a_budget_and_terms_that_can_use_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    command = ["homogenize", "plain", "--out", str(tmp_path / "out")]
    for more, message in (
        (["--target-error", "0.01"], "expected a budget of solves with it"),
        (["--budget", "80", "--target-error", "2"], "target of the error; expected between 0 and 1"),
        (["--budget", "80", "--in-plane", "pairwise"], "budget of solves"),
    ):
        assert main([*command, *more]) == 2
        assert message in capsys.readouterr().err
