"""A finite fabric of elastic rods under loads and grips; all yarns by themselves, or in a bounding volume."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import KW_ONLY, dataclass
from functools import cached_property

import numpy as np

from yarnscale.arrays import Array
from yarnscale.checked import checked
from yarnscale.fabric.direct_energy import FabricEnergy
from yarnscale.fabric.direct_motion import FabricDynamics, FabricMotion, MotionSettings
from yarnscale.fabric.direct_static import reactions
from yarnscale.fabric.fabric_scene import FabricScene, YarnLines
from yarnscale.fabric.rod_fabric import RodFabric
from yarnscale.fabric.rod_volume import RodVolume, VolumeDynamics
from yarnscale.fabric.sheet import NO_PATTERN, YarnSheet
from yarnscale.fabric.sheet_scene import SheetScene
from yarnscale.fabric.volume import BoundingVolume
from yarnscale.motion.obstacles import Obstacle
from yarnscale.yarn.friction import YarnFriction

USUAL_FRICTION = 0.1
"""Coefficient between yarns: without friction the yarns of a cut weave slide out, with 0.3 fabric creeps and hardly
curls (docs/validation/fabric.md)."""


@checked
@dataclass(frozen=True, eq=False)
class RodScene(FabricScene[FabricMotion]):
    """A fabric of rods to simulate.

    loads: gravity, grips and obstacles, such as ``sheet_scenes.hang(fabric.sheet)``. friction: coefficient between
    yarns. volume: around ``fabric.sheet.vertices``. Other arguments: see ``FabricScene``.
    """

    fabric: RodFabric
    loads: SheetScene
    _: KW_ONLY
    friction: float = USUAL_FRICTION

    @cached_property
    def energy(self) -> FabricEnergy:
        """The energy of the fabric."""
        return self.fabric.energy()

    @cached_property
    def body(self) -> FabricDynamics:
        """What moves. Raises InputError for explicit steps in a volume and numbers out of range."""
        friction = YarnFriction(self.friction) if self.friction else None
        settings = MotionSettings(self.gravity, self.damping, friction, method=self.method, integrator=self.integrator)
        self.energy.count_passages()
        parts = self.energy, settings, self.loads.holds, self.loads.pushes(self.energy)
        if self.volume is None:
            return FabricDynamics(*parts)
        return VolumeDynamics(*parts, volume=RodVolume(self.energy, self.volume))

    @cached_property
    def start(self) -> FabricMotion:
        return self.body.start()

    @property
    def gravity(self) -> tuple[float, float, float]:
        return self.loads.gravity

    @property
    def obstacles(self) -> Sequence[Obstacle]:
        return self.loads.obstacles

    @property
    def lines(self) -> YarnLines:
        """The yarns; a colour for each, in a knitted piece for each material."""
        sheet = self.fabric.sheet
        knitted = bool((sheet.source == NO_PATTERN).any())
        colours = sheet.yarn_material if knitted else np.arange(len(sheet.closed))
        return YarnLines(sheet.offsets, sheet.yarn_radii, sheet.closed, colours)

    def points(self, state: FabricMotion) -> Array:
        return self.energy.positions(state.x) * self.fabric.sheet.radius

    def centre_of_mass(self, state: FabricMotion) -> Array:
        return np.average(self.points(state), axis=0, weights=self.energy.masses())

    def counts(self) -> dict[str, int]:
        return rod_counts(self.fabric.sheet, self.volume)

    def measures(self, state: FabricMotion) -> dict[str, float]:
        """``penetration``, ``extension``, ``passages``, and ``force`` [N] where grips pull."""
        self.body.take_up(state)
        found = {
            "penetration": self.energy.penetration(state.x),
            "extension": float(np.abs(self.energy.extensions(state.x)).max()),
            "passages": self.energy.passage_count,
        }
        if self.loads.axis is not None and self.method == "explicit":
            holds = self.loads.holds(state.time)
            found["force"] = self.loads.pull(holds, reactions(self.energy, holds, state.x))
        elif self.loads.axis is not None:
            found["force"] = self.loads.force(self.energy, state.x, state.time)
        return found


def rod_counts(sheet: YarnSheet, volume: BoundingVolume | None = None) -> dict[str, int]:
    """Sizes of a model of rods; ``reduced_unknowns`` in a volume."""
    counts = {"vertices": sheet.vertex_count, "yarns": len(sheet.closed), "dofs": sheet.unknowns}
    counts |= {"unknowns": sheet.unknowns, "constraints": 0}
    return counts if volume is None else counts | {"reduced_unknowns": 3 * volume.count}
