"""Slip that friction has taken up, kept from one step to the next.

Friction is a spring along the surface that yields: within a step its force grows with the slip u up to μN at
|u| = ``reach``. A spring that began every step without slip would let what sticks creep by a part of ``reach`` a step.
So each contact begins a step with the slip that its last one ended with, at most ``reach``: sticking contacts hold
their place, as in elastic–plastic friction with a return to the yield surface (Simo and Laursen 1992). Slips are kept
in units of ``reach``, which grows with the step, so that forces stay as they are where steps grow.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from yarnscale.shell.state import Slips

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

_FACTORS = np.random.default_rng(0).integers(1, 2**63, 5, dtype=np.uint64)


def begun_with(slips: Slips | None, between: Integers, normals: Floats, reach: float) -> Floats:
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


def ended_with(between: Integers, slips: Floats, reach: float) -> Slips:
    """What contacts ``between`` (n, 5) keep of slips (n, 3) [m] at the end of a step."""
    amounts = slips / reach
    amounts /= np.maximum(np.linalg.norm(amounts, axis=1), 1.0)[:, None]
    return Slips(between, amounts)


def _numbers(between: Integers) -> NDArray[np.uint64]:
    """A number of each row, by which equal rows are found; rows are compared afterwards."""
    return (between.astype(np.uint64) * _FACTORS).sum(axis=1, dtype=np.uint64)
