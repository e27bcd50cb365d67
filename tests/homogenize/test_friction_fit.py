"""Sliders of a shell material from paths of its cell: known ones are found again, and a cell gives its paths."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest

import yarnscale as ys
from yarnscale.errors import InputError
from yarnscale.homogeneous.loads import FLAT, Loads
from yarnscale.homogenize import friction_fit, friction_paths
from yarnscale.homogenize.friction_paths import FrictionPath
from yarnscale.shell.materials.compact import CompactMaterial, SpringNetwork, shapes_of
from yarnscale.shell.materials.friction import Sliders
from yarnscale.shell.materials.history import MaterialHistory
from yarnscale.yarn.friction import YarnFriction

SCALE = np.array([0.5, 0.5, 0.5, 100.0, 100.0, 100.0])


def material(sliders: Sliders | None = None) -> CompactMaterial:
    none = SpringNetwork(*(np.zeros(tuple(shape)) for shape in shapes_of(1, 1, 1)))
    springs = none._replace(background=np.array([8.0, 3.0, 4.0, 1.0, 1.0, 1.0]))
    return CompactMaterial(0.0, SCALE, springs, density=0.2, sliders=sliders)


def test_known_sliders_are_found_again(monkeypatch) -> None:
    monkeypatch.setattr(friction_fit, "COUNT", 3)
    random = np.random.default_rng(2)
    directions = random.normal(size=(2, 6))
    directions[:, 1] = directions[:, 4] = 0.0  # their own mirror images
    growth = random.uniform(0, 0.02, (2, 2, 6))
    known = Sliders.checked(directions, [[0.0]] * 2, [20.0, 8.0], [0.02, 0.0], *growth)
    paths = []
    for number in range(4):
        corners = np.concatenate([np.zeros((1, 6)), 0.4 * random.uniform(-1, 1, (4, 6))]) * SCALE
        strains = np.concatenate([np.linspace(a, b, 20, endpoint=False) for a, b in itertools.pairwise(corners)])
        history = MaterialHistory.begin(material(known), strains[0])
        stresses = [history.force]
        for strain in strains[1:]:
            history = history.after(strain)
            stresses.append(history.force)
        elastic = material().stress(strains)
        paths.append(FrictionPath(f"path {number}", strains, np.array(stresses), elastic, complete=True))
    paths.insert(0, FrictionPath.none("not begun"))
    fitted = friction_fit.with_friction(material(), paths, 0.3)
    record = fitted.provenance["friction"]
    assert isinstance(record, dict) and record["coefficient"] == 0.3
    assert record["error"] < 0.1 and set(record["errors"]) == {path.name for path in paths[1:]}
    assert record["unfinished"] == ["not begun"]
    assert fitted.sliders is not None and (fitted.sliders.stiffnesses >= 0).all()
    with pytest.raises(InputError, match="paths with friction"):
        friction_fit.with_friction(material(), [], 0.3)


def test_the_fit_sees_the_stress_that_the_material_has() -> None:
    fabric, random = material(), np.random.default_rng(5)
    steps = {"steps": random.normal(size=(1, 6)), "step_offsets": np.array([0.3])}
    fabric = replace(fabric, springs=fabric.springs._replace(**steps))
    strains = np.cumsum(0.04 * random.normal(size=(60, 6)), axis=0) * SCALE
    unknowns = random.normal(size=(3, 20)) * [*[1.0] * 7, *[0.2] * 13]
    trace = friction_fit._trace(fabric, FrictionPath("random", strains, *np.zeros((2, 60, 6)), complete=True))
    history = MaterialHistory.begin(replace(fabric, sliders=friction_fit.sliders_of(unknowns)), strains[0])
    for strain, expected in zip(strains[1:], friction_fit.friction_of(trace, unknowns)[0][1:], strict=True):
        history = history.after(strain)
        found = (history.force - fabric.stress(strain)) * SCALE
        np.testing.assert_allclose(found, expected, atol=1e-6)


def test_a_path_without_friction_has_sliders_that_hold_nothing(monkeypatch) -> None:
    monkeypatch.setattr(friction_fit, "COUNT", 1)
    strains = 0.1 * np.random.default_rng(0).uniform(-1, 1, (40, 6)) * SCALE
    stress = material().stress(strains)
    fitted = friction_fit.with_friction(material(), [FrictionPath("loose", strains, stress, stress, True)], 0.3)
    assert fitted.sliders is not None
    history = MaterialHistory.begin(fitted, strains[0]).after(strains[1])
    np.testing.assert_allclose(history.force * SCALE, stress[1] * SCALE, atol=1e-3)


@pytest.mark.slow
def test_a_cell_goes_through_cycles_of_loads_and_paths_are_kept(monkeypatch, tmp_path) -> None:
    programme, some = friction_paths._programme, ("tension 0", "tension 45")
    monkeypatch.setattr(friction_paths, "STEPS", 1)
    monkeypatch.setattr(friction_paths, "_programme", lambda *of: [p for p in programme(*of) if p[0] in some])
    cell = ys.PeriodicCell(ys.patterns.build("plain"), ys.YarnMaterial.preset("hylc2020-basket"))
    walked: list[str] = []

    def at_once(work, cell, **_) -> None:
        for unit in work.pending():
            task, arguments = work.task(unit)
            walked.append(arguments[1])
            work.keep(unit, task(cell, *arguments)[0])

    monkeypatch.setattr(friction_paths, "work_off", at_once)

    def paths(mu: float) -> list[FrictionPath]:
        return friction_paths.friction_paths(cell, YarnFriction(mu), limit=1.0, folder=tmp_path)

    found = paths(0.2)
    names = [path.name for path in found]
    assert sorted(walked) == sorted(names) == sorted(some)
    pulled = found[names.index("tension 0")]
    assert pulled.complete and len(pulled.strains) == 11
    assert pulled.strains.shape == pulled.stresses.shape == pulled.elastic.shape
    friction = pulled.stresses - pulled.elastic
    assert np.abs(friction[1:]).max() > 0.0 and np.abs(friction[0]).max() == 0.0
    assert (friction[1::2, 0] > friction[2::2, 0]).all()  # more on pulling than on letting go
    walked.clear()
    (tmp_path / "tension-45.npz").write_bytes(b"half a file")
    again = paths(0.2)
    assert walked == ["tension 45"]
    for one, other in zip(found, again, strict=True):
        np.testing.assert_array_equal(one.stresses, other.stresses)
    paths(0.3)
    assert walked == ["tension 45", *names]


def test_a_kept_path_that_the_material_could_not_begin_is_not_complete(tmp_path) -> None:
    def units() -> friction_paths._PathUnits:
        return friction_paths._PathUnits(tmp_path, {"none": [(Loads(), FLAT)]}, YarnFriction(0.2))

    units().keep(0, FrictionPath.none("none"))
    assert not units().pending() and units().converged == 0


def test_a_cell_without_a_first_step_is_refused_before_anything_long() -> None:
    cell = ys.PeriodicCell(ys.patterns.build("plain"), ys.YarnMaterial.preset("hylc2020-basket"))
    with pytest.raises(InputError, match="paths with friction"):
        friction_paths.check_friction(cell.with_options(max_iterations=1), YarnFriction(0.2))
