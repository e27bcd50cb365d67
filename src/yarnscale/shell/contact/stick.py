"""Elastic slip of friction, transferred from one step to the next.

Friction is elastic–plastic along the surface: within a step its force grows with the slip u up to μN at
|u| = ``reach``. If every step began without slip, sticking contacts would creep by a part of ``reach`` per step.
So each contact begins with the slip at the end of the last step, at most ``reach``, as in a return to the yield surface
(Simo and Laursen 1992). Slips are stored in units of ``reach``, which is proportional to the step, so that forces do
not change with the length of steps.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from yarnscale.arrays import Array, Integers
from yarnscale.shell.state import Slips

_FACTORS = np.random.default_rng(0).integers(1, 2**63, 5, dtype=np.uint64)


def begun_with(slips: Slips | None, between: Integers, normals: Array, reach: float) -> Array:
    """Slip [m] with which contacts ``between`` (n, 5), see ``Slips``, begin a step, across their normals, (n, 3)."""
    start = np.zeros((len(between), 3))
    if slips is None or not len(slips.between) or not len(between):
        return start
    known, asked = _numbers(slips.between), _numbers(between)
    order = np.argsort(known)
    place = order[np.minimum(np.searchsorted(known[order], asked), len(order) - 1)]
    same = (slips.between[place] == between).all(axis=1)
    start[same] = reach * slips.amounts[place[same]]
    return start - np.einsum("ni,ni->n", start, normals)[:, None] * normals


def ended_with(between: Integers, slips: Array, reach: float) -> Slips:
    """Elastic slips of contacts ``between`` (n, 5) at the end of a step, from slips (n, 3) [m]."""
    amounts = slips / reach
    amounts /= np.maximum(np.linalg.norm(amounts, axis=1), 1.0)[:, None]
    return Slips(between, amounts)


def _numbers(between: Integers) -> NDArray[np.uint64]:
    """Hash of each row; rows with equal hashes are compared afterwards."""
    return (between.astype(np.uint64) * _FACTORS).sum(axis=1, dtype=np.uint64)
