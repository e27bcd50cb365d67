"""Parameters of Newton's cloth: against closed forms, and against strips that Newton itself simulates."""

from __future__ import annotations

import csv
import importlib.util
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import yarnscale as ys
from yarnscale.cli import main
from yarnscale.errors import InputError
from yarnscale.files.material_json import write_material
from yarnscale.files.newton_cloth import errors_by_test
from yarnscale.homogeneous.fabrics import MaterialFabric
from yarnscale.kinematics import GRAVITY
from yarnscale.laboratory import style3d
from yarnscale.laboratory.homogeneous_tests import tension
from yarnscale.laboratory.style3d import Style3DCloth, bending_on_grid, fit_style3d
from yarnscale.laboratory.table import Deviation, Measured

ROOT = Path(__file__).resolve().parents[2]
WOVEN = ys.OrthotropicMaterial(
    stretch_weft=60.0, stretch_coupling=0.0, stretch_warp=90.0, shear=20.0, bend_weft=1e-5, bend_bias=1e-5,
    bend_warp=2e-5, density=0.2,
)  # fmt: skip


@pytest.fixture(scope="module")
def fit():
    return fit_style3d(WOVEN)


def test_stiffnesses_of_cloth_that_newton_can_be(fit):
    # The Green strain of our cloth is 1 + s/2 times the stretch of Newton's.
    np.testing.assert_allclose(fit.cloth.stretch[:2], (60, 90), rtol=0.15)
    assert fit.cloth.density == 0.2
    errors = [
        abs(d.error) for d in fit.deviations if d.reference.test == "tension" and d.reference.quantity == "stretch"
    ]
    assert max(errors) < 12
    along = {d.reference.at: d for d in fit.deviations if d.reference.test == "bending" and d.reference.direction == 0}
    assert along[100.0].reference.value == pytest.approx(2e-3, rel=1e-6)
    assert along[100.0].other == pytest.approx(2e-3, rel=0.15)


def test_grid_bends_as_its_edges_say():
    # Newton's edge energies on one cell of its grid, summed by hand: 3/2 k (II11 − II12)² and so on.
    matrix = bending_on_grid(np.array([1.0, 2.0, 3.0]))
    slanting = 3 / 64 + 3.0
    for k11, k12, k22 in np.random.default_rng(0).normal(size=(4, 3)):
        energy = 1.5 * (k11 - k12) ** 2 + 3.0 * (k22 - k12) ** 2 + 6 * slanting * k12**2
        bent = np.array([k11, k12, k22])
        assert 0.5 * bent @ matrix @ bent == pytest.approx(energy)


def test_response_has_the_moduli_of_its_stress():
    cloth = Style3DCloth(0.2, (50.0, 50.0, 5.0), (1e-5, 2e-5, 1e-5), WOVEN.strain_scale)
    strain = np.array([0.1, 0.05, 0.1, 10.0, 5.0, -20.0])
    slopes = np.array(
        [(cloth.response(strain + h).stress - cloth.response(strain - h).stress) / 2e-6 for h in 1e-6 * np.eye(6)]
    )
    np.testing.assert_allclose(0.5 * (slopes + slopes.T), cloth.moduli(cloth.response(strain)), atol=1e-6)


def exported(out: Path, form: str, *options: str) -> int:
    """Status of the command, with a material beside its output."""
    material = out.with_name("cloth.json")
    write_material(material, WOVEN)
    return main(["export", str(material), "--to", form, *options, "--out", str(out)])


def test_command_writes_parameters_certificate_and_table(tmp_path, capsys):
    out = tmp_path / "newton.json"
    assert exported(out, "newton", "--loads", "0.1,2", "--json") == 0
    assert json.loads(capsys.readouterr().out)["format"] == "newton"
    content = json.loads(out.read_text())
    assert len(content["tri_aniso_ke"]) == len(content["edge_aniso_ke"]) == 3
    assert content["loads"]["range"] == [0.1, 2.0] and content["not_represented"]
    pulled = [r for r in content["certificate"] if r["test"] == "tension" and r["measured"] == "stretch"]
    assert {r["direction"] for r in pulled} == {0.0, 45.0, 90.0}
    assert max(r["at"] for r in pulled) == pytest.approx(2.0)
    for row in pulled:
        assert row["error_percent"] == pytest.approx(
            100 * (row["newton"] - row["material"]) / max(row["material"], 0.05 * max(r["material"] for r in pulled))
        )
    rows = list(csv.DictReader((tmp_path / "newton.tests.csv").open(encoding="utf-8")))
    assert {"tension", "bending", "twist", "free piece", "cantilever"} <= {r["test"] for r in rows}
    assert all(r["value unit"] for r in rows)


@pytest.mark.parametrize("loads", ["2,1", "0,1", "-1,2"])
def test_bad_range_is_refused_and_nothing_is_written(tmp_path, capsys, loads):
    assert exported(tmp_path / "newton.json", "newton", f"--loads={loads}") == 2
    assert "range of loads" in capsys.readouterr().err
    assert sorted(p.name for p in tmp_path.iterdir()) == ["cloth.json"]


def test_range_belongs_to_newton(tmp_path):
    assert exported(tmp_path / "cloth.c", "c", "--loads", "1,2") == 2
    with pytest.raises(InputError, match="range of loads"):
        fit_style3d(WOVEN, (1.0, np.inf))


def test_newtons_own_strip_stretches_and_bends_as_its_certificate_says(fit):
    pytest.importorskip("newton")
    spec = importlib.util.spec_from_file_location("newton_strip", ROOT / "benchmarks" / "newton_strip.py")
    assert spec is not None and spec.loader is not None
    strips = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(strips)
    (point,) = tension(fit.cloth, 0.0, [1.0])
    stretch = strips.stretched(fit.cloth)
    assert stretch == pytest.approx(point.stretch, rel=1e-3)
    (own,) = tension(MaterialFabric(WOVEN), 0.0, [1.0])
    assert stretch == pytest.approx(own.stretch, rel=0.12)
    length = (2 * 1e-5 / (0.2 * GRAVITY)) ** (1 / 3)
    assert strips.bending_length(fit.cloth, length) == pytest.approx(length, rel=0.08)


def bent(monkeypatch, fit, change):
    """Change all tests of bending along 45°; those of the material are known from its fit."""
    tested = style3d.run_tests

    def run(material, **options):
        tests = fit.tests if material is WOVEN else tested(material, **options)
        return replace(tests, bending=[change(p) if p.direction == 45 else p for p in tests.bending])

    monkeypatch.setattr(style3d, "run_tests", run)


def test_a_rigidity_that_is_not_known_is_refused(monkeypatch, fit):
    bent(monkeypatch, fit, lambda p: replace(p, moment=np.nan, status="stalled"))
    with pytest.raises(InputError, match="bent along 45°"):
        fit_style3d(WOVEN)


def test_a_negative_rigidity_is_said_to_be_lost(monkeypatch, fit):
    bent(monkeypatch, fit, lambda p: replace(p, moment=-2e-6 * p.curvature))
    (lost,) = set(fit_style3d(WOVEN).lost) - set(fit.lost)
    assert lost.startswith("negative rigidity of bending along 45° (-2e-06 N·m)")


def test_numbers_without_equilibrium_are_counted():
    row = Measured("tension", 45.0, "load", 1.0, "N/m", "stretch", 0.1, "-", "converged")
    ones = [Deviation(row, 0.11, 10.0), Deviation(row, 0.13, -30.0), Deviation(row, np.nan, np.nan)]
    (name,) = found = errors_by_test(ones)
    assert name == "tension along 45°, stretch"
    assert str(found[name]) == "20 %, 30 %, 1 of 3 without equilibrium"
    assert str(errors_by_test(ones[:2])[name]) == "20 %, 30 %"
    assert str(errors_by_test(ones[2:])[name]) == "1 of 1 without equilibrium"
    assert not errors_by_test([Deviation(row, 0.0, np.nan)])
