"""The command ``export``: both formats, notes about what is lost, errors of the user."""

from __future__ import annotations

import numpy as np
import pytest

from yarnscale.cli import main
from yarnscale.files.material_json import read_material, write_material
from yarnscale.shell.materials.compact import CompactMaterial, SpringNetwork
from yarnscale.shell.materials.orthotropic import OrthotropicMaterial
from yarnscale.shell.materials.spline_material import SplineMaterial
from yarnscale.shell.materials.tables import CubicSpline


@pytest.fixture
def source(tmp_path):
    knots = np.array([-1.0, 0.0, 1.0])
    axes = [CubicSpline(knots * k, knots**2, 2 * knots / k) for k in (0.5, 0.6, 0.7, 80.0, 90.0)]
    write_material(tmp_path / "material.json", SplineMaterial(0.1, tuple(axes), {}, density=0.2))
    return tmp_path / "material.json"


def test_hylc_json_gives_the_same_energy_and_says_what_is_lost(source, tmp_path, capsys):
    assert main(["export", str(source), "--format", "hylc", "--out", str(tmp_path / "out.json")]) == 0
    again = read_material(tmp_path / "out.json")
    strain = np.array([0.2, 0.1, -0.3, 20.0, 5.0, -30.0])
    x = strain[:3] / [0.5, 0.6, 0.7]
    bend = np.array([[20.0, 5.0], [5.0, -30.0]])
    bend = (bend @ bend)[[0, 1], [0, 1]] / np.array([80.0, 90.0]) ** 2
    assert float(again.energy_density(strain)) == pytest.approx(0.1 + np.sum(x**2) + np.sum(bend), rel=1e-12)
    assert "provenance" in capsys.readouterr().err


def test_source_is_written_of_a_compact_material_and_the_published_form_says_its_loss(tmp_path, capsys):
    springs = np.array([[2.0, 0, 1, 0, 0, 0], [1, 0, -1, 0.5, 0, 1], [0, 2, 0, 0, 0.3, 0.2]])
    network = SpringNetwork(
        np.zeros((0, 6)), np.zeros(0), springs, np.zeros((3, 0)), np.zeros(3), np.ones(3), np.full(6, 0.1),
        np.zeros((0, 6)), np.zeros(0), np.zeros(0),
    )  # fmt: skip
    samples = np.random.default_rng(0).uniform(-0.3, 0.5, (50, 6)) * [1, 1, 1, 100, 100, 100]
    scale = np.array([0.5, 0.5, 0.5, 100.0, 100.0, 100.0])
    write_material(tmp_path / "c.json", CompactMaterial(0.1, scale, network, density=0.2, samples=samples))
    for name, ending, word in (("c", "c", "int yarnscale_energy(const double"), ("warp", "py", "@wp.func")):
        out = tmp_path / f"out.{ending}"
        assert main(["export", str(tmp_path / "c.json"), "--format", name, "--out", str(out)]) == 0
        assert word in out.read_text()
    assert capsys.readouterr().err == ""
    out = tmp_path / "published.json"
    assert main(["export", str(tmp_path / "c.json"), "--format", "hylc", "--out", str(out)]) == 0
    assert "95th percentile" in capsys.readouterr().err
    assert read_material(out).density == 0.2


def test_wrong_suffixes_and_other_kinds_are_refused(source, tmp_path, capsys):
    assert main(["export", str(source), "--format", "c", "--out", str(tmp_path / "out.json")]) == 2
    constants = dict.fromkeys(("stretch_weft", "stretch_warp", "shear", "bend_weft", "bend_warp", "bend_bias"), 1.0)
    constants |= {"stretch_coupling": 0.1, "area": 0.1, "log_area": 0.1}
    write_material(tmp_path / "plain.json", OrthotropicMaterial(**constants, density=0.2))
    assert main(["export", str(tmp_path / "plain.json"), "--format", "c", "--out", str(tmp_path / "out.c")]) == 2
    assert "compact" in capsys.readouterr().err
    assert not (tmp_path / "out.c").exists()
