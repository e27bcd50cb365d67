"""What is simulated: a panel of a material, held at handles that move, pulled by gravity, meeting obstacles."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from yarnscale.checked import checked
from yarnscale.errors import InputError, not_negative
from yarnscale.kinematics import GRAVITY
from yarnscale.motion.handles import Handle
from yarnscale.motion.obstacles import MeshObstacle, Obstacle, Plane, Sphere, obstacle_name
from yarnscale.motion.rigid import Motion
from yarnscale.shell.contact.cloth_contact import ContactSettings
from yarnscale.shell.elastic.elements import FreeEdges
from yarnscale.shell.materials.material import ShellMaterial
from yarnscale.shell.mesh import TriangleMesh


@checked
@dataclass(frozen=True, eq=False)
class Cloth:
    """A panel and everything that acts on it.

    gravity: acceleration [m/s²]. contact: None where nothing may touch. damping: rate [1/s] at which free
    motion decays (Rayleigh's mass term); stiffness_damping: time [s] by which elastic forces lead the strain
    (Rayleigh's stiffness term), with a damping ratio of half of it times the angular frequency. air_drag: force per
    area and square of the speed across the surface [kg/m³], see ``air``. free_edges: see ``elements``.
    """

    mesh: TriangleMesh
    material: ShellMaterial
    handles: tuple[Handle, ...] = ()
    gravity: tuple[float, float, float] = (0.0, 0.0, -GRAVITY)
    contact: ContactSettings | None = None
    obstacles: tuple[Obstacle, ...] = ()
    damping: float = 0.0
    free_edges: FreeEdges = "extrapolate"
    stiffness_damping: float = 0.0
    air_drag: float = 0.0

    def __repr__(self) -> str:
        held = f"{len(self.handles)} handles, {len(self.obstacles)} obstacles"
        return f"Cloth({self.mesh!r} of {self.material!r}, {held})"

    def __post_init__(self) -> None:
        if len(self.gravity) != 3 or not np.isfinite(self.gravity).all():
            raise InputError("gravity", expected="three finite numbers [m/s²]", found=self.gravity)
        for name, unit in (("damping", "1/s"), ("stiffness_damping", "s"), ("air_drag", "kg/m³")):
            not_negative(name, getattr(self, name), f"zero or more [{unit}]")
        names = [handle.name for handle in self.handles]
        twice = next((name for k, name in enumerate(names) if name in names[:k]), None)
        if twice is not None:
            raise InputError("handles", expected="names that differ", found=f"'{twice:.40}' twice")
        if self.obstacles and self.contact is None:
            raise InputError("obstacles", expected="contact settings with them", found="none")

    def motions(self) -> list[tuple[str, Motion]]:
        """Rigid motions of handles and obstacles, by the names that messages have for them."""
        found = [(f"handle '{handle.name}'", handle.motion) for handle in self.handles]
        for number, obstacle in enumerate(self.obstacles):
            if isinstance(obstacle, Sphere | Plane | MeshObstacle):
                found.append((obstacle_name(obstacle, number), obstacle.motion))
        return found
