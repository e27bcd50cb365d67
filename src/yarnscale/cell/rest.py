"""Rest shapes: patterns whose cell carries no coarse in-plane stress (HYLC20 §5.1, EST22 §7.2).

A pattern as drawn is not at rest: its yarns push and pull, and a cell at its periods is under stress. Two methods
remove it. ``shrunk_to_rest`` lets the periods follow until the stress is gone, the yarns keeping their own rest shape
(straight ones stay bent in the fabric: stockinette curls). ``estimated_rest`` keeps the periods and sets what the
yarns are at rest instead, as knitting and finishing do (nothing is left that could curl).
"""

from __future__ import annotations

import time
from dataclasses import replace
from functools import partial

import numpy as np

from yarnscale.cell.periodic import PeriodicCell
from yarnscale.cell.release import released
from yarnscale.cell.rest_estimate import estimated_rest
from yarnscale.cell.rest_outcome import (
    RestRound,
    RestShape,
    RestStatus,
    RestStress,
    RoundObserver,
    note_round,
    outcome,
    rest_stress_ratio,
    shortened,
)
from yarnscale.cell.rest_shape import rebased, set_as_drawn
from yarnscale.checked import checked
from yarnscale.errors import InputError
from yarnscale.numerics.newton import Watch
from yarnscale.yarn.pattern import YarnPattern
from yarnscale.yarn.stiffness import Materials

__all__ = [
    "SETTING",
    "RestRound",
    "RestShape",
    "RestStatus",
    "RestStress",
    "estimated_rest",
    "rebased",
    "rest_stress_ratio",
    "set_as_drawn",
    "settled",
    "shrunk_to_rest",
]

SETTING = 0.8
"""Default share of the drawn curvature and twist that yarns have at rest."""
SMALLEST_STEP = 1e-5
"""A step of the periods below this is none: the stress is that of a strain of 1e-5."""


@checked
def settled(
    pattern: YarnPattern,
    material: Materials,
    *,
    setting: float = SETTING,
    shortening: float = 0.06,
    progress: RoundObserver | None = None,
    watch: Watch | None = None,
) -> RestShape:
    """A drawn pattern as relaxed fabric at rest; the same result every time.

    The yarns take on most of the shape they are drawn in, as yarn ravelled from a fabric has (HYLC20 fig. 10; the
    rest curvatures published with it are those of the drawings), are shortened, and the periods follow
    (``shrunk_to_rest``): that keeps what is left of their bending, so that stockinette curls, and gives a fabric whose
    yarns touch. Where shear stress is left, as in twills, the yarns are set further (``estimated_rest``), at those
    periods or, failing that, at the drawn ones; the history then continues with the rounds of that search.

    setting: share of the drawn curvature and twist that the yarns have at rest. 0 leaves straight yarns as they
    are: ribs then draw in to half their width, and loose fabrics are as stiff as their yarns bend.
    shortening: share of the rest lengths taken away; more makes a tighter fabric. progress: called after every round;
    watch: of ``PeriodicCell``.
    Raises InputError for a setting outside [0, 1] or a shortening outside [0, 0.5].
    """
    if not 0.0 <= setting <= 1.0:
        raise InputError("setting is out of range", expected="0 to 1", found=setting)
    start = set_as_drawn(pattern, share=setting, lengths=False)
    shape = shrunk_to_rest(
        PeriodicCell(start, material).with_options(watch=watch), shortening=shortening, progress=progress
    )
    if shape.status is not RestStatus.SKEWED:
        return shape
    attempts = [shape]
    # At the periods that shrinking found; where that is too tight to lose its shear stress, at those of the drawing.
    for source, share, rounds in ((shape.pattern, 0.0, 60), (start, 0.1, 200)):
        cell = PeriodicCell(source, material).with_options(watch=watch)
        attempts.append(estimated_rest(cell, shortening=share, max_rounds=rounds, progress=progress))
        if attempts[-1].converged:
            break
    history = tuple(entry for attempt in attempts for entry in attempt.history)
    return replace(attempts[-1], history=history, seconds=sum(attempt.seconds for attempt in attempts))


def shrunk_to_rest(
    cell: PeriodicCell, *, shortening: float = 0.0, max_rounds: int = 60, progress: RoundObserver | None = None
) -> RestShape:
    """Put yarns under tension by shortening them and let the periods follow to zero stress (``released``).

    The pattern is redrawn at the periods found until they stay. Rest curvatures and twists of the yarns stay. Shear
    stress cannot vanish so (the periods stay orthogonal) and bending stress need not (HYLC20 §5.1, after Leaf et al.
    2018).

    shortening: share of the rest lengths taken away first; more makes a tighter fabric.
    Raises InputError for a shortening outside [0, 0.5].
    """
    began, drawn = time.perf_counter(), cell.pattern
    cell, matrix = shortened(cell, shortening), None
    history: list[RestRound] = []
    status = RestStatus.ROUND_LIMIT
    while len(history) < max_rounds and status is RestStatus.ROUND_LIMIT:
        found = released(
            cell, matrix=matrix, tolerance=SMALLEST_STEP, max_steps=max_rounds - len(history),
            observe=partial(note_round, history, drawn, cell.pattern, progress=progress),
        )  # fmt: skip
        cell, matrix = found.cell, found.matrix
        if not found.state.usable or (not found.converged and len(history) < max_rounds):
            status = RestStatus.NOT_RELAXED
        # Redrawn, the constraint that holds yarns in place follows their new tangents: a little stress comes back.
        elif found.converged and np.abs(found.change).max() < SMALLEST_STEP:
            status = RestStatus.CONVERGED
    return outcome(cell, status, history, began)
