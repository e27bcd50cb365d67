"""Yarn materials as TOML files."""

from __future__ import annotations

import tomllib
from dataclasses import fields, replace
from pathlib import Path

import pytest

from yarnscale.errors import InputError
from yarnscale.files.material_toml import read_yarn_material, write_yarn_material
from yarnscale.yarn.material import NUMBERS, PRESETS, STRETCH_FIELDS, ContactRule, StretchRule

GOOD = """
young_modulus = 5e5
shear_modulus = 200000
bending_scale = 0.001
contact_stiffness = 60
density = 120.0
"""


@pytest.mark.parametrize("name", PRESETS)
def test_writing_and_reading_is_the_identity(tmp_path: Path, name: str) -> None:
    material = replace(PRESETS[name], name=f'{name} "α" \\ \n')
    write_yarn_material(material, tmp_path / "m.toml")
    assert read_yarn_material(tmp_path / "m.toml") == material


def test_two_phase_stretch_is_written_and_read(tmp_path: Path) -> None:
    rule = StretchRule("two_phase", knee=0.07, stiff_modulus=3e7)
    material = replace(PRESETS["wool"], stretch=rule)
    write_yarn_material(material, tmp_path / "m.toml")
    assert read_yarn_material(tmp_path / "m.toml").stretch == rule


def test_friction_is_written_and_read(tmp_path: Path) -> None:
    material = replace(PRESETS["wool"], contact=replace(PRESETS["wool"].contact, friction=0.25))
    write_yarn_material(material, tmp_path / "m.toml")
    assert read_yarn_material(tmp_path / "m.toml") == material


def test_presets_are_found_by_name() -> None:
    assert read_yarn_material("hylc2020-rib") is PRESETS["hylc2020-rib"]


def test_defaults_are_the_published_rule(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    path.write_text(GOOD)
    material = read_yarn_material(path)
    assert material.name == "mine"
    assert material.contact == ContactRule()
    assert material == replace(PRESETS["hylc2020-stockinette"], name="mine")


def test_the_example_in_the_documentation_reads(tmp_path: Path) -> None:
    text = (Path(__file__).parents[2] / "docs" / "reference" / "yarn_material_format.md").read_text()
    example = text.split("```toml\n")[1].split("```")[0]
    (tmp_path / "m.toml").write_text(example)
    assert read_yarn_material(tmp_path / "m.toml") == replace(PRESETS["wool"], name="soft wool")
    rules = [f"contact.{entry.name}" for entry in fields(ContactRule)]
    rules += [f"stretch.{name}" for name in STRETCH_FIELDS]
    for field in (*NUMBERS, "name", *rules):
        assert f"`{field}`" in text
    assert tomllib.loads(example)["contact"]["points"] == 5


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (GOOD.replace("5e5", "-5e5"), "young_modulus must be positive; expected > 0; found -500000.0"),
        (GOOD.replace("5e5", "nan"), "young_modulus must be positive"),
        (GOOD.replace("5e5", "'stiff'"), "young_modulus must be a number; expected a number; found 'stiff'"),
        (GOOD.replace("5e5", "true"), "young_modulus must be a number"),
        (GOOD.replace("density = 120.0", ""), "missing field 'density'"),
        (GOOD + "colour = 3", "unknown field 'colour'; expected young_modulus"),
        (GOOD + "contact = 3", r"field 'contact'; expected a table of fields; found 3"),
        (GOOD + "[contact]\nkernal = 'x'", "unknown field 'contact.kernal'; expected kernel, points"),
        (GOOD + "stretch = 3", r"field 'stretch'; expected a table of fields; found 3"),
        (GOOD + "[stretch]\nknees = 1", "unknown field 'stretch.knees'; expected law, knee, stiff_modulus"),
        (GOOD + "[stretch]\nlaw = 'two_phase'", "stretch.stiff_modulus must be positive; expected > 0"),
        (GOOD + "[contact]\npoints = 4", "contact.points must be odd"),
        (GOOD + "[contact]\nfriction = -0.1", "contact.friction must be zero or more; expected ≥ 0; found -0.1"),
        (GOOD + "[contact]\nkernel = 3", "contact.kernel is unknown"),
        (GOOD + "[contact]\nkernel = ['a']", "contact.kernel is unknown"),
        (GOOD + "name = 7", "name must be text"),
        (GOOD + "density = 3", r":7: file is not TOML; found Cannot overwrite a value"),
        ("young_modulus = ", r":1: file is not TOML"),
        ("a = " + "[" * 5000, "file is not TOML"),
        ("", "file is empty"),
    ],
)
def test_faults_are_named(text: str, message: str, tmp_path: Path) -> None:
    path = tmp_path / "m.toml"
    path.write_text(text)
    with pytest.raises(InputError, match=message) as error:
        read_yarn_material(path)
    assert str(error.value).startswith(str(path))
    assert "\n" not in str(error.value)


def test_unknown_names_and_missing_files(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"unknown material; expected a TOML file or one of hylc2020-.*; found 'silk'"):
        read_yarn_material("silk")
    with pytest.raises(InputError, match="file does not exist"):
        read_yarn_material(tmp_path / "none.toml")
