"""Smallest distance of yarns: segment distances over explicit periodic images."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import KDTree

from yarnscale.errors import InputError
from yarnscale.yarn.pattern import YarnPattern

THROUGH_EACH_OTHER = 0.05
"""Centre lines closer than this share of the diameter count as intersecting yarns."""
LARGEST_IMAGE_COUNT = 4_000_000
LARGEST_PAIR_COUNT = 20_000_000
CHUNK = 512


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


def closest_approach(
    pattern: YarnPattern, *, within: float | None = None, neighbours: int = 3
) -> ClosestApproach:
    """The smallest distance between centre lines of segments that are not neighbours along a yarn.

    All periodic images within `within` [m] (default: four radii) are searched. Segments of one yarn are neighbours if
    at most `neighbours` edges or less than half the circumference of a circle of the yarn's radius apart along it.
    Raises InputError if the pattern is too crowded to be searched.
    """
    within = 4.0 * pattern.radius if within is None else within
    best = ClosestApproach(np.inf)
    edge = pattern.edge_vectors()
    reach = within + float(np.linalg.norm(edge, axis=1).max())
    images = _images(pattern, edge, reach)
    for first, second, tile in _candidates(images, reach):
        free = ~_along_same_yarn(pattern, first, second, tile, neighbours)
        first, second, tile = first[free], second[free], tile[free]
        if len(first) == 0:
            continue
        offset = np.zeros((len(first), 3))
        offset[:, :2] = tile * pattern.period
        distance = segment_distance(
            pattern.vertices[first], edge[first], pattern.vertices[second] + offset, edge[second]
        )
        distance *= 2.0 / (pattern.relative_radius[first] + pattern.relative_radius[second])
        least = int(np.argmin(distance))
        if distance[least] < best.distance:
            a, b = (int(step) for step in tile[least])
            best = ClosestApproach(float(distance[least]), int(first[least]), int(second[least]), (a, b))
    return best if best.distance <= within else ClosestApproach(np.inf)


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


def segment_distance(
    start_a: np.ndarray, edge_a: np.ndarray, start_b: np.ndarray, edge_b: np.ndarray
) -> np.ndarray:
    """Distance of the segments ``start + [0, 1] edge``, row by row; shapes (m, 3) -> (m,) [m].

    The closest points are found by clamping (Ericson, Real-Time Collision Detection, §5.1.9).
    """
    gap = start_a - start_b
    aa, bb = _dot(edge_a, edge_a), _dot(edge_b, edge_b)
    ab, ga, gb = _dot(edge_a, edge_b), _dot(edge_a, gap), _dot(edge_b, gap)
    determinant = aa * bb - ab * ab
    skew = determinant > 1e-12 * aa * bb
    s = np.where(skew, np.clip((ab * gb - ga * bb) / np.where(skew, determinant, 1.0), 0.0, 1.0), 0.0)
    t = np.clip((ab * s + gb) / bb, 0.0, 1.0)
    s = np.clip((ab * t - ga) / aa, 0.0, 1.0)
    return np.linalg.norm(gap + s[:, None] * edge_a - t[:, None] * edge_b, axis=1)


def _dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return np.einsum("ij,ij->i", a, b)


@dataclass(frozen=True)
class _Images:
    """Midpoints of the segments of one tile, and of all copies near that tile."""

    midpoint: np.ndarray
    home: np.ndarray
    copy_midpoint: np.ndarray
    copy_segment: np.ndarray
    copy_tile: np.ndarray


def _images(pattern: YarnPattern, edge: np.ndarray, reach: float) -> _Images:
    midpoint = pattern.vertices + 0.5 * edge
    home = -np.floor(midpoint[:, :2] / pattern.period).astype(np.int64)
    midpoint[:, :2] += home * pattern.period
    rings = np.ceil(reach / pattern.period)
    if len(midpoint) * np.prod(2.0 * rings + 1.0) > LARGEST_IMAGE_COUNT:
        raise InputError(
            "period is too small for edges this long",
            expected=f"edges and radius of a few periods ({pattern.period[0]:g}, {pattern.period[1]:g}) m",
            found=f"a reach of {reach:g} m",
        )
    ra, rb = (int(ring) for ring in rings)
    tiles = np.stack(np.meshgrid(np.arange(-ra, ra + 1), np.arange(-rb, rb + 1), indexing="ij"), -1).reshape(
        -1, 2
    )
    copies = np.tile(midpoint, (len(tiles), 1, 1))
    copies[:, :, :2] += (tiles * pattern.period)[:, None, :]
    near = ((copies[..., :2] >= -reach) & (copies[..., :2] <= pattern.period + reach)).all(axis=2)
    which, segment = np.nonzero(near)
    return _Images(midpoint, home, copies[near], segment, tiles[which] + home[segment])


def _candidates(images: _Images, reach: float):
    """Chunks of pairs (first, second, tile of second relative to first) whose midpoints are within reach."""
    tree = KDTree(images.copy_midpoint)
    counts = np.asarray(tree.query_ball_point(images.midpoint, reach, return_length=True))
    if counts.sum() > LARGEST_PAIR_COUNT:
        raise InputError(
            "too many segments lie on top of each other",
            expected=f"at most {LARGEST_PAIR_COUNT} close pairs",
            found=int(counts.sum()),
        )
    for begin in range(0, len(images.midpoint), CHUNK):
        found = tree.query_ball_point(images.midpoint[begin : begin + CHUNK], reach)
        first = np.repeat(np.arange(begin, begin + len(found)), [len(hits) for hits in found])
        copy = np.concatenate([np.asarray(hits, dtype=np.int64) for hits in found])
        second = images.copy_segment[copy]
        once = first <= second
        first, second, copy = first[once], second[once], copy[once]
        yield first, second, images.copy_tile[copy] - images.home[first]


def _along_same_yarn(
    pattern: YarnPattern, first: np.ndarray, second: np.ndarray, tile: np.ndarray, neighbours: int
) -> np.ndarray:
    """Whether the second segment's copy is the first itself or a neighbour of it along its own yarn."""
    yarn = pattern.yarn_of_vertex[first]
    same = yarn == pattern.yarn_of_vertex[second]
    shift = pattern.yarn_shift[yarn]
    along = pattern.tile_along_yarn
    # Laps round the yarn that lead to this copy: tile_first + tile = tile_second + laps * shift.
    wanted = along[first] + tile - along[second]
    size = np.maximum((shift * shift).sum(axis=1), 1)
    laps = np.rint((wanted * shift).sum(axis=1) / size).astype(np.int64)
    same &= (laps[:, None] * shift == wanted).all(axis=1)
    middle, lap_length, lap_count = _arc_length(pattern)
    steps = pattern.position_along_yarn[second] + laps * lap_count[yarn] - pattern.position_along_yarn[first]
    arc = middle[second] + laps * lap_length[yarn] - middle[first]
    closed = (shift == 0).all(axis=1)
    steps = np.where(closed, _around(steps, lap_count[yarn]), np.abs(steps))
    arc = np.where(closed, _around(arc, lap_length[yarn]), np.abs(arc))
    between = arc - 0.5 * (pattern.rest_length[first] + pattern.rest_length[second])
    return same & (
        (steps <= neighbours) | (between < np.pi * pattern.radius * pattern.relative_radius[first])
    )


def _around(distance: np.ndarray, lap: np.ndarray) -> np.ndarray:
    """The shorter way round a ring."""
    forward = np.mod(distance, lap)
    return np.minimum(forward, lap - forward)


def _arc_length(pattern: YarnPattern) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Rest arc length at the middle of each edge, and length and edge count of each yarn's period."""
    middle = np.empty(len(pattern.edges))
    for chain in pattern.yarns:
        rest = pattern.rest_length[chain]
        middle[chain] = np.cumsum(rest) - 0.5 * rest
    length = np.array([pattern.rest_length[chain].sum() for chain in pattern.yarns])
    return middle, length, np.array([len(chain) for chain in pattern.yarns])
