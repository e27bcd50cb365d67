"""Scenes of cloth as TOML files; the format is described in docs/reference/scene_format.md."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

from yarnscale.files.fields import toml_file
from yarnscale.files.material_json import read_material
from yarnscale.files.material_library import names as material_names
from yarnscale.files.scene_mesh import is_garment, read_mesh, read_start
from yarnscale.files.scene_obstacles import read_obstacle
from yarnscale.files.scene_section import MOTION, REGION, SceneTable
from yarnscale.motion.handles import Handle
from yarnscale.motion.obstacles import Obstacle, Plane
from yarnscale.motion.schedule import Schedule
from yarnscale.shell.contact.cloth_contact import ContactSettings
from yarnscale.shell.dynamics.cloth import Cloth
from yarnscale.shell.dynamics.solver import SolverOptions
from yarnscale.shell.materials.material import ShellMaterial
from yarnscale.shell.mesh import TriangleMesh
from yarnscale.shell.scenes.plausible import cloth_notices, size_notices, sizes_line
from yarnscale.shell.scenes.ready import READY, ready_scene
from yarnscale.shell.scenes.scene import Scene
from yarnscale.shell.scenes.thickness import cloth_thickness, garment_thickness
from yarnscale.shell.state import ClothState

SOLVER = SolverOptions()


def read_scene(path: str | os.PathLike[str]) -> Scene:
    """The scene of a TOML file; files it names are looked for beside it.

    Raises InputError with file, line, field, expected and found for anything that is missing, unknown or
    of a wrong type.
    """
    path = Path(path)
    with toml_file(path) as table:
        return _scene(SceneTable(table.content, path))


def _scene(root: SceneTable) -> Scene:
    given = root.text("material")
    material = read_material(given if given in material_names() else root.beside(given))
    name = root.text_or("name", Path(root.path).stem)
    if "scene" in root.content or "garment" in root.content:
        scene = replace(_ready(root, material), name=name, may_give_way=_may_give_way(root))
        notices = root.build(lambda: [*cloth_notices(scene.cloth)])
        return replace(scene, notices=(sizes_line(scene.cloth), *notices))
    root.known("name", "material", "may_give_way", "gravity", "damping", "stiffness_damping", "air_drag",
               "free_edges", "mesh", "schedule", "handles", "contact", "obstacles")  # fmt: skip
    section = root.fields("mesh", optional=True)
    notices: list[str] = []
    mesh = read_mesh(section, notices.append)
    if not {"unit", "scale", "material_scale"} & set(section.content):
        notices += section.build(lambda: [*size_notices(mesh, material.density)])
    start = read_start(section, mesh)
    obstacles = tuple(
        _facing(read_obstacle(item), start, item, notices.append) for item in root.items("obstacles", optional=True)
    )
    garment = is_garment(section)
    thickness = garment_thickness(material, mesh, start) if garment else cloth_thickness(material, mesh)
    usual = ContactSettings(thickness=thickness)
    meets = "contact" in root.content or obstacles or garment
    contact = _contact(root.fields("contact", optional=True), usual) if meets else None
    free_edges = root.choice_or("free_edges", "extrapolate", ("extrapolate", "zero"))
    handles = tuple(_handle(item, mesh, start) for item in root.items("handles", optional=True))
    cloth = root.build(
        lambda: Cloth(
            mesh, material, handles, contact=contact, obstacles=obstacles, free_edges=free_edges,  # type: ignore[arg-type]
        )
    )  # fmt: skip
    cloth = root.changed(cloth, "gravity", "damping", "stiffness_damping", "air_drag")
    notices += root.build(lambda: [*cloth_notices(cloth)])
    schedule, options = _timing(root.fields("schedule", optional=True))
    return Scene(
        name, cloth, start, schedule, options, may_give_way=_may_give_way(root),
        notices=(sizes_line(cloth), *notices),
    )  # fmt: skip


def _may_give_way(root: SceneTable) -> bool:
    return root.flag_or("may_give_way", False)


def _ready(root: SceneTable, material: ShellMaterial) -> Scene:
    """A ready scene, with what the file says otherwise."""
    key = "scene" if "scene" in root.content else "garment"
    root.known("name", "material", "may_give_way", key, "spacing", "gravity", "damping", "air_drag", "schedule",
               "contact", "obstacles")  # fmt: skip
    name = root.choice_or(key, "", tuple(READY))
    spacing = root.number("spacing", positive=True) if "spacing" in root.content else None
    scene = root.build(lambda: ready_scene(name, material, spacing=spacing))
    cloth = scene.cloth
    if "obstacles" in root.content:
        cloth = replace(cloth, obstacles=tuple(read_obstacle(item) for item in root.items("obstacles")))
    if "contact" in root.content:
        cloth = replace(cloth, contact=_contact(root.fields("contact"), cloth.contact or ContactSettings()))
    cloth = root.changed(cloth, "gravity", "damping", "air_drag")
    schedule, options = _timing(root.fields("schedule", optional=True), scene.schedule, scene.options)
    return replace(scene, cloth=cloth, schedule=schedule, options=options)


def _facing(obstacle: Obstacle, start: ClothState, section: SceneTable, notice: Callable[[str], None]) -> Obstacle:
    """The obstacle; a plane with the whole cloth behind it is turned round, for it was meant from the other side."""
    if not isinstance(obstacle, Plane):
        return obstacle
    heights = (start.positions - obstacle.points(start.time)) @ np.asarray(obstacle.normal)
    if not (heights < 0).all():
        return obstacle
    notice(f"plane {section.name} is turned round: its normal points away from the cloth")
    x, y, z = obstacle.normal
    return replace(obstacle, normal=(-x, -y, -z))


def _handle(section: SceneTable, mesh: TriangleMesh, start: ClothState) -> Handle:
    section.known("name", *REGION, *MOTION)
    name, bounds = section.text_or("name", section.name), section.region()
    if bounds.ndim == 1:
        chosen = np.array([mesh.nearest_vertex(bounds)])
    else:
        places = mesh.panel if bounds.shape == (2, 2) else start.positions
        inside = ((places >= bounds[0] - 1e-9) & (places <= bounds[1] + 1e-9)).all(axis=1)
        chosen = np.unique(mesh.point_vertices[inside]) if bounds.shape == (2, 2) else np.flatnonzero(inside)
    motion = section.motion()
    return section.build(lambda: Handle(name, chosen, start.positions[chosen], motion))


def _contact(section: SceneTable, usual: ContactSettings) -> ContactSettings:
    keys = ("thickness", "pressure", "self_contact", "friction", "slip", "holding_force")
    return section.known(*keys).changed(usual, *keys)


def _timing(
    section: SceneTable, usual: Schedule | None = None, options: SolverOptions = SOLVER
) -> tuple[Schedule, SolverOptions]:
    """The schedule and how steps are solved; ``usual`` and ``options`` are the defaults of the file."""
    solving = ("tolerance", "iterations", "integrator", "minimiser")
    plan = usual or section.build(lambda: Schedule(section.number("duration"), 0.02, to_rest=False))
    return read_schedule(section, plan, solving), section.changed(options, *solving)


def read_schedule(section: SceneTable, usual: Schedule, others: tuple[str, ...] = ()) -> Schedule:
    """The schedule; ``usual`` says what holds where the file is silent; others: keys that are no part of it."""
    timing = ("duration", "time_step", "to_rest", "rest_tolerance", "longest_step", "frame_interval", "statics")
    loads = {"first": "first_load", "smallest": "smallest_load", "largest": "largest_load"}
    section.known(*timing, *loads.values(), *others, "animation", "rough_iterations")
    plan = usual
    if section.flag_or("animation", False):
        other = [key for key in ("statics", "to_rest") if section.flag_or(key, False)]
        if other:
            raise section.fault("animation", expected=f"false with {other[0]}", found="true")
        plan = plan.animated()
    steps = section.changed(plan.load_steps, **loads)
    if "rough_iterations" in section.content:
        rough = section.integer("rough_iterations")
        plan = section.build(lambda plan=plan: replace(plan, rough_iterations=rough))
    return section.changed(replace(plan, load_steps=steps), *timing)
