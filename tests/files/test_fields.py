"""Faults of TOML files name the line of their field, and numbers of any size are answered in one line."""

from __future__ import annotations

from pathlib import Path

import pytest

from yarnscale.errors import InputError
from yarnscale.files.fields import toml_file
from yarnscale.files.grid_toml import read_grid
from yarnscale.files.material_json import write_material
from yarnscale.files.material_toml import read_yarn_material
from yarnscale.files.scene_toml import read_scene
from yarnscale.shell.materials.orthotropic import OrthotropicMaterial

YARN = """young_modulus = 1e6
shear_modulus = 4e5
bending_scale = 0.01
contact_stiffness = 60
density = 120
[contact]
outer_radius_ratio = 1.0
inner_stiffness = 1e3
[stretch]
knee = 0.1
"""
SCENE = """material = "cloth.json"
damping = 1.0
[mesh]
width = 0.1
height = 0.1
spacing = 0.05
[schedule]
duration = 0.1
time_step = 0.02
[contact]
thickness = 0.002
[[obstacles]]
shape = "sphere"
centre = [0, 0, -1]
radius = 0.1
[[obstacles]]
shape = "sphere"
centre = [0, 0, -2]
radius = 0.2
"""
WRONG = ["1e-300", "1e300", "nan", "inf", "-1.0", "1" + "0" * 400, "'1'"]


def lines_with(text: str, keys: tuple[str, ...]) -> list[int]:
    return [n for n, line in enumerate(text.splitlines()) if line.startswith(keys)]


def changed(text: str, line: int, value: str) -> str:
    lines = text.splitlines()
    lines[line] = f"{lines[line].split('=')[0]}= {value}"
    return "\n".join(lines) + "\n"


def fault(path: Path, text: str, read) -> str:
    path.write_text(text, encoding="utf-8")
    with pytest.raises(InputError) as caught:
        read(path)
    assert "\n" not in str(caught.value) and len(str(caught.value)) < 400
    return str(caught.value)


@pytest.mark.parametrize("value", WRONG)
@pytest.mark.parametrize("line", lines_with(YARN, ("young", "shear", "bend", "cont", "dens", "outer", "inner", "knee")))
def test_yarn_materials(tmp_path: Path, line: int, value: str) -> None:
    path = tmp_path / "yarn.toml"
    assert fault(path, changed(YARN, line, value), read_yarn_material).startswith(f"{path}:{line + 1}: ")


@pytest.mark.parametrize("value", [*WRONG, "0.0"])
@pytest.mark.parametrize(
    "line", lines_with(SCENE, ("width", "height", "spacing", "duration", "time_step", "thickness", "radius"))
)
def test_scenes(tmp_path: Path, line: int, value: str) -> None:
    write_material(tmp_path / "cloth.json", OrthotropicMaterial(10.0, 1.0, 10.0, 1.0, bend_weft=1e-5, bend_warp=1e-5))
    path = tmp_path / "scene.toml"
    path.write_text(SCENE, encoding="utf-8")
    read_scene(path)
    if SCENE.splitlines()[line].startswith("duration") and value == "0.0":
        return
    assert fault(path, changed(SCENE, line, value), read_scene).startswith(f"{path}:{line + 1}: ")


def test_grids(tmp_path: Path) -> None:
    path = tmp_path / "grid.toml"
    for value in ("1e300", "nan", "-7.0", "'x'"):
        assert fault(path, f"s_a = [0.0]\ns_x = [0.0, {value}]\n", read_grid).startswith(f"{path}:")


def test_names_are_found_in_their_table(tmp_path: Path) -> None:
    path = tmp_path / "f.toml"
    path.write_text("a = 1\n[t]\na = 2\n[[u]]\nb = 1\n[[u]]\n'b' = 2\nc.d = 3\n")
    for what, line in (
        ("a is wrong", 1),
        ("[t] a", 3),
        ("field 'u[1].b'", 7),
        ("[u[1]] c.d", 8),
        ("[t] gone", 2),
    ):
        with pytest.raises(InputError, match=rf"f\.toml:{line}: "), toml_file(path):
            raise InputError(what, where=path)
    with pytest.raises(InputError, match=r"^other:9: "), toml_file(path):
        raise InputError("a", where="other:9")
