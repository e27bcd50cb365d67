"""Bounded Gauss–Newton over the whole chain of rest shape and states.

The rest shape answers to the parameters as strongly as the states do, so sensitivities with the rest shape held point
elsewhere. Columns of the Jacobian are therefore differences over the whole chain, from states next to the converged
ones; they are independent of each other and run side by side. One Jacobian costs as much as eight yarns that are tried,
so a step adds to it what it has shown itself (Broyden), and it is taken anew where that is not enough.
"""

from __future__ import annotations

from collections.abc import Generator, Iterator, Sequence

import numpy as np

from yarnscale.arrays import Array
from yarnscale.swatches.evaluations import Evaluations

DIFFERENCE = 1e-3
"""Step of differences, of the unknowns' ranges."""
_SHORTEST = 2e-4
"""A step below this is none."""
_SMALLEST_GAIN = 1e-3
"""Relative decrease of the objective at which the search ends, where two fresh Jacobians running gain no more."""
_SOLVED = 1e-14
"""Objective that needs no further step."""
_LASTING = 5
"""Steps for which a Jacobian that is kept up serves."""
_TRUSTED = 0.25
"""Decrease over that of the linear model below which the Jacobian is taken anew."""
_FACTORS = (1.0, 30.0)
"""Factors of the damping that are tried, together by a descent alone, else the second where the first fails."""


def jacobian(evaluations: Evaluations, unknowns: Array) -> Array:
    """d(residuals)/d(unknowns) (m, n), by differences that turn inwards where a bound is near."""
    steps = np.where(unknowns + DIFFERENCE > 1.0, -DIFFERENCE, DIFFERENCE)
    base = evaluations.residuals(unknowns)
    found = evaluations.many(list(unknowns + np.diag(steps)), near=unknowns)
    return np.column_stack([(f.residuals - base) / step for f, step in zip(found, steps, strict=True)])


class GaussNewton:
    """Gauss–Newton steps from one start, unknowns within [0, 1]; it may be left off and taken up again.

    Levenberg's damping: the step is that of a linear least-squares problem with bounds. here, value: the best point
    (n,) so far and its objective. ended: whether no further step gains anything.
    """

    def __init__(self, evaluations: Evaluations, start: Array) -> None:
        self.here = np.clip(np.asarray(start, np.float64), 0.0, 1.0)
        self.value = evaluations.many([self.here], keep=True)[0].objective
        self.ended = False
        self._evaluations = evaluations
        self._damping, self._slow = 1e-2, 0
        self._slopes, self._age = np.empty((0, 0)), _LASTING

    def advance(self, steps: int, *, alone: bool) -> Iterator[list[Array]]:
        """Up to so many steps; yields the points that it evaluates next, so that several descents do so together.

        alone: whether dampings are tried side by side.
        """
        for _ in range(steps):
            if self.ended:
                return
            yield from self._step(alone)

    def _step(self, alone: bool) -> Iterator[list[Array]]:
        if self._age >= _LASTING:
            self._renew()
        found = yield from self._lower(alone)
        if found is None and self._age > 0:
            self._renew()
            found = yield from self._lower(alone)
        if found is None:
            self.ended = True
            return
        point, value, foreseen = found
        gain, length = 1.0 - value / self.value, float(np.abs(point - self.here).max())
        trusted = self.value - value > _TRUSTED * (self.value - foreseen)
        little, fresh = gain < _SMALLEST_GAIN or length < _SHORTEST, self._age == 0
        self._keep_up(point)
        self.here, self.value = point, value
        if not trusted or (little and not fresh):
            # Only a new Jacobian shows that nothing more can be gained.
            self._age = _LASTING
        if gain >= _SMALLEST_GAIN:
            self._slow = 0
        elif fresh:
            self._slow += 1
        self.ended = self._slow == 2 or (length < _SHORTEST and fresh) or value < _SOLVED
        self._damping = min(self._damping, 1.0)

    def _renew(self) -> None:
        self._slopes, self._age = jacobian(self._evaluations, self.here), 0

    def _keep_up(self, point: Array) -> None:
        """Broyden's update: the slopes then say of the step what it did."""
        step = point - self.here
        change = self._evaluations.residuals(point) - self._evaluations.residuals(self.here)
        self._slopes = self._slopes + np.outer(change - self._slopes @ step, step) / (step @ step)
        self._age += 1

    def _lower(self, alone: bool) -> Generator[list[Array], None, tuple[Array, float, float] | None]:
        """A point with a lower objective, that objective and the one foreseen; None where there is none.

        Slopes that were kept up get one try of each damping before they are taken anew.
        """
        residuals = self._evaluations.residuals(self.here)
        for attempt in range(4 if self._age == 0 else 1):
            points = [self._damped(residuals, factor * self._damping) for factor in _FACTORS]
            values: list[float] = []
            for together in [points] if alone else [[point] for point in points]:
                yield together
                values += [found.objective for found in self._evaluations.many(together, keep=True)]
                if min(values) < self.value:
                    break
            k = int(np.argmin(values))
            if values[k] < self.value:
                self._damping = max(1e-6, self._damping * (0.2 if k == 0 else 6.0))
                foreseen = residuals + self._slopes @ (points[k] - self.here)
                return points[k], values[k], float(foreseen @ foreseen)
            if self._age > 0:
                break
            # Where slopes are right and steps fail, both ends of a step may rest in different shapes.
            settled = self._evaluations.settle(points[-1], self.here) if attempt == 0 else None
            if settled is self.here:
                residuals = self._evaluations.residuals(self.here)
                self.value = float(residuals @ residuals)
                self._renew()
                continue
            if settled is not None and (value := self._evaluations.many([settled])[0].objective) < self.value:
                foreseen = residuals + self._slopes @ (settled - self.here)
                return settled, value, float(foreseen @ foreseen)
            if max(np.abs(point - self.here).max() for point in points) < _SHORTEST:
                break
            self._damping *= 900.0
        return None

    def _damped(self, residuals: Array, damping: float) -> Array:
        """The point of the linear least-squares problem within the bounds."""
        from scipy.optimize import lsq_linear

        count, scale = len(self.here), max(float(np.linalg.norm(self._slopes, ord=2)), 1e-12)
        matrix = np.vstack([self._slopes, np.sqrt(damping) * scale * np.eye(count)])
        target = np.concatenate([-residuals, np.zeros(count)])
        bounds = (-self.here - 1e-12, 1.0 - self.here + 1e-12)
        return np.clip(self.here + lsq_linear(matrix, target, bounds=bounds).x, 0.0, 1.0)


def gauss_newton(evaluations: Evaluations, start: Array, *, iterations: int = 20) -> Array:
    """A local minimum of the mean square from a start, unknowns within [0, 1]."""
    descent = GaussNewton(evaluations, start)
    advance(evaluations, [descent], iterations)
    return descent.here


def advance(evaluations: Evaluations, descents: Sequence[GaussNewton], steps: int) -> None:
    """Up to so many steps of every descent, the points of all evaluated side by side."""
    paths = [descent.advance(steps, alone=len(descents) == 1) for descent in descents]
    while paths:
        wanted = [(path, next(path, None)) for path in paths]
        evaluations.many([point for _, points in wanted for point in points or ()], keep=True)
        paths = [path for path, points in wanted if points is not None]
