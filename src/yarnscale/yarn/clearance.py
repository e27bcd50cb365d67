"""Smallest distance of yarns: segment distances over explicit periodic images."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from yarnscale.errors import InputError
from yarnscale.yarn.close_pairs import close_pairs, pair_gaps
from yarnscale.yarn.pattern import YarnPattern
from yarnscale.yarn.strands import Neighbours, Strands

THROUGH_EACH_OTHER = 0.05
"""Centre lines closer than this share of the diameter count as intersecting yarns."""


@dataclass(frozen=True)
class ClosestApproach:
    """The two segments whose centre lines are closest.

    `distance` [m], infinite if there is none within the range; between yarns of other radii than the
    pattern's it is scaled so that they touch at twice the pattern's radius. `first` and `second`: first vertices of the
    two edges (-1 if there are none). `tile`: (a, b) of the second edge, relative to that of the first.
    """

    distance: float
    first: int = -1
    second: int = -1
    tile: tuple[int, int] = (0, 0)


def closest_approach(pattern: YarnPattern, *, within: float | None = None, own: float | None = None) -> ClosestApproach:
    """The smallest distance between centre lines of segments that are not neighbours along a yarn.

    All periodic images within `within` [m] (default: four radii) are searched. Segments of one yarn are neighbours
    if they would be where yarns touch at the distance `own` [m] (default: their diameter; see ``Neighbours``).
    Raises InputError if the pattern is too crowded to be searched.
    """
    within = 4.0 * pattern.radius if within is None else within
    wrapped, share = pattern.wrapped(), pattern.relative_radius
    edge = np.linalg.norm(pattern.edge_vectors(), axis=1)
    strands = Strands.around(wrapped, within + float(edge.max()))
    nodes = strands.copies(wrapped.vertices, wrapped.period)
    distance = 2.0 * pattern.radius * share if own is None else own
    neighbours = Neighbours.by_length(strands, pattern.rest_length, distance)
    first, copy = close_pairs(strands, nodes, within, neighbours=neighbours)
    second, tile = copy % strands.count, strands.tiles[copy // strands.count]
    distance = 2.0 * pair_gaps(nodes, strands.ends, first, copy) / (share[first] + share[second])
    if distance.min(initial=np.inf) > within:
        return ClosestApproach(np.inf)
    best = int(np.argmin(distance))
    moved = np.round((wrapped.vertices - pattern.vertices)[:, :2] / pattern.period).astype(np.int64)
    a, b = (tile[best] + moved[second[best]] - moved[first[best]]).tolist()
    return ClosestApproach(float(distance[best]), int(first[best]), int(second[best]), (a, b))


def check_clearance(
    pattern: YarnPattern, *, where: object = None, least: float = THROUGH_EACH_OTHER
) -> ClosestApproach:
    """The closest approach; InputError naming the segments when below `least` diameters."""
    try:
        approach = closest_approach(pattern)
    except InputError as error:
        raise error.at(where) from None
    diameter = 2.0 * pattern.radius
    if approach.distance < least * diameter:
        ends = pattern.next_vertex
        image = "" if approach.tile == (0, 0) else f" (its copy in tile {approach.tile})"
        raise InputError(
            f"yarns run through each other: segment {approach.first}-{ends[approach.first]} and "
            f"segment {approach.second}-{ends[approach.second]}{image}",
            where=where,
            expected=f"centre lines at least {least:g} diameters ({least * diameter:.3g} m) apart",
            found=f"{approach.distance / diameter:.2g} diameters ({approach.distance:.2g} m)",
        )
    return approach
