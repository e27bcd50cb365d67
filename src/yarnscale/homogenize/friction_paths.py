"""Paths of a cell with friction for a shell material: tension, shear and bending in cycles of growing amplitude.

Strains are those of the elastic material with a guess of friction under cycles of loads: friction keeps fabric off the
states into which a frictionless one slips. The cell follows them with friction, and once more without.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from zipfile import BadZipFile

import numpy as np

from yarnscale.arrays import Array
from yarnscale.cell.friction import CellHistory
from yarnscale.cell.periodic import PeriodicCell
from yarnscale.errors import InputError
from yarnscale.homogeneous.histories import followed, history_of, loaded_state, path_with_friction, under_loads
from yarnscale.homogeneous.loads import FLAT, Loads, Prescribed
from yarnscale.homogenize.sample import SamplingProgress, work_off
from yarnscale.homogenize.units import Task
from yarnscale.homogenize.worker import peak_megabytes
from yarnscale.kinematics import ShellStrain
from yarnscale.shell.materials.compact import CompactMaterial
from yarnscale.shell.materials.friction import Sliders
from yarnscale.yarn.friction import YarnFriction

COUNT = 10
"""Sliders of a fitted material."""
STEPS = 12
"""Steps between two turns."""
_GUESS, _SLIP, _ACROSS = 0.3, 0.02, 0.1
"""Of the guess: limits over elastic stresses, scaled strain at which sliders move under 1 J/m², and share
of other stresses in the limit."""
_FIRST_STEP = 0.005
"""Stretch s_x of a first step."""
_SMALL = 4e-4
"""Of the largest load: what counts as none where loads grow by shares."""
_AMPLITUDES = ((0.04, 0.002), (0.1, 0.005), (0.2, 0.01), (1.0, 0.004))
"""Where loads of tension turn, of the largest: above, and below."""
_PULLS = (0.02, 0.2)
"""Tension both ways of sheared pieces, and along which bent ones, of the largest load."""
_SHEARS = (0.0, 0.02, -0.02, 0.06, -0.06, 0.14, -0.14, 0.0)
_BENDS = (0.0, 0.015, -0.015, 0.035, -0.035, 0.08, -0.08, 0.0)
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


def check_friction(cell: PeriodicCell, friction: YarnFriction) -> None:
    """InputError where a cell has no first step with friction, before anything long begins."""
    first = _walked(cell, friction, "first step", np.outer([0.0, _FIRST_STEP], np.eye(6)[0]))
    if not first.complete:
        raise InputError("paths with friction", expected="a cell that rests and can be stretched", found="none")


def friction_paths(
    cell: PeriodicCell,
    material: CompactMaterial,
    friction: YarnFriction,
    *,
    limit: float,
    folder: Path,
    workers: int = 1,
    dask: str | None = None,
    progress: Callable[[SamplingProgress], None] | None = None,
) -> list[FrictionPath]:
    """Paths of a cell for its elastic material, up to loads of ``limit`` [N/m].

    folder: where each path is kept once it is done; those of the same strains and friction are not walked again.
    workers, dask, progress: as of ``sample``.
    """
    guessed = replace(material, sliders=_guess(material))
    planned = {name: _strains(guessed, corners) for name, corners in _programme(cell.pattern.radius, limit)}
    work = _PathUnits(folder, planned, friction)
    work_off(work, cell, workers=workers, dask=dask, progress=progress)
    missing = [FrictionPath(name, *np.zeros((3, 0, 6)), complete=False) for name in planned]
    return [work.found.get(unit, path) for unit, path in enumerate(missing)]


class _PathUnits:
    """Paths to walk, each on its own; kept as ``NAME.npz`` with what was asked for."""

    def __init__(self, folder: Path, planned: Mapping[str, Array], friction: YarnFriction) -> None:
        self.folder, self.planned, self.friction = folder, planned, friction
        self.names, self.total = list(planned), len(planned)
        self.found = {unit: path for unit, name in enumerate(planned) if (path := self._kept(name)) is not None}

    def _asked(self, name: str) -> dict[str, Array]:
        return {
            "planned": self.planned[name],
            "friction": np.array(self.friction.coefficient),
        }

    def _kept(self, name: str) -> FrictionPath | None:
        try:
            with np.load(self._file(name)) as kept:
                if any(not np.array_equal(kept[key], value) for key, value in self._asked(name).items()):
                    return None
                arrays = [kept[key] for key in ("strains", "stresses", "elastic")]
        except (OSError, KeyError, ValueError, BadZipFile):
            return None
        return FrictionPath(name, *arrays, complete=0 < len(arrays[0]) == len(self.planned[name]))

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


def _guess(material: CompactMaterial) -> Sliders:
    # As many sliders as the fitted material has, so that both share their kernels.
    directions, stiffnesses, growth = np.zeros((COUNT, 6)), np.zeros(COUNT), np.full((COUNT, 6), _ACROSS * _SLIP)
    directions[:6], stiffnesses[:6] = np.eye(6), _GUESS / _SLIP
    growth[:6] += (1.0 - _ACROSS) * _SLIP * np.eye(6)
    bends = np.zeros((COUNT, len(material.springs.steps)))
    return Sliders.checked(directions, bends, stiffnesses, np.zeros(COUNT), growth)


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


def _strains(material: CompactMaterial, corners: list[Corner]) -> Array:
    """Strains (n, 6) of a material with friction through corners of loads, as far as it finds equilibria."""
    here = history_of(material, None, corners[0][1])
    if here is None:
        return np.zeros((0, 6))
    found = [loaded_state(here).strain]
    for (loads, held), (next_loads, next_held) in pairwise(corners):

        def solver(share: float) -> Callable:
            values = held.values + share * (next_held.values - held.values)  # noqa: B023
            return under_loads(_between(loads, next_loads, share), Prescribed(next_held.matrix, values))  # noqa: B023

        leg = list(followed(here, 0.0, np.linspace(0.0, 1.0, STEPS + 1)[1:].tolist(), solver))
        found += [loaded_state(history).strain for history in leg]
        if len(leg) < STEPS:
            break
        here = leg[-1]
    return np.array(found)


def _between(first: Loads, last: Loads, share: float) -> Loads:
    """Loads that grow or fall by equal factors."""
    floor = _SMALL * max((load for _, load in first.tensions + last.tensions), default=0.0)
    mixed = []
    for (angle, begin), (_, end) in zip(first.tensions, last.tensions, strict=True):
        ratio = (end + floor) / (begin + floor) if floor else 1.0
        mixed.append((angle, (begin + floor) * ratio**share - floor))
    return Loads(tensions=tuple(mixed))


def _walk(cell: PeriodicCell, friction: YarnFriction, name: str, strains: Array) -> tuple[FrictionPath, float]:
    """``_walked`` as a worker calls it, with its peak memory [MB]."""
    return _walked(cell, friction, name, strains), peak_megabytes()


def _walked(cell: PeriodicCell, friction: YarnFriction, name: str, strains: Array) -> FrictionPath:
    """The cell along strains (n, 6), with friction and without."""
    states = [ShellStrain.from_vector(strain) for strain in strains]
    rest = cell.relax(states[0]) if states else None
    if rest is None or not rest.usable:
        return FrictionPath(name, *np.zeros((3, 0, 6)), complete=False)
    start = CellHistory.begin(cell, friction, rest)
    histories = [start, *path_with_friction(start, states[1:])]
    elastic, here = [rest.stress], rest
    for state in states[1 : len(histories)]:
        found = cell.relax(state, start=here, nearby=True)
        here = found if found.usable else here
        elastic.append(found.stress if found.usable else np.full(6, np.nan))
    stresses = np.array([history.state.stress for history in histories])
    return FrictionPath(name, strains[: len(histories)], stresses, np.array(elastic), len(histories) == len(states))
