"""Fabric with friction under strains or loads, step by step: a periodic cell of yarns, or a shell material with
friction."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from typing import Any, TypeVar

import numpy as np

from yarnscale.arrays import Array
from yarnscale.cell.equilibrium import Equilibrium
from yarnscale.cell.friction import CellHistory, Solve
from yarnscale.cell.periodic import PeriodicCell
from yarnscale.homogeneous.fabrics import CellFabric, MaterialFabric, Response, moduli_or_nan
from yarnscale.homogeneous.loads import LoadedState, Loads, Prescribed, equilibrium_under
from yarnscale.kinematics import ShellStrain
from yarnscale.numerics.newton import Status
from yarnscale.shell.materials.history import MaterialHistory
from yarnscale.shell.materials.material import ShellMaterial
from yarnscale.yarn.friction import YarnFriction

FabricHistory = CellHistory | MaterialHistory
Followed = TypeVar("Followed", bound=FabricHistory)
Control = TypeVar("Control", float, Array)
_KEPT = 5
"""Responses that have the same moduli."""
_HALVINGS = 4


def history_of(
    subject: PeriodicCell | ShellMaterial, friction: YarnFriction | None, prescribed: Prescribed
) -> FabricHistory | None:
    """A history that begins without load under prescribed strains, with slack contacts; None where it has no rest.

    friction: of the yarns of a cell; a shell material has its own. Raises InputError for one without friction.
    """
    if isinstance(subject, PeriodicCell) and friction is not None:
        rest = equilibrium_under(CellFabric(subject), Loads(), prescribed=prescribed)
        return CellHistory.begin(subject, friction, rest.response.state) if rest.converged else None
    if not isinstance(subject, ShellMaterial):
        raise TypeError(f"no friction of a {type(subject).__name__}")
    begun = MaterialHistory.begin(subject, np.zeros(6))
    rest = equilibrium_under(MaterialFabric(subject), Loads(), prescribed=prescribed)
    return MaterialHistory.begin(begun.material, rest.strain) if rest.converged else None


@dataclass(frozen=True, eq=False)
class _RareModuli(CellFabric):
    """A cell whose moduli, which cost several solves, are those of an earlier response most of the time."""

    known: list[Array]

    def moduli(self, response: Response) -> Array:
        fresh = len(self.known) % _KEPT == 0
        self.known.append(super().moduli(response) if fresh else self.known[-1])
        return self.known[-1]


def under_loads(loads: Loads, prescribed: Prescribed, *, rough: float | None = None) -> Callable[[Any, Any], Any]:
    """The solve of a step (``step`` of either history) under loads with some strains prescribed.

    Iterations of a cell use moduli of earlier responses; whether it ends at a minimum, its own moduli decide. rough:
    relative tolerance on the loads, with which a cell may end at any equilibrium, minimum or not.
    """
    known: list[Array] = []

    def of_cell(cell: PeriodicCell, near: Equilibrium) -> Equilibrium | None:
        fabric = _RareModuli(cell, known)
        start = fabric.response(near.strain.vector, Response.of(near))
        tolerance: dict[str, Any] = {} if rough is None else {"tolerance": rough}
        found = equilibrium_under(fabric, loads, prescribed=prescribed, start=start, **tolerance)
        if not found.converged:
            return None
        if rough is not None:
            return found.response.state
        known[:] = [moduli_or_nan(CellFabric(cell), found.response)]
        found = replace(found, moduli=known[0])
        found = equilibrium_under(CellFabric(cell), loads, prescribed=prescribed, start=found)
        return found.response.state if found.converged else None

    def solve(subject: PeriodicCell | MaterialHistory, near: Any) -> Any:
        if isinstance(subject, PeriodicCell):
            return of_cell(subject, near)
        fabric = MaterialFabric(subject)
        found = equilibrium_under(fabric, loads, prescribed=prescribed, start=fabric.response(near))
        return found.strain if found.converged else None

    return solve


def loaded_state(history: FabricHistory | None) -> LoadedState:
    """A step's end as tests without friction know it; None: it was not reached."""
    nothing = np.full((6, 6), np.nan)
    if history is None:
        return LoadedState(Response(nothing[0], np.nan, nothing[0]), nothing, np.nan, Status.STALLED, 0)
    if isinstance(history, CellHistory):
        strain, stress = history.state.strain.vector, history.state.stress
    else:
        strain, stress = history.strain, history.force
    return LoadedState(Response(strain, history.stored, stress), nothing, 0.0, Status.CONVERGED, 0)


def path_with_friction(start: CellHistory, strains: Iterable[ShellStrain]) -> Iterator[CellHistory]:
    """Equilibria at one macroscopic state after the other, after a history; ends at a state that has no equilibrium.

    Steps that fail are halved. Results converge as the steps become shorter.
    """

    def solver(strain: Array) -> Solve:
        return lambda cell, near: cell.relax(ShellStrain.from_vector(strain), start=near, nearby=True)

    yield from followed(start, start.state.strain.vector, (s.vector for s in strains), solver)


def followed(
    start: Followed,
    first: Control,
    values: Iterable[Control],
    solver: Callable[[Control], Any],
) -> Iterator[Followed]:
    """``path_with_friction`` through values of what a step solves for, loads for instance; first: that of the start."""
    here: Followed | None = start
    for value in values:
        here = _stepped(here, first, value, solver, _HALVINGS)
        if here is None:
            return
        first = value
        yield here


def _stepped(
    here: Followed,
    before: Control,
    value: Control,
    solver: Callable[[Control], Any],
    halvings: int,
) -> Followed | None:
    """The history one step on, through the state half-way where that fails; its dissipation is that of both."""
    found: Any = here.step(solver(value))
    if found is not None or halvings == 0:
        return found
    middle = 0.5 * (before + value)
    half = _stepped(here, before, middle, solver, halvings - 1)
    end = None if half is None else _stepped(half, middle, value, solver, halvings - 1)
    if end is None or half is None:
        return None
    return replace(end, dissipated=half.dissipated + end.dissipated)
