"""The writer of HYLC JSON: published files come back, energies agree."""

from __future__ import annotations

import json

import numpy as np
import pytest

from yarnscale.files.hylc_json import hylc_content
from yarnscale.files.material_json import read_material, write_material

REACH = np.array([0.7, 0.6, 0.5, 90.0, 110.0])


@pytest.mark.parametrize("name", ["stock1", "satin1"])
def test_published_files_come_back(shared, tmp_path, name):
    source = shared / "reference" / f"{name}.json"
    write_material(tmp_path / "out.json", read_material(source))
    before, after = (json.loads(p.read_text()) for p in (source, tmp_path / "out.json"))
    assert after["density"] == before["density"]
    assert after["strain scale"] == before["strain scale"]
    assert after["strain shift"] == before["strain shift"]
    assert after["coeffs"]["const"] == before["coeffs"]["const"]
    for kind, keys in (("1D", "k t p m"), ("2D", "k0 k1 tu tv p mu mv muv")):
        assert len(after["coeffs"][kind]) == len(before["coeffs"][kind])
        for ours, theirs in zip(after["coeffs"][kind], before["coeffs"][kind], strict=True):
            for key in keys.split():
                np.testing.assert_allclose(ours[key], theirs[key], rtol=1e-14, atol=1e-15)


@pytest.mark.parametrize("reach", [1.0, 1.4])
def test_out_and_in_again_agrees(tmp_path, material, states, reach):
    ours = material
    write_material(tmp_path / "out.json", ours)
    again = read_material(tmp_path / "out.json")
    strains = states(reach)
    for name in ("energy_density", "stress", "moduli"):
        expected = getattr(ours, name)(strains)
        found = getattr(again, name)(strains)
        np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-11 * np.max(np.abs(expected)))
    assert again.density == ours.density


def test_strains_are_normalised_by_the_range(material):
    content = hylc_content(material)
    assert content["strain scale"] == pytest.approx(REACH.tolist())
    assert content["coeffs"]["1D"][4]["t"] == pytest.approx([*np.linspace(-1, 1, 11)])  # type: ignore[index]
