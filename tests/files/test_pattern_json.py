"""The native pattern format, and reading patterns by name or file."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from yarnscale.drawing.library import build, names
from yarnscale.errors import InputError
from yarnscale.files.pattern_json import FIELDS, read_pattern_json, read_yarns_json, write_pattern_json
from yarnscale.files.patterns import read_pattern, write_pattern
from yarnscale.yarn.material import PRESETS, ContactRule, StretchRule


@pytest.mark.parametrize("name", names())
def test_writing_and_reading_is_the_identity(tmp_path: Path, name: str) -> None:
    pattern = build(name, rest_shape="current")
    write_pattern_json(pattern, tmp_path / "p.json")
    again = read_pattern_json(tmp_path / "p.json")
    assert again.content_hash() == pattern.content_hash()
    assert again.name == name


def test_the_file_is_plain_json_with_the_documented_fields(tmp_path: Path) -> None:
    write_pattern_json(build("plain"), tmp_path / "p.json")
    document = json.loads((tmp_path / "p.json").read_text())
    assert tuple(document) == FIELDS
    assert (document["format"], document["version"]) == ("yarnscale-pattern", 1)
    text = (Path(__file__).parents[2] / "docs" / "reference" / "pattern_format.md").read_text()
    for field in FIELDS:
        assert f"`{field}`" in text


@pytest.mark.parametrize("name", ["wool", "hylc2020-satin"])
def test_yarn_materials_travel_with_the_pattern(tmp_path: Path, name: str) -> None:
    pattern, yarn = build("plain"), PRESETS[name]
    est = replace(yarn, contact=ContactRule("est2022"), stretch=StretchRule("two_phase", 0.02, 1e8))
    for given in (yarn, est):
        write_pattern_json(pattern, tmp_path / "p.json", yarns=given)
        assert read_yarns_json(tmp_path / "p.json") == given
        assert read_pattern(tmp_path / "p.json").content_hash() == pattern.content_hash()
    plated = replace(pattern, yarn_material=np.arange(len(pattern.yarns)) % 2)
    write_pattern_json(plated, tmp_path / "p.json", yarns=(yarn, replace(yarn, young_modulus=1.0)))
    assert read_yarns_json(tmp_path / "p.json") == (yarn, replace(yarn, young_modulus=1.0))
    write_pattern_json(pattern, tmp_path / "p.json")
    assert read_yarns_json(tmp_path / "p.json") is None


def test_broken_yarn_materials_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "p.json"
    write_pattern_json(build("plain"), path, yarns=PRESETS["wool"])
    whole = json.loads(path.read_text())
    for value in ([], {}, [3], [{}], [whole["materials"][0] | {"density": -1}], whole["materials"] * 2):
        path.write_text(json.dumps(whole | {"materials": value}))
        with pytest.raises(InputError) as error:
            read_yarns_json(path)
        assert "p.json" in str(error.value) or "are of 1 materials" in str(error.value)


def put(*place: Any) -> Callable[[dict[str, Any]], None]:
    """A fault: set document[place[0]]…[place[-2]] = place[-1]."""

    def fault(document: dict[str, Any]) -> None:
        target: Any = document
        for key in place[:-2]:
            target = target[key]
        target[place[-2]] = place[-1]

    return fault


@pytest.mark.parametrize(
    ("fault", "message"),
    [
        (put("format", "other"), r":2: field 'format'; expected 'yarnscale-pattern'; found 'other'"),
        (put("version", 2), r":3: field 'version'; expected 1; found 2"),
        (put("version", True), "field 'version'"),
        (put("units", {"length": "mm", "angle": "rad"}), "field 'units'"),
        (put("colour", "red"), r"unknown field 'colour'; expected format, version"),
        (lambda d: d.pop("rest_twist"), "missing field 'rest_twist'"),
        (put("name", 3), ":4: field 'name'; expected a string; found 3"),
        (put("radius", "thin"), r":7: field 'radius'; expected a number; found 'thin'"),
        (put("radius", -1.0), r":7: radius must be positive; expected > 0 m; found -1"),
        (put("radius", 10**400), "field 'radius'; expected a finite number"),
        (put("period", [0.01]), "field 'period'; expected 2 numbers; found 1 numbers"),
        (put("vertices", []), "field 'vertices'"),
        (put("vertices", 3, [0.0, 1.0]), r":8: field 'vertices\[3\]'; expected 3 numbers; found 2"),
        (put("vertices", 3, 1, True), r"field 'vertices\[3\]\[1\]'; expected a number"),
        (put("vertices", 3, 1, None), r"field 'vertices\[3\]\[1\]'; expected a number; found None"),
        (put("twist", 4, "0"), r"field 'twist\[4\]'; expected a number"),
        (put("twist", 5), "field 'twist'; expected 32 numbers; found one number"),
        (put("rest_length", 4, 0), r"rest_length\[4\] must be positive"),
        (put("edges", 4, 1, 5.0), r"field 'edges\[4\]\[1\]'; expected an integer; found 5.0"),
        (put("edges", 4, 1, 1e9), r"field 'edges\[4\]\[1\]'; expected an integer"),
        (put("edges", 4, 1, 2**70), r"field 'edges'; expected small integers"),
        (
            put("edges", 4, 1, 400),
            r"edges\[4\] ends at a vertex that is not there; expected 0 ≤ v1 < 32; found",
        ),
        (put("edges", 4, 0, 5), r"edges\[4\] must start at vertex 4"),
        (put("edges", 4, 1, 4), "vertex 4 must have one incoming edge; expected 1 edge; found 2 edges"),
        (put("reference_director", 2, [0, 0, 0]), r"reference_director\[2\] must be a unit vector"),
    ],
)
def test_faults_are_named(fault: Callable[[dict[str, Any]], None], message: str, tmp_path: Path) -> None:
    path = tmp_path / "p.json"
    write_pattern_json(build("plain"), path)
    document = json.loads(path.read_text())
    fault(document)
    # One field a line, as the writer has the head, so that the lines in the messages can be checked.
    head = [json.dumps({k: v})[1:-1] for k, v in document.items()]
    path.write_text("{\n" + ",\n".join(head) + "\n}\n")
    with pytest.raises(InputError, match=message) as error:
        read_pattern_json(path)
    assert str(error.value).startswith(str(path))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('{"format": "yarnscale-pattern",\n "version": }', ":2: file is not JSON"),
        ("[1, 2]", "file is not an object; expected a JSON object; found list"),
        ('{"radius": 1,\n "twist": NaN}', ":2: number is not finite; expected a finite number; found NaN"),
        ('{"radius": 1, "radius": 2}', "field 'radius' occurs twice"),
        ("[" * 100_000, "file is not JSON"),
        ('{"radius": ' + "9" * 5000 + "}", "file is not JSON"),
        ("", "file is empty"),
    ],
)
def test_texts_that_are_no_pattern(text: str, message: str, tmp_path: Path) -> None:
    path = tmp_path / "p.json"
    path.write_text(text)
    with pytest.raises(InputError, match=message) as error:
        read_pattern_json(path)
    assert "\n" not in str(error.value)


def test_yarns_through_each_other_are_refused(tmp_path: Path) -> None:
    pattern = build("plain")
    low = pattern.vertices.copy()
    low[:, 2] *= 0.01
    tangent = replace(pattern, vertices=low, reference_director=flat_directors(low, pattern))
    write_pattern_json(tangent, tmp_path / "p.json")
    with pytest.raises(InputError, match="yarns run through each other: segment"):
        read_pattern_json(tmp_path / "p.json")


def flat_directors(vertices: np.ndarray, pattern) -> np.ndarray:
    edge = vertices[pattern.next_vertex] - vertices
    edge[:, :2] += pattern.edges[:, 2:] * pattern.period
    director = np.cross(edge, np.cross([0.0, 0.0, 1.0], edge))
    return director / np.linalg.norm(director, axis=1)[:, None]


def test_reading_by_name_suffix_or_content(tmp_path: Path) -> None:
    pattern = build("garter")
    for suffix in (".pyp", ".json"):
        kept = replace(pattern, polyline=suffix == ".pyp")
        write_pattern(pattern, tmp_path / f"p{suffix}")
        assert read_pattern(tmp_path / f"p{suffix}").content_hash() == kept.content_hash()
        (tmp_path / "bare").write_bytes((tmp_path / f"p{suffix}").read_bytes())
        assert read_pattern(tmp_path / "bare").content_hash() == kept.content_hash()
    write_pattern(replace(pattern, polyline=True), tmp_path / "p.json")
    assert read_pattern(tmp_path / "p.json").polyline
    assert read_pattern("garter").content_hash() == pattern.content_hash()


def test_what_is_neither_name_nor_pattern(tmp_path: Path) -> None:
    with pytest.raises(
        InputError,
        match=r"unknown pattern; expected a .pyp, .json, .chart, .wif or .k file or one of stockinette, .*'lace'",
    ):
        read_pattern("lace")
    with pytest.raises(InputError, match="file does not exist"):
        read_pattern(tmp_path / "none.pyp")
    (tmp_path / "text.txt").write_text("hello")
    with pytest.raises(InputError, match=r"file is no pattern; expected \*pattern"):
        read_pattern(tmp_path / "text.txt")
    with pytest.raises(InputError, match=r"unknown pattern format; expected \.pyp, \.json.*; found '\.obj'"):
        write_pattern(build("plain"), tmp_path / "p.obj")
