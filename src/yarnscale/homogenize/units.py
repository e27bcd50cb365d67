"""Units of work of a sampling run: a state of a grid, a level of a ray, ...; what each starts from and leaves."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any, Protocol

import numpy as np

from yarnscale.cell.equilibrium import Start
from yarnscale.homogenize.plan import bends_twice, solve_order
from yarnscale.homogenize.rays import Ray
from yarnscale.homogenize.store import SampleStore
from yarnscale.homogenize.worker import CODE_OF, LoadedStart, sample_level, solve, strain_of
from yarnscale.kinematics import ShellStrain

Task = tuple[Callable[..., Any], tuple[Any, ...]]
_CONVERGED, _STALLED, _EXCLUDED = (CODE_OF[name] for name in ("converged", "stalled", "excluded"))


class Units(Protocol):
    """Numbered units of work: ``total`` of them, of which so many ``converged``."""

    total: int

    @property
    def converged(self) -> int: ...

    def pending(self) -> list[int]:
        """Units that are left, in the order of work."""
        ...

    def ready(self, unit: int) -> bool:
        """Whether what the unit starts from is done."""
        ...

    def settled(self, unit: int) -> bool:
        """Whether the unit needs no work after all."""
        ...

    def task(self, unit: int) -> Task:
        """What a worker is to call, behind the cell; it returns a result and its peak memory [MB]."""
        ...

    def keep(self, unit: int, result: Any) -> None:
        """Store what a worker has found."""
        ...

    def give_up(self, unit: int) -> None:
        """Leave a unit pending that made workers die."""
        ...


class GridUnits:
    """States of given strains; each starts from the nearest one closer to rest."""

    def __init__(self, store: SampleStore) -> None:
        self.store = store
        self.order, self.parents = solve_order(store.states)
        self.status = store.status()
        twice = bends_twice(store.states)
        for index in np.flatnonzero(twice & (self.status == 0)):
            store.write_empty(int(index), _EXCLUDED)
            self.status[index] = _EXCLUDED
        self.done = set(np.flatnonzero(self.status != 0).tolist())
        self.total = self.solved = int((~twice).sum())

    def pending(self) -> list[int]:
        return [int(i) for i in self.order if self.status[i] == 0]

    def ready(self, unit: int) -> bool:
        parent = int(self.parents[unit])
        return parent < 0 or parent in self.done

    def settled(self, unit: int) -> bool:
        return False

    def task(self, unit: int) -> Task:
        parent = int(self.parents[unit])
        while parent >= 0 and self.status[parent] != _CONVERGED:
            parent = int(self.parents[parent])
        start = None
        if parent >= 0:
            shape = self.store.read(parent, "fluctuation"), self.store.read(parent, "twist")
            start = Start(strain_of(self.store.states[parent]), *shape)
        return solve, (self.store.states[unit], start, self.store.has_moduli)

    def keep(self, unit: int, result: dict[str, object]) -> None:
        self.store.write(unit, result)
        self.status[unit] = int(result["status"])  # type: ignore[call-overload]
        self.done.add(unit)

    def give_up(self, unit: int) -> None:
        """Leave a unit pending that made workers die, and continue with those that start from it."""
        self.done.add(unit)

    @property
    def converged(self) -> int:
        return int((self.status == _CONVERGED).sum())

    ended = 0


class RayUnits:
    """Levels of rays; each starts from the level before, the first one from rest, the first ray, or another state.

    The states of a level are written in order and the last place of a level, filled or not, at the end: a level
    without it is done again as a whole. A level that needs no step, and so has no state, is passed over; one on which
    the fabric buckles or unravels has a place that is ``stalled``, and ends its ray.
    """

    def __init__(self, store: SampleStore) -> None:
        self.store = store
        self.rays = [Ray.from_plain(entry) for entry in store.rays]
        _, self.levels, self.iterates = store.shape
        self.status = store.status().reshape(-1, self.iterates)
        real = [len(ray.levels) for ray in self.rays]
        for ray, count in enumerate(real):
            for unit in range(ray * self.levels + count, (ray + 1) * self.levels):
                if self.status[unit, -1] == 0:
                    self._write(unit, [])
        self.units = [ray * self.levels + level for ray, count in enumerate(real) for level in range(count)]
        self.total = len(self.units)
        self.lost: set[int] = set()

    def pending(self) -> list[int]:
        """Units that are left: first the levels near rest, of all rays."""
        left = [unit for unit in self.units if self.status[unit, -1] == 0]
        return sorted(left, key=lambda unit: (unit % self.levels, unit))

    def _before(self, unit: int) -> int | None:
        """The level that a level comes after; None for the state of rest."""
        if unit == 0:
            return None
        ray, level = divmod(unit, self.levels)
        return unit - 1 if level else self.rays[ray].origin // self.iterates

    def ready(self, unit: int) -> bool:
        """Whether the level before is done, or will not be."""
        before = self._before(unit)
        return before is None or self.status[before, -1] != 0 or before in self.lost

    def settled(self, unit: int) -> bool:
        """Whether the ray ended before this level; its places are marked then."""
        before = self._before(unit)
        if before is None:
            return False
        level = unit % self.levels
        if self.lost.intersection([before, *range(unit - level, unit)]):
            self.lost.add(unit)
            return True
        # Under tension fabric that gives way at one load may be stable at the next.
        pardoned = self.rays[unit // self.levels].kind == "tension"
        ended = (self.status[unit - level : unit] == _STALLED).any(axis=1).sum() > pardoned
        if not ended and self._last_state(unit) is not None:
            return False
        self._write(unit, [])
        return True

    def task(self, unit: int) -> Task:
        ray, level = divmod(unit, self.levels)
        return sample_level, (*self.rays[ray].levels[level], self._start(unit), self.iterates)

    def _states_before(self, unit: int) -> Iterator[int]:
        """Converged states on the load path to a level, the last one first."""
        before = self._before(unit)
        first = self.rays[unit // self.levels].origin if unit % self.levels == 0 else None
        while before is not None:
            for place in np.flatnonzero(self.status[before] == _CONVERGED)[::-1]:
                index = before * self.iterates + int(place)
                if first is None or index <= first:
                    yield index
            first = self.rays[before // self.levels].origin if before % self.levels == 0 else None
            before = self._before(before)

    def _last_state(self, unit: int) -> int | None:
        return next(self._states_before(unit), None)

    def _start(self, unit: int) -> LoadedStart | None:
        last = self._last_state(unit)
        if last is None:
            return None
        read = self.store.read
        return LoadedStart(
            ShellStrain.from_vector(read(last, "strain")), read(last, "fluctuation"), read(last, "twist"),
            float(read(last, "energy_density")), read(last, "stress"), self._known_moduli(unit),
        )  # fmt: skip

    def _known_moduli(self, unit: int) -> np.ndarray:
        """The last moduli on the load path to a level; NaN where there are none."""
        for index in self._states_before(unit):
            moduli = self.store.read(index, "moduli")
            if np.isfinite(moduli).all():
                return moduli
        return np.full((6, 6), np.nan)

    def keep(self, unit: int, result: tuple[list[dict[str, object]], bool]) -> None:
        self._write(unit, *result)

    def _write(self, unit: int, found: list[dict[str, object]], ended: bool = False) -> None:
        for place in range(self.iterates):
            index = unit * self.iterates + place
            if place < len(found):
                self.store.write(index, found[place])
                self.status[unit, place] = int(found[place]["status"])  # type: ignore[call-overload]
            else:
                empty = _STALLED if ended and place == len(found) else _EXCLUDED
                self.store.write_empty(index, empty)
                self.status[unit, place] = empty

    def give_up(self, unit: int) -> None:
        """Leave a level pending that workers died of; its ray ends there for now."""
        self.lost.add(unit)

    @property
    def solved(self) -> int:
        return self.converged

    @property
    def converged(self) -> int:
        return int((self.status == _CONVERGED).sum())

    @property
    def ended(self) -> int:
        """Rays that ended before their last level, where the fabric buckles, unravels or is rolled up."""
        rays = self.status.reshape(len(self.rays), -1)
        return int((rays == _STALLED).any(axis=1).sum())
