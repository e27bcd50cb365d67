"""The pear-loop test simulated: a swatch hangs by its ends from two clamps brought together (EST22 §4.3 and 5.2).

Both ends leave the clamps straight down, the loop hangs below under its own weight, and its aspect ratio is read:
height below the clamps over greatest width. Weight is essential: without it the ratio is the same for every stiffness.
A swatch of bending energy k κ² and mass ρ per area, bent into a cylinder, is an elastica of stiffness 2k under the
load ρ g.

Lines of the mesh run across the swatch, so that they are generators of the cylinder. A fold between two lines stands
for the curvature half a spacing to either side; the first free fold is therefore held half a spacing inside the
loop, which makes the error of the clamps of second order.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.optimize import brentq

from yarnscale.arrays import Array, Flags, Integers
from yarnscale.errors import InputError, positive
from yarnscale.kinematics import GRAVITY
from yarnscale.shell.materials.orthotropic import DirectionalMaterial
from yarnscale.shell.mesh import TriangleMesh, rectangle
from yarnscale.swatches.held_shell import HeldShell, Measure
from yarnscale.swatches.measurements import LENGTH, Direction

SEGMENTS = 35
"""Segments along the loop, an odd number."""
_GRADING = 1.1
"""Quarter turn of a sine that sets the lines: spacing at the clamps is its cosine times that in the middle."""
WEIGHT = (0.0, 0.0, -GRAVITY)


@dataclass(frozen=True, eq=False)
class LoopResponse:
    """Loops at several distances of the clamps; arrays (n,).

    distance: [m]; ratio: height over width; converged: which are equilibria; positions: (n, nv, 3) [m], across the
    swatch, from clamp to clamp, and up.
    """

    distance: Array
    ratio: Array
    converged: Flags
    positions: Array


class PearLoop:
    """A swatch hanging from two clamps.

    direction: of the fabric along the loop. length: between the clamps, width: across [m]. segments: along the loop,
    odd.
    """

    def __init__(
        self, direction: Direction, length: float = 0.10, width: float = 0.06, *, segments: int = SEGMENTS
    ) -> None:
        for name, value in (("length", length), ("width", width)):
            positive(f"swatch {name}", value, LENGTH)
        if segments < 5 or segments % 2 == 0:
            raise InputError("segments", expected="an odd number from 5", found=segments)
        self.direction, self.length, self.width, self.segments = direction, length, width, segments
        self.lines = _lines(segments, length)
        self.mesh, self._line = _mesh(self.lines, width, math.pi / 2 - direction.angle)
        held = np.minimum(self._line, len(self.lines) - 1 - self._line) < 3
        self.shell = HeldShell(self.mesh, np.repeat(~held[:, None], 3, axis=1))
        self._share = 1.0 / np.bincount(self._line)[self._line]

    def respond(
        self, material: DirectionalMaterial, distances: Sequence[float] | Array, *, near: LoopResponse | None = None
    ) -> LoopResponse:
        """Aspect ratios at distances of the clamps [m]; ``near``: the same distances with a similar material."""
        distances = np.asarray(distances, np.float64)
        if distances.ndim != 1 or not len(distances) or not (distances > 0).all():
            raise InputError("distances of the clamps", expected="positive lengths [m]", found=distances)
        count = self.mesh.vertex_count
        positions, converged = np.empty((len(distances), count, 3)), np.zeros(len(distances), bool)
        ratio = np.empty(len(distances))
        last: tuple[Array, Array] | None = None
        for k in np.argsort(-distances):  # from wide to narrow
            plain = self._weightless(float(distances[k]))
            start = plain if last is None else last[0] + (plain - last[1])
            if near is not None and near.converged[k]:
                start = near.positions[k]
            found = self.shell.solve(material, start, gravity=WEIGHT, iterations=200)
            positions[k], converged[k] = found.positions, found.converged
            ratio[k] = self.measure(found.positions).value
            if found.converged:
                last = found.positions, plain
        return LoopResponse(distances, ratio, converged, positions)

    def measure(self, positions: Array) -> Measure:
        """Aspect ratio at positions (nv, 3), of the mean line of the swatch."""
        curve = self.centre_line(positions)
        height, by_up = _peak(-curve[:, 1])
        right, by_right = _peak(curve[:, 0])
        left, by_left = _peak(-curve[:, 0])
        width = right + left
        by_line = np.column_stack([-height / width**2 * (by_right - by_left), -by_up / width])
        by_positions = np.zeros_like(positions)
        by_positions[:, 1:] = by_line[self._line] * self._share[:, None]
        return Measure(height / width, by_positions)

    def derivatives(self, material: DirectionalMaterial, response: LoopResponse, constants: Sequence[str]) -> Array:
        """d(ratio)/d(constants), shape (n, constants); NaN for loops that did not converge."""
        states = zip(response.positions, response.converged, strict=True)
        return self.shell.derivatives_of(material, states, lambda x: [self.measure(x)], constants)[:, 0]

    def centre_line(self, positions: Array) -> Array:
        """Mean of the lines across, (lines, 2): from clamp to clamp, and up [m]."""
        curve = np.zeros((len(self.lines), 2))
        np.add.at(curve, self._line, self._share[:, None] * positions[:, 1:])
        return curve

    def largest_curvature(self, positions: Array) -> float:
        """Largest curvature of the loop [1/m], over two folds: at free edges even and odd lines differ in stiffness."""
        segments = np.diff(self.centre_line(positions)[2:-2], axis=0)
        lengths = np.linalg.norm(segments, axis=1)
        turns = np.diff(np.unwrap(np.arctan2(segments[:, 1], segments[:, 0])))
        spans = lengths[:-2] / 2 + lengths[1:-1] + lengths[2:] / 2
        return float(np.abs((turns[1:] + turns[:-1]) / spans).max())

    def _weightless(self, distance: float) -> Array:
        """A smooth loop of the right length between clamps at a distance [m], to start from."""
        curve = self.length * _loop(0.5 + self.lines / self.length, distance / self.length)
        curve[:, 0] -= distance / 2
        return np.column_stack([self.mesh.panel[:, 0], curve[self._line]])


def _lines(segments: int, length: float) -> Array:
    """Where lines lie along the swatch, from its middle [m], closer together near the clamps, (segments + 4,)."""
    spread = np.sin(_GRADING * np.linspace(-1.0, 1.0, segments)) / math.sin(_GRADING)
    share = spread[-1] - spread[-2]
    last = length / 2 * share / (1 + share / 2)
    # Two more lines are held beyond the first at each end, so that no free edge is near a fold.
    beyond = length / 2 + last * np.array([0.5, 1.5])
    return np.concatenate([-beyond[::-1], (length - last) / 2 * spread, beyond])


def _mesh(lines: Array, width: float, grain: float) -> tuple[TriangleMesh, Integers]:
    """Panel whose lines across (panel x) lie at these places along it (panel y), and the line of every vertex."""
    rows = len(lines) - 1
    height = float(lines[-1] - lines[0])
    even = rectangle(width, height, 2 * height / rows / math.sqrt(3))
    line = np.rint((even.panel[:, 1] / height + 0.5) * rows).astype(np.int64)
    graded = TriangleMesh(np.column_stack([even.panel[:, 0], lines[line]]), even.triangles)
    return graded.with_grain(grain), line


def _loop(along: Array, distance: float) -> Array:
    """Points (n, 2) of a curve of length one from (0, 0) down, round, up to (distance, 0), and straight beyond."""
    fine = np.linspace(0.0, 1.0, 2001)

    def path(swell: float) -> Array:
        angle = -math.pi / 2 + math.pi * fine - swell * np.sin(2 * math.pi * fine)
        slope = np.column_stack([np.cos(angle), np.sin(angle)])
        steps = 0.5 * (slope[1:] + slope[:-1]) / (len(fine) - 1)
        return np.vstack([[0.0, 0.0], np.cumsum(steps, axis=0)])

    if not 0 < distance < 2 / math.pi:
        raise InputError("distance of the clamps", expected="less than 2/π of the length", found=f"{distance:g} of it")
    swell = brentq(lambda swell: path(swell)[-1, 0] - distance, 0.0, 1.5)
    points = path(swell)  # pyright: ignore[reportArgumentType]
    inside = np.clip(along, 0.0, 1.0)
    curve = np.column_stack([np.interp(inside, fine, points[:, axis]) for axis in (0, 1)])
    curve[:, 1] += np.abs(along - inside)
    # The first fold, half a segment inside, is held on the clamp's vertical.
    first, last = 3, len(along) - 3
    curve[:first, 0], curve[last:, 0] = 0.0, distance
    curve[:first, 1] = -along[:first]
    curve[last:, 1] = along[last:] - 1.0
    return curve


def _peak(values: Array) -> tuple[float, Array]:
    """Largest value of the cubic spline through evenly numbered values, and its derivative by them (n,)."""
    count = len(values)
    spline = CubicSpline(np.arange(count), values)
    turns = spline.derivative().roots(extrapolate=False)
    places = np.append(turns, np.argmax(values))
    place = float(places[np.argmax(spline(places))])
    weights = CubicSpline(np.arange(count), np.eye(count))(place)  # the place is best: moving it changes nothing
    return float(weights @ values), weights
