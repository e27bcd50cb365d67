"""A finite fabric of spline yarns that hangs by its last row; all control points, or in a bounding volume."""

from __future__ import annotations

from dataclasses import KW_ONLY, dataclass
from functools import cached_property

import numpy as np

from yarnscale.arrays import Array
from yarnscale.checked import checked
from yarnscale.errors import InputError
from yarnscale.fabric.adaptive_volume import AdaptiveVolume
from yarnscale.fabric.fabric_scene import FabricScene, YarnLines
from yarnscale.fabric.measures import fibre_extension, penetration
from yarnscale.fabric.spline_knit import SplineFabric
from yarnscale.fabric.spline_motion import STANDARD_GRAVITY, Reduction, SplineMotion, YarnMotion
from yarnscale.motion.body import Method

_POINTS_PER_SEGMENT = 3


def reduction_for(chosen: Reduction | None, method: Method, adaptive: bool) -> Reduction:
    """The reduction of a volume: the chosen one, by default homogenized where steps are implicit and knots stay."""
    return chosen or ("published" if adaptive or method == "explicit" else "homogenized")


@checked
@dataclass(frozen=True, eq=False)
class SplineScene(FabricScene[YarnMotion]):
    """A fabric of spline yarns to simulate, held along its last row.

    volume: around ``fabric.control``; reduction: its elasticity, "homogenized" or "published" (LOD03), None for
    homogenized where that is possible: in implicit steps, without adaptive. adaptive: whether the volume inserts and
    removes knots. gravity: [m/s²]. Other arguments: see ``FabricScene``.
    """

    fabric: SplineFabric
    _: KW_ONLY
    adaptive: bool = False
    reduction: Reduction | None = None
    gravity: tuple[float, float, float] = STANDARD_GRAVITY

    def __post_init__(self) -> None:
        if self.adaptive and self.volume is None:
            raise InputError("adaptive", expected="a volume", found="none")

    @cached_property
    def _full(self) -> SplineMotion:
        return SplineMotion(
            self.fabric, volume=self.volume, reduction=reduction_for(self.reduction, self.method, self.adaptive),
            gravity=self.gravity, held=self.fabric.top, damping=self.damping, method=self.method,
            integrator=self.integrator,
        )  # fmt: skip

    @cached_property
    def body(self) -> SplineMotion | AdaptiveVolume:
        """What moves. Raises InputError for numbers out of range."""
        return AdaptiveVolume(self._full) if self.adaptive else self._full

    @property
    def start(self) -> YarnMotion:
        return self._full.start

    @property
    def lines(self) -> YarnLines:
        """The yarns, a colour for each."""
        count = self.fabric.yarn_count
        length = self.fabric.segments_per_yarn * _POINTS_PER_SEGMENT + 1
        radii, closed = np.full(count, self.fabric.radius), np.zeros(count, bool)
        return YarnLines(np.arange(count + 1) * length, radii, closed, np.arange(count))

    def points(self, state: YarnMotion) -> Array:
        return self.fabric.lines(self.body.yarns(state).positions, _POINTS_PER_SEGMENT).reshape(-1, 3)

    def centre_of_mass(self, state: YarnMotion) -> Array:
        positions = self.body.yarns(state).positions
        mass = self._full.of_yarns.mass_matrix()
        weights = mass @ np.ones(len(positions))
        return weights @ positions / weights.sum()

    def counts(self) -> dict[str, int]:
        return self.body.counts()

    def measures(self, state: YarnMotion) -> dict[str, float]:
        """``penetration`` and ``extension``."""
        control = self.body.yarns(state).positions
        extension = fibre_extension(self.fabric, control)[0]
        return {"penetration": penetration(self.fabric, control), "extension": extension}
