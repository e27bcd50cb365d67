"""Terms of three in-plane strains in material files: nothing is lost, broken content names its field."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from yarnscale.errors import InputError
from yarnscale.files.material_json import material_text, read_material


def test_reading_gives_back_every_bit(tmp_path, inside_material):
    path = tmp_path / "material.json"
    path.write_text(material_text(inside_material))
    again = read_material(path)
    assert material_text(again) == path.read_text()
    np.testing.assert_array_equal(again.inside.nodal, inside_material.inside.nodal)  # type: ignore[union-attr]


def test_a_file_without_coupling_has_none(tmp_path, inside_material):
    content = json.loads(material_text(inside_material))
    del content["terms"]["inside"]["coupling"]
    path = tmp_path / "material.json"
    path.write_text(json.dumps(content))
    strains = np.random.default_rng(1).uniform(-0.5, 0.5, (50, 6)) * [1, 1, 1, 150, 100, 150]
    expected = replace(inside_material, inside=inside_material.inside.without_coupling())
    found = read_material(path)
    np.testing.assert_allclose(found.stress(strains), expected.stress(strains), rtol=1e-12)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda t: t.pop("knots"), ["terms.inside.knots"]),
        (lambda t: t["knots"].pop(), ["terms.inside.knots", "three lists"]),
        (lambda t: t["knots"][1].reverse(), ["terms.inside.knots.a", "increasing"]),
        (lambda t: t["splines"].pop(), ["terms.inside.splines", "5 splines"]),
        (lambda t: t["splines"][2].pop("xay"), ["terms.inside.splines[2].xay"]),
        (lambda t: t["splines"][0]["a"].pop(), ["terms.inside.splines[0].a", "numbers"]),
        (lambda t: t["shapes_y"].pop(), ["terms.inside.shapes_y", "2 splines"]),
        (lambda t: t["shapes_x"][1]["slopes"].pop(), ["terms.inside.shapes_x[1].slopes"]),
        (lambda t: t["coupling"].update(curvature=-1.0), ["terms.inside.coupling.curvature"]),
        (lambda t: t["coupling"]["spline"].pop("xy"), ["terms.inside.coupling.spline.xy"]),
    ],
)
def test_broken_content_names_its_field(tmp_path, inside_material, change, words):
    content = json.loads(material_text(inside_material))
    change(content["terms"]["inside"])
    path = tmp_path / "material.json"
    path.write_text(json.dumps(content))
    with pytest.raises(InputError) as caught:
        read_material(path)
    for word in [path.name, *words]:
        assert word in str(caught.value)
