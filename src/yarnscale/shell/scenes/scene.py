"""Scenes: a cloth, its start, its schedule and the quantities measured at the end; two built-in ones."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from yarnscale.arrays import Array, Integers
from yarnscale.checked import checked
from yarnscale.errors import InputError
from yarnscale.motion.handles import Handle
from yarnscale.motion.obstacles import Sphere
from yarnscale.motion.rigid import Motion
from yarnscale.motion.run import Run
from yarnscale.motion.scene import SimulatedOutcome, SimulatedScene
from yarnscale.motion.schedule import Schedule
from yarnscale.shell.contact.cloth_contact import ContactSettings
from yarnscale.shell.dynamics.cloth import Cloth
from yarnscale.shell.dynamics.solver import ClothSolver, SolverOptions
from yarnscale.shell.elastic.out_of_range import OutOfRange, out_of_range
from yarnscale.shell.materials.material import ShellMaterial
from yarnscale.shell.mesh import TriangleMesh, rectangle
from yarnscale.shell.scenes.thickness import cloth_thickness
from yarnscale.shell.state import ClothState

Measure = Callable[[ClothSolver, ClothState], Mapping[str, float]]

SHEET = 0.30
"""Edge of the square sheet of both built-in scenes [m]."""
SPACING = 0.0065
"""Edge length of its triangles [m]: 2612 vertices."""
BAR_WIDTH, BAR_LENGTH, BAR_INSET = 0.021, 0.201, 0.048
"""The bars of the published stretch tests [m]: strips with their centre lines 48 mm inside opposite edges."""
BAR_TRAVEL = {"stockinette": 0.035, "basket": 0.020, "rib": 0.040}
"""Displacement of each bar in the published tests [m]; of the rib along its wale."""
AIR_DRAG = 10.0
"""Of the published stretch tests, quadratic in the speed across the surface [kg/m³]."""
BAR_GAP = SHEET - 2 * BAR_INSET - BAR_WIDTH
"""Distance between the facing edges of the bars at rest [m]; it grows by the amount of the stretch."""


@checked
@dataclass(frozen=True, eq=False)
class Scene(SimulatedScene[ClothState, "SceneResult"]):
    """Something to simulate: name, cloth, first state, schedule and what to measure of the last state.

    may_give_way: whether unfulfilled motion of handles and obstacles is allowed; else such a run fails.
    notices: sentences about sizes and unlikely values.
    """

    name: str
    cloth: Cloth
    start: ClothState
    schedule: Schedule
    options: SolverOptions = field(default_factory=SolverOptions)
    measure: Measure | None = None
    may_give_way: bool = False
    notices: tuple[str, ...] = ()

    @property
    def settings(self) -> dict[str, object]:
        return {name: getattr(self, name) for name in ("cloth", "start", "schedule", "options")}

    @property
    def body(self) -> ClothSolver:
        """A solver of its own for every run."""
        return ClothSolver(self.cloth, self.options)

    def outcome(self, body: ClothSolver, run: Run[ClothState], seconds: float) -> SceneResult:
        measures = {} if self.measure is None else dict(self.measure(body, run.state))
        return SceneResult(self, run, seconds, measures, out_of_range(body.energy, run.state.positions))

    def __repr__(self) -> str:
        return f"Scene('{self.name}': {self.cloth!r}, {self.schedule.duration:g} s)"


@dataclass(frozen=True, eq=False)
class SceneResult(SimulatedOutcome[ClothState]):
    """Outcome of a scene: its run, seconds of work, and ``measures`` of the scene."""

    scene: Scene
    measures: Mapping[str, float]
    out_of_range: OutOfRange | None = None

    def __repr__(self) -> str:
        measures = ", ".join(f"{name}={value:.4g}" for name, value in self.measures.items())
        return f"SceneResult('{self.scene.name}': {self.run.outcome} in {self.run.steps} steps; {measures})"

    @property
    def intersections(self) -> int | None:
        """Frames, the last state among them, in which the cloth crosses itself or a body; None: not tested."""
        return self.run.faults.get("intersections")

    @property
    def obstacle_intersections(self) -> int | None:
        """Frames in which the cloth crosses an obstacle; None without obstacles."""
        return self.run.faults.get("obstacle_intersections")

    def summary(self) -> dict[str, object]:
        """Everything but the shape, as plain values."""
        return {
            "scene": self.scene.name,
            **{name: float(value) for name, value in self.measures.items()},
            "vertices": self.scene.cloth.mesh.vertex_count,
            "intersections": None,
            "obstacle_intersections": None,
            **self.run.summary(),
            "out_of_range": None if self.out_of_range is None else self.out_of_range.plain(),
            "seconds": self.seconds,
        }


@checked
def stretch(
    material: ShellMaterial,
    *,
    direction: Literal["course", "wale"] = "course",
    amount: float = 0.2,
    travel: float | None = None,
    duration: float | None = None,
    air_drag: float = AIR_DRAG,
    size: float = SHEET,
    spacing: float | None = None,
    time_step: float = 0.05,
    self_contact: bool = True,
    frame_interval: float | None = None,
) -> Scene:
    """A square sheet between two bars that move apart until their gap has grown by ``amount``, then at rest.

    The published test of HYLC20 (Fig. 16): 30×30 cm, gravity −z, bars as ``BAR_WIDTH`` etc. travel: displacement of
    each bar [m], instead of ``amount``; published ones in ``BAR_TRAVEL``. duration: of the motion [s], default
    ``bar_duration``. air_drag: [kg/m³]. size: of the sheet [m]; bars and triangles (``spacing``, by default) grow with
    it. Measures: ``lambda_along``, ``lambda_across`` (area-weighted stretch over the central fifth of both edges) and
    ``bar_force`` [N]. Without self-contact the curled edges of a knit intersect themselves.
    Raises InputError.
    """
    if direction not in ("course", "wale"):
        raise InputError("direction", expected="course or wale", found=direction)
    if not (np.isfinite(amount) and -0.5 < amount < 5):
        raise InputError("amount", expected="a number between -0.5 and 5", found=amount)
    if not (math.isfinite(size) and 0.005 <= size <= 5):
        raise InputError("size of the sheet", expected="between 0.005 and 5 m", found=size)
    scale = size / SHEET
    gap = scale * BAR_GAP
    if travel is None:
        travel = 0.5 * amount * gap
    if not (math.isfinite(travel) and -0.25 < travel / gap < 2.5):
        limits = f"between {-0.25 * gap:g} and {2.5 * gap:g} m"
        raise InputError("travel of a bar", expected=limits, found=travel)
    if duration is None:
        duration = bar_duration(travel)
    axis = 0 if direction == "course" else 1
    mesh = rectangle(size, size, scale * SPACING if spacing is None else spacing)
    start = ClothState.flat(mesh)
    shift = np.zeros(3)
    shift[axis] = travel
    bars = []
    for name, side in (("first bar", -1.0), ("second bar", 1.0)):
        vertices = bar_points(mesh.panel, axis, side, size)
        displacement = side * shift
        motion = Motion((displacement[0], displacement[1], displacement[2]), 0.0, duration)
        bars.append(Handle(name, vertices, start.positions[vertices], motion))
    contact = ContactSettings(thickness=cloth_thickness(material, mesh)) if self_contact else None
    cloth = Cloth(mesh, material, tuple(bars), contact=contact, air_drag=air_drag)

    def measure(solver: ClothSolver, state: ClothState) -> dict[str, float]:
        stretches = central_stretch(mesh, state.positions, 0.03 * scale)
        forces = [abs(float(solver.pull(bar, state)[axis])) for bar in bars]
        return {
            "lambda_along": float(stretches[axis]),
            "lambda_across": float(stretches[1 - axis]),
            "bar_force": float(np.mean(forces)),
        }

    # Only the final equilibrium counts; the dynamics before it need not be solved exactly.
    schedule = Schedule(duration, time_step, frame_interval=frame_interval, rough_iterations=30)
    return Scene(f"stretch {direction}", cloth, start, schedule, measure=measure)


def bar_points(points: Array, axis: int, side: float, size: float) -> Integers:
    """Which points (n, 2) [m] of a flat sheet centred on 0 belong to a bar of the stretch test.

    axis: of the pull; side: −1 or 1, on which the bar is; size: of the sheet [m], as in ``stretch``.
    """
    scale = size / SHEET
    centre, half = np.zeros(2), np.full(2, 0.5 * scale * BAR_LENGTH)
    centre[axis] = side * scale * (0.5 * SHEET - BAR_INSET)
    half[axis] = 0.5 * scale * BAR_WIDTH
    return np.flatnonzero((np.abs(points - centre) <= half + 1e-9).all(axis=1))


def bar_duration(travel: float) -> float:
    """Duration [s] of a displacement [m] of the bars of the stretch test.

    The published 0.4 s for 35 mm, 0.25 s for 20 mm and 0.45 s for 40 mm lie on a line: 0.1 m/s and 0.05 s.
    """
    return 0.05 + abs(travel) / 0.1


@checked
def drape(
    material: ShellMaterial,
    *,
    radius: float = 0.07,
    spacing: float = SPACING,
    duration: float = 1.0,
    time_step: float = 0.025,
    to_rest: bool = False,
    friction: float = 0.3,
    self_contact: bool = True,
    frame_interval: float | None = None,
) -> Scene:
    """A square sheet that falls on a ball of ``radius`` [m] at the origin, for ``duration`` [s].

    Measures: see ``measure_sheet``.
    """
    mesh = rectangle(SHEET, SHEET, spacing)
    settings = ContactSettings(cloth_thickness(material, mesh), self_contact=self_contact, friction=friction)
    ball = Sphere((0.0, 0.0, 0.0), radius)
    start = ClothState.flat(mesh, height=radius + settings.thickness)
    cloth = Cloth(mesh, material, contact=settings, obstacles=(ball,), damping=2.0)

    schedule = Schedule(duration, time_step, to_rest=to_rest, frame_interval=frame_interval, rough_iterations=20)
    return Scene("drape", cloth, start, schedule, measure=measure_sheet)


def measure_sheet(solver: ClothSolver, state: ClothState) -> dict[str, float]:
    """``lowest`` and ``highest`` point, ``closest`` distance of surfaces [m], root mean square ``speed`` [m/s]."""
    heights = state.positions[:, 2]
    return {
        "lowest": float(heights.min()),
        "highest": float(heights.max()),
        "closest": solver.closest(state),
        "speed": float(np.sqrt((state.velocities**2).sum(axis=1).mean())),
    }


def central_stretch(mesh: TriangleMesh, positions: Array, half: float) -> Array:
    """√I11 and √I22, area-weighted over triangles with their centre within ±half [m] of the panel's, (2,)."""
    triangles = mesh.triangles
    near = (np.abs(mesh.panel[mesh.corners].mean(axis=1)) < half).all(axis=1)
    corners = positions[triangles[near]]
    edges = np.stack([corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]], axis=2)
    gradient = edges @ mesh.inverse_rest[near]
    lengths = np.linalg.norm(gradient, axis=1)
    return mesh.areas[near] @ lengths / mesh.areas[near].sum()
