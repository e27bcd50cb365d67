"""Fluctuations û of the yarns of a cell under any strain, interpolated between samples.

    û(s, II) ≈ û(s, 0) + [û(s, λ_x = II11) − û(s, 0)] + [û(s, λ_y = II22) − û(s, 0)]

each bracket linear between samples, as is û(s, 0) in s = (s_x, s_a, s_y): exact at every sampled state, continuous
everywhere. (HYLC20 §6 adds energies in this way, and Sperl et al. 2021, "Mechanics-Aware Deformation of Yarn Pattern
Geometry", displacements; here bending is sampled at every in-plane state, since slack and taut fabric
differ.) Twist II12 bends the yarns with the surface and has no term of its own. Outside the samples the nearest
sampled state is used; the yarns still follow the surface and its full stretch.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numba
import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import RBFInterpolator
from scipy.spatial import KDTree

from yarnscale.arrays import Array, Flags, Integers
from yarnscale.cell.periodic import PeriodicCell
from yarnscale.errors import InputError
from yarnscale.homogenize.plan import StrainGrid
from yarnscale.homogenize.states import FabricStates
from yarnscale.homogenize.store import SampleStore
from yarnscale.homogenize.worker import CODE_OF, STRAINS
from yarnscale.yarn.pattern import YarnPattern

STRETCHES = (-0.16, -0.08, 0.0, 0.12, 0.27, 0.46, 0.7)
SHEARS = (-0.5, -0.25, 0.0, 0.25, 0.5)
CURVATURE = 0.08
"""Sampled by default: s_x and s_y, s_a, and curvature times yarn radius, of both signs."""
LARGEST_TABLE = 300_000_000
"""Largest size of a table that needs no solves [bytes]."""
_TABLED = [0, 1, 2, 3, 5]
"""Components of strain that a table has axes for: all but the twist II12."""
_BEND_SIZE = 0.2
"""Curvature times yarn radius that corresponds to a strain of one."""


def detail_grid(cell: PeriodicCell) -> StrainGrid:
    """Default states of a table: 245 flat ones, each also bent along x and y with both signs."""
    bend = CURVATURE / cell.pattern.radius
    bends = (-bend, 0.0, bend)
    return StrainGrid(STRETCHES, SHEARS, STRETCHES, bends, bends)


@dataclass(frozen=True, eq=False)
class FluctuationTable:
    """Co-rotated fluctuations û of a pattern's vertices over a grid of states.

    axes: sampled s_x, s_a, s_y [-], λ_x, λ_y [1/m], increasing. values: (n_x, n_a, n_y, 1 + m_x + m_y, n, 3) [m]; along
    the fourth axis û of the flat state, then û minus it for every λ_x, then for every λ_y. replaced: number of states
    that did not converge and are replaced by the nearest converged one.
    """

    pattern: YarnPattern
    axes: tuple[Array, Array, Array, Array, Array]
    values: Array | NDArray[np.float32]
    replaced: int = 0

    @classmethod
    def from_store(cls, store: SampleStore, pattern: YarnPattern) -> FluctuationTable:
        """The table of a store of samples: of a grid with flat states among them as it is, of scattered states by
        interpolation (``from_scattered``).

        Raises InputError for a store of another pattern or without a usable state.
        """
        if store.attributes["provenance"]["pattern_hash"] != pattern.content_hash():
            raise InputError("samples of another pattern", where=store.path, expected=pattern.name)
        if store.dims != STRAINS:
            return cls.from_scattered(store, pattern)
        axes, index = _sorted_grid(store)
        flat_x, flat_y = (np.flatnonzero(axes[k] == 0.0) for k in (3, 4))
        if len(flat_x) == 0 or len(flat_y) == 0:
            raise InputError(
                "samples for yarns on cloth",
                where=store.path,
                expected="flat states among them, 0 in lambda_x and lambda_y",
                found="bent states only",
            )
        # Flat states, then those bent along x, then along y.
        slots = [index[..., flat_x[0], flat_y[0]]]
        slots += [index[..., k, flat_y[0]] for k in range(len(axes[3]))]
        slots += [index[..., flat_x[0], k] for k in range(len(axes[4]))]
        return cls(pattern, axes, *_values(store, axes, slots))

    @classmethod
    def from_scattered(cls, store: SampleStore, pattern: YarnPattern) -> FluctuationTable:
        """A table interpolated between the converged states of a store, without solves.

        The interpolant is piecewise smooth, exact at the stored states, and used within their range only. Raises
        InputError if no state of the store converged.
        """
        stored = ScatteredFluctuations.of(store, pattern.radius)
        axes = stored.axes()
        flat = np.stack(np.meshgrid(*axes[:3], indexing="ij"), -1)
        bends = [(0.0, 0.0), *((b, 0.0) for b in axes[3]), *((0.0, b) for b in axes[4])]
        values = np.empty((*flat.shape[:3], len(bends), len(pattern.edges), 3), dtype=np.float32)
        for number, bend in enumerate(bends):
            states = np.concatenate([flat, np.broadcast_to(bend, (*flat.shape[:3], 2))], axis=-1)
            values[:, :, :, number] = stored.at(states.reshape(-1, 5)).reshape(*flat.shape[:3], -1, 3)
        values[:, :, :, 1:] -= values[:, :, :, :1]
        return cls(pattern, axes, values)


@dataclass(frozen=True, eq=False)
class ScatteredFluctuations:
    """û (m, 3n) [m] at scattered strains (m, 6), interpolated by radial basis functions |Δ| and a linear polynomial.

    Components in the order of ``kinematics.COMPONENTS``. size: (6,) units of the distance of states.
    """

    states: Array
    values: Array
    size: Array

    @classmethod
    def of(cls, store: SampleStore, radius: float) -> ScatteredFluctuations:
        """From the converged states of a store; radius: of the yarn [m], the scale of curvatures. Raises InputError."""
        good = np.flatnonzero(store.status() == CODE_OF["converged"])
        if len(good) == 0:
            raise InputError("samples for yarns on cloth", where=store.path, expected="a converged state", found="none")
        states, first = np.unique(FabricStates.of(store).strains, axis=0, return_index=True)
        values = np.stack([store.read(int(i), "fluctuation").ravel() for i in good[first]])
        return cls(states, values, np.array([1.0] * 3 + [_BEND_SIZE / radius] * 3))

    def axes(self) -> tuple[Array, Array, Array, Array, Array]:
        """Axes of a table: the default values in the range of the states, its ends, and midpoints.

        Midpoints as long as the table stays below ``LARGEST_TABLE``.
        """
        bend = CURVATURE * self.size[3] / _BEND_SIZE
        usual = (STRETCHES, SHEARS, STRETCHES, (-bend, 0.0, bend), (-bend, 0.0, bend))
        low, high = (limit[_TABLED] for limit in (self.states.min(axis=0), self.states.max(axis=0)))

        def within(axes: Sequence[Sequence[float] | Array]) -> list[Array]:
            clipped = (np.clip(u, lo, hi) for u, lo, hi in zip(axes, low, high, strict=True))
            return [np.unique([*u, lo, hi]) for u, lo, hi in zip(clipped, low, high, strict=True)]

        coarse = within(usual)
        fine = within([np.sort(np.concatenate([u, 0.5 * (u[1:] + u[:-1])])) for u in map(np.asarray, usual)])
        counts = [len(u) for u in fine]
        size = 4 * np.prod(counts[:3]) * (1 + counts[3] + counts[4]) * self.values.shape[1]
        x, a, y, p, q = fine if size <= LARGEST_TABLE else coarse
        return x, a, y, p, q

    @cached_property
    def _varying(self) -> Flags:
        """Which components vary among the states."""
        return np.ptp(self.states, axis=0) > 0.0

    @cached_property
    def _interpolant(self) -> RBFInterpolator:
        known = (self.states / self.size)[:, self._varying]
        try:
            return RBFInterpolator(known, self.values, kernel="linear", degree=1)
        except (np.linalg.LinAlgError, ValueError):
            # Too few states for a plane through them; they have a mean.
            return RBFInterpolator(known, self.values, kernel="linear", degree=0)

    def at(self, states: Array) -> Array:
        """û at states (k, 6), or (k, 5) without twist II12; (k, 3n) [m]."""
        if states.shape[1] == len(_TABLED):
            states = np.insert(states, 4, 0.0, axis=1)
        if not self._varying.any():
            return np.repeat(self.values[:1], len(states), axis=0)
        return self._interpolant((states / self.size)[:, self._varying])

    def error_on(self, store: SampleStore) -> Array:
        """‖Δû‖ [m] of every vertex in converged states of another store, (k, n).

        Only states within the range of these ones and different from them.
        """
        other = ScatteredFluctuations.of(store, _BEND_SIZE / self.size[3])
        inside = (other.states >= self.states.min(axis=0)) & (other.states <= self.states.max(axis=0))
        nearest = KDTree(self.states / self.size).query(other.states / self.size)[0]
        chosen = inside.all(axis=1) & (nearest > 1e-9)
        difference = self.at(other.states[chosen]) - other.values[chosen]
        return np.linalg.norm(difference.reshape(len(difference), self.values.shape[1] // 3, 3), axis=2)


def _sorted_grid(store: SampleStore) -> tuple[tuple[Array, Array, Array, Array, Array], Integers]:
    """Increasing axes of a grid store, and the number of every state in that order."""
    states = store.states.reshape((*store.shape, 5))
    index = np.arange(store.count).reshape(store.shape)
    axes = []
    for k in range(5):
        along = np.moveaxis(states[..., k], k, 0).reshape(store.shape[k], -1)[:, 0]
        order = np.argsort(along)
        axes.append(np.ascontiguousarray(along[order]))
        index = index.take(order, axis=k)
    return (axes[0], axes[1], axes[2], axes[3], axes[4]), index


def _values(
    store: SampleStore, axes: tuple[Array, Array, Array, Array, Array], slots: list[Integers]
) -> tuple[Array, int]:
    """``values`` and ``replaced`` of a table; slots: numbers of the states over (s_x, s_a, s_y), flat ones first."""
    good = store.status() == CODE_OF["converged"]
    if not good[slots[0]].any():
        raise InputError(
            "samples for yarns on cloth", where=store.path, expected="a converged flat state", found="none"
        )
    size = [float(np.abs(axis).max()) or 1.0 for axis in axes[:3]]
    places = store.states[slots[0].ravel(), :3] / size
    flat, replaced = slots[0].ravel(), 0
    table = []
    for number, slot in enumerate(slots):
        here = slot.ravel()
        usable = good[here] & good[flat]
        replaced += int((~usable).sum()) if number == 0 or not np.array_equal(here, flat) else 0
        if not usable.any():
            table.append(np.zeros_like(table[0]))
            continue
        nearest = np.flatnonzero(usable)[KDTree(places[usable]).query(places)[1]]
        shape = np.stack([store.read(int(i), "fluctuation") for i in here[nearest]])
        if number:
            shape -= np.stack([store.read(int(i), "fluctuation") for i in flat[nearest]])
        table.append(shape)
    values = np.stack(table, axis=1)
    return np.ascontiguousarray(values.reshape(*slots[0].shape, *values.shape[1:])), replaced


@numba.njit(cache=True, error_model="numpy")
def bracket(axis, value):
    """Interval of an increasing axis that contains a value, and the relative place in it, clamped to [0, 1]."""
    last = len(axis) - 1
    if last == 0 or value <= axis[0]:
        return 0, 0.0
    if value >= axis[last]:
        return last - 1, 1.0
    k = 0  # a search by halves would put what is no number behind the last interval
    while value >= axis[k + 1]:
        k += 1
    return k, (value - axis[k]) / (axis[k + 1] - axis[k])


@numba.njit(cache=True, error_model="numpy")
def fluctuation(values, axes, state, vertex, out):
    """û of one vertex at a state (5,), into ``out`` (3,)."""
    i, u = bracket(axes[0], state[0])
    j, v = bracket(axes[1], state[1])
    k, w = bracket(axes[2], state[2])
    p, f = bracket(axes[3], state[3])
    q, g = bracket(axes[4], state[4])
    along_y = 1 + len(axes[3])
    out[0] = out[1] = out[2] = 0.0
    for a in range(2):
        for b in range(2):
            for c in range(2):
                share = (u if a else 1.0 - u) * (v if b else 1.0 - v) * (w if c else 1.0 - w)
                if share == 0.0:
                    continue
                here = values[i + a, j + b, k + c]
                for d in range(3):
                    sum_ = here[0, vertex, d]
                    if f < 1.0:
                        sum_ += (1.0 - f) * here[1 + p, vertex, d]
                    if f > 0.0:
                        sum_ += f * here[2 + p, vertex, d]
                    if g < 1.0:
                        sum_ += (1.0 - g) * here[along_y + q, vertex, d]
                    if g > 0.0:
                        sum_ += g * here[along_y + q + 1, vertex, d]
                    out[d] += share * sum_
