"""How the yarn of a knitted piece begins, turns and ends: twisted loops, selvedges, bind-off, ends. Lengths in radii.

Borders are drawn with room for the yarn, and find their shape in an equilibrium.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from yarnscale.arrays import Array
from yarnscale.fabric.knitted_course import BorderRow, Strand, smooth

TAIL = 8.0
"""Length of yarn left over at either end of a yarn [r]."""
CAST_ON_DEPTH = 4.0
"""Of the twisted loops below the heads that the first course is drawn through [r]."""
CARRY_STEP = 2.2
"""Distance of yarns carried past each other along a selvedge [r]."""


def cast_on(heads: Sequence[Strand], width: float) -> Strand:
    """Heads of twisted loops, whose legs cross and join those of their neighbours, from left to right.

    The yarn comes in under a loop, goes up its right leg, over the head, down the left leg, and out over itself to the
    right.
    """
    pitch = width / len(heads)
    base, lean = min(float(head.points[:, 1].min()) for head in heads) - CAST_ON_DEPTH, 0.25 * pitch
    start: ArrayLike = [-TAIL, base, 0.0]
    parts = [Strand.drawn(start)]
    for wale, head in enumerate(heads):
        middle = (wale + 0.5) * pitch
        left, right = head.points[0], head.points[-1]
        across = base + 0.45 * CAST_ON_DEPTH
        under = [
            [middle - lean, base + 0.1, -0.7],
            [middle, across, -1.05],
            [middle + 0.2 * pitch, across + 1.3, 0.0],
        ]
        over = [
            [middle - 0.2 * pitch, across + 1.3, 1.05],
            [middle, across, 1.05],
            [middle + lean, base + 0.1, 0.7],
        ]
        end = [(wale + 1) * pitch, base, 0.0]
        parts += [
            smooth([start, under, right]),
            head.reversed(),
            smooth([left, over, end]),
            Strand.drawn(end),
        ]
        start = end
    return Strand.merged(parts)


def selvedge(start: Array, stop: Array, *, right: bool, out: float = 0.0, level: float = 0.0) -> Strand:
    """The yarn from the end of one course to the beginning of a higher one, around half a circle outside.

    out: so much further out; level: height at which it passes other yarns there.
    """
    side = 1.0 if right else -1.0
    middle, half = 0.5 * (start + stop), 0.5 * (stop[1] - start[1])
    reach = half if out == 0.0 else out
    angle = np.linspace(-0.5 * np.pi, 0.5 * np.pi, 9)[1:-1]
    arc = np.stack(
        [
            middle[0] + side * (reach * np.cos(angle) + 0.5),
            middle[1] + half * np.sin(angle),
            middle[2] + 0.5 * (stop[2] - start[2]) * np.sin(angle) + level,
        ],
        axis=1,
    )
    return smooth([start, arc, stop])


def tail(start: Array, *, right: bool) -> Strand:
    """The free end of a yarn outside a selvedge, from the fabric outwards."""
    end = start + np.array([TAIL if right else -TAIL, 0.0, -start[2]])
    return Strand.merged([smooth([start, end]), Strand.drawn(end)])


def last_row(row: BorderRow, width: float, *, backward: bool, bound_off: bool) -> Strand:
    """Loops that lie along the border, each drawn through the one before, and the yarn's end through the last.

    backward: from right to left. bound_off: False leaves the loops upright.
    """
    if backward:
        return last_row(row.mirrored(width), width, backward=False, bound_off=bound_off).mirrored(width)
    points, pitch = row.yarn.points, width / len(row.rise)
    # All loops begin at the level of the highest one, free of other loops.
    level = float(max(points[row.rise, 1].max(), points[row.fall - 1, 1].max()))
    close = min(1.0, pitch / _LINK_PITCH)
    parts, begin = [], 0
    for wale, (rise, fall) in enumerate(zip(row.rise, row.fall, strict=True)):
        middle = (wale + 0.5) * pitch
        parts.append(row.yarn.part(begin, int(rise) + 1))
        if bound_off:
            link = [middle, level, 0.0] + _LINK @ [[close, 0.0, 0.0], [pitch, 0.0, 0.0], [0, 1, 0], [0, 0, 1]]
            parts.append(smooth([points[rise], link, points[fall - 1]]))
        else:
            parts.append(row.yarn.part(int(rise) + 1, int(fall) - 1))
        begin = int(fall) - 1
    parts.append(row.yarn.part(begin, len(row.yarn)))
    last = points[-1]
    middle = width + 0.5 * pitch
    if bound_off:
        way = [
            # Straight up, as the yarn turns into the course below where this one ends.
            [width + 0.9, last[1] + 1.2, 0.5 * last[2] - 0.3],
            [width + 1.2, 0.5 * (last[1] + level) + 0.6, -0.8],
            [middle, level + 2.1, -1.05],
            [middle + 0.4, level + 3.8, 0.0],
            [middle + 1.8, level + 4.3, 1.0],
            [middle + 0.5 * pitch, level + 4.3, 1.05],
            [middle + 0.5 * pitch + TAIL, level + 4.3, 0.0],
        ]
    else:
        way = [[last[0] + TAIL, last[1], 0.0]]
    return Strand.merged([*parts, smooth([last, way]), Strand.drawn(way[-1])])


_LINK = np.array(
    [
        # x from the stitch's middle (the second column in pitches), y over the legs' ends, z.
        [-1.5, 0.0, 2.1, -1.05],
        [-1.2, 0.0, 3.7, 0.0],
        [-0.3, 0.05, 5.0, 0.8],
        [-1.8, 0.5, 5.3, 1.05],
        [0.0, 0.5, 5.4, 1.05],
        [2.5, 0.5, 6.4, 0.3],
        [1.0, 1.0, 6.6, -0.6],
        [-0.7, 1.5, 5.8, -1.05],
        [0.0, 1.5, 4.3, -1.05],
        [-0.8, 1.5, 2.6, -0.5],
        [1.6, 1.0, 2.1, 1.05],
        [-1.5, 1.0, 2.1, 1.05],
        [0.2, 0.5, 3.2, 1.05],
        [-1.6, 0.5, 3.5, 0.9],
        [1.6, 0.0, 3.2, -0.4],
        [1.5, 0.0, 2.1, -1.05],
    ]
)
"""A loop of the bind-off from its left leg to its right one: up through the loop before, along the border around the
neck of the loop after it, and back."""
_LINK_PITCH = 8.0
"""Wale spacing below which these loops are narrower [r]."""
