"""How long a cell takes to relax, and where the time of an iteration goes; one thread.

Run ``python benchmarks/cell_relax.py [PATTERN …]`` with names or files of patterns (default: stockinette.pyp and
satin.pyp of the reference data folder, ``../shared`` or ``$YARNSCALE_SHARED``; else the built-in stockinette).
Start-up (imports, compilation, loading of kernels) is not counted: a first solve warms everything.
"""

from __future__ import annotations

import argparse
import os
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from unittest import mock

import numpy as np

from yarnscale.cell import PeriodicCell
from yarnscale.cell import energy as cell_energy
from yarnscale.files.patterns import read_pattern
from yarnscale.kinematics import ShellStrain
from yarnscale.numerics import assembly, block_pattern, factor
from yarnscale.yarn import contact_list
from yarnscale.yarn.material import PRESETS, YarnMaterial

TARGET = 0.2
"""Seconds from rest to s_x = 0.33 of the published stockinette."""


@dataclass
class Profile:
    """Seconds spent inside named calls; a call within another counts for the inner one only."""

    seconds: dict[str, float] = field(default_factory=dict)
    _inside: list[float] = field(default_factory=list)

    def wrap(self, name: str, function: Callable) -> Callable:
        def measured(*args, **kwargs):  # type: ignore[no-untyped-def]
            start = time.perf_counter()
            self._inside.append(0.0)
            try:
                return function(*args, **kwargs)
            finally:
                elapsed = time.perf_counter() - start
                inner = self._inside.pop()
                self.seconds[name] = self.seconds.get(name, 0.0) + elapsed - inner
                if self._inside:
                    self._inside[-1] += elapsed

        return measured


def places() -> list[tuple[str, object, str]]:
    """(name in the table, owner, attribute) of what is measured."""
    backend = factor.Factorisation
    return [
        ("kernels and scatter: Hessian", assembly.StencilSet, "hessian"),
        ("kernels and scatter: gradient", assembly.StencilSet, "gradient"),
        ("kernels: energy", assembly.StencilSet, "value"),
        ("pair search", contact_list, "close_pairs"),
        ("stencils of new pairs", contact_list, "StencilSet"),
        ("matrix pattern and slots", block_pattern.BlockPattern, "slots"),
        ("matrix pattern and slots", block_pattern.BlockPattern, "of"),
        ("symbolic analysis", backend, "__init__"),
        ("factor", backend, "factor"),
        ("solve", backend, "solve"),
        ("step bound", cell_energy.CellEnergy, "bound"),
    ]


def relax_with_profile(cell: PeriodicCell, strain: ShellStrain) -> tuple[Profile, int, int, float]:
    """Seconds by place, iterations, factorisations and all seconds of one relaxation."""
    profile = Profile()
    patches = []
    for name, owner, attribute in places():
        patches.append(mock.patch.object(owner, attribute, profile.wrap(name, getattr(owner, attribute))))
    for patch in patches:
        patch.start()
    try:
        start = time.perf_counter()
        state = cell.relax(strain)
        total = time.perf_counter() - start
    finally:
        for patch in patches:
            patch.stop()
    return profile, state.iterations, state.factorisations, total


def timed(cell: PeriodicCell, strain: ShellStrain, repeats: int) -> tuple[float, int, str]:
    """Median seconds, iterations and status."""
    seconds = []
    for _ in range(repeats):
        start = time.perf_counter()
        state = cell.relax(strain)
        seconds.append(time.perf_counter() - start)
    return float(np.median(seconds)), state.iterations, state.status.name


def material_of(name: str) -> YarnMaterial:
    preset = f"hylc2020-{name}"
    return YarnMaterial.preset(preset if preset in PRESETS else "hylc2020-stockinette")


def report(source: str, states: int) -> None:
    pattern = read_pattern(source)
    cell = PeriodicCell(pattern, material_of(Path(source).stem))
    cell.relax(ShellStrain(0.05, 0.02, 0.0, 5.0))
    cell.relax(ShellStrain(0.05))
    print(f"\n{Path(source).stem}: {len(pattern.edges)} vertices")
    for strain in (ShellStrain(), ShellStrain(0.33), ShellStrain(s_y=0.33), ShellStrain(II11=60.0)):
        seconds, iterations, status = timed(cell, strain, 5)
        target = f"  (target {TARGET} s)" if strain.s_x == 0.33 else ""
        print(f"  rest → {strain.vector}: {seconds:.3f} s, {iterations} iterations, {status}{target}")

    strain = ShellStrain(0.33)
    profile, iterations, factorisations, total = relax_with_profile(cell, strain)
    print(f"  ms per iteration at s_x = 0.33 ({iterations} iterations, {factorisations} factorisations)")
    shares = {**profile.seconds, "rest": total - sum(profile.seconds.values())}
    for name, seconds in sorted(shares.items(), key=lambda item: -item[1]):
        print(f"    {name:32}{1e3 * seconds / max(iterations, 1):8.3f}{100 * seconds / total:7.1f} %")
    print(f"    {'all':32}{1e3 * total / max(iterations, 1):8.3f}")

    rng = np.random.default_rng(0)
    rows = []
    for _ in range(states):
        vector = np.array([rng.uniform(-0.15, 0.6), rng.uniform(-0.4, 0.4), rng.uniform(-0.15, 0.6), 0, 0, 0])
        if rng.random() < 0.5:
            vector[rng.choice([3, 5])] = rng.uniform(-60, 60)
        start = time.perf_counter()
        state = cell.relax(ShellStrain.from_vector(vector))
        rows.append((time.perf_counter() - start, state.iterations, state.converged))
    seconds, iterations, converged = np.array(rows).T
    print(
        f"  {states} random states from rest: {seconds.sum():.2f} s, {converged.sum():.0f} converged;",
        end=" ",
    )
    print(f"seconds median {np.median(seconds):.3f}, most {seconds.max():.3f};", end=" ")
    print(f"iterations median {np.median(iterations):.0f}, most {iterations.max():.0f};", end=" ")
    print(f"{1e3 * seconds.sum() / iterations.sum():.2f} ms per iteration")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("patterns", nargs="*", help="names or files of patterns")
    parser.add_argument("--states", type=int, default=20, help="random states per pattern")
    options = parser.parse_args()
    here = Path(os.environ.get("YARNSCALE_SHARED") or Path(__file__).resolve().parents[2] / "shared")
    published = [str(here / "reference" / f"{name}.pyp") for name in ("stockinette", "satin")]
    sources = options.patterns or (published if Path(published[0]).is_file() else ["stockinette"])
    for source in sources:
        report(source, options.states)


if __name__ == "__main__":
    main()
