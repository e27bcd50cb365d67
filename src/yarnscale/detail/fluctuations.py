"""How the yarns of a cell lie under any strain: sampled fluctuations û, interpolated.

    û(s, II) ≈ û(s, 0) + [û(s, λ_x = II11) − û(s, 0)] + [û(s, λ_y = II22) − û(s, 0)]

each bracket linear between samples, as is û(s, 0) in s = (s_x, s_a, s_y): exact at every sampled state, continuous
everywhere. (HYLC20 §6 adds energies like this, and Sperl et al. 2021, "Mechanics-Aware Deformation of Yarn Pattern
Geometry", displacements; here bending is sampled at every in-plane state, for slack and taut fabric answer
differently.) Twist II12 bends the yarns with the surface and has no term of its own. Outside the samples the nearest
sampled state stands in; the yarns still follow the surface and its full stretch.
"""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from yarnscale.cell.periodic import PeriodicCell
from yarnscale.errors import InputError
from yarnscale.homogenize.plan import StrainGrid
from yarnscale.homogenize.store import SampleStore
from yarnscale.homogenize.worker import CODE_OF, STRAINS
from yarnscale.yarn.pattern import YarnPattern

Floats = NDArray[np.float64]

STRETCHES = (-0.16, -0.08, 0.0, 0.12, 0.27, 0.46, 0.7)
SHEARS = (-0.5, -0.25, 0.0, 0.25, 0.5)
CURVATURE = 0.08
"""Sampled by default: s_x and s_y, s_a, and curvature times yarn radius, either way."""


def detail_grid(cell: PeriodicCell) -> StrainGrid:
    """The states that a table of a cell is made from by default: 245 flat ones, each bent in four ways too."""
    bend = CURVATURE / cell.pattern.radius
    bends = (-bend, 0.0, bend)
    return StrainGrid(STRETCHES, SHEARS, STRETCHES, bends, bends)


@dataclass(frozen=True, eq=False)
class FluctuationTable:
    """Co-rotated fluctuations û of a pattern's vertices over a grid of states.

    axes: sampled s_x, s_a, s_y [-], λ_x, λ_y [1/m], increasing. values: (n_x, n_a, n_y, 1 + m_x + m_y, n, 3) [m]; along
    the fourth axis û of the flat state, then û minus it for every λ_x, then for every λ_y. replaced: number of states
    that did not converge, for which the nearest one that did stands in.
    """

    pattern: YarnPattern
    axes: tuple[Floats, Floats, Floats, Floats, Floats]
    values: Floats
    replaced: int = 0

    @classmethod
    def from_store(cls, store: SampleStore, pattern: YarnPattern) -> FluctuationTable:
        """The table of a store of samples; its states are a grid, with flat ones among them.

        Raises InputError where the store is of another pattern, scattered, or without any usable state.
        """
        if store.attributes["provenance"]["pattern_hash"] != pattern.content_hash():
            raise InputError("samples of another pattern", where=store.path, expected=pattern.name)
        if store.dims != STRAINS:
            raise InputError(
                "samples for yarns on cloth",
                where=store.path,
                expected="a grid of strains",
                found="scattered",
            )
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

    def at(self, states: Floats, vertices: NDArray[np.int64]) -> Floats:
        """û of vertices (k,) of the pattern at states (k, 5) in the order of ``axes``, (k, 3) [m]."""
        return _looked_up(self.values, self.axes, np.ascontiguousarray(states, dtype=float), vertices)


def _sorted_grid(
    store: SampleStore,
) -> tuple[tuple[Floats, Floats, Floats, Floats, Floats], NDArray[np.int64]]:
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
    store: SampleStore,
    axes: tuple[Floats, Floats, Floats, Floats, Floats],
    slots: list[NDArray[np.int64]],
) -> tuple[Floats, int]:
    """``values`` and ``replaced`` of a table; ``slots`` number the states over (s_x, s_a, s_y), the flat ones first."""
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
    """Interval of an increasing axis that holds a value, and how far in it lies, clamped to [0, 1]."""
    last = len(axis) - 1
    if last == 0 or value <= axis[0]:
        return 0, 0.0
    if value >= axis[last]:
        return last - 1, 1.0
    k = 0
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


@numba.njit(cache=True)
def _looked_up(values, axes, states, vertices):
    found = np.empty((len(vertices), 3))
    for k in range(len(vertices)):
        fluctuation(values, axes, states[k], vertices[k], found[k])
    return found
