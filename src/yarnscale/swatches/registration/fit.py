"""Curves moved until yarns drawn along them look like the photographs.

The brightness of a side is taken to depend linearly on what is seen of the yarns there (normal, hollowness, presence of
yarn), so that the lighting of a photograph need not be known: its coefficients follow by least squares. The curves
minimise the difference that is left (Gauss–Newton), together with small changes of their shape as it was drawn and with
yarns two radii apart; hidden parts follow these alone.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from yarnscale.arrays import Array
from yarnscale.swatches.registration.curves import YarnCurves
from yarnscale.swatches.registration.relief import FEATURES, Relief

FINEST = 5.0
"""Pixels of a cell for one radius."""
STEP = 0.05
"""Difference of control points by which derivatives are taken [r]."""
KEEP_SHAPE, KEEP_DEPTH, KEEP_PLACE, APART, PINNED = 0.3, 0.2, 0.01, 1.0, 10.0
"""Weights of changes of shape in the plane, bends in depth, changes of place, overlaps, points set by hand."""
BLURS = (0.6, 0.35, 0.2)
"""Blur of pictures in the rounds of the fit [r]."""
ROUNDS = 12
"""Most Gauss–Newton steps for each blur."""


@dataclass(frozen=True, eq=False)
class View:
    """One side of a fabric. cell: mean brightness of a period (rows, columns), x to the right of the front.

    side: FRONT or BACK. phase: (2,) [m] at which the curves' origin lies in the cell.
    """

    cell: Array
    side: float
    phase: Array

    def relief(self, curves: YarnCurves) -> Relief:
        """What is seen of curves."""
        move = np.array([*self.phase, 0.0])
        rows, columns = self.cell.shape
        return Relief.of(
            curves.samples + move,
            curves.following + move,
            curves.sample_radii,
            curves.period,
            (rows, columns),
            self.side,
        )

    def pixel(self, curves: YarnCurves) -> tuple[float, float]:
        """Height and width of a pixel [m]."""
        rows, columns = self.cell.shape
        return float(curves.period[1] / rows), float(curves.period[0] / columns)

    def features(self, curves: YarnCurves, blur: float) -> Array:
        """Features of what is seen (rows · columns, FEATURES + 1)."""
        return self.relief(curves).features(curves.radius, self.pixel(curves), blur).reshape(self.cell.size, -1)

    def lit(self, curves: YarnCurves, light: Array, blur: float) -> Array:
        """Brightness of what is seen (rows · columns,)."""
        return self.relief(curves).lit(light, curves.radius, self.pixel(curves), blur).ravel()

    def brightness(self, curves: YarnCurves, blur: float) -> Array:
        """The cell's brightness, blurred as the curves' are (rows · columns,)."""
        rows, columns = self.cell.shape
        widths = [blur * rows / curves.period[1], blur * columns / curves.period[0]]
        return ndimage.gaussian_filter(self.cell, widths, mode="wrap").ravel()


def shape_of_cell(period: Array, radius: float, finest: float = FINEST) -> tuple[int, int]:
    """Rows and columns of the cell of a picture."""
    columns, rows = np.maximum(np.rint(finest * period / radius), 8).astype(int)
    return int(rows), int(columns)


def phased(view: View, curves: YarnCurves, blur: float) -> tuple[View, float]:
    """The view at the phase that explains its brightness best, and the share of it explained (R²)."""
    rows, columns = view.cell.shape
    features = replace(view, phase=np.zeros(2)).features(curves, blur).reshape(rows, columns, -1)[..., :FEATURES]
    features = features - features.mean(axis=(0, 1))
    target = view.brightness(curves, blur).reshape(rows, columns)
    target = target - target.mean()
    gram = np.einsum("ijk,ijl->kl", features, features) + 1e-9 * rows * columns * np.eye(FEATURES)
    spectrum = np.fft.fft2(features, axes=(0, 1))
    # Correlation of the picture with every feature moved by every number of rows and columns.
    lagged = np.fft.ifft2(np.fft.fft2(target)[..., None] * spectrum.conj(), axes=(0, 1)).real
    factors = np.linalg.solve(gram, lagged.reshape(-1, FEATURES).T).T.reshape(lagged.shape)
    explained = (factors * lagged).sum(axis=-1) / (target * target).sum()
    # What faces the eye is bright.
    explained[factors[..., 2] <= 0.0] = -1.0
    row, column = np.unravel_index(np.argmax(explained), explained.shape)
    phase = np.array([column / columns, row / rows]) * curves.period
    return replace(view, phase=phase), float(explained.max())


@dataclass(frozen=True, eq=False)
class Fitted:
    """Curves and views after a fit; explained: share of the brightness of each view (R²)."""

    curves: YarnCurves
    views: tuple[View, ...]
    explained: tuple[float, ...]


def fitted(
    drawn: YarnCurves,
    views: Sequence[View],
    *,
    pins: dict[int, Array] | None = None,
    pinned: float = PINNED,
    blurs: Sequence[float] = BLURS,
    progress: Callable[[str], object] | None = None,
) -> Fitted:
    """The curves moved onto the pictures. pins: places (2,) [m] of control points by number."""
    problem = _Problem(drawn, list(views), pins or {}, pinned, progress or (lambda text: None))
    unknowns = problem.start()
    for blur in blurs:
        unknowns = problem.solved(unknowns, blur * drawn.radius)
    return problem.outcome(unknowns)


def apart(curves: YarnCurves) -> YarnCurves:
    """The curves with the same plan, two radii apart where they cross."""
    places = {point: place for point, place in enumerate(curves.controls[:, :2])}
    return fitted(curves, (), pins=places, blurs=(0.0,)).curves


@dataclass(eq=False)
class _Problem:
    """Unknowns: control points and phases of the views [r]."""

    drawn: YarnCurves
    views: list[View]
    pins: dict[int, Array]
    pinned: float
    progress: Callable[[str], object]

    def start(self) -> Array:
        """The unknowns as drawn."""
        phases = [view.phase for view in self.views]
        return np.concatenate([self.drawn.controls.ravel(), *phases]) / self.drawn.radius

    def state(self, unknowns: Array) -> tuple[YarnCurves, list[View]]:
        """Curves and views."""
        values, n = unknowns * self.drawn.radius, self.drawn.controls.size
        phases = values[n:].reshape(-1, 2)
        views = [replace(view, phase=phase) for view, phase in zip(self.views, phases, strict=True)]
        return replace(self.drawn, controls=values[:n].reshape(-1, 3)), views

    def solved(self, unknowns: Array, blur: float) -> Array:
        """Levenberg–Marquardt with the lighting solved for at every step."""
        damping = 1e-2
        targets = [view.brightness(self.drawn, blur) for view in self.views]
        for number in range(1, ROUNDS + 1):
            self.progress(f"step {number} at blur {blur / self.drawn.radius:.2g} radii")
            residual, jacobian = self.linearised(unknowns, blur, targets)
            value = float(residual @ residual)
            normal, slope, reached = jacobian.T @ jacobian, jacobian.T @ residual, value
            for _attempt in range(6):
                step = -np.linalg.solve(normal + damping * np.diag(np.diag(normal) + 1e-3), slope)
                step *= min(1.0, 0.5 / max(float(np.abs(step).max()), 1e-300))
                trial = self.linearised(unknowns + step, blur, targets, slopes=False)[0]
                if (reached := float(trial @ trial)) < value:
                    break
                damping *= 5.0
            else:
                break
            unknowns, damping = unknowns + step, max(0.3 * damping, 1e-5)
            if value - reached < 1e-3 * value or np.abs(step).max() < 3e-3:
                break
        return unknowns

    def linearised(
        self, unknowns: Array, blur: float, targets: list[Array], *, slopes: bool = True
    ) -> tuple[Array, Array]:
        """Residuals and, if asked for, their derivatives."""
        curves, views = self.state(unknowns)
        stitches = float(curves.period.prod()) / (36.0 * curves.radius**2)
        parts, rows = [], []
        for number, (view, target) in enumerate(zip(views, targets, strict=True)):
            features = view.features(curves, blur)
            light = np.linalg.lstsq(features, target, rcond=1e-8)[0]
            weight = np.sqrt(10.0 * stitches / len(target)) / float(target.std())
            parts.append(weight * (features @ light - target))
            if slopes:
                rows.append(weight * self.picture_slopes(unknowns, number, light, blur))
        shape, shape_rows = self.shape(unknowns, curves)
        parts.append(shape)
        rows.append(shape_rows)
        return np.concatenate(parts), np.concatenate(rows) if slopes else np.empty(0)

    def picture_slopes(self, unknowns: Array, number: int, light: NDArray[Any], blur: float) -> Array:
        """Derivatives of a view's brightness under its lighting."""

        def lit(moved: Array) -> Array:
            curves, views = self.state(moved)
            return views[number].lit(curves, light, blur)

        slopes = np.zeros((self.views[number].cell.size, len(unknowns)))
        steps = STEP * np.eye(len(unknowns))
        here = lit(unknowns)
        phases = self.drawn.controls.size + 2 * np.arange(len(self.views))
        for k in range(len(unknowns)):
            if k < phases[0] or 0 <= k - phases[number] < 2:
                slopes[:, k] = (lit(unknowns + steps[k]) - here) / STEP
        return slopes

    def shape(self, unknowns: Array, curves: YarnCurves) -> tuple[Array, Array]:
        """Residuals of shape, place, overlap and pins."""
        n, size = self.drawn.controls.size, self.drawn.radius
        change = (curves.controls - self.drawn.controls) / size
        bends = np.kron(curves.bends, np.diag([KEEP_SHAPE, KEEP_SHAPE, KEEP_DEPTH]))
        # In depth yarns are as straight as those that they cross let them be; the drawing is a scheme there.
        shape = change.copy()
        shape[:, 2] = curves.controls[:, 2] / size
        touching = curves.touching()
        overlap, slope = touching.rows(curves.weights)
        share = APART / size * 0.5
        parts = [bends @ shape.ravel(), KEEP_PLACE * change.ravel(), share * overlap]
        blocks = [bends, KEEP_PLACE * np.eye(n), share * slope * size]
        for point, place in self.pins.items():
            parts.append(self.pinned * (curves.controls[point, :2] - place) / size)
            block = np.zeros((2, n))
            block[[0, 1], [3 * point, 3 * point + 1]] = self.pinned
            blocks.append(block)
        rows = np.concatenate(blocks)
        return np.concatenate(parts), np.hstack([rows, np.zeros((len(rows), len(unknowns) - n))])

    def outcome(self, unknowns: Array) -> Fitted:
        """Curves and views, and how well they agree."""
        curves, views = self.state(unknowns)
        blur, explained = BLURS[-1] * curves.radius, []
        for view in views:
            seen, target = view.features(curves, blur), view.brightness(curves, blur)
            left = target - seen @ np.linalg.lstsq(seen, target, rcond=1e-8)[0]
            explained.append(1.0 - float(left.var() / target.var()))
        return Fitted(curves, tuple(views), tuple(explained))
