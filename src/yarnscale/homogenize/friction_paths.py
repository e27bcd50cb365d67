"""Paths of a cell with friction for a shell material: tension, shear and bending in cycles of growing amplitude.

The cell goes through cycles of loads with friction, and along the same strains without. States of a frictionless
fabric under the same loads would not do: friction keeps fabric off the states into which that slips.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from zipfile import BadZipFile

import numpy as np

from yarnscale.arrays import Array
from yarnscale.cell.equilibrium import Equilibrium
from yarnscale.cell.friction import CellHistory
from yarnscale.cell.periodic import PeriodicCell
from yarnscale.errors import InputError
from yarnscale.homogeneous.histories import followed, history_of, path_with_friction, under_loads
from yarnscale.homogeneous.loads import FLAT, Loads, Prescribed
from yarnscale.homogenize.sample import SamplingProgress, work_off
from yarnscale.homogenize.units import Task
from yarnscale.homogenize.worker import peak_megabytes
from yarnscale.kinematics import ShellStrain
from yarnscale.yarn.friction import YarnFriction

COUNT = 14
"""Sliders of a fitted material."""
STEPS = 12
"""Steps between two turns."""
_ROUGH = 0.03
"""Share of the loads that a state may miss: its strain and stress are what counts."""
_FIRST_STEP = 0.005
"""Stretch s_x of a first step."""
_SMALL = 4e-4
"""Of the largest load: what counts as none where loads grow by shares."""
_AMPLITUDES = ((0.004, 0.0004), (0.04, 0.002), (0.1, 0.005), (0.2, 0.01), (1.0, 0.004))
"""Where loads of tension turn, of the largest: above, and below."""
_PULLS = (0.02, 0.2)
"""Tension both ways of sheared pieces, and along which bent ones, of the largest load."""
_SHEARS = (0.0, 0.004, -0.004, 0.02, -0.02, 0.06, -0.06, 0.14, -0.14, 0.0)
_BENDS = (0.0, 0.003, -0.003, 0.015, -0.015, 0.035, -0.035, 0.08, -0.08, 0.0)
"""Where shear s_a turns, and curvature times the yarn radius."""

Corner = tuple[Loads, Prescribed]


@dataclass(frozen=True, eq=False)
class FrictionPath:
    """A path of a cell: strains (n, 6) and stresses with friction and without (n, 6); the first state is at rest.

    name: of the test. complete: whether the cell could follow to the end.
    """

    name: str
    strains: Array
    stresses: Array
    elastic: Array
    complete: bool

    @classmethod
    def none(cls, name: str) -> FrictionPath:
        """A path that could not begin."""
        return cls(name, *np.zeros((3, 0, 6)), complete=False)


def check_friction(cell: PeriodicCell, friction: YarnFriction) -> None:
    """InputError where a cell has no first step with friction, before anything long begins."""
    rest = cell.relax()
    first = ShellStrain.from_vector(rest.strain.vector + _FIRST_STEP * np.eye(6)[0])
    if not rest.usable or not list(path_with_friction(CellHistory.begin(cell, friction, rest), [first])):
        raise InputError("paths with friction", expected="a cell that rests and can be stretched", found="none")


def friction_paths(
    cell: PeriodicCell,
    friction: YarnFriction,
    *,
    limit: float,
    folder: Path,
    workers: int = 1,
    dask: str | None = None,
    progress: Callable[[SamplingProgress], None] | None = None,
) -> list[FrictionPath]:
    """Paths of a cell up to loads of ``limit`` [N/m].

    folder: where each path is kept once it is done; those of the same loads and friction are not walked again.
    workers, dask, progress: as of ``sample``.
    """
    work = _PathUnits(folder, dict(_programme(cell.pattern.radius, limit)), friction)
    work_off(work, cell, workers=workers, dask=dask, progress=progress)
    missing = [FrictionPath.none(name) for name in work.names]
    return [work.found.get(unit, path) for unit, path in enumerate(missing)]


class _PathUnits:
    """Paths to walk, each on its own; kept as ``NAME.npz`` with what was asked for."""

    def __init__(self, folder: Path, planned: Mapping[str, Sequence[Corner]], friction: YarnFriction) -> None:
        self.folder, self.planned, self.friction = folder, planned, friction
        self.names, self.total = list(planned), len(planned)
        self.found = {unit: path for unit, name in enumerate(planned) if (path := self._kept(name)) is not None}

    def _asked(self, name: str) -> dict[str, Array]:
        return {
            "corners": np.array([_numbers(*corner) for corner in self.planned[name]]),
            "friction": np.array(self.friction.coefficient),
            "walk": np.array([STEPS, _ROUGH]),
        }

    def _kept(self, name: str) -> FrictionPath | None:
        try:
            with np.load(self._file(name)) as kept:
                if any(not np.array_equal(kept[key], value) for key, value in self._asked(name).items()):
                    return None
                arrays = [kept[key] for key in ("strains", "stresses", "elastic")]
        except (OSError, KeyError, ValueError, BadZipFile):
            return None
        return FrictionPath(name, *arrays, complete=len(arrays[0]) == _length(self.planned[name]))

    def _file(self, name: str) -> Path:
        return self.folder / f"{name.replace(' ', '-')}.npz"

    def pending(self) -> list[int]:
        return [unit for unit in range(self.total) if unit not in self.found]

    def ready(self, unit: int) -> bool:
        return True

    def settled(self, unit: int) -> bool:
        return False

    def task(self, unit: int) -> Task:
        name = self.names[unit]
        return _walk, (self.friction, name, self.planned[name])

    def keep(self, unit: int, result: FrictionPath) -> None:
        """Write a path whole or not at all."""
        self.folder.mkdir(parents=True, exist_ok=True)
        file = self._file(result.name)
        building = file.with_suffix(".building.npz")
        arrays = {key: getattr(result, key) for key in ("strains", "stresses", "elastic")}
        np.savez(building, allow_pickle=False, **arrays, **self._asked(result.name))
        os.replace(building, file)
        self.found[unit] = result

    def give_up(self, unit: int) -> None:
        """A path whose workers died is not there."""

    @property
    def converged(self) -> int:
        return sum(path.complete for path in self.found.values())


def _programme(radius: float, limit: float) -> Iterator[tuple[str, list[Corner]]]:
    """Names and corners of the cycles."""
    turns = [limit * share for pair in _AMPLITUDES for share in pair]
    for degrees in (0.0, 45.0, 90.0):
        straight = Prescribed() if degrees == 45.0 else Prescribed.components(s_a=0.0)
        pulls = [Loads.tension(math.radians(degrees), load) for load in (0.0, *turns)]
        yield f"tension {degrees:g}", [(load, FLAT + straight) for load in pulls]
    yield "biaxial", [(_both(load), FLAT + Prescribed.components(s_a=0.0)) for load in (0.0, *turns[:-2])]
    for share in _PULLS:
        corners = [(_both(share * limit), FLAT + Prescribed.components(s_a=shear)) for shear in _SHEARS]
        yield f"shear under {share:g}", [(_both(0.0), corners[0][1]), *corners]
    for degrees in (0.0, 45.0, 90.0):
        bent = [Prescribed.bent(math.radians(degrees), value / radius) for value in _BENDS]
        yield f"bending {degrees:g}", [(Loads(), curved) for curved in bent]
        if degrees != 45.0:
            pull = _both(0.5 * _PULLS[1] * limit)
            yield f"bending {degrees:g} under tension", [(_both(0.0), bent[0]), *((pull, curved) for curved in bent)]


def _both(load: float) -> Loads:
    return Loads.tension(0.0, load) + Loads.tension(0.5 * math.pi, load)


def _length(corners: Sequence[Corner]) -> int:
    """States of a path that is complete."""
    return 1 + STEPS * (len(corners) - 1)


def _numbers(loads: Loads, held: Prescribed) -> Array:
    """A corner as numbers; those of a path have the same shape."""
    return np.concatenate([np.ravel(loads.tensions), held.matrix.ravel(), held.values])


def _between(first: Loads, last: Loads, share: float) -> Loads:
    """Loads that grow or fall by equal factors."""
    floor = _SMALL * max((load for _, load in first.tensions + last.tensions), default=0.0)
    mixed = []
    for (angle, begin), (_, end) in zip(first.tensions, last.tensions, strict=True):
        ratio = (end + floor) / (begin + floor) if floor else 1.0
        mixed.append((angle, (begin + floor) * ratio**share - floor))
    return Loads(tensions=tuple(mixed))


def _walk(
    cell: PeriodicCell, friction: YarnFriction, name: str, corners: Sequence[Corner]
) -> tuple[FrictionPath, float]:
    """A path as a worker calls it, with its peak memory [MB]."""
    return _walked(cell, friction, name, corners), peak_megabytes()


def _walked(cell: PeriodicCell, friction: YarnFriction, name: str, corners: Sequence[Corner]) -> FrictionPath:
    """The cell through corners of loads with friction, as far as it finds equilibria, and along its strains without."""
    states = _under_loads(cell, friction, corners)
    if not states:
        return FrictionPath.none(name)
    elastic, here = [states[0].stress], states[0]
    for state in states[1:]:
        found = cell.relax(state.strain, start=here, nearby=True)
        here = found if found.usable else here
        elastic.append(found.stress if found.usable else np.full(6, np.nan))
    strains, stresses = (np.array(rows) for rows in zip(*((s.strain.vector, s.stress) for s in states), strict=True))
    return FrictionPath(name, strains, stresses, np.array(elastic), complete=len(states) == _length(corners))


def _under_loads(cell: PeriodicCell, friction: YarnFriction, corners: Sequence[Corner]) -> list[Equilibrium]:
    """Equilibria of the cell with friction from corner to corner."""
    here = history_of(cell, friction, corners[0][1])
    found = [here] if isinstance(here, CellHistory) else []
    for number, ((loads, held), (next_loads, next_held)) in enumerate(pairwise(corners)):
        if len(found) <= number * STEPS:
            break

        def solver(share: float) -> Callable:
            values = held.values + share * (next_held.values - held.values)  # noqa: B023
            at = Prescribed(next_held.matrix, values)  # noqa: B023
            return under_loads(_between(loads, next_loads, share), at, rough=_ROUGH)  # noqa: B023

        found += followed(found[-1], 0.0, np.linspace(0.0, 1.0, STEPS + 1)[1:].tolist(), solver)
    return [history.state for history in found]
