"""Names of the ready scenes and what makes them."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from yarnscale.checked import checked
from yarnscale.errors import InputError
from yarnscale.motion.schedule import FRAME
from yarnscale.shell.materials.material import ShellMaterial
from yarnscale.shell.scenes import body_scenes, scene, sheet_scenes
from yarnscale.shell.scenes.scene import Scene

READY: dict[str, Callable[..., Scene]] = {
    "stretch-course": partial(scene.stretch, direction="course", frame_interval=FRAME),
    "stretch-wale": partial(scene.stretch, direction="wale", frame_interval=FRAME),
    "drape": partial(scene.drape, frame_interval=FRAME),
    "drape-on-ball": sheet_scenes.drape_on_ball,
    "hang": sheet_scenes.hang,
    "bagging": sheet_scenes.bagging,
    "twist": sheet_scenes.twist,
    "ring": sheet_scenes.pull_through,
    "scarf": body_scenes.scarf,
    "tshirt": body_scenes.t_shirt,
    "sweater": body_scenes.sweater,
}
"""Scenes by name; each takes a material and, as an option, ``spacing`` [m]."""


@checked
def ready_scene(name: str, material: ShellMaterial, *, spacing: float | None = None) -> Scene:
    """A ready scene of a material; spacing: edge length of its triangles [m]. Raises InputError."""
    if name not in READY:
        raise InputError("ready scene", expected=" or ".join(READY), found=name)
    return READY[name](material) if spacing is None else READY[name](material, spacing=spacing)
