"""From centre lines to patterns: sampling, reference frames and rest shape."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline

from yarnscale.errors import InputError
from yarnscale.yarn.frames import (
    GAUSS_POINTS,
    carried_along,
    curve_length,
    material_curvature,
    reference_twist,
    upright,
)
from yarnscale.yarn.pattern import YarnPattern

REST_SHAPES = ("straight", "current")
DENSITY = 16
"""Points of a smooth curve for each vertex."""


@dataclass(frozen=True, eq=False)
class PeriodicCurve:
    """A centre line that ends at a periodic image of its first point.

    points: shape (k, 3) [m]; the point after the last is ``points[0] + shift * period``.
    shift: net tile shift (dx, dy) of one lap.
    """

    points: np.ndarray
    shift: tuple[int, int]

    def closed(self, period: np.ndarray) -> np.ndarray:
        """The points with the image of the first one at the end, shape (k + 1, 3) [m]."""
        end = self.points[:1] + np.array([*(np.asarray(self.shift) * period), 0.0])
        return np.concatenate([self.points, end])

    def length(self, period: np.ndarray) -> float:
        """Length of one lap [m]."""
        return float(np.linalg.norm(np.diff(self.closed(period), axis=0), axis=1).sum())

    def resampled(self, count: int, period: np.ndarray) -> PeriodicCurve:
        """`count` points at equal distances along this (densely sampled) line, beginning at the first."""
        return PeriodicCurve(self._points_at(np.arange(count) / count, period), self.shift)

    def vertices(self, count: int, period: np.ndarray) -> PeriodicCurve:
        """`count` vertices of a yarn along this (densely sampled) line, a little outside of its bends.

        The polygon of them is the nearest one to the line: its Gauss points, where smooth yarns touch (theory §1), lie
        on the line.
        """
        place = np.arange(count) / count
        lap = np.array([*(np.asarray(self.shift) * period), 0.0])
        nearest = np.zeros((count, 3))
        for share in GAUSS_POINTS:
            wave = self._points_at(place + share / count, period) - np.outer(place, lap)
            nearest += (1.0 - share) * wave + share * np.roll(wave - lap / count, 1, axis=0)
        # Normal equations: a vertex has 4/3 of itself and 1/3 of either neighbour.
        size = (4.0 + 2.0 * np.cos(2.0 * np.pi * np.arange(count // 2 + 1) / count)) / 3.0
        wave = np.fft.irfft(np.fft.rfft(nearest, axis=0) / size[:, None], count, axis=0)
        return PeriodicCurve(wave + np.outer(place, lap), self.shift)

    def smooth(self, period: np.ndarray) -> PeriodicCurve:
        """The curve of a yarn with its vertices at these points, densely sampled."""
        edge = np.diff(self.closed(period), axis=0)
        points = self.points + (edge - np.roll(edge, 1, axis=0)) / 12.0
        points = PeriodicCurve(points, self.shift).closed(period)
        knots = np.arange(len(points))
        lap, last = points[-1] - points[0], knots[-1]
        wave = points - np.outer(knots / last, lap)
        wave[-1] = wave[0]
        at = np.arange(DENSITY * last) / DENSITY
        dense = CubicSpline(knots, wave, bc_type="periodic")(at)
        return PeriodicCurve(dense + np.outer(at / last, lap), self.shift)

    def _points_at(self, places: np.ndarray, period: np.ndarray) -> np.ndarray:
        """Points at places (k,) along the line, from 0 to 1, shape (k, 3) [m]."""
        points = self.closed(period)
        along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
        return np.stack([np.interp(places * along[-1], along, points[:, k]) for k in range(3)], 1)


def pattern_from_curves(
    curves: Sequence[PeriodicCurve],
    period: Sequence[float] | np.ndarray,
    radius: float,
    *,
    name: str = "pattern",
    rest_shape: str = "straight",
    yarn_material: Sequence[int] | np.ndarray | None = None,
    yarn_radius: np.ndarray | None = None,
) -> YarnPattern:
    """A pattern whose yarns have their vertices at the points of the curves.

    Rest lengths are those of the smooth curve. The rest curvature is zero (``rest_shape="straight"``) or the present
    one (``"current"``), and so is the rest twist. Reference directors are transported along each yarn; the angle that
    remains where the yarn closes is the reference twist of that joint, and the twist angles distribute it evenly along
    the yarn. yarn_material: number of each curve's material, default 0. yarn_radius: of each curve [m], the largest of
    them ``radius``.
    Raises InputError for curves with fewer than three points and for what `YarnPattern` refuses.
    """
    if rest_shape not in REST_SHAPES:
        raise InputError("rest_shape is unknown", expected=" or ".join(REST_SHAPES), found=rest_shape)
    if len(curves) == 0:
        raise InputError("a pattern needs yarns", expected="at least one curve", found=0)
    period = np.asarray(period, dtype=np.float64)
    for index, curve in enumerate(curves):
        if curve.points.ndim != 2 or curve.points.shape[1] != 3 or len(curve.points) < 3:
            raise InputError(f"curves[{index}] has too few points", expected="shape (≥ 3, 3)", found=curve.points.shape)
    counts = np.array([len(curve.points) for curve in curves])
    starts = np.concatenate([[0], np.cumsum(counts)[:-1]])
    edges = _edges(starts, counts, [curve.shift for curve in curves])
    vertices = np.concatenate([curve.points for curve in curves])
    edge = np.concatenate([np.diff(curve.closed(period), axis=0) for curve in curves])
    length = np.linalg.norm(edge, axis=1)
    if not (length > 0.0).all():
        raise InputError("a curve repeats a point", expected="distinct points", found=vertices[length == 0.0][0])
    tangent = edge / length[:, None]
    director = np.concatenate([_transported_directors(line) for line in np.split(tangent, starts[1:])])
    previous = np.empty(len(edges), dtype=np.int64)
    previous[edges[:, 1]] = edges[:, 0]
    joint_twist = reference_twist(tangent, director, previous)
    lines = zip(np.split(joint_twist, starts[1:]), np.split(length, starts[1:]), strict=True)
    twist = np.concatenate([_even_twist(*line) for line in lines])
    bent = rest_shape == "current"
    curvature = material_curvature(tangent, director, twist, previous)
    return YarnPattern(
        vertices=vertices,
        twist=twist,
        edges=edges,
        rest_length=curve_length(edge, previous, edges[:, 1]),
        rest_curvature=curvature if bent else np.zeros((len(edges), 2)),
        rest_twist=twist - twist[previous] + joint_twist if bent else np.zeros(len(edges)),
        reference_director=director,
        reference_twist=joint_twist,
        period=period,
        radius=radius,
        name=name,
        yarn_material=None if yarn_material is None else np.asarray(yarn_material),
        yarn_radius=yarn_radius,
    )


def _edges(starts: np.ndarray, counts: np.ndarray, shifts: list[tuple[int, int]]) -> np.ndarray:
    """Rows (v0, v1, dx, dy): vertices in turn, the last edge leading to the first's image."""
    edges = np.zeros((int(counts.sum()), 4), dtype=np.int64)
    edges[:, 0] = np.arange(len(edges))
    edges[:, 1] = edges[:, 0] + 1
    last = starts + counts - 1
    edges[last, 1] = starts
    edges[last, 2:] = np.asarray(shifts, dtype=np.int64)
    return edges


def _transported_directors(tangent: np.ndarray) -> np.ndarray:
    """Directors along one yarn without twist, beginning near the z axis; shape (k, 3)."""
    start = np.array([0.0, 0.0, 1.0]) if abs(tangent[0, 2]) < 0.9 else np.array([1.0, 0.0, 0.0])
    return carried_along(upright(start[None], tangent[:1])[0], tangent)


def _even_twist(joint_twist: np.ndarray, length: np.ndarray) -> np.ndarray:
    """Angles θ of one yarn that spread its whole twist evenly, with Σ l θ = 0; shape (k,) [rad]."""
    voronoi = 0.5 * (length + np.roll(length, 1))
    wanted = joint_twist.sum() * voronoi / voronoi.sum()
    twist = np.cumsum(wanted - joint_twist)
    return twist - (length * twist).sum() / length.sum()
