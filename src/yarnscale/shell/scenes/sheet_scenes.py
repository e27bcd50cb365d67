"""Ready scenes of a square sheet: hanging, draped as published, twisted between bars, pulled through a ring."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from yarnscale.arrays import Array, Integers
from yarnscale.checked import checked
from yarnscale.errors import InputError, positive
from yarnscale.motion.handles import Handle
from yarnscale.motion.obstacles import MeshObstacle, Obstacle, Sphere
from yarnscale.motion.rigid import Motion
from yarnscale.motion.schedule import FRAME, Schedule
from yarnscale.shell.contact.cloth_contact import ContactSettings
from yarnscale.shell.dynamics.cloth import Cloth
from yarnscale.shell.dynamics.solver import ClothSolver
from yarnscale.shell.materials.material import ShellMaterial
from yarnscale.shell.mesh import TriangleMesh, rectangle
from yarnscale.shell.scenes.scene import SHEET, SPACING, Scene, measure_sheet
from yarnscale.shell.scenes.thickness import cloth_thickness
from yarnscale.shell.state import ClothState


def _scene(
    name: str, mesh: TriangleMesh, start: ClothState, material: ShellMaterial, duration: float,
    contact: ContactSettings, handles: Sequence[Handle], obstacles: tuple[Obstacle, ...] = (),
) -> Scene:  # fmt: skip
    cloth = Cloth(mesh, material, tuple(handles), contact=contact, obstacles=obstacles, damping=2.0)
    schedule = Schedule(duration, FRAME / 2, to_rest=False, frame_interval=FRAME)
    return Scene(name, cloth, start, schedule, measure=measure_sheet)


@checked
def hang(material: ShellMaterial, *, spacing: float = SPACING, duration: float = 1.5) -> Scene:
    """A sheet that falls from its plane, held at two neighbouring corners 24 cm apart, and comes to rest."""
    mesh = rectangle(SHEET, SHEET, spacing)
    start = ClothState.flat(mesh)
    pins = tuple(
        Handle(f"{name} corner", vertices, start.positions[vertices], Motion((shift, 0.0, 0.0), 0.0, 0.5))
        for name, vertices, shift in (
            ("left", _near(mesh, (-0.5 * SHEET, 0.5 * SHEET), 0.6 * spacing), 0.03),
            ("right", _near(mesh, (0.5 * SHEET, 0.5 * SHEET), 0.6 * spacing), -0.03),
        )
    )
    contact = ContactSettings(cloth_thickness(material, mesh), friction=0.3)
    return _scene("hang", mesh, start, material, duration, contact, pins)


@checked
def drape_on_ball(material: ShellMaterial, *, spacing: float = SPACING, duration: float = 1.5) -> Scene:
    """The published drape (HYLC20 Fig. 17): held within 1 cm of (−0.1, ±0.1) m, over a ball of 3 cm 4 cm below."""
    mesh = rectangle(SHEET, SHEET, spacing)
    start = ClothState.flat(mesh)
    pins = tuple(
        Handle(f"pin {k + 1}", vertices, start.positions[vertices])
        for k, vertices in enumerate(_near(mesh, (-0.1, side), 0.01) for side in (-0.1, 0.1))
    )
    contact, ball = (
        ContactSettings(cloth_thickness(material, mesh), friction=0.3),
        Sphere((0.0, 0.0, -0.04), 0.03),
    )
    return _scene("drape-on-ball", mesh, start, material, duration, contact, pins, (ball,))


@checked
def bagging(
    material: ShellMaterial, *, size: float = 0.12, spacing: float | None = None, depth: float | None = None,
    duration: float = 2.0,
) -> Scene:  # fmt: skip
    """A square sheet held at its edges, through which a ball swings like a knee; what remains is its bag.

    size: of the sheet [m], six times the radius of the ball. spacing: [m], default a twentieth of the size. depth: of
    the ball's lowest point [m], default a quarter, at most 3/8 of the size; 0: it passes above. Measures: ``sag``,
    depth of the middle, and ``mean_sag`` of the whole sheet [m]. An elastic sheet hangs as if there had been no ball.
    """
    positive("size", size)
    spacing = size / 20 if spacing is None else spacing
    depth, most = size / 4 if depth is None else depth, 0.375 * size
    if not (math.isfinite(depth) and 0.0 <= depth <= most):
        raise InputError("depth of the ball", expected=f"between 0 and {most:g} m", found=depth)
    mesh = rectangle(size, size, spacing)
    start = ClothState.flat(mesh)
    settings = ContactSettings(cloth_thickness(material, mesh), friction=0.2)
    rim = np.flatnonzero(np.abs(mesh.panel).max(axis=1) > 0.5 * size - 0.5 * spacing)
    above, radius = size / 24, size / 6
    arm = above + depth if depth else size / 12
    pivot = (0.0, 0.0, radius + above + (0.0 if depth else arm))
    swing = Motion((0.0, 0.0, 0.0), 0.2 * duration, 0.4 * duration, rotation=(0.0, -math.pi, 0.0), pivot=pivot)
    ball = Sphere((-arm, 0.0, pivot[2]), radius, swing)
    handle = Handle("rim", rim, start.positions[rim])
    scene = _scene("bagging", mesh, start, material, duration, settings, (handle,), (ball,))
    middle = mesh.nearest_vertex(np.zeros(2))

    def measure(solver: ClothSolver, state: ClothState) -> dict[str, float]:
        heights = state.positions[:, 2]
        return {"sag": -float(heights[middle]), "mean_sag": -float(solver.masses @ heights / solver.masses.sum())}

    return replace(scene, measure=measure)


@checked
def twist(
    material: ShellMaterial,
    *,
    spacing: float = 0.01,
    turns: float = 1.0,
    width: float = 0.10,
    duration: float = 2.0,
) -> Scene:
    """A strip of 30 cm between two bars that rotate against each other by ``turns``, then stop."""
    if not (math.isfinite(turns) and abs(turns) <= 5):
        raise InputError("turns", expected="up to 5", found=turns)
    mesh = rectangle(SHEET, width, spacing)
    start = ClothState.flat(mesh)
    bars = []
    for name, side in (("left bar", -1.0), ("right bar", 1.0)):
        vertices = np.flatnonzero(side * mesh.panel[:, 0] > 0.5 * SHEET - 0.6 * spacing)
        # Twisted fibres at the edges grow longer; the bars come closer so that they need not.
        motion = Motion(
            (-side * 0.02 * min(abs(turns), 1.0), 0.0, 0.0),
            0.0,
            0.75 * duration,
            rotation=(side * math.pi * turns, 0.0, 0.0),
            pivot=(side * 0.5 * SHEET, 0.0, 0.0),
        )
        bars.append(Handle(name, vertices, start.positions[vertices], motion))
    contact = ContactSettings(cloth_thickness(material, mesh), friction=0.3)
    return _scene("twist", mesh, start, material, duration, contact, bars)


@checked
def pull_through(
    material: ShellMaterial,
    *,
    spacing: float = 0.0085,
    opening: float | None = None,
    duration: float = 1.5,
) -> Scene:
    """A sheet on a ring, pulled down through it by its middle.

    opening: radius of the hole [m], default ``roomy_opening`` of the cloth's thickness.
    """
    mesh = rectangle(SHEET, SHEET, spacing)
    settings = ContactSettings(cloth_thickness(material, mesh), friction=0.2)
    if opening is None:
        opening = roomy_opening(settings.thickness)
    if not (math.isfinite(opening) and 0.005 <= opening <= 0.1):
        raise InputError("opening of the ring", expected="between 0.005 and 0.1 m", found=opening)
    tube = 0.012
    start = ClothState.flat(mesh, height=tube + settings.thickness)
    middle = _near(mesh, (0.0, 0.0), 1.1 * spacing)
    pull = Motion((0.0, 0.0, -0.24), 0.0, 0.9 * duration)
    handle = Handle("middle", middle, start.positions[middle], pull)
    ring = MeshObstacle(*torus(opening + tube, tube))
    return _scene("ring", mesh, start, material, duration, settings, (handle,), (ring,))


def roomy_opening(thickness: float) -> float:
    """Radius [m] of a hole of which a sheet pulled through by its middle fills at most a quarter.

    It is fullest when the middles of the sheet's edges arrive: a circle of this radius, thickness [m] wide. Folds fill
    at most half of the area, and friction blocks compressed cloth.
    """
    return max(0.025, math.sqrt(4.0 * SHEET * thickness))


def torus(radius: float, tube: float, *, around: int = 64, across: int = 24) -> tuple[Array, Integers]:
    """A ring about the z-axis: vertices (n, 3) and triangles (m, 3) that face outwards; radii in [m]."""
    i, j = np.meshgrid(np.arange(around), np.arange(across), indexing="ij")
    a, b = 2 * math.pi * i / around, 2 * math.pi * j / across
    out = radius + tube * np.cos(b)
    points = np.stack([out * np.cos(a), out * np.sin(a), tube * np.sin(b)], axis=-1).reshape(-1, 3)
    here, next_i, next_j = i * across + j, (i + 1) % around * across + j, i * across + (j + 1) % across
    both = (i + 1) % around * across + (j + 1) % across
    triangles = np.concatenate(
        [np.stack(t, axis=-1).reshape(-1, 3) for t in ((here, next_i, both), (here, both, next_j))]
    )
    return points, triangles


def _near(mesh: TriangleMesh, point: tuple[float, float], radius: float) -> Integers:
    """Vertices within a distance of a point of the flat panel, at least the nearest one."""
    away = np.linalg.norm(mesh.panel - np.asarray(point), axis=1)
    return np.flatnonzero(away <= max(radius, float(away.min())) + 1e-9)
