"""What holds points of yarns at places: stiff springs, their forces, and how far the points are from there."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from yarnscale.arrays import Array, Flags, Integers
from yarnscale.numerics.sums import Springs
from yarnscale.yarn.stiffness import PatternStiffness

HOLD = 1000.0
"""Stiffness of what holds a vertex, over that of its yarn in tension."""


class YarnPoints(Protocol):
    """Points of yarns as a function of a state: lengths in ``radius`` [m], forces in ``force_unit`` [N]."""

    @property
    def radius(self) -> float: ...
    @property
    def force_unit(self) -> float: ...
    @property
    def count(self) -> int: ...
    @property
    def stiffness(self) -> PatternStiffness: ...
    def positions(self, x: Array, /) -> Array: ...


@dataclass(frozen=True, eq=False)
class Holds:
    """Vertices held at places: nodes (k,), targets (k, 3) [m]; axes: along which they are held (all).

    spun: edges (j,) whose twist is held at ``angles`` (j,) [rad]. handles: which of the vertices each handle holds, by
    its name, as masks (k,) (none: one holds all).
    """

    nodes: Integers
    targets: Array
    axes: tuple[bool, bool, bool] = (True, True, True)
    spun: Integers = field(default_factory=lambda: np.empty(0, np.int64))
    angles: Array = field(default_factory=lambda: np.empty(0))
    handles: Mapping[str, Flags] = field(default_factory=dict)

    @classmethod
    def none(cls) -> Holds:
        """Nothing is held."""
        return cls(np.empty(0, np.int64), np.empty((0, 3)))

    def weights(self, energy: YarnPoints) -> Array:
        """Stiffness of the springs on held vertices (k, 3), lengths in radii."""
        return HOLD * energy.stiffness.position_scale()[self.nodes, None] * np.array(self.axes, np.float64)

    def springs(self, energy: YarnPoints) -> Springs:
        """Stiff springs to the targets."""
        weight, centre = np.zeros((energy.count, 3)), np.zeros((energy.count, 3))
        weight[self.nodes] = self.weights(energy)
        centre[self.nodes] = self.targets / energy.radius
        spin, angle = np.zeros(energy.count), np.zeros(energy.count)
        spin[self.spun], angle[self.spun] = HOLD * energy.stiffness.twist_scale()[self.spun], self.angles
        return Springs(np.concatenate([weight.ravel(), spin]), np.concatenate([centre.ravel(), angle]))

    def forces(self, energy: YarnPoints, x: Array) -> Array:
        """Force with which each held vertex is held (k, 3) [N]."""
        return (
            self.weights(energy) * (self.targets / energy.radius - energy.positions(x)[self.nodes]) * energy.force_unit
        )

    def distances(self, energy: YarnPoints, x: Array) -> dict[str, float]:
        """How far each handle's farthest vertex is from its target [m]."""
        away = energy.positions(x)[self.nodes] * energy.radius - self.targets
        away = np.linalg.norm(away * np.array(self.axes, np.float64), axis=1)
        handles = self.handles or {"held vertices": np.ones(len(away), bool)}
        return {name: float(away[held].max(initial=0.0)) for name, held in handles.items()}
