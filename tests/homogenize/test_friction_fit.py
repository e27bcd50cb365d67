"""Sliders of a shell material from paths of its cell: known ones are found again, and a cell gives its paths."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

import yarnscale as ys
from yarnscale.errors import InputError
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
    known = Sliders.checked(directions, [20.0, 8.0], random.uniform(0, 0.02, (2, 6)))
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
    paths.insert(0, FrictionPath("not begun", *np.zeros((3, 0, 6)), complete=False))
    fitted = friction_fit.with_friction(material(), paths, 0.3)
    record = fitted.provenance["friction"]
    assert isinstance(record, dict) and record["coefficient"] == 0.3
    assert record["error"] < 0.1 and set(record["errors"]) == {path.name for path in paths[1:]}
    assert record["unfinished"] == ["not begun"]
    assert fitted.sliders is not None and (fitted.sliders.stiffnesses >= 0).all()
    with pytest.raises(InputError, match="paths with friction"):
        friction_fit.with_friction(material(), [], 0.3)


def test_a_path_without_friction_has_sliders_that_hold_nothing(monkeypatch) -> None:
    monkeypatch.setattr(friction_fit, "COUNT", 1)
    strains = 0.1 * np.random.default_rng(0).uniform(-1, 1, (40, 6)) * SCALE
    stress = material().stress(strains)
    fitted = friction_fit.with_friction(material(), [FrictionPath("loose", strains, stress, stress, True)], 0.3)
    assert fitted.sliders is not None
    history = MaterialHistory.begin(fitted, strains[0]).after(strains[1])
    np.testing.assert_allclose(history.force * SCALE, stress[1] * SCALE, atol=1e-3)


def test_a_cell_follows_cycles_of_its_material(monkeypatch) -> None:
    monkeypatch.setattr(friction_paths, "STEPS", 1)
    cell = ys.PeriodicCell(ys.patterns.build("plain"), ys.YarnMaterial.preset("hylc2020-basket"))
    done: list[tuple[int, int]] = []
    paths = friction_paths.friction_paths(
        cell, material(), YarnFriction(0.2), limit=1.0, progress=lambda *parts: done.append(parts)
    )
    assert done[-1] == (len(paths), len(paths))
    names = [path.name for path in paths]
    assert "tension 45" in names and "bending 0 under tension" in names and "biaxial" in names
    pulled = paths[names.index("tension 0")]
    assert pulled.complete and len(pulled.strains) == 7
    assert pulled.strains.shape == pulled.stresses.shape == pulled.elastic.shape
    friction = pulled.stresses - pulled.elastic
    assert np.abs(friction[1:]).max() > 0.0 and np.abs(friction[0]).max() == 0.0
    assert (friction[1::2, 0] > friction[2::2, 0]).all()  # more on pulling than on letting go
