"""What notebooks show of the main objects: a picture and a short table, made where pictures are made."""

from __future__ import annotations

from importlib import import_module


class Displayed:
    """An object that a notebook shows with ``show.notebook``."""

    def _repr_html_(self) -> str:
        return import_module("yarnscale.show.notebook").html_of(self)
