"""Curves moved onto lines that were traced over both photographs: visible parts lie on them, hidden ones follow."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from scipy.spatial import KDTree

from yarnscale.arrays import Array
from yarnscale.errors import InputError
from yarnscale.swatches.registration import fit
from yarnscale.swatches.registration.curves import SAMPLES, YarnCurves
from yarnscale.swatches.registration.registration import Registration

STIFFENING = (0.2, 0.2, 0.3, 0.3, 0.5, 0.5, 1.0, 1.0, 1.0)
"""Weights of visible points on their nearest lines, round after round: first the yarn as a whole, then its parts."""
_GRID = 24
"""Places along each period at which a side is tried."""
_FAR = 2.0
"""Distance from which a line counts as missing [r]."""
LEAST_COVERED = 0.6
"""Share of the visible control points near a traced line, below which lines are missing."""


def onto_lines(drawn: YarnCurves, lines: Mapping[str, Sequence[Array]]) -> Registration:
    """The curves moved onto lines (k, 2) [m] by side, of the period of the curves; the back as it is photographed.

    Raises InputError where too little of what a side shows was traced.
    """
    period, radius = drawn.period, drawn.radius
    trees = {}
    for side, traced in lines.items():
        turn = np.array([-1.0 if side == "back" else 1.0, 1.0])
        points = np.concatenate([_dense(line, 0.2 * radius) for line in traced]) * turn
        trees[side] = KDTree(points % period, boxsize=period)
    state = Registration(drawn, {}, 1.0)
    places = {side: _place(state, side, tree) for side, tree in trees.items()}
    for number, weight in enumerate(STIFFENING):
        pins = {}
        for side, tree in trees.items():
            seen = np.flatnonzero(state.seen(side)[::SAMPLES])
            here = state.curves.controls[seen, :2] + places[side]
            distance, nearest = tree.query(here % period)
            near = distance < _FAR * radius
            if number == 0 and near.sum() < max(1.0, LEAST_COVERED * len(near)):
                what = f"traced lines of the {side} cover {near.sum()} of {len(near)} points that it shows"
                raise InputError(what, expected=f"{100 * LEAST_COVERED:.0f} % or more, over one whole period")
            away = tree.data[nearest] - here % period
            away -= np.rint(away / period) * period
            if not near.any():
                continue
            # What is left of the side's place is common to all points.
            common = away[near].mean(axis=0)
            places[side] = places[side] + common
            targets = state.curves.controls[seen, :2] + away - common
            pins |= {int(point): targets[k] for k, point in enumerate(seen) if near[k]}
        state = replace(state, curves=fit.fitted(drawn, (), pins=pins, pinned=weight, blurs=(0.0,)).curves, apart=True)
    return state


def _place(state: Registration, side: str, tree: KDTree) -> Array:
    """Where the curves' origin lies on a side's lines (2,) [m]."""
    curves = state.curves
    crests = curves.samples[state.seen(side), :2]
    steps = np.arange(_GRID) / _GRID
    tried = np.stack(np.meshgrid(steps, steps), -1).reshape(-1, 2) * curves.period
    distance = tree.query((crests[None] + tried[:, None]) % curves.period)[0]
    return tried[np.argmin(np.minimum(distance, _FAR * curves.radius).mean(axis=1))]


def _dense(line: Array, step: float) -> Array:
    """Points along a polyline (k, 2) at most a step apart."""
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1))])
    at = np.linspace(0.0, along[-1], max(2, int(np.ceil(along[-1] / step)) + 1))
    return np.stack([np.interp(at, along, line[:, k]) for k in range(2)], axis=1)
