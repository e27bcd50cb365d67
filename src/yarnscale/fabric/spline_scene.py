"""A finite fabric of spline yarns under loads and grips; all control points, or in a bounding volume."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import KW_ONLY, dataclass
from functools import cached_property
from typing import Any

import numpy as np

from yarnscale.arrays import Array
from yarnscale.checked import checked
from yarnscale.errors import InputError
from yarnscale.fabric.adaptive_volume import AdaptiveVolume
from yarnscale.fabric.fabric_scene import FabricScene, YarnLines
from yarnscale.fabric.measures import fibre_extension, penetration
from yarnscale.fabric.sheet_scene import PlannedScene, SheetScene
from yarnscale.fabric.spline_knit import SplineFabric
from yarnscale.fabric.spline_motion import STANDARD_GRAVITY, SplineMotion, YarnMotion
from yarnscale.fabric.spline_points import SplinePoints
from yarnscale.fabric.volume_cells import Reduction
from yarnscale.motion.body import Method
from yarnscale.motion.obstacles import Obstacle

_POINTS_PER_SEGMENT = 3


def reduction_for(chosen: Reduction | None, method: Method, adaptive: bool) -> Reduction:
    """The reduction of a volume: the chosen one, by default homogenized where steps are implicit and knots stay."""
    return chosen or ("published" if adaptive or method == "explicit" else "homogenized")


@checked
@dataclass(frozen=True, eq=False)
class SplineScene(FabricScene[YarnMotion]):
    """A fabric of spline yarns to simulate.

    loads: gravity, grips and obstacles, such as ``sheet_scenes.drape(SplinePoints(fabric).sheet)``; None: it hangs by
    one point of every loop of its last row, as in LOD03, under ``gravity`` [m/s²], which loads replace by their own.
    displacement: of the fabric at the start from where it is drawn [m]; loads are those of the displaced sheet
    (``in_place`` makes both). volume: around
    ``fabric.control``; reduction: its elasticity, "homogenized" or "published" (LOD03), None for homogenized where that
    is possible: in implicit steps, without adaptive. adaptive: whether the volume inserts and removes knots. Other
    arguments: see ``FabricScene``. Without a volume the schedule has dynamics alone. Raises InputError.
    """

    fabric: SplineFabric
    loads: SheetScene | None = None
    _: KW_ONLY
    gravity: tuple[float, float, float] = STANDARD_GRAVITY
    displacement: tuple[float, float, float] = (0.0, 0.0, 0.0)
    adaptive: bool = False
    reduction: Reduction | None = None

    def __post_init__(self) -> None:
        if self.loads is not None:
            if self.gravity not in (STANDARD_GRAVITY, self.loads.gravity):
                raise InputError("gravity", expected="none beside that of the loads", found=self.gravity)
            object.__setattr__(self, "gravity", self.loads.gravity)
        if self.adaptive and self.volume is None:
            raise InputError("adaptive", expected="a volume", found="none")
        if self.volume is None and (self.schedule.to_rest or self.schedule.statics):
            named = "statics" if self.schedule.statics else "to_rest"
            raise InputError(f"schedule of spline yarns, {named}", expected="dynamics alone, or a volume", found="true")

    @classmethod
    def in_place(cls, fabric: SplineFabric, plan: PlannedScene, **settings: Any) -> SplineScene:
        """The fabric in a scene for any fabric; settings: the other arguments. Raises InputError."""
        sheet = SplinePoints(fabric).sheet
        laid = plan.laid(sheet)
        x, y, z = (laid.vertices[0] - sheet.vertices[0]).tolist()
        return cls(fabric, plan.of(laid), displacement=(x, y, z), **settings)

    @cached_property
    def _full(self) -> SplineMotion:
        return SplineMotion(
            self.fabric, volume=self.volume, reduction=reduction_for(self.reduction, self.method, self.adaptive),
            gravity=self.gravity, held=self.fabric.top if self.loads is None else None, loads=self.loads,
            displacement=self.displacement, damping=self.damping, method=self.method, integrator=self.integrator,
        )  # fmt: skip

    @property
    def obstacles(self) -> Sequence[Obstacle]:
        """Obstacles that the fabric touches."""
        return () if self.loads is None else self.loads.obstacles

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
        """``penetration``, ``extension``, ``passages`` where they are counted, and ``force`` [N] where grips pull."""
        control = self.body.yarns(state).positions
        extension = fibre_extension(self.fabric, control)[0]
        found: dict[str, float] = {"penetration": penetration(self.fabric, control), "extension": extension}
        if self.method == "implicit" or self.volume is None:
            found["passages"] = self._full.touch.lasting(state.passages)
        forces = self._full.forces
        if self.loads is not None and self.loads.axis is not None and forces is not None:
            x = self._full.expanded(state).positions.ravel()
            found["force"] = forces.loads.force(forces.points, x, state.time)
        return found
