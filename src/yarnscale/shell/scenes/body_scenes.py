"""Ready scenes of clothes on a body that moves: sweater, T-shirt and scarf.

Dressing is part of the scene: the body begins thin between the layers of the flat garment and grows to its depth.
Then it lowers its arms, turns, and lifts them again.
"""

from __future__ import annotations

import math

import numpy as np

from yarnscale.arrays import Array
from yarnscale.checked import checked
from yarnscale.errors import InputError
from yarnscale.motion.schedule import FRAME, Schedule
from yarnscale.shell.contact.cloth_contact import ContactSettings
from yarnscale.shell.dynamics.cloth import Cloth
from yarnscale.shell.dynamics.solver import SolverOptions
from yarnscale.shell.garments.mannequin import MovingMannequin, Pose, mannequin
from yarnscale.shell.garments.wardrobe import SWEATER, T_SHIRT, ShirtCut, shirt
from yarnscale.shell.materials.material import ShellMaterial
from yarnscale.shell.mesh import TriangleMesh, rectangle
from yarnscale.shell.scenes.scene import Scene, measure_sheet
from yarnscale.shell.state import ClothState

THIN = 0.2
"""Depth of the body before it is dressed, over its full depth."""
DANCE = (
    Pose(0.0, depth=THIN),
    Pose(0.4),
    Pose(1.0, lowered=0.95),
    Pose(1.5, lowered=0.45, turned=0.6),
    Pose(2.0, lowered=0.85, turned=-0.3),
)
"""Dressed after 0.4 s, arms lowered, turned, arms lifted half way and back: 60 frames."""
PRESSURE = 2e3
"""Of contact at half its thickness [Pa]: clothes rest on a small area."""
_WAIT = (
    Pose(0.0, lowered=0.9),
    Pose(1.0, lowered=0.9),
    Pose(1.5, lowered=0.9, turned=0.5),
    Pose(2.0, lowered=0.9),
)


@checked
def sweater(
    material: ShellMaterial,
    *,
    spacing: float = 0.02,
    cut: ShirtCut = SWEATER,
    duration: float = 2.0,
    time_step: float = FRAME / 2,
    thickness: float = 2e-3,
    friction: float = 0.3,
) -> Scene:
    """A sweater of four panels on a body that moves; spacing [m] of the mesh: 0.0102 gives 20 000 triangles.

    Measures: see ``measure_sheet``. Raises InputError.
    """
    mesh = shirt("sweater", cut, spacing).mesh
    return _scene("sweater", mesh, material, DANCE, duration, time_step, thickness, friction)


@checked
def t_shirt(
    material: ShellMaterial,
    *,
    spacing: float = 0.02,
    cut: ShirtCut = T_SHIRT,
    duration: float = 2.0,
    time_step: float = FRAME / 2,
    thickness: float = 1e-3,
    friction: float = 0.3,
) -> Scene:
    """A T-shirt on a body that moves; otherwise as ``sweater``."""
    mesh = shirt("tshirt", cut, spacing).mesh
    return _scene("tshirt", mesh, material, DANCE, duration, time_step, thickness, friction)


@checked
def scarf(
    material: ShellMaterial,
    *,
    length: float = 1.5,
    width: float = 0.18,
    spacing: float = 0.015,
    duration: float = 2.0,
    time_step: float = FRAME / 2,
    thickness: float = 2e-3,
    friction: float = 0.4,
) -> Scene:
    """A scarf that falls from above the shoulders around the neck of a rotating body; wales along its length.

    length, width: [m], at least 0.6 and at most 0.3. Measures: see ``measure_sheet``. Raises InputError.
    """
    if not (math.isfinite(length) and length >= 0.6):
        raise InputError("length of the scarf", expected="at least 0.6 m", found=length)
    if not (math.isfinite(width) and 0 < width <= 0.3):
        raise InputError("width of the scarf", expected="up to 0.3 m", found=width)
    flat = rectangle(length, width, spacing, grain=-0.5 * math.pi)
    mesh = TriangleMesh(flat.material, flat.triangles, flat.grain, assembled=_round_the_neck(flat.panel))
    return _scene("scarf", mesh, material, _WAIT, duration, time_step, thickness, friction)


def _scene(
    name: str, mesh: TriangleMesh, material: ShellMaterial, poses: tuple[Pose, ...], duration: float,
    time_step: float, thickness: float, friction: float,
) -> Scene:  # fmt: skip
    contact = ContactSettings(thickness=thickness, pressure=PRESSURE, friction=friction)
    body = MovingMannequin(mannequin(), poses)
    cloth = Cloth(mesh, material, contact=contact, obstacles=(body,), damping=1.0)
    schedule = Schedule(duration, time_step, to_rest=False, frame_interval=FRAME)
    options = SolverOptions(tolerance=2e-2)
    return Scene(name, cloth, ClothState.flat(mesh), schedule, options, measure_sheet)


def _round_the_neck(panel: Array) -> Array:
    """A strip (n, 2) on edge above the shoulders, half a circle behind the neck and straight to the front, (n, 3)."""
    radius, along = 0.105, panel[:, 0]
    angle = np.clip(along / radius, -0.5 * math.pi, 0.5 * math.pi)
    straight = np.abs(along) - np.abs(angle) * radius
    x, y = radius * np.sin(angle), radius * np.cos(angle) - straight
    return np.column_stack([x, y, panel[:, 1] + 0.5 * np.ptp(panel[:, 1]) + 0.12])
