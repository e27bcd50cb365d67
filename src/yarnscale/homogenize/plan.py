"""Which macroscopic states to sample, and from which neighbour each solve starts."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from yarnscale.arrays import Array, Flags, Integers
from yarnscale.errors import InputError
from yarnscale.homogenize.worker import STRAINS
from yarnscale.kinematics import LARGEST, ShellStrain

LARGEST_GRID = 1_000_000


@dataclass(frozen=True)
class StrainRange:
    """The box of states in which a material is sampled.

    stretch: least and largest s_x and s_y [-]. shear: largest |s_a| [-]. curvature: largest |λ| times the yarn radius.
    """

    stretch: tuple[float, float] = (-0.2, 0.7)
    shear: float = 0.6
    curvature: float = 0.1

    def __post_init__(self) -> None:
        low, high = self.stretch
        if not -1.0 < low < 0.0 < high:
            raise InputError("range of stretch", expected="-1 < low < 0 < high", found=self.stretch)
        if not 0.0 < self.shear < 1.0:
            raise InputError("range of shear", expected="between 0 and 1", found=self.shear)
        if not 0.0 < self.curvature < 1.0:
            raise InputError("range of curvature times radius", expected="between 0 and 1", found=self.curvature)

    def bounds(self, radius: float) -> Array:
        """Least and largest value of (s_x, s_a, s_y, λ_x, λ_y) for a yarn radius [m], shape (5, 2)."""
        bend = self.curvature / radius
        return np.array([self.stretch, (-self.shear, self.shear), self.stretch, (-bend, bend), (-bend, bend)])


@dataclass(frozen=True)
class StrainGrid:
    """All combinations of five axes; a state bends in one direction at most."""

    s_x: tuple[float, ...] = (0.0,)
    s_a: tuple[float, ...] = (0.0,)
    s_y: tuple[float, ...] = (0.0,)
    lambda_x: tuple[float, ...] = (0.0,)
    lambda_y: tuple[float, ...] = (0.0,)

    def __post_init__(self) -> None:
        count = 1
        for name in STRAINS:
            values = getattr(self, name)
            if len(values) == 0:
                raise InputError(f"grid axis {name}", expected="at least one value", found="none")
            if len(set(values)) != len(values):
                raise InputError(f"grid axis {name}", expected="distinct values", found=f"{values!s:.60}")
            count *= len(values)
            for value in values:
                if name.startswith("s_"):
                    ShellStrain(**{name: value})
                else:
                    if not abs(value) <= LARGEST:
                        raise InputError(f"grid axis {name}", expected="a finite number", found=value)
        if count > LARGEST_GRID:
            raise InputError("grid", expected=f"at most {LARGEST_GRID} states", found=count)

    @property
    def axes(self) -> dict[str, Array]:
        """The five axes as arrays."""
        return {name: np.array(getattr(self, name)) for name in STRAINS}


def axes_and_planes(bounds: Array, solves: int) -> Array:
    """About ``solves`` states on the five axes and nine planes of HYLC20 §6.1, (N, 5), rest first.

    bounds: (5, 2). A third of the states is on the axes, the others on the planes; points are denser near rest.
    """
    per_axis = max(4, round(solves * 0.2 / 5))
    per_side = max(2, round(np.sqrt(max(solves - 5 * per_axis - 1, 9 * 4) / 9)))
    states = [np.zeros(5)]
    for k in range(5):
        for value in _points(bounds[k], per_axis):
            state = np.zeros(5)
            state[k] = value
            states.append(state)
    for i, j in combinations(range(5), 2):
        if (i, j) == (3, 4):
            continue
        for u in _points(bounds[i], per_side):
            for v in _points(bounds[j], per_side):
                state = np.zeros(5)
                state[i], state[j] = u, v
                states.append(state)
    return np.array(states)


def _points(bound: Array, count: int) -> Array:
    """``count`` values of a range without 0, shared between its sides by their length, denser near 0."""
    low, high = float(bound[0]), float(bound[1])
    below = min(max(1, round(count * -low / (high - low))), count - 1)
    left = low * np.linspace(1, 0, below + 1)[:-1] ** 1.3
    right = high * np.linspace(0, 1, count - below + 1)[1:] ** 1.3
    return np.concatenate([left, right])


def random_states(bounds: Array, count: int, *, seed: int = 1) -> Array:
    """States off all axes and planes, (count, 5): stretch in both directions and shear, half of them bent.

    bounds: (5, 2). Stretch goes down to a tenth of its compressive range only: deep compression buckles.
    """
    rng = np.random.default_rng(seed)
    low = np.where([True, False, True, False, False], 0.1, 0.9) * bounds[:, 0]
    states = rng.uniform(low, 0.9 * bounds[:, 1], (count, 5))
    bend = rng.integers(0, 4, count)
    states[:, 3] = np.where(bend == 1, rng.uniform(0.9 * bounds[3, 0], 0.9 * bounds[3, 1], count), 0.0)
    states[:, 4] = np.where(bend == 2, rng.uniform(0.9 * bounds[4, 0], 0.9 * bounds[4, 1], count), 0.0)
    return states


def solve_order(states: Array, bounds: Array | None = None) -> tuple[Integers, Integers]:
    """Order of solves, from rest outward, and the state each one starts from (−1: the rest shape).

    A start is the nearest state closer to rest, in strains scaled by ``bounds`` (5, 2); so the outcome does
    not depend on how many workers share the run.
    """
    size = np.abs(states).max(axis=0) if bounds is None else np.abs(bounds).max(axis=1)
    scaled = states / np.where(size > 0, size, 1.0)
    distance = np.linalg.norm(scaled, axis=1)
    order = np.argsort(distance, kind="stable")
    parents = np.full(len(states), -1, np.int64)
    for place, index in enumerate(order):
        closer = order[:place][distance[order[:place]] < distance[index] - 1e-12]
        if len(closer):
            gaps = np.linalg.norm(scaled[closer] - scaled[index], axis=1)
            parents[index] = closer[np.argmin(gaps)]
    return order, parents


def bends_twice(states: Array) -> Flags:
    """Which states bend about both axes, (N,)."""
    return (states[:, 3] != 0.0) & (states[:, 4] != 0.0)


def scattered_axes(states: Array) -> Mapping[str, Array]:
    """Columns of scattered states by name."""
    return {name: np.ascontiguousarray(states[:, k]) for k, name in enumerate(STRAINS)}
