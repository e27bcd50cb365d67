"""Smooth periodic centre lines through few control points, and the contact between them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.linalg import block_diag

from yarnscale.arrays import Array, Integers
from yarnscale.drawing.curves import PeriodicCurve, pattern_from_curves
from yarnscale.yarn.close_pairs import close_pairs, nearest_places
from yarnscale.yarn.pattern import YarnPattern
from yarnscale.yarn.strands import Neighbours, Strands

CONTROL_SPACING = 2.2
"""Length of yarn for one control point [r]."""
SAMPLES = 5
"""Samples of the centre line for each control point."""


@dataclass(frozen=True, eq=False)
class YarnCurves:
    """Periodic yarns as cubic splines through control points.

    controls: (k, 3) [m], of all yarns one after the other. counts: control points of each yarn. shifts: net tile shift
    of one lap of each yarn. period: (2,) [m]. radii: of each yarn [m].
    """

    controls: Array
    counts: tuple[int, ...]
    shifts: tuple[tuple[int, int], ...]
    period: Array
    radii: Array

    @classmethod
    def of(cls, pattern: YarnPattern) -> YarnCurves:
        """The yarns of a pattern."""
        yarn_radius = (
            np.full(len(pattern.yarns), pattern.radius) if pattern.yarn_radius is None else pattern.yarn_radius
        )
        walked = pattern.vertices.copy()
        walked[:, :2] += pattern.tile_along_yarn * pattern.period
        shifts = [(int(a), int(b)) for a, b in pattern.yarn_shift]
        lines = [
            PeriodicCurve(walked[chain], shift).smooth(pattern.period)
            for chain, shift in zip(pattern.yarns, shifts, strict=True)
        ]
        return cls.through(lines, pattern.period, np.asarray(yarn_radius))

    @classmethod
    def through(cls, lines: Sequence[PeriodicCurve], period: Array, radii: Array) -> YarnCurves:
        """Splines along given (densely sampled) lines [m]."""
        counts = [
            max(4, round(line.length(period) / (CONTROL_SPACING * radius)))
            for line, radius in zip(lines, radii, strict=True)
        ]
        controls = [line.resampled(count, period).points for line, count in zip(lines, counts, strict=True)]
        shifts = tuple(line.shift for line in lines)
        return cls(np.concatenate(controls), tuple(counts), shifts, period, radii)

    @property
    def radius(self) -> float:
        """Of the thickest yarn [m]."""
        return float(self.radii.max())

    @cached_property
    def _drift(self) -> tuple[Array, Array]:
        """Mean progress [m] of yarns from the first period to the next: at control points (k, 3), at samples (m, 3)."""
        parts = []
        for at in (1, SAMPLES):
            progress = [
                (np.arange(at * count) / (at * count))[:, None] * np.array([*(np.array(shift) * self.period), 0.0])
                for count, shift in zip(self.counts, self.shifts, strict=True)
            ]
            parts.append(np.concatenate(progress))
        return parts[0], parts[1]

    @property
    def weights(self) -> Array:
        """Samples over control points (m, k)."""
        return _spline_weights(self.counts)

    @property
    def bends(self) -> Array:
        """Second differences of control points (k, k)."""
        return _second_differences(self.counts)

    @cached_property
    def samples(self) -> Array:
        """Points along the yarns (m, 3) [m]."""
        controls, samples = self._drift
        return self.weights @ (self.controls - controls) + samples

    @cached_property
    def following(self) -> Array:
        """The point after each sample (m, 3) [m]."""
        return np.concatenate([line.closed(self.period)[1:] for line in self.lines()])

    @cached_property
    def sample_radii(self) -> Array:
        """Radius at each sample (m,) [m]."""
        return np.repeat(self.radii, [SAMPLES * count for count in self.counts])

    def lines(self) -> list[PeriodicCurve]:
        """The samples of each yarn."""
        ends = np.cumsum([SAMPLES * count for count in self.counts])
        parts = np.split(self.samples, ends[:-1])
        return [PeriodicCurve(part, shift) for part, shift in zip(parts, self.shifts, strict=True)]

    def pattern(
        self, *, name: str, edge: float, yarn_material: Integers | None = None, rest_shape: str = "straight"
    ) -> YarnPattern:
        """The pattern with edges of about this length [r of each yarn]."""
        level = np.array([0.0, 0.0, 0.5 * (self.samples[:, 2].max() + self.samples[:, 2].min())])
        curves = []
        for line, radius in zip(self.lines(), self.radii, strict=True):
            dense = _dense(PeriodicCurve(line.points - level, line.shift), self.period)
            count = max(3, round(dense.length(self.period) / (edge * radius)))
            curves.append(dense.vertices(count, self.period))
        alike = bool(np.ptp(self.radii) == 0.0)
        return pattern_from_curves(
            curves, self.period, self.radius, name=name, rest_shape=rest_shape, yarn_material=yarn_material,
            yarn_radius=None if alike else self.radii,
        )  # fmt: skip

    def touching(self) -> Touching:
        """Places where yarns are closer than their radii, for a correction."""
        pattern = pattern_from_curves(self.lines(), self.period, self.radius)
        reach = 2.3 * self.radius
        strands = Strands.around(pattern, reach + float(pattern.rest_length.max()))
        nodes = strands.copies(pattern.vertices, pattern.period)
        neighbours = Neighbours.by_length(strands, pattern.rest_length, 2.0 * self.sample_radii)
        first, copy = close_pairs(strands, nodes, reach, neighbours=neighbours)
        return Touching.of(nodes, strands.ends, first, copy, len(pattern.vertices), self.sample_radii)


@dataclass(frozen=True, eq=False)
class Touching:
    """Pairs of segments: four samples (p, 4), their weights in the difference (p, 4), distance and wanted one (p,)."""

    samples: Integers
    weights: Array
    direction: Array
    gap: Array
    wanted: Array

    @classmethod
    def of(cls, nodes: Array, ends: Integers, first: Integers, copy: Integers, count: int, radii: Array) -> Touching:
        """The pairs of segments that begin at these nodes."""
        samples, weights = np.empty((len(first), 4), np.int64), np.empty((len(first), 4))
        direction, gap = np.empty((len(first), 3)), np.empty(len(first))
        for m, (i, g) in enumerate(zip(first, copy, strict=True)):
            s, t, _ = nearest_places(nodes, i, ends[i], g, ends[g])
            corners = np.array([i, ends[i], g, ends[g]])
            samples[m], weights[m] = corners % count, (1.0 - s, s, t - 1.0, -t)
            apart = weights[m] @ nodes[corners]
            gap[m] = np.linalg.norm(apart)
            direction[m] = apart / max(gap[m], 1e-12)
        return cls(samples, weights, direction, gap, radii[samples[:, 0]] + radii[samples[:, 2]])

    def rows(self, weights: Array) -> tuple[Array, Array]:
        """Overlaps (p,) [m] and their derivatives by the control points (p, 3 k); weights: of samples (m, k)."""
        deep = self.gap < self.wanted
        samples, share, direction = self.samples[deep], self.weights[deep], self.direction[deep]
        by_control = np.einsum("pc,pck->pk", share, weights[samples])
        slope = -(by_control[:, :, None] * direction[:, None, :]).reshape(len(samples), 3 * weights.shape[1])
        return (self.wanted - self.gap)[deep], slope


@lru_cache(maxsize=8)
def _spline_weights(counts: tuple[int, ...]) -> Array:
    return np.asarray(block_diag(*(_periodic_spline(count, SAMPLES) for count in counts)))


@lru_cache(maxsize=8)
def _second_differences(counts: tuple[int, ...]) -> Array:
    ones = [np.eye(count) for count in counts]
    return np.asarray(block_diag(*(np.roll(one, 1, 1) - 2.0 * one + np.roll(one, -1, 1) for one in ones)))


def _periodic_spline(count: int, per_point: int) -> Array:
    identity = np.eye(count)
    spline = CubicSpline(np.arange(count + 1), np.vstack([identity, identity[:1]]), bc_type="periodic")
    return spline(np.arange(count * per_point) / per_point)


def _dense(line: PeriodicCurve, period: Array, per_point: int = 8) -> PeriodicCurve:
    """Many points of the spline through the points of a line."""
    count = len(line.points)
    way = np.array([*(np.array(line.shift) * period), 0.0])
    even = (np.arange(count) / count)[:, None] * way
    fine = (np.arange(count * per_point) / (count * per_point))[:, None] * way
    return PeriodicCurve(_periodic_spline(count, per_point) @ (line.points - even) + fine, line.shift)
