"""The built-in body: torso, arms, neck and head as one smooth closed surface that moves.

Its shape is a smooth union of capsules and ellipsoids given by distance functions; the surface where the distance is
zero is extracted from a grid, one vertex in every cell that it crosses (surface nets), and projected onto the zero
set. Coordinates: x to the body's left as seen from the front, y to its back, z up; the arms are along x at z = 0.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache

import numpy as np

from yarnscale.arrays import Array, Integers
from yarnscale.errors import InputError
from yarnscale.motion.rigid import rotation_matrix
from yarnscale.shell.garments.panels import smoothed

SHOULDER = 0.17
"""Distance of the shoulder joints from the middle [m]."""
REACH = 0.76
"""x of the ends of the hands [m]."""
_LOW, _HIGH = np.array([-0.84, -0.21, -0.86]), np.array([0.84, 0.21, 0.45])
_BLEND = 0.05


@dataclass(frozen=True, eq=False)
class Mannequin:
    """The body with arms stretched out: vertices (n, 3) [m] and triangles (m, 3) that face outwards."""

    vertices: Array
    triangles: Integers

    def pose(self, *, lowered: float = 0.0, turned: float = 0.0, depth: float = 1.0) -> Array:
        """Vertices (n, 3) [m] with the arms lowered and the body rotated about z by angles [rad].

        depth: factor of its front-to-back extent; a thin body fits between the layers of flat clothes.
        """
        points = self.vertices * [1.0, depth, 1.0]
        share = _arm_share(self.vertices)[:, None]
        for side in (-1.0, 1.0):
            arm = share * (side * self.vertices[:, :1] > 0)
            joint = np.array([side * SHOULDER, 0.0, 0.0])
            swung = (points - joint) @ rotation_matrix(np.array([0.0, side * lowered, 0.0])).T + joint
            points = points + arm * (swung - points)
        return points @ rotation_matrix(np.array([0.0, 0.0, turned])).T


@dataclass(frozen=True)
class Pose:
    """Pose of the body at a time [s]: angles [rad] and depth as in ``Mannequin.pose``."""

    time: float
    lowered: float = 0.0
    turned: float = 0.0
    depth: float = 1.0


@dataclass(frozen=True, eq=False)
class MovingMannequin:
    """A body that moves smoothly from pose to pose, as an obstacle for cloth. Raises InputError."""

    body: Mannequin
    poses: tuple[Pose, ...]

    def __post_init__(self) -> None:
        times = np.array([pose.time for pose in self.poses])
        if len(times) == 0 or not np.isfinite(times).all() or (np.diff(times) <= 0).any():
            raise InputError("times of the poses", expected="increasing numbers [s]", found=times)

    @property
    def moves(self) -> bool:
        return len(self.poses) > 1

    @property
    def triangles(self) -> Integers:
        return self.body.triangles

    def points(self, time: float) -> Array:
        times = [pose.time for pose in self.poses]
        place = float(np.interp(time, times, np.arange(len(times))))
        before = min(int(place), len(times) - 1)
        one, two = self.poses[before], self.poses[min(before + 1, len(times) - 1)]
        share = place - before
        share *= share * (3.0 - 2.0 * share)
        return self.body.pose(
            lowered=one.lowered + share * (two.lowered - one.lowered),
            turned=one.turned + share * (two.turned - one.turned),
            depth=one.depth + share * (two.depth - one.depth),
        )


@cache
def mannequin(spacing: float = 0.02) -> Mannequin:
    """The body with edges of about ``spacing`` [m]. Raises InputError for impossible spacings."""
    if not (math.isfinite(spacing) and 0.004 <= spacing <= 0.03):
        raise InputError("spacing of the body", expected="between 0.004 and 0.03 m", found=spacing)
    points, triangles = _surface(spacing)
    for _ in range(6):
        points = _onto_surface(smoothed(points, triangles))
    return Mannequin(points, triangles)


def body_distance(points: Array) -> Array:
    """Approximate distance of points (n, 3) from the body's surface [m], negative inside, (n,)."""
    mirrored = np.abs(points[:, :1])
    half = np.concatenate([mirrored, points[:, 1:]], axis=1)
    # The torso is a capsule in a space stretched so that its section becomes round.
    torso = _capsule(points * [0.7, 1.0, 1.0], (0, 0, -0.66), (0, 0, -0.12), 0.115, 0.112)
    shoulders = _capsule(points, (-0.13, 0, -0.03), (0.13, 0, -0.03), 0.06, 0.06)
    arm = _capsule(half, (0.15, 0, -0.01), (REACH, 0, 0.025), 0.054, 0.027)
    neck = _capsule(points, (0, 0.005, -0.02), (0, -0.005, 0.13), 0.056, 0.054)
    centre, axes = np.array([0.0, -0.01, 0.235]), np.array([0.078, 0.095, 0.115])
    head = (np.linalg.norm((points - centre) / axes, axis=1) - 1.0) * axes.min()
    whole = _union(torso, shoulders, 1.5 * _BLEND)
    whole = _union(whole, arm, _BLEND)
    whole = _union(whole, neck, 2.0 * _BLEND)
    return _union(whole, head, 0.6 * _BLEND)


def _arm_share(points: Array) -> Array:
    """How far points follow the arms, from 0 on the torso to 1, (n,)."""
    outward = _ramp(np.abs(points[:, 0]), SHOULDER - 0.08, SHOULDER + 0.07)
    return outward * _ramp(points[:, 2], -0.15, -0.07)


def _ramp(values: Array, low: float, high: float) -> Array:
    share = np.clip((values - low) / (high - low), 0.0, 1.0)
    return share * share * (3.0 - 2.0 * share)


def _capsule(points: Array, start: object, end: object, first: float, last: float) -> Array:
    """Distance from a segment, less a radius that goes from ``first`` to ``last`` [m]."""
    a, b = np.asarray(start, float), np.asarray(end, float)
    axis = b - a
    along = np.clip((points - a) @ axis / (axis @ axis), 0.0, 1.0)
    nearest = a + along[:, None] * axis
    return np.linalg.norm(points - nearest, axis=1) - (first + along * (last - first))


def _union(one: Array, two: Array, blend: float) -> Array:
    """Smallest of two distances, rounded off where they differ by less than ``blend`` [m]."""
    near = np.maximum(blend - np.abs(one - two), 0.0) / blend
    return np.minimum(one, two) - 0.25 * blend * near**2


def _surface(spacing: float) -> tuple[Array, Integers]:
    """One vertex per crossed cell of a grid, a quadrilateral of two triangles per crossed edge."""
    # Symmetric about x = 0, which lies between two planes of the grid.
    counts = 2 * np.ceil((_HIGH - _LOW) / spacing / 2).astype(int)
    axes = [low + spacing * np.arange(n + 1) for low, n in zip(_LOW, counts, strict=True)]
    axes[0] = spacing * (np.arange(counts[0] + 2) - 0.5 * (counts[0] + 1))
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    values = body_distance(grid.reshape(-1, 3)).reshape(grid.shape[:3])
    cells = tuple(n - 1 for n in values.shape)
    total, count = np.zeros((*cells, 3)), np.zeros(cells)
    quads = []
    for axis in range(3):
        u, v = (axis + 1) % 3, (axis + 2) % 3
        first, last = (
            np.take(values, range(cells[axis]), axis),
            np.take(values, range(1, cells[axis] + 1), axis),
        )
        crossed = np.argwhere((first < 0) != (last < 0))
        here = tuple(crossed.T)
        share = first[here] / (first[here] - last[here])
        places = grid[here].copy()
        places[:, axis] += share * spacing
        around = []
        for du, dv in ((-1, -1), (0, -1), (0, 0), (-1, 0)):
            cell = crossed.copy()
            cell[:, u] += du
            cell[:, v] += dv
            np.add.at(total, tuple(cell.T), places)
            np.add.at(count, tuple(cell.T), 1.0)
            around.append(np.ravel_multi_index(tuple(cell.T), cells))
        quad = np.column_stack(around)
        inward = first[here] >= 0
        quad[inward] = quad[inward, ::-1]
        quads.append(quad)
    quad = np.concatenate(quads)
    used, numbers = np.unique(quad, return_inverse=True)
    points = total.reshape(-1, 3)[used] / count.ravel()[used, None]
    a, b, c, d = numbers.reshape(-1, 4).T
    shorter = (np.linalg.norm(points[a] - points[c], axis=1) <= np.linalg.norm(points[b] - points[d], axis=1))[:, None]
    one = np.where(shorter, np.column_stack([a, b, c]), np.column_stack([a, b, d]))
    two = np.where(shorter, np.column_stack([a, c, d]), np.column_stack([b, c, d]))
    return points, np.concatenate([one, two]).astype(np.int64)


def _onto_surface(points: Array) -> Array:
    """Two steps of Newton along the gradient of the distance."""
    for _ in range(2):
        size = 1e-5
        steps = size * np.eye(3)
        gradient = np.column_stack(
            [(body_distance(points + s) - body_distance(points - s)) / (2 * size) for s in steps]
        )
        square = np.maximum((gradient**2).sum(axis=1), 0.05)
        points = points - (body_distance(points) / square)[:, None] * gradient
    return points
