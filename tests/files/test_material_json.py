"""Our material file: lossless, told from HYLC JSON, refused with file and field where broken."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from yarnscale.errors import InputError
from yarnscale.files.material_json import read_material, write_material
from yarnscale.shell.materials.compact import CompactMaterial, SpringNetwork, shapes_of
from yarnscale.shell.materials.friction import Sliders
from yarnscale.shell.materials.orthotropic import OrthotropicMaterial
from yarnscale.shell.materials.stiffening import StiffeningMaterial


def compact_material(steps: int, springs: int, walls: int, *, mirrored: bool = True) -> CompactMaterial:
    """Random numbers of everything."""
    rng = np.random.default_rng(3)
    arrays = SpringNetwork(*(rng.normal(size=tuple(shape)) for shape in shapes_of(steps, springs, walls)))
    positive = {name: np.abs(getattr(arrays, name)) for name in ("stiffnesses", "background", "wall_stiffnesses")}
    scale = np.array([0.5, 0.5, 0.5, 100.0, 100.0, 100.0])
    return CompactMaterial(
        0.1, scale, arrays._replace(**positive), density=0.3, mirrored=mirrored,
        samples=0.3 * scale * rng.normal(size=(5, 6)), spacing=0.2, provenance={"pattern": "stockinette – 1×1"},
    )  # fmt: skip


ORTHOTROPIC = OrthotropicMaterial(
    40.1,
    9.3,
    25.7,
    6.1,
    1.5,
    0.3,
    bend_weft=4e-6,
    bend_bias=3e-6,
    bend_warp=2e-6,
    density=1 / 3,
    provenance={"source": "test"},
)
STIFFENING = StiffeningMaterial(
    *np.linspace(1.0, 14.0, 14).tolist(),
    bend_weft=2e-6,
    bend_bias=1e-6,
    bend_warp=1e-6,
    provenance={"source": "test"},
)


@pytest.mark.parametrize("counts", [(4, 6, 2), (0, 3, 0)])
def test_a_compact_material_comes_back_to_the_last_bit(tmp_path, counts):
    material = compact_material(*counts)
    path = tmp_path / "material.json"
    write_material(path, material)
    back = read_material(path)
    assert isinstance(back, CompactMaterial)
    assert dict(back.provenance) == dict(material.provenance)
    write_material(tmp_path / "again.json", back)
    assert (tmp_path / "again.json").read_text() == path.read_text()
    strains = np.random.default_rng(0).uniform(-0.3, 0.5, (20, 6)) * [1, 1, 1, 200, 200, 200]
    np.testing.assert_array_equal(back.energy_density(strains), material.energy_density(strains))
    np.testing.assert_allclose(back.outside(strains), material.outside(strains), rtol=1e-3, atol=1e-3)


def test_friction_comes_back_and_is_refused_where_it_is_broken(tmp_path):
    sliders = Sliders.checked(np.eye(6)[:2], [[0.5], [-0.1]], [3.0, 1 / 3], [0.0, 0.02], *np.full((2, 2, 6), 0.01))
    material, path = replace(compact_material(1, 1, 0), sliders=sliders), tmp_path / "material.json"
    write_material(path, material)
    back = read_material(path)
    assert isinstance(back, CompactMaterial) and back.sliders is not None
    for ours, theirs in zip(sliders, back.sliders, strict=True):
        np.testing.assert_allclose(theirs, ours, rtol=1e-8)
    write_changed(path, material, lambda c: c["friction"].update(same_sign=[[1.0]]))
    with pytest.raises(InputError, match="same_sign"):
        read_material(path)
    write_changed(path, material, lambda c: c["friction"]["units"].update({"same_sign, other_sign": "m/N"}))
    with pytest.raises(InputError, match="m\\^2/J"):
        read_material(path)


def test_a_spline_of_an_older_version_is_refused_with_what_to_do(tmp_path):
    path = tmp_path / "material.json"
    path.write_text('{"format": "yarnscale-material", "version": 1, "kind": "spline"}')
    with pytest.raises(InputError, match="run yarnscale homogenize again"):
        read_material(path)


def test_an_orthotropic_material_of_an_older_version_is_read(tmp_path):
    path = tmp_path / "fabric.json"
    write_changed(path, ORTHOTROPIC, lambda c: c.update(version=1))
    assert read_material(path) == ORTHOTROPIC


@pytest.mark.parametrize("material", [ORTHOTROPIC, STIFFENING], ids=["orthotropic", "stiffening"])
def test_an_orthotropic_material_comes_back(tmp_path, material):
    path = tmp_path / "fabric.json"
    write_material(path, material)
    back = read_material(path)
    assert back == material
    assert dict(back.provenance) == {"source": "test"}


@pytest.mark.parametrize("material", [compact_material(2, 3, 1), ORTHOTROPIC], ids=["compact", "orthotropic"])
def test_the_file_is_plain_json_with_units(material, tmp_path):
    write_material(tmp_path / "material.json", material)
    content = json.loads((tmp_path / "material.json").read_text())
    assert content["format"] == "yarnscale-material"
    assert content["version"] == 3
    assert content["units"]["density"] == "kg/m^2"


def test_published_files_are_read_too(shared):
    material = read_material(shared / "reference" / "satin1.json")
    energy = float(material.energy_density([0.2, 0.1, -0.05, 15, -8, -20]))
    assert energy == pytest.approx(0.66167915, abs=1e-8)


def test_a_published_material_can_be_copied(shared, tmp_path):
    published = read_material(shared / "reference" / "stock1.json")
    write_material(tmp_path / "copy.json", published)
    copy = read_material(tmp_path / "copy.json")
    strains = np.random.default_rng(1).uniform(-0.5, 0.9, (200, 6)) * [1, 1, 1, 200, 200, 200]
    np.testing.assert_allclose(copy.energy_density(strains), published.energy_density(strains), rtol=1e-12)


def write_changed(path, material, change) -> None:
    write_material(path, material)
    content = json.loads(path.read_text())
    change(content)
    path.write_text(json.dumps(content))


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda c: c.pop("format"), ["format", "yarnscale-material"]),
        (lambda c: c.update(format="other"), ["format", "other"]),
        (lambda c: c.update(version=4), ["version", "found 4"]),
        (lambda c: c.update(kind="magic"), ["kind", "magic"]),
        (lambda c: c.update(kind=[1]), ["kind", "string"]),
        (lambda c: c["units"].update(density="g"), ["units.density", "kg/m^2"]),
        (lambda c: c["units"].pop("scale, samples"), ["units.scale, samples"]),
        (lambda c: c.update(density=-1), ["density", "positive"]),
        (lambda c: c.update(mirrored=3), ["mirrored"]),
        (lambda c: c["scale"].pop(), ["scale", "6 numbers"]),
        (lambda c: c.pop("provenance"), ["provenance"]),
        (lambda c: c["terms"].pop("bends"), ["terms.bends"]),
        (lambda c: c["terms"]["springs"].pop(), ["terms.springs", "3 × 6"]),
        (lambda c: c["terms"]["stiffnesses"].__setitem__(0, -1.0), ["stiffnesses", "negative"]),
        (lambda c: c["trusted"].update(samples=[[1.0]]), ["trusted.samples[0]", "6 numbers"]),
        (lambda c: c["trusted"].update(spacing=0), ["trusted.spacing", "positive"]),
    ],
)
def test_broken_content_names_file_and_field(tmp_path, change, words):
    path = tmp_path / "material.json"
    write_changed(path, compact_material(2, 3, 1), change)
    with pytest.raises(InputError) as caught:
        read_material(path)
    message = str(caught.value)
    assert "\n" not in message
    for word in [str(path), *words]:
        assert word in message


def test_unstable_constants_name_the_file(tmp_path):
    path = tmp_path / "fabric.json"
    write_changed(path, ORTHOTROPIC, lambda c: c["terms"].update(stretch_weft=-1.0))
    with pytest.raises(InputError, match=r"fabric\.json.*stretch_weft"):
        read_material(path)


def test_what_is_no_json_value_is_not_written(tmp_path):
    path = tmp_path / "material.json"
    path.write_text("old")
    for value in (float("nan"), np.zeros(2), object()):
        material = OrthotropicMaterial(1.0, 0.0, 1.0, 1.0, provenance={"value": value})
        with pytest.raises(InputError, match="provenance"):
            write_material(path, material)
    assert path.read_text() == "old"


def test_an_unwritable_target_is_an_input_error(tmp_path):
    with pytest.raises(InputError):
        write_material(tmp_path / "nowhere" / "material.json", ORTHOTROPIC)
