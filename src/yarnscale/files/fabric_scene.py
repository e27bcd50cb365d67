"""Scenes of finite fabrics as TOML files, in the format of scenes of cloth (docs/reference/scene_format.md)."""

from __future__ import annotations

import os
from pathlib import Path

from yarnscale.fabric.fabric_scene import fabric_schedule
from yarnscale.fabric.sheet_scene import HandleRegion, PlannedScene
from yarnscale.files.fields import toml_file
from yarnscale.files.scene_obstacles import read_obstacle
from yarnscale.files.scene_section import MOTION, REGION, SceneTable
from yarnscale.files.scene_toml import read_schedule
from yarnscale.kinematics import GRAVITY


def read_fabric_scene(path: str | os.PathLike[str]) -> PlannedScene:
    """The scene of a TOML file. Raises InputError with file, line, field, expected and found."""
    path = Path(path)
    with toml_file(path) as table:
        root = SceneTable(table.content, path)
        root.known("name", "may_give_way", "gravity", "damping", "fabric", "handles", "contact", "obstacles",
                   "schedule")  # fmt: skip
        fabric = root.fields("fabric", optional=True).known("position")
        contact = root.fields("contact", optional=True).known("friction")
        timing = root.fields("schedule")
        usual = timing.build(lambda: fabric_schedule(timing.number("duration")))
        plan = PlannedScene(
            read_schedule(timing, usual),
            root.vector_or("gravity", (0.0, 0.0, -GRAVITY)),
            tuple(_handle(item) for item in root.items("handles", optional=True)),
            tuple(read_obstacle(item) for item in root.items("obstacles", optional=True)),
            position=fabric.vector_or("position", (0.0, 0.0, 0.0)),
        )
        plan = contact.changed(plan, "friction")
        return root.changed(plan, "damping", "may_give_way")


def _handle(section: SceneTable) -> HandleRegion:
    section.known("name", *REGION, *MOTION)
    return HandleRegion(section.text_or("name", section.name), section.region(), section.motion())
