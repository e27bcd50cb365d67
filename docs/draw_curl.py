"""Draw docs/pictures/curl.png: free sheets of homogenized stockinette and plain weave, let go flat.

Run ``python docs/draw_curl.py``. Orange is the right side. The knit's first and last rows roll to the right side.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from yarnscale.files.animation import Animation, Moment, Surface
from yarnscale.files.material_json import read_material
from yarnscale.motion.run import simulate
from yarnscale.motion.schedule import Schedule
from yarnscale.shell.contact.cloth_contact import ContactSettings
from yarnscale.shell.dynamics.cloth import Cloth
from yarnscale.shell.dynamics.solver import ClothSolver
from yarnscale.shell.mesh import rectangle
from yarnscale.shell.state import ClothState
from yarnscale.show.run_page import frames_picture

ROOT = Path(__file__).resolve().parents[1]
SIZE, SPACING = 0.10, 0.004
MOMENTS = (0.0, 0.04, 0.08)


def main() -> None:
    """Simulate both and draw three moments of each."""
    mesh = rectangle(SIZE, SIZE, SPACING)
    shapes: list[np.ndarray] = []
    titles: list[str] = []
    for name in ("stockinette", "plain"):
        material = read_material(ROOT / "tests" / "fabrics" / f"{name}.json")
        cloth = Cloth(mesh, material, gravity=(0, 0, 0), contact=ContactSettings(thickness=5e-4), damping=5.0)
        states: list[ClothState] = []
        schedule = Schedule(MOMENTS[-1], 0.01, to_rest=False, frame_interval=MOMENTS[1])
        simulate(
            ClothSolver(cloth),
            ClothState.flat(mesh),
            schedule,
            on_frame=lambda _, s, kept=states: kept.append(s),
        )
        shapes += [state.positions for state in states]
        titles += [f"{name}, {state.time:.2f} s" for state in states]
    numbers = np.arange(float(len(shapes)))
    drawn = Animation(numbers, lambda k: Moment(k, cloth=shapes[k]), Surface(mesh.triangles))
    frames_picture(ROOT / "docs" / "pictures" / "curl.png", drawn, columns=len(MOMENTS), titles=titles)


if __name__ == "__main__":
    main()
