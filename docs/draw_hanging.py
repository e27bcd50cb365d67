"""Draw docs/pictures/hanging.png: the hanging jersey of LOD03 Figures 10–13, all its yarns and in a bounding volume.

Run ``python docs/draw_hanging.py``. Above, every yarn with its contacts; below, the same yarns in a volume of (5, 5, 2)
control points. The fabric is let go flat and lying, held by the seven loops of its last row, and swings down.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from yarnscale.fabric.spline_knit import jersey
from yarnscale.fabric.spline_motion import SplineMotion, YarnMotion
from yarnscale.fabric.volume import BoundingVolume
from yarnscale.motion.run import simulate
from yarnscale.motion.schedule import Schedule
from yarnscale.show import theme
from yarnscale.show.canvas import aim, canvas, light
from yarnscale.show.curves import Curve
from yarnscale.show.seen_tubes import tube_mesh
from yarnscale.yarn.material import YarnMaterial

ROOT = Path(__file__).resolve().parents[1]
WIDTH, HEIGHT = 1440, 640
MOMENTS = (0.4, 1.0, 2.0, 3.0)
GRAVITY = (0.0, -9.81 * np.sin(0.5), -9.81 * np.cos(0.5))
"""Downwards, in the frame of the fabric as it is let go: 0.5 rad from lying level [m/s²]."""


def main() -> None:
    """Simulate both and draw four moments of each."""
    fabric = jersey(7, 7, YarnMaterial.preset("wool"))
    shown: list[list[np.ndarray]] = []
    for volume in (None, BoundingVolume.around(fabric.control, (5, 5))):
        moving = SplineMotion(fabric, volume=volume, held=fabric.top, gravity=GRAVITY, damping=1.0)
        frames: list[np.ndarray] = []

        def keep(
            number: int, motion: YarnMotion, moving: SplineMotion = moving, frames: list[np.ndarray] = frames
        ) -> None:
            if any(abs(motion.time - moment) < 1e-6 for moment in MOMENTS):
                frames.append(fabric.lines(moving.yarns(motion).positions, 2))

        schedule = Schedule(MOMENTS[-1], 1 / 240, to_rest=False, frame_interval=0.2)
        run = simulate(moving, moving.start, schedule, on_frame=keep)
        print(run.outcome, run.steps, "steps")
        shown.append(frames)
    # Turned so that gravity points down in the picture.
    down = np.asarray(GRAVITY) / np.linalg.norm(GRAVITY)
    turn = np.stack([[1.0, 0.0, 0.0], np.cross([1.0, 0.0, 0.0], down), -down])
    everything = np.concatenate([np.concatenate(frames) for frames in shown]).reshape(-1, 3) @ turn.T
    with canvas(ROOT / "docs" / "pictures" / "hanging.png", size=(WIDTH, HEIGHT), shape=(2, len(MOMENTS))) as plotter:
        for row, frames in enumerate(shown):
            for column, lines in enumerate(frames):
                plotter.subplot(row, column)
                plotter.set_background(theme.PAPER)
                light(plotter)
                curves = [Curve(line @ turn.T, yarn) for yarn, line in enumerate(lines)]
                plotter.add_mesh(tube_mesh(curves, fabric.radius), scalars="colour", rgb=True, smooth_shading=True)
                label = "every yarn" if row == 0 else "volume (5, 5, 2)"
                plotter.add_text(f"{label}, {MOMENTS[column]:g} s", font_size=11, color=theme.INK)
                aim(plotter, everything, camera=(0.6, 1.6, 0.5), aspect=WIDTH / len(MOMENTS) / (HEIGHT / 2))


if __name__ == "__main__":
    main()
