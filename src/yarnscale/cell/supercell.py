"""How an equilibrium depends on the size of the cell: larger ones may buckle (HYLC20 leaves this as future work)."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from yarnscale.cell.equilibrium import Equilibrium
from yarnscale.cell.periodic import PeriodicCell
from yarnscale.errors import InputError
from yarnscale.kinematics import ShellStrain

LARGEST_VERTEX_COUNT = 5000
"""Vertices of the largest cell that a study solves."""


@dataclass(frozen=True, eq=False)
class SizeResult:
    """One cell size of a study.

    size: tiles along x and y. energy_density: of the lowest equilibrium found [J/m²]. drop: how far it lies below that
    of one tile, relative to it; where it is above round-off, larger cells buckle. iterations, seconds: of all starts.
    """

    size: tuple[int, int]
    vertices: int
    energy_density: float
    drop: float
    iterations: int
    seconds: float
    state: Equilibrium


def supercell(cell: PeriodicCell, size: tuple[int, int]) -> PeriodicCell:
    """The same fabric and material with a period of ``size`` tiles."""
    if size == (1, 1):
        return cell
    return replace(cell, pattern=cell.pattern.repeated(*size))


def check_size(cell: PeriodicCell, size: tuple[int, int]) -> None:
    """InputError for a size that is no positive number of tiles, or too large."""
    count = len(cell.pattern.edges) * size[0] * size[1]
    if min(size) < 1 or count > LARGEST_VERTEX_COUNT:
        raise InputError(
            f"cell size {size[0]}x{size[1]}",
            expected=f"positive numbers of tiles, at most {LARGEST_VERTEX_COUNT} vertices",
            found=f"{count} vertices",
        )


def tiled(state: Equilibrium, size: tuple[int, int]) -> Equilibrium:
    """An equilibrium as the start of a larger cell: every tile does the same."""
    copies = size[0] * size[1]
    fluctuation, twist = np.tile(state.fluctuation, (copies, 1)), np.tile(state.twist, copies)
    return replace(state, fluctuation=fluctuation, twist=twist)


def study(
    cell: PeriodicCell, strain: ShellStrain, sizes: Sequence[tuple[int, int]], *, starts: int = 3
) -> list[SizeResult]:
    """Relax cells of several sizes under one state; the first one solved is a single tile, that ``drop`` refers to.

    A larger cell starts from the equilibrium of one tile, repeated, and from perturbations of it; the lowest of
    ``starts`` equilibria counts. InputError for sizes that are no positive numbers of tiles or too large.
    """
    if not sizes:
        raise InputError("cell sizes", expected="at least one, e.g. 2x1", found="none")
    for size in sizes:
        check_size(cell, size)
    cell = cell.with_options(starts=starts)
    began = time.perf_counter()
    single = cell.relax(strain)
    alone = time.perf_counter() - began
    results = []
    for size in sizes:
        if size == (1, 1):
            state, seconds = single, alone
        else:
            began = time.perf_counter()
            state = supercell(cell, size).relax(strain, start=tiled(single, size))
            seconds = time.perf_counter() - began
        drop = (single.energy_density - state.energy_density) / max(abs(single.energy_density), 1e-300)
        results.append(
            SizeResult(
                size=size,
                vertices=len(state.twist),
                energy_density=state.energy_density,
                drop=drop,
                iterations=state.iterations,
                seconds=seconds,
                state=state,
            )
        )
    return results
