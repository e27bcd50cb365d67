"""Our material file: lossless, told from HYLC JSON, refused with file and field where broken."""

from __future__ import annotations

import json

import numpy as np
import pytest

from yarnscale.errors import InputError
from yarnscale.files.material_json import material_text, read_material, write_material
from yarnscale.shell.materials.orthotropic import OrthotropicMaterial
from yarnscale.shell.materials.spline_material import SplineMaterial
from yarnscale.shell.materials.spline_patches import PLANES
from yarnscale.shell.materials.tables import BicubicSpline, CubicSpline, Tail

REACH = np.array([0.8, 0.7, 0.8, 100.0, 90.0])


def spline_material() -> SplineMaterial:
    rng = np.random.default_rng(5)
    tails = [Tail.GROWING, Tail.LINEAR, Tail.GROWING, Tail.GROWING, Tail.LINEAR]
    axes = []
    for axis, tail in enumerate(tails):
        knots = np.sort(rng.uniform(-1, 1, 4 + axis)) * REACH[axis]
        axes.append(CubicSpline(knots, *rng.normal(size=(2, 4 + axis)), tail))
    planes = {}
    for i, j in PLANES[1:]:
        u, v = np.sort(rng.normal(size=3)) * REACH[i], np.sort(rng.normal(size=4)) * REACH[j]
        planes[i, j] = BicubicSpline(u, v, *rng.normal(size=(4, 3, 4)))
    box = np.stack([-REACH / 3, REACH / 7], axis=1)
    provenance = {"pattern": "stockinette – 1×1", "solves": 812, "notes": [1.5, None, {"a": "b"}]}
    return SplineMaterial(np.pi, tuple(axes), planes, 0.1 + 0.2, range=box, provenance=provenance)


ORTHOTROPIC = OrthotropicMaterial(
    40.1, 9.3, 25.7, 6.1, 1.5, 0.3, 4e-6, 3e-6, 2e-6, density=1 / 3, provenance={"source": "test"}
)


def test_a_spline_material_comes_back_to_the_last_bit(tmp_path):
    material = spline_material()
    path = tmp_path / "material.json"
    write_material(path, material)
    back = read_material(path)
    assert isinstance(back, SplineMaterial)
    assert (back.constant, back.density) == (material.constant, material.density)
    np.testing.assert_array_equal(back.range, material.range)
    assert dict(back.provenance) == dict(material.provenance)
    assert list(back.planes) == list(material.planes)
    for one, two in zip(back.axes, material.axes, strict=True):
        assert one.tail == two.tail
        for name in ("knots", "values", "slopes"):
            np.testing.assert_array_equal(getattr(one, name), getattr(two, name))
    for pair, plane in material.planes.items():
        for name in ("knots_u", "knots_v", "values", "slopes_u", "slopes_v", "twists"):
            np.testing.assert_array_equal(getattr(back.planes[pair], name), getattr(plane, name))
    assert material_text(back) == material_text(material)
    strains = np.random.default_rng(0).uniform(-0.3, 0.5, (20, 6)) * [1, 1, 1, 200, 200, 200]
    np.testing.assert_array_equal(back.energy_density(strains), material.energy_density(strains))


def test_an_orthotropic_material_comes_back(tmp_path):
    path = tmp_path / "fabric.json"
    write_material(path, ORTHOTROPIC)
    back = read_material(path)
    assert back == ORTHOTROPIC
    assert dict(back.provenance) == {"source": "test"}


@pytest.mark.parametrize("material", [spline_material(), ORTHOTROPIC], ids=["spline", "orthotropic"])
def test_the_file_is_plain_json_with_units(material):
    content = json.loads(material_text(material))
    assert content["format"] == "yarnscale-material"
    assert content["version"] == 1
    assert content["units"]["density"] == "kg/m^2"


def test_published_files_are_read_too(shared):
    material = read_material(shared / "reference" / "satin1.json")
    energy = float(material.energy_density([0.2, 0.1, -0.05, 15, -8, -20]))
    assert energy == pytest.approx(0.66167915, abs=1e-8)


def test_a_published_material_can_be_kept_in_our_format(shared, tmp_path):
    published = read_material(shared / "reference" / "stock1.json")
    write_material(tmp_path / "copy.json", published)
    copy = read_material(tmp_path / "copy.json")
    strains = np.random.default_rng(1).uniform(-0.5, 0.9, (200, 6)) * [1, 1, 1, 200, 200, 200]
    np.testing.assert_array_equal(copy.energy_density(strains), published.energy_density(strains))


def changed(material, change) -> str:
    content = json.loads(material_text(material))
    change(content)
    return json.dumps(content)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda c: c.pop("format"), ["format", "yarnscale-material"]),
        (lambda c: c.update(format="other"), ["format", "other"]),
        (lambda c: c.update(version=2), ["version", "found 2"]),
        (lambda c: c.update(kind="magic"), ["kind", "magic"]),
        (lambda c: c.update(kind=[1]), ["kind", "string"]),
        (lambda c: c["units"].update(lambda_x="1/cm"), ["units.lambda_x", "1/m"]),
        (lambda c: c["units"].pop("s_x"), ["units.s_x"]),
        (lambda c: c.update(density=-1), ["density", "positive"]),
        (lambda c: c["range"].update(s_a=[0.5, -0.5]), ["range"]),
        (lambda c: c["range"].update(s_a=[0.5]), ["range.s_a", "2 numbers"]),
        (lambda c: c.pop("provenance"), ["provenance"]),
        (lambda c: c["terms"]["axes"].pop(3), ["terms.axes", "lambda_x"]),
        (lambda c: c["terms"]["axes"][0].update(tail="up"), ["terms.axes[0].tail", "growing"]),
        (lambda c: c["terms"]["axes"][1].update(strain="s_x"), ["terms.axes[1].strain"]),
        (lambda c: c["terms"]["axes"][1]["knots"].reverse(), ["terms.axes[1].knots", "increasing"]),
        (lambda c: c["terms"]["planes"][2].update(strains=["lambda_x", "s_a"]), ["planes[2].strains"]),
        (lambda c: c["terms"]["planes"][2].update(strains=3), ["planes[2].strains"]),
        (lambda c: c["terms"]["planes"][2]["twists"].pop(), ["planes[2].twists", "3 × 4"]),
        (lambda c: c["terms"]["planes"][2]["values"][1].pop(), ["planes[2].values"]),
        (lambda c: c["terms"]["planes"][0]["knots"].pop(), ["planes[0].knots"]),
        (lambda c: c["terms"]["planes"][0].pop("values"), ["planes[0].values"]),
    ],
)
def test_broken_content_names_file_and_field(tmp_path, change, words):
    path = tmp_path / "material.json"
    path.write_text(changed(spline_material(), change))
    with pytest.raises(InputError) as caught:
        read_material(path)
    message = str(caught.value)
    assert "\n" not in message
    for word in [str(path), *words]:
        assert word in message


def test_unstable_constants_name_the_file(tmp_path):
    path = tmp_path / "fabric.json"
    path.write_text(changed(ORTHOTROPIC, lambda c: c["terms"].update(stretch_weft=-1.0)))
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
