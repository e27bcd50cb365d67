"""Scenes of cloth as TOML files; the format is described in docs/scene_format.md."""

from __future__ import annotations

import math
import os
import re
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

import numpy as np

from yarnscale.errors import InputError
from yarnscale.files.json_fields import Fields
from yarnscale.files.material_json import read_material
from yarnscale.files.obj_surface import read_obj_surface
from yarnscale.files.source_text import read_source
from yarnscale.shell.cloth import Cloth, Handle, Motion
from yarnscale.shell.contact import ContactSettings
from yarnscale.shell.mesh import TriangleMesh, disk, rectangle
from yarnscale.shell.obstacles import MeshObstacle, Obstacle, Plane, Sphere
from yarnscale.shell.scene import Scene
from yarnscale.shell.simulate import Schedule, SolverOptions
from yarnscale.shell.state import ClothState

Built = TypeVar("Built")
Vector = tuple[float, float, float]


class _Section(Fields):
    """A table of the file; keys have defaults, and unknown keys are refused by ``known``."""

    def known(self, *names: str) -> _Section:
        for key in self.content:
            if key not in names:
                raise InputError(
                    f"unknown key '{self.label(str(key))}'", where=self.path, expected=", ".join(names)
                )
        return self

    def section(self, key: str) -> _Section:
        return _Section(self.content.get(key, {}), self.path, self.label(key))

    def sections(self, key: str) -> list[_Section]:
        if key not in self.content:
            return []
        return [_Section(item.content, item.path, item.name) for item in self.items(key)]

    def number_or(self, key: str, default: float) -> float:
        return self.number(key) if key in self.content else default

    def vector_or(self, key: str, default: Vector) -> Vector:
        return self.vector(key) if key in self.content else default

    def vector(self, key: str) -> Vector:
        x, y, z = self.numbers(key, shape=(3,))
        return float(x), float(y), float(z)

    def flag_or(self, key: str, default: bool) -> bool:
        value = self.content.get(key, default)
        if not isinstance(value, bool):
            raise self.fault(key, expected="true or false", found=repr(value)[:60])
        return value

    def choice_or(self, key: str, default: str, choices: tuple[str, ...]) -> str:
        value = self.text(key) if key in self.content else default
        if value not in choices:
            raise self.fault(key, expected=" or ".join(choices), found=repr(value)[:60])
        return value

    def build(self, make: Callable[[], Built]) -> Built:
        """What ``make`` returns; an InputError of it is told with file and section."""
        try:
            return make()
        except InputError as error:
            what = f"[{self.name}] {error.what}" if self.name else error.what
            where = error.where if error.where is not None else self.path
            raise InputError(what, where=where, expected=error.expected, found=error.found) from None


def read_scene(path: str | os.PathLike[str]) -> Scene:
    """The scene of a TOML file; files it names are looked for beside it.

    Raises InputError with file, field, expected and found for anything that is missing, unknown or of a wrong type.
    """
    path = Path(path)
    root = _Section(_parse(path), path)
    root.known("name", "material", "gravity", "damping", "free_edges", "mesh", "schedule", "handles", "contact",
               "obstacles")  # fmt: skip
    material = read_material(path.parent / root.text("material"))
    section = root.section("mesh")
    mesh = _mesh(section)
    start = _start(section, mesh)
    obstacles = tuple(_obstacle(item) for item in root.sections("obstacles"))
    contact = _contact(root.section("contact")) if "contact" in root.content or obstacles else None
    cloth = root.build(
        lambda: Cloth(
            mesh,
            material,
            tuple(_handle(item, mesh, start) for item in root.sections("handles")),
            gravity=root.vector_or("gravity", (0.0, 0.0, -9.81)),
            contact=contact,
            obstacles=obstacles,
            damping=root.number_or("damping", 0.0),
            free_edges=root.choice_or("free_edges", "extrapolate", ("extrapolate", "zero")),  # type: ignore[arg-type]
        )
    )
    name = root.text("name") if "name" in root.content else path.stem
    return Scene(name, cloth, start, *_schedule(root.section("schedule")))


def _parse(path: Path) -> dict[str, object]:
    text = read_source(path)
    try:
        return tomllib.loads(text)
    except (tomllib.TOMLDecodeError, RecursionError, ValueError) as error:
        line = re.search(r"at line (\d+)", str(error))
        number = int(line.group(1)) if line else text.rstrip().count("\n") + 1
        raise InputError("file is not TOML", where=f"{path}:{number}", found=str(error)) from None


def _mesh(section: _Section) -> TriangleMesh:
    if section.choice_or("shape", "rectangle", ("rectangle", "disk")) == "disk":
        section.known("shape", "radius", "spacing", "grain", "position", "tilt")
        radius, spacing = section.number("radius"), section.number("spacing")
        return section.build(
            lambda: disk(radius, spacing, grain=math.radians(section.number_or("grain", 0.0)))
        )
    section.known("shape", "width", "height", "spacing", "grain", "irregularity", "seed", "position", "tilt")
    width, height, spacing = (section.number(key) for key in ("width", "height", "spacing"))
    return section.build(
        lambda: rectangle(
            width,
            height,
            spacing,
            grain=math.radians(section.number_or("grain", 0.0)),
            irregularity=section.number_or("irregularity", 0.0),
            seed=section.integer("seed") if "seed" in section.content else 0,
        )
    )


def _start(section: _Section, mesh: TriangleMesh) -> ClothState:
    """The panel, turned about the x-axis by ``tilt`` degrees, with its centre at ``position``."""
    tilt = math.radians(section.number_or("tilt", 0.0))
    x, y = mesh.panel.T
    turned = np.column_stack([x, y * math.cos(tilt), y * math.sin(tilt)])
    positions = turned + section.vector_or("position", (0.0, 0.0, 0.0))
    return ClothState(positions, np.zeros_like(positions))


def _handle(section: _Section, mesh: TriangleMesh, start: ClothState) -> Handle:
    section.known("name", "box", "vertex", "displacement", "start", "duration")
    name = section.text("name") if "name" in section.content else section.name
    if ("box" in section.content) == ("vertex" in section.content):
        raise section.fault("box", expected="either 'box' or 'vertex'", found="both or neither")
    if "vertex" in section.content:
        chosen = np.array([mesh.nearest_vertex(section.numbers("vertex", shape=(2,)))])
    else:
        low, high = np.sort(section.numbers("box", shape=(2, 2)), axis=0)
        inside = (mesh.panel >= low - 1e-9) & (mesh.panel <= high + 1e-9)
        chosen = np.flatnonzero(inside[:, 0] & inside[:, 1])
    return section.build(
        lambda: Handle(
            name,
            chosen,
            start.positions[chosen],
            Motion(
                section.vector_or("displacement", (0.0, 0.0, 0.0)),
                section.number_or("start", 0.0),
                section.number_or("duration", 0.0),
            ),
        )
    )


def _contact(section: _Section) -> ContactSettings:
    section.known("thickness", "pressure", "self_contact", "friction", "slip")
    default = ContactSettings()
    return section.build(
        lambda: ContactSettings(
            thickness=section.number_or("thickness", default.thickness),
            pressure=section.number_or("pressure", default.pressure),
            self_contact=section.flag_or("self_contact", default.self_contact),
            friction=section.number_or("friction", default.friction),
            slip=section.number_or("slip", default.slip),
        )
    )


def _obstacle(section: _Section) -> Obstacle:
    shape = section.choice_or("shape", "", ("sphere", "plane", "mesh"))
    if shape == "sphere":
        section.known("shape", "centre", "radius")
        return section.build(lambda: Sphere(section.vector("centre"), section.number("radius")))
    if shape == "plane":
        section.known("shape", "point", "normal")
        point = section.vector_or("point", (0.0, 0.0, 0.0))
        return section.build(lambda: Plane(point, section.vector_or("normal", (0.0, 0.0, 1.0))))
    section.known("shape", "file", "scale", "position")
    vertices, triangles = read_obj_surface(Path(section.path).parent / section.text("file"))
    scale, position = section.number_or("scale", 1.0), section.vector_or("position", (0.0, 0.0, 0.0))
    return section.build(lambda: MeshObstacle(scale * vertices + np.array(position), triangles))


def _schedule(section: _Section) -> tuple[Schedule, SolverOptions]:
    section.known("duration", "time_step", "to_rest", "rest_tolerance", "longest_step", "frame_interval",
                  "tolerance", "iterations")  # fmt: skip
    frames = section.number("frame_interval") if "frame_interval" in section.content else None
    default = SolverOptions()
    schedule = section.build(
        lambda: Schedule(
            section.number("duration"),
            section.number_or("time_step", 0.02),
            to_rest=section.flag_or("to_rest", False),
            longest_step=section.number_or("longest_step", 0.5),
            rest_tolerance=section.number_or("rest_tolerance", 1e-2),
            frame_interval=frames,
        )
    )
    return schedule, section.build(
        lambda: SolverOptions(
            tolerance=section.number_or("tolerance", default.tolerance),
            iterations=section.integer("iterations")
            if "iterations" in section.content
            else default.iterations,
        )
    )
