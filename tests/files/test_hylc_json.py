"""The reader of published HYLC materials: check values, every kind of broken file."""

from __future__ import annotations

import copy
import json

import numpy as np
import pytest

from yarnscale.errors import InputError
from yarnscale.files.material_json import read_material
from yarnscale.shell.materials.spline_patches import PLANES

CHECK_STATE = np.array([0.2, 0.1, -0.05, 15.0, -8.0, -20.0])


def content() -> dict:
    """A small valid material: quadratic in everything, two planes with slopes."""
    t = [-1.0, 0.0, 0.5]
    one = [{"k": k, "t": t, "p": [x * x for x in t], "m": [2 * x for x in t]} for k in range(5)]
    flat = {"tu": t, "tv": [0.0, 1.0], "p": [0.0] * 6, "mu": [0.0] * 6, "mv": [0.0] * 6}
    two = [{"k0": i, "k1": j, **copy.deepcopy(flat)} for i, j in PLANES]
    two[0]["p"] = [0.0, 0.0, 0.0, -1.0, 0.0, 0.5]  # u v, flat [iv * 3 + iu]
    two[0]["mu"] = [0.0, 0.0, 0.0, 1.0, 1.0, 1.0]
    two[0]["mv"] = [-1.0, 0.0, 0.5] * 2
    two[0]["muv"] = [1.0] * 6
    return {
        "density": 0.3,
        "strain scale": [0.8, 0.5, 0.8, 200.0, 100.0],
        "strain shift": [1, 0, 1, 0, 0],
        "coeffs": {"const": 0.05, "1D": one, "2D": two},
    }


def written(folder, text: str | bytes):
    path = folder / "material.json"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


@pytest.mark.parametrize(("name", "value"), [("stock1", 1.17430886), ("satin1", 0.66167915)])
def test_published_materials_give_the_check_values(shared, name, value):
    material = read_material(shared / "reference" / f"{name}.json")
    assert float(material.energy_density(CHECK_STATE)) == pytest.approx(value, abs=1e-8)


def test_published_terms_are_kept_although_not_zero_at_zero(shared):
    material = read_material(shared / "reference" / "stock1.json")
    rest = material.constant + sum(float(f(0.0)) for f in material.axes)
    rest += sum(float(f(0.0, 0.0)) for f in material.planes.values())
    assert float(material.energy_density(np.zeros(6))) == pytest.approx(rest, rel=1e-12)
    assert material.constant == pytest.approx(0.0552671, abs=1e-7)
    assert material.density == pytest.approx(0.33182390968)


def test_published_stress_is_the_derivative(shared):
    material = read_material(shared / "reference" / "satin1.json")
    step = np.array([1e-6] * 3 + [1e-4] * 3)
    pairs = CHECK_STATE + np.concatenate([np.diag(step), -np.diag(step)])
    energy = material.energy_density(pairs)
    expected = (energy[:6] - energy[6:]) / (2 * step)
    np.testing.assert_allclose(material.stress(CHECK_STATE), expected, rtol=1e-6)


def test_strains_are_normalised_and_planes_are_laid_out_by_v(tmp_path):
    material = read_material(written(tmp_path, json.dumps(content())))
    x = np.array([0.2 / 0.8, 0.1 / 0.5, 0.1 / 0.8, 30 / 200, 0.0])
    expected = 0.05 + np.sum(x**2) + x[0] * x[1]
    assert float(material.energy_density([0.2, 0.1, 0.1, 30.0, 0.0, 0.0])) == pytest.approx(expected)


def test_mixed_slopes_default_to_zero(tmp_path):
    broken = content()
    del broken["coeffs"]["2D"][0]["muv"]
    material = read_material(written(tmp_path, json.dumps(broken)))
    assert not material.planes[0, 1].twists.any()


def remove(*path):
    def change(document):
        for key in path[:-1]:
            document = document[key]
        del document[path[-1]]

    return change


def put(value, *path):
    def change(document):
        for key in path[:-1]:
            document = document[key]
        document[path[-1]] = value

    return change


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (remove("density"), ["density"]),
        (remove("coeffs"), ["coeffs"]),
        (remove("coeffs", "const"), ["coeffs.const"]),
        (remove("coeffs", "1D", 3), ["k = 3", "lambda_x"]),
        (remove("coeffs", "1D", 2, "m"), ["coeffs.1D[2].m"]),
        (put([0.0, 1.0], "coeffs", "1D", 2, "p"), ["coeffs.1D[2].p", "3 numbers", "2 numbers"]),
        (put([0.0, 0.0, 1.0], "coeffs", "1D", 1, "t"), ["coeffs.1D[1].t", "increasing"]),
        (put(["a", 0.0, 1.0], "coeffs", "1D", 1, "p"), ["coeffs.1D[1].p[0]", "a number"]),
        (put(1, "coeffs", "1D", 0, "k"), ["coeffs.1D[1].k"]),
        (put(True, "coeffs", "1D", 0, "k"), ["coeffs.1D[0].k", "integer"]),
        (put({}, "coeffs", "1D"), ["coeffs.1D", "list"]),
        (put([0.0] * 5, "coeffs", "2D", 4, "mv"), ["coeffs.2D[4].mv", "6 numbers"]),
        (put(4, "coeffs", "2D", 3, "k0"), ["coeffs.2D[3].k0"]),
        (put(0.0, "density"), ["density", "positive"]),
        (put(10**400, "density"), ["density"]),
        (put([1.0, 1.0, 0.0, 1.0, 1.0], "strain scale"), ["strain scale", "positive"]),
        (put([1.0] * 4, "strain scale"), ["strain scale", "5 numbers"]),
    ],
)
def test_broken_content_names_file_and_field(tmp_path, change, words):
    document = content()
    change(document)
    path = written(tmp_path, json.dumps(document))
    with pytest.raises(InputError) as caught:
        read_material(path)
    message = str(caught.value)
    assert "\n" not in message
    for word in [path.name, *words]:
        assert word in message


@pytest.mark.parametrize(
    ("text", "word"),
    [
        (b"", "empty"),
        (b"\x00\x01\xfe\xff", "text"),
        (b"\xff\xfe{}", "UTF-8"),
        (b"{\n'density': 1}", ":2"),
        (b"[1, 2]", "object"),
        (b'{"density": NaN}', "NaN"),
        (b"[" * 200_000, "JSON"),
        (json.dumps(content()).encode()[:-40], "JSON"),
    ],
)
def test_broken_files_are_refused_in_one_line(tmp_path, text, word):
    path = written(tmp_path, text)
    with pytest.raises(InputError) as caught:
        read_material(path)
    assert word in str(caught.value)
    assert path.name in str(caught.value)


def test_a_missing_file_is_an_input_error(tmp_path):
    with pytest.raises(InputError, match=r"nowhere\.json"):
        read_material(tmp_path / "nowhere.json")
