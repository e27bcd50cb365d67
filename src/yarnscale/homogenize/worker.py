"""One solve of a sampling run; a worker process loads this and no more."""

from __future__ import annotations

import os
import signal
from dataclasses import dataclass
from multiprocessing import parent_process
from multiprocessing.connection import wait
from pathlib import Path
from threading import Thread

import numpy as np

from yarnscale.arrays import Array
from yarnscale.cell.equilibrium import Equilibrium, Start
from yarnscale.cell.periodic import PeriodicCell
from yarnscale.homogeneous.fabrics import CellFabric, Response, moduli_or_nan
from yarnscale.homogeneous.loads import LoadedState, Loads, Prescribed, equilibrium_under
from yarnscale.kinematics import ShellStrain
from yarnscale.numerics.newton import Status

STRAINS = ("s_x", "s_a", "s_y", "lambda_x", "lambda_y")
"""Coordinates of a sampled state: stretches and shear [-], curvature along x or along y [1/m]."""

STATUS_CODES = {
    0: "pending",
    1: Status.CONVERGED.name.lower(),
    2: Status.STALLED.name.lower(),
    3: Status.ITERATION_LIMIT.name.lower(),
    4: Status.INVALID.name.lower(),
    5: "passages",
    6: "excluded",
}
"""Meaning of ``status``: yarns of ``passages`` passed through each other, ``excluded`` ones bend in two directions."""
CODE_OF = {name: code for code, name in STATUS_CODES.items()}


def strain_of(state: Array) -> ShellStrain:
    """Macroscopic state of (s_x, s_a, s_y, λ_x, λ_y)."""
    return ShellStrain(state[0], state[1], state[2], state[3], 0.0, state[4])


def record(state: Equilibrium) -> dict[str, object]:
    """What every store keeps of an equilibrium."""
    return {
        "energy_density": state.energy_density,
        "stress": state.stress,
        "iterations": state.iterations,
        "seconds": state.seconds,
        "residual": state.residual,
        "min_distance_over_diameter": state.min_distance_over_diameter,
        "fluctuation": state.fluctuation,
        "twist": state.twist,
        "positions": state.positions,
        "status": CODE_OF[state.outcome],
    }


def prepare() -> None:
    """Make this process a worker that ends with the process that started it, and silently on Ctrl-C."""
    if hasattr(signal, "pthread_sigmask"):
        signal.signal(signal.SIGINT, signal.SIG_DFL)
        signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
    parent = parent_process()
    if parent is not None:
        Thread(target=_follow, args=(parent.sentinel,), daemon=True).start()


def _follow(sentinel: int) -> None:
    """End with the parent: a worker would wait for work for ever, since its siblings hold the queue open."""
    wait([sentinel])
    os._exit(1)


@dataclass(frozen=True, eq=False)
class LoadedStart(Start):
    """A start of which energy density [J/m²], stress (6,) and moduli (6, 6) are known too."""

    energy: float
    stress: Array
    moduli: Array


def solve(
    cell: PeriodicCell, state: Array, start: Start | None, moduli: bool = False
) -> tuple[dict[str, object], float]:
    """One solve, run by a worker: its record, with moduli if asked, and the worker's peak memory [MB]."""
    equilibrium = cell.relax(strain_of(state), start=start)
    extra = {"moduli": moduli_or_nan(CellFabric(cell), Response.of(equilibrium))} if moduli else {}
    return record(equilibrium) | extra, peak_megabytes()


LEVEL_TOLERANCE, LEVEL_FLOOR = 0.1, 2e-5
"""Load that may be missing where the next level begins, as a share of its own or [N/m]."""
LEVEL_STEP = 0.24
"""Largest change of a scaled strain between the samples of a level, times the larger stretch."""
BENT_ENOUGH, CRUSHED = 0.25, -0.72
"""Curvature times yarn radius, and stretch, at which a ray ends: rolled up or crushed flat, solves fail often."""


def sample_level(
    cell: PeriodicCell, loads: Loads, prescribed: Prescribed, start: LoadedStart | None, iterates: int
) -> tuple[tuple[list[dict[str, object]], bool], float]:
    """Equilibria between a start and loads, at most ``iterates``: their records, whether the ray ends there because
    the fabric has no equilibrium beyond, is rolled up or crushed, and peak memory [MB].

    Every step of the macroscopic Newton method is an equilibrium of the yarns, and so a sample.
    """
    found: list[dict[str, object]] = []
    if start is not None:
        strain = start.strain.vector
        bent = np.abs(strain[3:]).max() * cell.pattern.radius > BENT_ENOUGH
        if bent or min(strain[0], strain[2]) < CRUSHED:
            return (found, True), peak_megabytes()

    def keep(response: Response, moduli: Array) -> None:
        found.append(record(response.state) | {"strain": response.strain, "moduli": moduli})

    before, stretch = None, 1.0
    if start is not None:
        stretch += max(0.0, start.strain.s_x, start.strain.s_y)
        there = Response(start.strain.vector, start.energy, start.stress, state=start)
        before = LoadedState(there, start.moduli, 0.0, Status.CONVERGED, 0)
    outcome = equilibrium_under(
        CellFabric(cell), loads, prescribed=prescribed, start=before, tolerance=LEVEL_TOLERANCE, floor=LEVEL_FLOOR,
        radius=LEVEL_STEP * stretch, max_iterations=iterates, observe=keep,
    )  # fmt: skip
    return (found, outcome.status in (Status.STALLED, Status.INVALID)), peak_megabytes()


def peak_megabytes() -> float:
    """Largest memory of this process [MB]."""
    try:
        # getrusage would count what the parent held when it started this process.
        for line in Path("/proc/self/status").read_text().splitlines():
            if line.startswith("VmHWM:"):
                return float(line.split()[1]) / 1024.0
    except OSError:
        pass
    try:
        import resource
    except ImportError:  # no such module on Windows
        return float("nan")
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0
