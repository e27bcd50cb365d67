"""Cloth against a sphere or a half-space: pairs of the shape's point and a triangle or vertex of the cloth.

A plane is in contact with vertices, the closest points of flat triangles. A sphere is in contact with the point of
each triangle that is closest to its centre, so that it cannot penetrate a coarse mesh.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from yarnscale.arrays import Array, Integers
from yarnscale.motion.obstacles import Plane, Shape, Sphere, obstacle_name
from yarnscale.motion.rigid import rotation_matrix
from yarnscale.shell.contact import pair_hessian
from yarnscale.shell.contact.barrier import ContactSettings, barrier
from yarnscale.shell.contact.crossings import Crossing, shape_crossing
from yarnscale.shell.contact.pair_contact import KEPT, PairContact
from yarnscale.shell.contact.pair_search import Close, Pairs, nearer
from yarnscale.shell.mesh import TriangleMesh


class _ShapeSearch:
    """Pairs of a shape's point, number ``point``, and every triangle or, thrice, vertex (n, 3), of weights (n,)."""

    def __init__(self, shape: Shape, figures: Integers, weights: Array, point: int, thickness: float) -> None:
        self.shape, self.weights, self.thickness = shape, weights, thickness
        vertices = np.column_stack([np.full(len(figures), point), figures])
        radius = shape.radius if isinstance(shape, Sphere) else 0.0
        anywhere, none = np.full((1, 3), math.inf), np.zeros(len(figures))
        self.pairs = Pairs(-anywhere, anywhere, vertices[:, :2], vertices, len(figures), np.zeros((1, 3)), none, radius)

    def along(self, start: Array, end: Array) -> Pairs:
        return self.pairs

    def known(self, start: Array, moves: Array) -> tuple[Pairs | None, float]:
        return None, 0.0

    def nearer(self, positions: Array, within: float) -> Integers:
        return self.pairs.vertices[self._nearer(positions, within)[0]]

    def close(self, positions: Array) -> Close:
        numbers, coefficients, distances, normals = self._nearer(positions, self.thickness)
        ones, none = np.ones(len(numbers)), np.zeros(len(numbers))
        return Close(
            positions, self.pairs.vertices[numbers], ones > 0, self.weights[numbers], coefficients, distances,
            normals, (ones, none, none),
        )  # fmt: skip

    def _nearer(self, positions: Array, within: float) -> tuple[Integers, Array, Array, Array]:
        if isinstance(self.shape, Sphere):
            return nearer(self.pairs, positions, within)
        normal, vertices = np.asarray(self.shape.normal), self.pairs.vertices
        heights = (positions[vertices[:, 1]] - positions[vertices[:, 0]]) @ normal
        near = np.flatnonzero(heights < within)
        coefficients = np.tile([1.0, -1.0, 0.0, 0.0], (len(near), 1))
        return near, coefficients, heights[near], np.tile(-normal, (len(near), 1))


class ShapeContact(PairContact):
    """Contact with one shape among the obstacles, whose point is row ``guest`` of all ``rows``, or at rest (None)."""

    def __init__(
        self, shape: Shape, number: int, mesh: TriangleMesh, settings: ContactSettings, guest: int | None, rows: int
    ) -> None:
        self.shape, self.number = shape, number
        if isinstance(shape, Sphere):
            figures, areas = mesh.triangles, mesh.areas
        else:
            figures, areas = np.repeat(np.arange(mesh.vertex_count), 3).reshape(-1, 3), mesh.vertex_areas
        self.count = len(figures)
        fixed = shape.points(0.0)[:1] if guest is None else np.zeros((0, 3))
        point = rows if guest is None else guest
        search = _ShapeSearch(shape, figures, areas * settings.stiffness, point, settings.thickness)
        super().__init__(search, settings, rows, fixed)

    def _carried(self, close: Close, begun: Array, times: tuple[float, float]) -> Array:
        """A sphere that turns carries its surface along."""
        motion = self.shape.motion
        share = motion.share(times[1]) - motion.share(times[0])
        apart = np.einsum("nk,nki->ni", close.coefficients, close.positions[close.vertices])
        turned = (apart - begun) @ rotation_matrix(share * np.asarray(motion.rotation)).T
        along = apart - turned
        return along - np.einsum("ni,ni->n", along, close.normals)[:, None] * close.normals

    def _add_repulsion(self, close: Close, everything: Array, slots: NDArray[np.int32], blocks: Array) -> None:
        if isinstance(self.shape, Sphere):
            return super()._add_repulsion(close, everything, slots, blocks)
        # Heights above a plane are linear in positions: b'' n nᵀ, as friction along n has it.
        bend = np.maximum(close.weights * barrier(close.distances, self.settings.thickness)[2], 0.0)
        pair_hessian.add_friction(
            close.vertices, close.coefficients, close.normals, close.normals, np.zeros_like(bend), bend, slots, blocks
        )  # fmt: skip

    def bound(self, positions: Array, step: Array) -> float:
        if isinstance(self.shape, Sphere):
            return super().bound(positions, step)
        start, end = self.everything(positions), self.everything(positions + step)
        vertices, normal = self.search.along(start, end).vertices, np.asarray(self.shape.normal)
        height, later = ((x[vertices[:, 1]] - x[vertices[:, 0]]) @ normal for x in (start, end))
        hits = later < KEPT * height
        return float(((1.0 - KEPT) * height[hits] / (height - later)[hits]).min(initial=1.0))

    def intersects(self, positions: Array) -> bool:
        return self.closest(positions) <= 0

    def crossings(self, positions: Array) -> list[Crossing]:
        everything = self.everything(positions)
        close = self.search.close(everything)
        inside = close.distances <= 0
        if not inside.any():
            return []
        weights, corners = -close.coefficients[inside, 1:], everything[close.vertices[inside, 1:]]
        places = np.einsum("nk,nki->ni", weights, corners)
        kind = "vertex" if isinstance(self.shape, Plane) else "triangle"
        name = obstacle_name(self.shape, self.number)
        return [shape_crossing(self.number, name, kind, close.distances[inside], places, self.count)]
