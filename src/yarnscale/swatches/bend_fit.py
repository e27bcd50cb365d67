"""The bending stiffnesses whose simulated pear loops are nearest to the measured ones (EST22 §5.2).

Seven distances of the clamps per direction; the ratio of the loops is fitted by bounded Gauss–Newton steps with exact
derivatives. Unknowns are logarithms of k_weft, k_warp and of what k_bias has beyond its least admissible value.
Swatches along the weft and the warp bend into cylinders: each determines one stiffness.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import least_squares

from yarnscale.arrays import Array
from yarnscale.errors import InputError
from yarnscale.kinematics import GRAVITY
from yarnscale.shell.materials.orthotropic import BENDING, DirectionalMaterial
from yarnscale.swatches.measurements import BendTest, Direction, SwatchMeasurements
from yarnscale.swatches.pear_loop import SEGMENTS, LoopResponse, PearLoop
from yarnscale.swatches.shell_fit import mean_error

STATES = 7
"""Distances of the clamps per direction (EST22 §5.2)."""
_PRIOR = 1e-3 * np.array([[1.0, 0.0, -1.0], [-0.5, 1.0, -0.5]])
"""Weights of differences between the stiffnesses, taken for small: unmeasured ones follow the measured."""
_WIDEST = 3.0 * math.log(10.0)
"""Largest logarithm of a stiffness over the reference: three decades either way."""
_FAILED = 3.0
_STARTS = np.array([-4.0, -2.0, 0.0, 2.0])


@dataclass(frozen=True, eq=False)
class FittedLoops:
    """Pear loops along one direction, measured and simulated; distance [m] and ratios, (n,).

    largest_curvature: of the simulated loops [1/m].
    """

    direction: Direction
    distance: Array
    measured_ratio: Array
    ratio: Array
    largest_curvature: float


@dataclass(frozen=True, eq=False)
class BendFit:
    """A shell with fitted bending, and the loops that it reproduces."""

    material: DirectionalMaterial
    loops: tuple[FittedLoops, ...]

    @property
    def error(self) -> float:
        """Mean error of the ratio over its mean, all directions together."""
        return mean_error([(loop.ratio, loop.measured_ratio) for loop in self.loops])


def fit_bending(
    measurements: SwatchMeasurements, membrane: DirectionalMaterial, *, segments: int = SEGMENTS
) -> BendFit:
    """Bending stiffnesses from pear loops; ``membrane`` gives the other constants. Raises InputError without loops."""
    if not measurements.bend or measurements.area_density is None:
        raise InputError(f"measurements of '{measurements.name}'", expected="a bend test", found="none")
    problem = _Loops(measurements.bend, replace(membrane, density=measurements.area_density), segments)
    starts = [np.full(3, shift) for shift in _STARTS]
    start = min(starts, key=lambda unknowns: float(np.sum(problem.residuals(unknowns) ** 2)))
    found = least_squares(
        problem.residuals,
        start,
        jac=problem.jacobian,  # pyright: ignore[reportArgumentType]
        bounds=(-_WIDEST, _WIDEST),
        xtol=1e-6,
        ftol=1e-10,
        gtol=1e-10,
        max_nfev=60,
    )
    fitted = []
    for test, loop, response, ratio in zip(
        measurements.bend, problem.loops, problem.respond(found.x), problem.ratios, strict=True
    ):
        curvature = max(loop.largest_curvature(response.positions[k]) for k in range(len(ratio)))
        fitted.append(FittedLoops(test.direction, response.distance, ratio, response.ratio, curvature))
    return BendFit(problem.material(found.x), tuple(fitted))


class _Loops:
    """Differences of ratios over their mean, over the root of their number, and a weak prior of isotropy."""

    def __init__(self, tests: tuple[BendTest, ...], membrane: DirectionalMaterial, segments: int) -> None:
        self.membrane = membrane
        chosen = [_spaced(test) for test in tests]
        self.distances, self.ratios = [c[0] for c in chosen], [c[1] for c in chosen]
        self.loops = [
            PearLoop(test.direction, test.swatch_length, test.swatch_width, segments=segments) for test in tests
        ]
        length = float(np.mean([test.swatch_length for test in tests]))
        # The bending length of limp fabric is about a fifth of the swatch.
        self.reference = membrane.density * GRAVITY * (length / 5) ** 3 / 2
        count = sum(len(ratio) for ratio in self.ratios)
        self.scale = 1.0 / (np.concatenate(self.ratios).mean() * math.sqrt(count))
        self._point: Array | None = None
        self._responses: list[LoopResponse | None] = [None] * len(tests)

    def material(self, unknowns: Array) -> DirectionalMaterial:
        weft, surplus, warp = self.reference * np.exp(unknowns)
        # With less along the bias beside these two the energy may be negative.
        least = (math.sqrt(weft) - math.sqrt(warp)) ** 2 / 4
        return replace(self.membrane, bend_weft=float(weft), bend_warp=float(warp), bend_bias=float(least + surplus))

    def residuals(self, unknowns: Array) -> Array:
        parts = []
        for response, ratio in zip(self.respond(unknowns), self.ratios, strict=True):
            parts.append(np.where(response.converged, self.scale * (response.ratio - ratio), _FAILED))
        return np.concatenate([*parts, _PRIOR @ unknowns])

    def jacobian(self, unknowns: Array) -> Array:
        return np.vstack([self.sensitivity(unknowns), _PRIOR])

    def sensitivity(self, unknowns: Array) -> Array:
        """d(differences)/d(unknowns)."""
        material = self.material(unknowns)
        weft, surplus, warp = self.reference * np.exp(unknowns)
        lean = (math.sqrt(weft) - math.sqrt(warp)) / 4
        chain = np.array([[weft, 0, 0], [lean * math.sqrt(weft), surplus, -lean * math.sqrt(warp)], [0, 0, warp]])
        rows = [
            np.nan_to_num(loop.derivatives(material, response, BENDING))
            for loop, response in zip(self.loops, self.respond(unknowns), strict=True)
        ]
        return self.scale * np.vstack(rows) @ chain

    def respond(self, unknowns: Array) -> list[LoopResponse]:
        if self._point is None or not np.array_equal(unknowns, self._point):
            material = self.material(unknowns)
            # Far from the last point its loops are no good start.
            near = self._point is not None and np.abs(unknowns - self._point).max() < 1.0
            for k, (loop, distance) in enumerate(zip(self.loops, self.distances, strict=True)):
                self._responses[k] = loop.respond(material, distance, near=self._responses[k] if near else None)
            self._point = unknowns.copy()
        return [response for response in self._responses if response is not None]


def _spaced(test: BendTest) -> tuple[Array, Array]:
    """Distances and ratios of a test, thinned to evenly spaced ones where there are more than ``STATES``."""
    if len(test.distance) <= STATES:
        return test.distance, test.ratio
    order = np.argsort(test.distance)
    even = np.linspace(test.distance.min(), test.distance.max(), STATES)
    return even, np.interp(even, test.distance[order], test.ratio[order])
