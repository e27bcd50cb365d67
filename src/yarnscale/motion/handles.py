"""Vertices of cloth or yarns that are held, and moved."""

from __future__ import annotations

from dataclasses import dataclass

from yarnscale.arrays import Array, Integers
from yarnscale.errors import InputError
from yarnscale.motion.rigid import STILL, Motion


@dataclass(frozen=True, eq=False)
class Handle:
    """Vertices that are held where they start, and moved: a pin (one vertex), a bar or a grip (a strip of them).

    vertices: (n,); rest: their places before the motion [m], (n, 3).
    """

    name: str
    vertices: Integers
    rest: Array
    motion: Motion = STILL

    def __post_init__(self) -> None:
        if len(self.vertices) == 0:
            raise InputError(f"handle '{self.name}'", expected="vertices in its region", found="none")

    def places(self, time: float) -> Array:
        """Where the vertices are held at a time [s], (n, 3) [m]."""
        return self.motion.place(self.rest, time)
