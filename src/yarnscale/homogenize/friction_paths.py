"""Paths of a cell with friction for a shell material: tension, shear and bending in cycles of growing amplitude.

Strains are those of the elastic material with a guess of friction under cycles of loads: friction keeps fabric off the
states into which a frictionless one slips. The cell follows them with friction, and once more without.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise

import numpy as np

from yarnscale.arrays import Array
from yarnscale.cell.friction import CellHistory, followed, path_with_friction
from yarnscale.cell.periodic import PeriodicCell
from yarnscale.homogeneous.histories import history_of, loaded_state, under_loads
from yarnscale.homogeneous.loads import FLAT, Loads, Prescribed
from yarnscale.homogenize.executors import local_workers
from yarnscale.kinematics import ShellStrain
from yarnscale.shell.materials.compact import CompactMaterial
from yarnscale.shell.materials.friction import Sliders
from yarnscale.yarn.friction import YarnFriction

COUNT = 10
"""Sliders of a fitted material, with their mirror images twice as many."""
STEPS = 12
"""Steps between two turns."""
_GUESS, _SLIP, _ACROSS = 0.3, 0.02, 0.1
"""Of the guess: limits over elastic stresses, scaled strain at which sliders move under 1 J/m², and share
of other stresses in the limit."""
_SMALL = 4e-4
"""Of the largest load: what counts as none where loads grow by shares."""
_AMPLITUDES = ((0.04, 0.002), (0.2, 0.01), (1.0, 0.004))
"""Where loads of tension turn, of the largest: above, and below."""
_PULLS = (0.02, 0.2)
"""Tension both ways of sheared pieces, and along which bent ones, of the largest load."""
_SHEARS = (0.0, 0.02, -0.02, 0.14, -0.14, 0.0)
_BENDS = (0.0, 0.015, -0.015, 0.08, -0.08, 0.0)
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


def friction_paths(
    cell: PeriodicCell,
    material: CompactMaterial,
    friction: YarnFriction,
    *,
    limit: float,
    workers: int = 1,
    progress: Callable[[int, int], None] | None = None,
) -> list[FrictionPath]:
    """Paths of a cell for its elastic material, up to loads of ``limit`` [N/m].

    ``progress`` gets the number of paths done and in all.
    """
    guessed = replace(material, sliders=_guess(material.mirrored))
    planned = [(name, _strains(guessed, corners)) for name, corners in _programme(cell.pattern.radius, limit)]
    walk = partial(_walked, cell, friction)
    found: list[FrictionPath] = []

    def take(path: FrictionPath) -> None:
        found.append(path)
        if progress is not None:
            progress(len(found), len(planned))

    if workers == 1:
        for plan in planned:
            take(walk(plan))
    else:
        with local_workers(workers) as pool:
            for path in pool.map(walk, planned):
                take(path)
    return found


def _guess(mirrored: bool) -> Sliders:
    # As many sliders as the fitted material has, so that both share their kernels.
    count = COUNT * (2 if mirrored else 1)
    directions, stiffnesses = np.zeros((count, 6)), np.zeros(count)
    directions[:6], stiffnesses[:6] = np.eye(6), _GUESS / _SLIP
    growth = np.full((count, 6), _ACROSS * _SLIP)
    growth[:6] += (1.0 - _ACROSS) * _SLIP * np.eye(6)
    return Sliders.checked(directions, stiffnesses, growth)


def _programme(radius: float, limit: float) -> Iterator[tuple[str, list[Corner]]]:
    """Names and corners of the cycles."""
    turns = [limit * share for pair in _AMPLITUDES for share in pair]
    for degrees in (0.0, 45.0, 90.0):
        straight = Prescribed() if degrees == 45.0 else Prescribed.components(s_a=0.0)
        pulls = [Loads.tension(math.radians(degrees), load) for load in (0.0, *turns)]
        yield f"tension {degrees:g}", [(load, FLAT + straight) for load in pulls]
    yield "biaxial", [(_both(load), FLAT + Prescribed.components(s_a=0.0)) for load in (0.0, *turns[:4])]
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


def _walked(cell: PeriodicCell, friction: YarnFriction, plan: tuple[str, Array]) -> FrictionPath:
    """The cell along strains, with friction and without."""
    name, strains = plan
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
