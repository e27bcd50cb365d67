"""Time and memory of the direct simulation: Hessian, factor, one implicit and one explicit step, by size of the fabric.

python benchmarks/direct_fabric.py [pattern] [sizes in m, such as 0.05,0.1,0.3]
"""

from __future__ import annotations

import resource
import sys
import time
from collections.abc import Callable
from typing import TypeVar

from yarnscale.cell import PeriodicCell
from yarnscale.fabric.boundary import glue
from yarnscale.fabric.direct_energy import FabricEnergy
from yarnscale.fabric.direct_motion import FabricDynamics, MotionSettings
from yarnscale.fabric.direct_moves import PassageCount
from yarnscale.fabric.sheet import YarnSheet
from yarnscale.fabric.sheet_scene import drape
from yarnscale.numerics.factor import factorisation
from yarnscale.yarn import library
from yarnscale.yarn.material import YarnMaterial

STEP = 1 / 120
FRAME = 1 / 30
T = TypeVar("T")


def timed(function: Callable[[], T]) -> tuple[float, T]:
    begin = time.perf_counter()
    result = function()
    return time.perf_counter() - begin, result


def measure(name: str, size: float) -> None:
    pattern, material = library.build(name), YarnMaterial.preset(library.structure(name).material)
    cell = PeriodicCell(pattern, material)
    state = cell.relax()
    sheet = YarnSheet.filling(pattern, size, size)
    sheet = sheet.moved(cell.placement(state)(sheet.source, sheet.tile), twist=state.twist[sheet.source])
    energy = FabricEnergy(sheet, material, springs=glue(sheet, material))
    x = energy.start()
    energy.hessian(x)
    gradient, _ = timed(lambda: energy.gradient(x))
    hessian, (_, _, _, block, entries) = timed(lambda: energy.hessian(x))
    entries = entries + 1e-3 * energy.ties(x)
    entries[block.pattern.diagonal] += 1e-2 * abs(entries[block.pattern.diagonal]).mean()
    analysis, factor = timed(lambda: factorisation(block.pattern))
    seconds, done = timed(lambda: factor.factor(entries))
    scene = drape(sheet)
    count = PassageCount(energy, x)
    dynamics = FabricDynamics(
        energy, MotionSettings(scene.gravity, 5.0), scene.holds, scene.obstacles(energy), count
    )
    implicit, step = timed(lambda: dynamics.implicit(dynamics.start(), STEP))
    stable = dynamics.stable_step(dynamics.start())
    explicit, _ = timed(lambda: dynamics.explicit(dynamics.start(), stable))
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20
    ended = "ok" if done else "indefinite"
    implicit_frame, explicit_frame = implicit / STEP * FRAME, explicit / stable * FRAME
    print(f"{name} {size:g} m: {sheet.vertex_count} vertices, {memory:.1f} GB, passages {count.passages}")
    print(
        f"  gradient {gradient:.3f} s, Hessian {hessian:.3f} s, analysis {analysis:.2f} s, "
        f"factor {seconds:.2f} s ({ended})"
    )
    print(f"  implicit: step {implicit:.1f} s, {step.iterations} iterations, {implicit_frame:.0f} s a frame")
    print(f"  explicit: step {explicit:.3f} s of {stable:.1e} s, {explicit_frame:.0f} s a frame")


if __name__ == "__main__":
    chosen = sys.argv[1] if len(sys.argv) > 1 else "stockinette"
    sizes = sys.argv[2] if len(sys.argv) > 2 else "0.05,0.1"
    for text in sizes.split(","):
        measure(chosen, float(text))
