"""Bounding volumes, published and homogenized, against all spline yarns: time of a step.

python benchmarks/bounding_volume.py [--quick]

Motion and quality of fit: ``yarnscale fabric --method compare``.
"""

from __future__ import annotations

import argparse
import math
import time

import numpy as np

from yarnscale.fabric.spline_knit import SplineFabric, jersey
from yarnscale.fabric.spline_motion import SplineMotion
from yarnscale.fabric.volume import BoundingVolume
from yarnscale.fabric.volume_cells import Reduction
from yarnscale.yarn.material import YarnMaterial

WOOL = YarnMaterial.preset("wool")
STEP = 1 / 240
Shape = tuple[int, int]
MODELS: dict[str, tuple[Shape | None, Reduction]] = {
    "full": (None, "published"),
    "published (5,5,2)": ((5, 5), "published"),
    "published (9,9,2)": ((9, 9), "published"),
    "homogenized (5,5,2)": ((5, 5), "homogenized"),
    "homogenized (6,6,2)": ((6, 6), "homogenized"),
}


def _moving(fabric: SplineFabric, model: str, **options: float | str) -> SplineMotion:
    shape, reduction = MODELS[model]
    volume = None if shape is None else BoundingVolume.around(fabric.control, shape)
    return SplineMotion(fabric, volume=volume, reduction=reduction, held=fabric.top, **options)  # type: ignore[arg-type]


def _seconds_a_step(moving: SplineMotion, step: float, count: int) -> tuple[float, float]:
    """Processor seconds of a step, which others on the machine disturb little, and Newton iterations; means."""
    motion, seconds, iterations = moving.step(moving.start, step).state, [], []
    for _ in range(count):
        begin = time.process_time()
        result = moving.step(motion, step)
        seconds.append(time.process_time() - begin)
        motion, _ = result.state, iterations.append(result.iterations)
    return float(np.mean(seconds)), float(np.mean(iterations))


def show_times(quick: bool) -> None:
    """Time per step and per simulated second."""
    print("stitches  model                unknowns  explicit ms  stable µs  s per s | implicit ms  Newton  s per s")
    for rows, columns in ((7, 7),) if quick else ((7, 7), (15, 30), (30, 60)):
        fabric, base = jersey(rows, columns, WOOL), None
        for model, (shape, reduction) in MODELS.items():
            moving, stable, explicit = _moving(fabric, model), math.nan, math.nan
            if reduction == "published":
                led = _moving(fabric, model, method="explicit")
                stable = led.longest_step(led.start)
                explicit, _ = _seconds_a_step(led, stable, 5 if shape is None else 50)
            few = shape is None and rows * columns > 1000
            implicit, newton = _seconds_a_step(moving, STEP, 3 if few else 12)
            found = np.array([explicit / stable, implicit / STEP])
            base = found if base is None else base
            ratio = "" if shape is None else f"  {base[0] / found[0]:.0f}x, {base[1] / found[1]:.0f}x"
            counts = moving.counts()
            print(
                f"{rows:3d}x{columns:<3d}   {model:19s} {counts.get('reduced_unknowns', counts['unknowns']):8d} "
                f"{1e3 * explicit:11.2f} {1e6 * stable:10.1f} {found[0]:8.1f} | "
                f"{1e3 * implicit:9.1f} {newton:8.1f} {found[1]:8.1f}{ratio}",
                flush=True,
            )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true")
    show_times(parser.parse_args().quick)


if __name__ == "__main__":
    main()
