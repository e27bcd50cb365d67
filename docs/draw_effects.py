"""Draw docs/pictures/effects.png: sheets held along two sides and pulled by 0.3, with and without terms of pairs.

Run ``python docs/draw_effects.py`` (a minute). HYLC20 Fig. 17: what the terms in two strains do. Seen from above and
aside; orange is the right side; the force is that of one clamp per metre of its length.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Literal

import numpy as np

from yarnscale.files.animation import Animation, Moment, Surface
from yarnscale.files.material_json import read_material
from yarnscale.motion.run import simulate
from yarnscale.motion.schedule import Schedule
from yarnscale.shell.contact.cloth_contact import ContactSettings
from yarnscale.shell.dynamics.cloth import Cloth, Handle, Motion
from yarnscale.shell.dynamics.solver import ClothSolver
from yarnscale.shell.materials.spline_material import SplineMaterial
from yarnscale.shell.mesh import rectangle
from yarnscale.shell.state import ClothState
from yarnscale.show.run_page import frames_picture

ROOT = Path(__file__).resolve().parents[1]
SIZE, SPACING, STRETCH = 0.12, 0.005, 0.3
MESH = rectangle(SIZE, SIZE, SPACING)
NAMES = ("stockinette", "rib-1x1", "honeycomb", "plain")
Direction = Literal["course", "wale"]


def pulled(material: SplineMaterial, direction: Direction) -> tuple[np.ndarray, float]:
    """Positions at rest under the pull, and the force of a clamp [N]."""
    start, axis = ClothState.flat(MESH), 0 if direction == "course" else 1
    clamps = []
    for side in (-1.0, 1.0):
        held = np.flatnonzero(side * MESH.panel[:, axis] > 0.5 * SIZE - 0.6 * SPACING)
        way = [0.0, 0.0, 0.0]
        way[axis] = side * 0.5 * STRETCH * (SIZE - SPACING)
        motion = Motion((way[0], way[1], way[2]), 0.0, 0.2)
        clamps.append(Handle(f"clamp {side:g}", held, start.positions[held], motion))
    contact = ContactSettings(thickness=1e-3)
    cloth = Cloth(MESH, material, tuple(clamps), gravity=(0, 0, 0), contact=contact, damping=3.0)
    solver = ClothSolver(cloth)
    run = simulate(solver, start, Schedule(0.3, 0.03, rough_iterations=40))
    if not run.converged or any(run.faults.values()):
        raise RuntimeError(f"no rest: {run.outcome}, frames that cross: {run.faults}")
    return run.state.positions, abs(float(solver.pull(clamps[1], run.state)[axis]))


def main() -> None:
    """Pull four fabrics along course and wale, whole and with terms of one strain only."""
    shapes: list[np.ndarray] = []
    titles: list[str] = []
    for direction in ("course", "wale"):
        for pairs in (True, False):
            for name in NAMES:
                material = read_material(ROOT / "tests" / "fabrics" / f"{name}.json")
                assert isinstance(material, SplineMaterial)
                if not pairs:
                    material = replace(material, planes={})
                positions, force = pulled(material, direction)
                told = "" if pairs else ", no pairs"
                title = f"{name}, {direction}{told}: {force / SIZE:.2g} N/m"
                print(title, flush=True)
                shapes.append(positions)
                titles.append(title)
    drawn = Animation(np.arange(float(len(shapes))), lambda k: Moment(k, cloth=shapes[k]), Surface(MESH.triangles))
    frames_picture(
        ROOT / "docs" / "pictures" / "effects.png", drawn, columns=len(NAMES), camera=(0.25, -0.6, 1.0),
        size=(500, 500), titles=titles,
    )  # fmt: skip


if __name__ == "__main__":
    main()
