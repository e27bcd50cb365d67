"""Scenes of cloth: start, loads, schedule and measured quantities; ready scenes for any material."""

from yarnscale.shell.scenes.body_scenes import scarf, sweater, t_shirt
from yarnscale.shell.scenes.ready import READY, ready_scene
from yarnscale.shell.scenes.scene import Scene, SceneResult, drape, stretch
from yarnscale.shell.scenes.sheet_scenes import drape_on_ball, hang, pull_through, twist

__all__ = [
    "READY", "Scene", "SceneResult", "drape", "drape_on_ball", "hang", "pull_through", "ready_scene",
    "scarf", "stretch", "sweater", "t_shirt", "twist",
]  # fmt: skip


def __dir__() -> list[str]:
    return __all__
