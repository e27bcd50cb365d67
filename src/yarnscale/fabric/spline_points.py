"""Points along spline yarns, close together: what handles, obstacles and other yarns act on."""

from __future__ import annotations

import numpy as np
from scipy.sparse import bsr_array, csr_array, tril

from yarnscale.arrays import Array
from yarnscale.fabric.sheet import YarnSheet
from yarnscale.fabric.sheet_scene import SheetScene
from yarnscale.fabric.spline_knit import CurvePoints, SplineFabric
from yarnscale.fabric.spline_model import point_rows
from yarnscale.numerics.factor import SymmetricPattern, places_among
from yarnscale.yarn.stiffness import PatternStiffness

_SPACING = 1.2
"""Length of yarn between two points [radii]."""


def points_per_segment(fabric: SplineFabric) -> int:
    """How many points of every segment are close enough to each other."""
    length = np.linalg.norm(np.diff(fabric.lines(fabric.control, 8), axis=1), axis=2).sum(axis=1).max()
    return int(np.ceil(length / fabric.segments_per_yarn / (_SPACING * fabric.radius)))


class SplinePoints:
    """Points of a fabric's yarns as a linear function of a body's unknowns; lengths in radii, energies in ``unit`` [J].

    sheet: the points as vertices at rest. rows: (3k, n) from unknowns [m] to points [m]. radius: distance from the
    points at which obstacles touch [m], which is the unit of length.
    """

    def __init__(self, fabric: SplineFabric) -> None:
        self.per_segment = points_per_segment(fabric)
        lines = fabric.lines(fabric.control, self.per_segment)
        self.sheet = YarnSheet.from_lines([*lines], fabric.radius, name="spline yarns")
        place, yarns = np.arange(lines.shape[1]) / self.per_segment, fabric.yarn_count
        self.rows = point_rows(fabric, CurvePoints(np.repeat(np.arange(yarns), len(place)), np.tile(place, yarns)))
        self.stiffness = PatternStiffness.of(self.sheet, fabric.material)
        self.fabric, self.radius, self.count = fabric, fabric.radius, len(self.sheet.vertices)

    def on_surface(self, rows: csr_array) -> SplinePoints:
        """The same points, taken as on the mid-surface of a volume, and obstacles half its thickness away."""
        points = SplinePoints.__new__(SplinePoints)
        vars(points).update(vars(self))
        points.rows = rows
        points.radius = float(np.abs(self.sheet.vertices[:, 2]).max()) + self.radius
        return points

    @property
    def unit(self) -> float:
        """Of energy: E π r³ [J]."""
        return self.stiffness.unit * (self.radius / self.sheet.radius) ** 3

    @property
    def force_unit(self) -> float:
        """Of force [N]."""
        return self.unit / self.radius

    def positions(self, x: Array) -> Array:
        """Points (k, 3) at unknowns (n,) [m]."""
        return (self.rows @ x.ravel()).reshape(-1, 3) / self.radius


class PointForces:
    """Handles and obstacles, as a term of a sum of energies with a pattern; ``begin`` says for which step."""

    def __init__(self, points: SplinePoints, loads: SheetScene, pattern: SymmetricPattern) -> None:
        self.points, self.loads = points, loads
        self._keys = pattern.keys
        self._pushes = loads.pushes(points)
        self._aim(0.0)

    def begin(self, x: Array, start: float, end: float) -> None:
        """Begin a step from a time to another [s]."""
        for push in self._pushes:
            push.begin(self.points.positions(x), start, end)
        self._aim(end)

    def _aim(self, time: float) -> None:
        holds = self.loads.holds(time)
        self._nodes, self._weights = holds.nodes, holds.weights(self.points)
        self._targets = holds.targets / self.points.radius

    def _at(self, x: Array) -> tuple[float, Array, list[Array]]:
        """Energy [J], gradient by points (3k,) [N], and Hessians of obstacles by points (k, 3, 3)."""
        points, positions = self.points, self.points.positions(x)
        away = positions[self._nodes] - self._targets
        value, pull = 0.5 * float((self._weights * away**2).sum()), np.zeros_like(positions)
        np.add.at(pull, self._nodes, self._weights * away)
        blocks = []
        for push in self._pushes:
            more, pressed, block = push.at(positions)
            value, pull = value + more, pull + pressed
            blocks.append(block)
        return value * points.unit, points.force_unit * pull.ravel(), blocks

    def value(self, x: Array) -> float:
        """Energy [J]."""
        return self._at(x)[0]

    def gradient(self, x: Array, gradient: Array) -> float:
        """Energy [J]; adds the gradient [N]."""
        value, pull, _ = self._at(x)
        gradient += self.points.rows.T @ pull
        return value

    def hessian(self, x: Array, gradient: Array, pattern: SymmetricPattern, entries: Array) -> float:
        """Energy [J]; adds gradient [N] and Hessian [N/m]."""
        value, pull, pushed = self._at(x)
        gradient += self.points.rows.T @ pull
        blocks = sum(pushed, np.zeros((self.points.count, 3, 3)))
        np.add.at(blocks, self._nodes, self._weights[:, :, None] * np.eye(3))
        pressed = np.flatnonzero(blocks.any(axis=(1, 2)))
        if len(pressed):
            rows = csr_array(self.points.rows[(3 * pressed[:, None] + np.arange(3)).ravel()])
            middle = bsr_array((blocks[pressed], np.arange(len(pressed)), np.arange(len(pressed) + 1)))
            lower = tril(rows.T @ (middle @ rows)).tocoo()
            places = places_among(self._keys, lower.col.astype(np.int64) * pattern.size + lower.row)
            if places is None:
                raise ValueError("the pattern does not cover these points")
            np.add.at(entries, places, self.points.force_unit / self.points.radius * lower.data)
        return value
