"""Cloth against a sphere or a half-space.

A plane is in contact with vertices, the closest points of flat triangles. A sphere is in contact with the point of
each triangle that is closest to its centre, so that it cannot penetrate a coarse mesh.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from yarnscale.motion.obstacles import Plane, Shape, Sphere
from yarnscale.motion.rigid import rotation_matrix
from yarnscale.shell.contact.barrier import ContactSettings, barrier, smooth_length
from yarnscale.shell.contact.crossings import Crossing, shape_crossing
from yarnscale.shell.contact.stick import begun_with, ended_with
from yarnscale.shell.mesh import TriangleMesh
from yarnscale.shell.state import Slips

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

_KEPT = 0.1
"""Part of a distance that remains after a step."""


@dataclass(frozen=True, eq=False)
class _Touch:
    """Points of the cloth near the shape, Σ weights·vertices.

    which: index of each point, among vertices (plane) or triangles (sphere), (n,); vertices: (n, k); weights:
    (n, k); distances: (n,) [m]; normals: out of the shape, (n, 3).
    """

    which: Integers
    vertices: Integers
    weights: Floats
    distances: Floats
    normals: Floats


class ShapeContact:
    """Contact with one shape, whose point is row ``guest`` of the ``rows`` of positions, or at rest (None)."""

    def __init__(
        self, shape: Shape, mesh: TriangleMesh, settings: ContactSettings, guest: int | None, rows: int
    ) -> None:
        self.shape, self.settings, self.guest, self.size = shape, settings, guest, 3 * rows
        self.count, self.triangles = mesh.vertex_count, mesh.triangles
        areas = mesh.areas if isinstance(shape, Sphere) else mesh.vertex_areas
        self.weights = areas * settings.stiffness
        self.shape_radius = shape.radius if isinstance(shape, Sphere) else math.inf
        self._still = shape.points(0.0)[0]
        self.held: _Touch | None = None
        self.grip, self.origin, self.reach = np.zeros(0), np.zeros((0, 3)), 1.0
        self.between = np.zeros((0, 5), np.int64)

    def start_step(
        self, positions: Floats, duration: float, time: float, number: int = 0, slips: Slips | None = None
    ) -> None:
        if self.settings.friction == 0.0:
            return
        touch = self._touch(positions)
        slope = barrier(touch.distances, self.settings.thickness)[1]
        self.grip = -slope * self.weights[touch.which] * self.settings.friction
        self.held = touch
        centre = self._point(positions)
        away = _combine(touch, positions) - centre
        self.reach = self.settings.slip * duration
        self.between = np.zeros((len(touch.which), 5), np.int64)
        self.between[:, 0], self.between[:, 1] = 2 * number, touch.which
        away -= begun_with(slips, self.between, touch.normals, self.reach)
        # Relative to the point of the shape; a sphere that turns carries its surface along.
        self.origin = away @ self._turned(time, duration).T

    def slips(self, positions: Floats) -> Slips:
        """Elastic slips at the end of a step."""
        return ended_with(self.between, self._slip(positions)[0], self.reach)

    def value(self, positions: Floats) -> float:
        touch = self._touch(positions)
        if (touch.distances <= 0).any():
            return math.inf
        energy = barrier(touch.distances, self.settings.thickness)[0] @ self.weights[touch.which]
        return float(energy) + float(self.grip @ self._slip(positions)[1])

    def gradient(self, positions: Floats, gradient: Floats) -> float:
        touch = self._touch(positions)
        if (touch.distances <= 0).any():
            return math.inf
        energy, slope, _ = barrier(touch.distances, self.settings.thickness)
        weights = self.weights[touch.which]
        self._push(touch, (slope * weights)[:, None] * touch.normals, gradient)
        sliding, potential, rate, _ = self._slip(positions)
        if self.held is not None:
            self._push(self.held, (self.grip * rate)[:, None] * sliding, gradient)
        return float(energy @ weights) + float(self.grip @ potential)

    def hessian(self, positions: Floats) -> tuple[Integers, Floats]:
        touch = self._touch(positions)
        _, slope, bend = barrier(touch.distances, self.settings.thickness)
        areas = self.weights[touch.which]
        found = [self._entries(touch, np.maximum(bend * areas, 0.0)[:, None, None] * _outer(touch.normals))]
        if isinstance(self.shape, Sphere):
            found.append(self._tilt_entries(touch, positions, -slope * areas))
        if self.held is not None:
            sliding, _, rate, change = self._slip(positions)
            length = np.linalg.norm(sliding, axis=1)
            along = _outer(sliding / np.maximum(length, 1e-300)[:, None])
            across = np.eye(3) - _outer(self.held.normals) - along
            blocks = rate[:, None, None] * across + change[:, None, None] * along
            found.append(self._entries(self.held, self.grip[:, None, None] * blocks))
        return np.concatenate([k for k, _ in found]), np.concatenate([e for _, e in found])

    def room(self, positions: Floats, within: float) -> Integers:
        """Keys, as of ``hessian``, of points closer than ``within`` [m]."""
        touch = self._touch(positions, within)
        return self._entries(touch, np.zeros((len(touch.which), 3, 3)))[0]

    def bound(self, positions: Floats, step: Floats) -> float:
        relative = positions[: self.count] - self._point(positions)
        moved = step[: self.count] - (step[self.guest] if self.guest is not None else 0.0)
        if isinstance(self.shape, Plane):
            normal = np.asarray(self.shape.normal)
            height, sinking = relative @ normal, -(moved @ normal)
            hits = sinking > (1.0 - _KEPT) * height
            return float(((1.0 - _KEPT) * height[hits] / sinking[hits]).min(initial=1.0))
        return self._advance(relative[self.triangles], moved[self.triangles])

    def closest(self, positions: Floats) -> float:
        return float(self._touch(positions, math.inf).distances.min())

    def intersects(self, positions: Floats) -> bool:
        return self.closest(positions) <= 0

    def crossings(self, positions: Floats, body: int, name: str) -> list[Crossing]:
        """Crossings of the cloth with the shape; body: its number among the obstacles."""
        flat = isinstance(self.shape, Plane)
        inside = self._touch(positions, math.nextafter(0.0, 1.0))
        if not len(inside.which):
            return []
        kind, count = ("vertex", self.count) if flat else ("triangle", len(self.triangles))
        return [shape_crossing(body, name, kind, inside.distances, _combine(inside, positions), count)]

    def _advance(self, corners: Floats, steps: Floats) -> float:
        """Fraction of steps of corners (n, 3, 3) relative to the centre that keeps every triangle outside.

        Conservative advancement: no point of a triangle is faster than its fastest corner.
        """
        assert isinstance(self.shape, Sphere)
        radius, fastest = self.shape.radius, np.linalg.norm(steps, axis=2).max(axis=1)
        lowest = np.linalg.norm(corners, axis=2).min(axis=1) - _size(corners) - fastest
        some = np.flatnonzero((lowest < radius) & (fastest > 0))
        corners, steps, fastest = corners[some], steps[some], fastest[some]
        begin = np.linalg.norm(_nearest(corners)[1], axis=1) - radius
        done, first = np.zeros(len(some)), 1.0
        for _ in range(40):
            if not len(done):
                break
            distance = np.linalg.norm(_nearest(corners + done[:, None, None] * steps)[1], axis=1) - radius
            spare = distance - _KEPT * begin
            done = done + np.maximum(spare, 0.0) / fastest
            arrived = spare < 0.01 * begin
            first = min(first, float(done[arrived].min(initial=1.0)))
            on = ~arrived & (done < first)
            corners, steps, fastest, begin, done = corners[on], steps[on], fastest[on], begin[on], done[on]
        return min(first, float(done.min(initial=1.0)))

    def _touch(self, positions: Floats, within: float | None = None) -> _Touch:
        """Points closer than the thickness, or than ``within`` [m]."""
        limit = self.settings.thickness if within is None else within
        relative = positions[: self.count] - self._point(positions)
        if isinstance(self.shape, Plane):
            normal = np.asarray(self.shape.normal)
            distance = relative @ normal
            near = np.flatnonzero(distance < limit)
            normals = np.broadcast_to(normal, (len(near), 3))
            return _Touch(near, near[:, None], np.ones((len(near), 1)), distance[near], normals)
        corners = relative[self.triangles]
        radius = self.shape.radius
        lowest = np.linalg.norm(relative, axis=1)[self.triangles].min(axis=1) - _size(corners)
        some = np.flatnonzero(lowest < radius + limit)
        weights, away = _nearest(corners[some])
        length = np.linalg.norm(away, axis=1)
        near = length - radius < limit
        which = some[near]
        normals = away[near] / np.maximum(length[near], 1e-300)[:, None]
        return _Touch(which, self.triangles[which], weights[near], length[near] - radius, normals)

    def _point(self, positions: Floats) -> Floats:
        return self._still if self.guest is None else positions[self.guest]

    def _turned(self, time: float, duration: float) -> Floats:
        """Rotation of the shape during a step, (3, 3)."""
        motion = self.shape.motion
        share = motion.share(time + duration) - motion.share(time)
        return rotation_matrix(share * np.asarray(motion.rotation))

    def _slip(self, positions: Floats) -> tuple[Floats, Floats, Floats, Floats]:
        """Tangential motion over the shape of the held points, (n, 3), and its smoothed length f: f, f'/l and f''."""
        if self.held is None:
            return np.zeros((0, 3)), np.zeros(0), np.zeros(0), np.zeros(0)
        moved = _combine(self.held, positions) - self._point(positions) - self.origin
        normals = self.held.normals
        sliding = moved - np.einsum("ni,ni->n", moved, normals)[:, None] * normals
        return sliding, *smooth_length(np.linalg.norm(sliding, axis=1), self.reach)

    def _push(self, touch: _Touch, forces: Floats, gradient: Floats) -> None:
        """Add forces (n, 3) on points to the gradient, and their reactions to the shape's point."""
        np.add.at(gradient, touch.vertices, touch.weights[:, :, None] * forces[:, None, :])
        if self.guest is not None:
            gradient[self.guest] -= forces.sum(axis=0)

    def _entries(self, touch: _Touch, blocks: Floats) -> tuple[Integers, Floats]:
        """Keys and entries of second derivatives (n, 3, 3) by the points, in the lower triangle, not yet summed."""
        weights, count = touch.weights, len(touch.weights)
        if self.guest is not None:
            weights = np.column_stack([weights, np.full(count, -1.0)])
        wide = 3 * weights.shape[1]
        entries = np.einsum("na,nb,nij->naibj", weights, weights, blocks).reshape(count, wide, wide)
        return _lower_entries(self._involved(touch), entries, self.size)

    def _tilt_entries(self, touch: _Touch, positions: Floats, forces: Floats) -> tuple[Integers, Floats]:
        """Stiffness against tilting: the positive part of −∇²d times forces (n,) [N], see ``_tilts``."""
        corners = positions[touch.vertices]
        factors = _tilts(corners, touch.weights, touch.normals, touch.distances + self.shape_radius)
        count, wide = len(factors), 3 * factors.shape[1]
        factors = factors.transpose(0, 2, 1, 3).reshape(count, 3, wide)
        if self.guest is None:
            factors = factors[:, :, :-3]
        scaled = (forces * (touch.distances + self.shape_radius))[:, None, None] * factors
        return _lower_entries(self._involved(touch), np.einsum("nci,ncj->nij", factors, scaled), self.size)

    def _involved(self, touch: _Touch) -> Integers:
        """Rows of the positions that each point depends on, (n, k)."""
        if self.guest is None:
            return touch.vertices
        return np.column_stack([touch.vertices, np.full(len(touch.vertices), self.guest)])


def _tilts(corners: Floats, weights: Floats, normals: Floats, distances: Floats) -> Floats:
    """Change of the direction from the centre to the closest points of triangles (n, 3, 3): (n, 4, 3, 3).

    distances: from the centre, (n,). The closest point is on a face, an edge or a corner, with barycentric weights
    w, gradients g of w along it, and the projection P onto it. To second order in moves x of the corners and c of
    the centre, −∇²d = d |Σ C_j x_j + C c|² − |…|²/d with C_j = g_j nᵀ + w_j P/d and C = −P/d. The last term, the
    curvature of the ball, is left out.
    """
    gradients, projection = np.zeros_like(corners), np.zeros_like(corners)
    used = weights > 0
    on_face = used.all(axis=1)
    along = np.stack([corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]], axis=1)[on_face]
    dual = np.linalg.solve(np.einsum("nai,nbi->nab", along, along), along)
    gradients[on_face, 1:] = dual
    gradients[on_face, 0] = -dual.sum(axis=1)
    projection[on_face] = np.eye(3) - _outer(normals[on_face])
    on_edge = np.flatnonzero(used.sum(axis=1) == 2)
    pairs = np.nonzero(used[on_edge])[1].reshape(-1, 2)
    edges = corners[on_edge, pairs[:, 1]] - corners[on_edge, pairs[:, 0]]
    edges /= np.einsum("ni,ni->n", edges, edges)[:, None]
    gradients[on_edge, pairs[:, 1]] = edges
    gradients[on_edge, pairs[:, 0]] = -edges
    projection[on_edge] = _outer(edges / np.linalg.norm(edges, axis=1)[:, None])
    spin = projection / distances[:, None, None]
    turned = gradients[:, :, :, None] * normals[:, None, None, :] + weights[:, :, None, None] * spin[:, None]
    return np.concatenate([turned, -spin[:, None]], axis=1)


def _lower_entries(vertices: Integers, entries: Floats, size: int) -> tuple[Integers, Floats]:
    """Keys ``column·size + row``, row ≥ column, and entries of symmetric (n, 3k, 3k) by vertices (n, k), not summed."""
    unknowns = (3 * vertices[:, :, None] + np.arange(3)).reshape(len(vertices), 3 * vertices.shape[1])
    row = np.broadcast_to(unknowns[:, :, None], entries.shape)
    column = row.transpose(0, 2, 1)
    lower = row >= column
    return (column * size + row)[lower], entries[lower]


def _combine(touch: _Touch, positions: Floats) -> Floats:
    """The points, (n, 3)."""
    return np.einsum("nk,nki->ni", touch.weights, positions[touch.vertices])


def _outer(vectors: Floats) -> Floats:
    return vectors[:, :, None] * vectors[:, None, :]


def _size(corners: Floats) -> Floats:
    """Longest edge of triangles (n, 3, 3), (n,)."""
    return np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)


def _nearest(corners: Floats) -> tuple[Floats, Floats]:
    """Weights (n, 3) and places (n, 3) of the points of triangles (n, 3, 3) closest to the origin."""
    first, following = corners, np.roll(corners, -1, axis=1)
    along = following - first
    share = -np.einsum("nki,nki->nk", first, along) / np.maximum(
        np.einsum("nki,nki->nk", along, along), 1e-300
    )
    share = np.clip(share, 0.0, 1.0)
    on_edges = first + share[:, :, None] * along
    best = np.einsum("nki,nki->nk", on_edges, on_edges).argmin(axis=1)
    rows = np.arange(len(corners))
    weights = np.zeros((len(corners), 3))
    weights[rows, best] = 1.0 - share[rows, best]
    weights[rows, (best + 1) % 3] += share[rows, best]
    # The foot of the perpendicular, where it lies inside.
    normal = np.cross(along[:, 0], along[:, 1])
    inner = np.einsum("nki,ni->nk", np.cross(following, np.roll(corners, -2, axis=1)), normal)
    total = np.einsum("ni,ni->n", normal, normal)
    inside = (inner >= 0).all(axis=1) & (total > 0)
    weights[inside] = inner[inside] / total[inside, None]
    return weights, np.einsum("nk,nki->ni", weights, corners)
